"""Which of the configurations that meet a target the arm goes to: the best of those to which it may go.

Everywhere: ``start`` (n,) [rad] is where the arm stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError, MotionRefusedError, UnreachableError
from armctl.facts.targets import AtPoint
from armctl.kinematics import DEFAULT_STEP, Choice, Solutions, Target, checked_criterion
from armctl.motion.clearance import ends_clear
from armctl.motion.plan import Profile, plan_joints
from armctl.motion.preflight import passes
from armctl.motion.trajectory import Trajectory
from armctl.robot import Robot

_ANOTHER_RAD, _MOST_TRIED, _MOST_LOOKED_AT = 0.2, 64, 2000
"""configurations that differ by less are not tried one by one, and no more than so many of so many"""
_AT_ONCE = 64
"""configurations whose ends are looked at together"""
_ROLL_STEP = math.radians(5.0)
"""of a roll that is free, where none may be gone to as it stands"""
_TURNED = 1e-6
"""rotations that differ by less are the same [rad]"""


def solve(robot: Robot, start: ArrayLike | None, target: Target, choose: Choice) -> FloatArray:
    """The configuration (n,) [rad] that a criterion chooses for a target.

    Raises ``InputError`` where there is no such criterion, ``UnreachableError`` where there is no solution:
    with the reason and the nearest point. A solver answers an orientation that cannot be had by the nearest;
    the arm is not sent there.
    """
    return _solved(robot, start, target, choose)[0]


def _solved(
    robot: Robot, start: ArrayLike | None, target: Target, choose: Choice
) -> tuple[FloatArray, Solutions | None]:
    """As ``solve``, and the solutions that it was chosen from; None: they need not be listed for that."""
    if not isinstance(target, Target):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"a target is made with Target.of(position), it is not {target!r}")
    solver = robot.inverse_kinematics
    position_only = target.pitch is None and target.roll is None and target.rotation is None
    own = not isinstance(choose, str) and callable(choose)
    if not own and checked_criterion(choose) == "least-rotation" and position_only and solver.direct:
        q = solver.least_rotation(target.position)  # the same without listing ten thousand others
        if np.isfinite(q).all():
            return q, None
    begin = None if start is None else robot.chain.checked_one(start)
    solutions = solver.solve(target, DEFAULT_STEP, begin)
    if not solutions.success:
        raise UnreachableError(solutions.refusal or "there is no solution")
    q = solutions.best(choose, start)
    off = robot.off_rotation(solutions, q)
    if off is not None:
        raise UnreachableError(off)
    return q, solutions


def solve_points(robot: Robot, points: FloatArray, choose: Choice, start: FloatArray) -> FloatArray:
    """(k, n) joint angles [rad] for points (k, 3) [m], each chosen by a criterion from the one before.

    Raises ``UnreachableError``: a point has no solution; says which and why.
    """
    found: list[FloatArray] = []
    for number, point in enumerate(points, 1):
        try:
            found.append(solve(robot, found[-1] if found else start, Target.of(point), choose))
        except UnreachableError as cause:
            raise UnreachableError(AtPoint(number, len(points), cause.reason)) from cause
    return np.array(found)


def may_go_to(
    robot: Robot,
    start: ArrayLike,
    end: ArrayLike,
    duration_s: float | None = None,
    profile: Profile = "cubic",
    *,
    checked: bool = True,
) -> bool:
    """Whether ``plan_joints`` gives a motion; quicker, where why not is not asked."""
    try:
        trajectory = plan_joints(robot, start, end, duration_s, profile, checked=False)
    except MotionRefusedError:
        return False
    return not checked or passes(robot, trajectory)


def first_possible(
    robot: Robot,
    start: FloatArray,
    q: FloatArray,
    may_go: Callable[[FloatArray], bool],
    known: Sequence[FloatArray] = (),
) -> int | None:
    """Index of the first of configurations ``q`` (k, n) [rad] to which the arm may go; None: none was found.

    ``start`` (n,) [rad]: where it stands. Only some are tried, which differ from each other and from the
    ``known`` ones, which are refused; and of these only where the arm may stand.
    """
    rows = _different(q, known)
    found = _first_clear(robot, start, q[rows], may_go)
    return None if found is None else rows[found]


def _first_clear(
    robot: Robot, start: FloatArray, q: FloatArray, may_go: Callable[[FloatArray], bool]
) -> int | None:
    """Index of the first of some configurations (k, n) [rad], which are tried one by one."""
    tried = 0
    for begin in range(0, len(q), _AT_ONCE):
        some = q[begin : begin + _AT_ONCE]
        for at in np.flatnonzero(ends_clear(robot, start, some)).tolist():
            if may_go(some[at]):
                return begin + at
            tried += 1
            if tried == _MOST_TRIED:
                return None
    return None


def _different(q: FloatArray, known: Sequence[FloatArray] = ()) -> list[int]:
    """Rows of ``q`` (k, n) [rad] that differ from those before them, and from the ``known`` ones (n,)."""
    different = list(known)
    rows: list[int] = []
    for row in range(0, len(q), 1 + len(q) // _MOST_LOOKED_AT):
        if all(np.abs(q[row] - other).max() > _ANOTHER_RAD for other in different):
            different.append(q[row])
            rows.append(row)
    return rows


class JudgedConfigurations:
    """Ways of an arm from where it stands, by motions of a profile; each is judged once."""

    def __init__(self, robot: Robot, start: FloatArray, profile: Profile) -> None:
        """Of an arm that stands at ``start`` (n,) [rad]."""
        self._of = robot, start, profile
        self._known: dict[bytes, str] = {}
        self._possible: dict[bytes, bool] = {}

    def refused(self, q: FloatArray) -> str:
        """Why the arm may not go to ``q`` (n,) [rad]; empty where it may."""
        key = _key(q)
        if key not in self._known:
            self._known[key] = "" if self._possible.get(key) else way_refused(*self._of, q)
        return self._known[key]

    def possible(self, q: FloatArray) -> bool:
        """Whether the arm may go to ``q`` (n,) [rad]; quicker, where why not is not asked."""
        key = _key(q)
        if key not in self._possible:
            known = self._known.get(key)
            robot, start, profile = self._of
            may_go = may_go_to(robot, start, q, None, profile) if known is None else not known
            self._possible[key] = may_go
        return self._possible[key]

    def known(self, q: FloatArray) -> str | None:
        """As ``refused``; None where that has not been judged yet."""
        return self._known.get(_key(q))

    @property
    def refuse_some(self) -> bool:
        """Whether the arm may not go to one of those that were judged."""
        # copies: another thread may judge one more meanwhile
        return any(tuple(self._known.values())) or not all(tuple(self._possible.values()))


def _key(q: FloatArray) -> bytes:
    return (q + 0.0).tobytes()


def way_refused(robot: Robot, start: FloatArray, profile: Profile, q: FloatArray) -> str:
    """Why the arm may not go from ``start`` to ``q`` (n,) [rad] by a motion of the joints; empty: it may."""
    try:
        plan_joints(robot, start, q, None, profile)
    except MotionRefusedError as refusal:
        return str(refusal)
    return ""


def plan_target(
    robot: Robot,
    start: ArrayLike,
    target: Target,
    choose: Choice = "least-rotation",
    duration_s: float | None = None,
    profile: Profile = "cubic",
    *,
    checked: bool = True,
) -> Trajectory:
    """Plan a motion of the tool to a target and check it; ``choose`` as in ``Arm.go``.

    It goes to the best of the solutions to which the arm may go. Raises as ``plan_joints``, why the best of
    all is refused, where it may go to none; ``UnreachableError`` where there is no solution, with the reason
    and the nearest point.
    """
    return plan_choice(robot, start, target, choose, duration_s, profile, checked=checked)[0]


def plan_choice(
    robot: Robot,
    start: ArrayLike,
    target: Target,
    choose: Choice = "least-rotation",
    duration_s: float | None = None,
    profile: Profile = "cubic",
    *,
    checked: bool = True,
) -> tuple[Trajectory, MotionRefusedError | None]:
    """As ``plan_target``; and why it does not go to the best of all solutions, None where it does.

    ``not_the_best`` says it.
    """
    best, solutions = _solved(robot, start, target, choose)
    try:
        return plan_joints(robot, start, best, duration_s, profile, checked=checked), None
    except MotionRefusedError as refusal:
        begin = robot.chain.checked_one(start)
        ask = partial(may_go_to, robot, begin, duration_s=duration_s, profile=profile, checked=checked)
        other = _next_best(robot, begin, target, solutions, choose, best, ask)
        if other is None:
            raise
        return plan_joints(robot, start, other, duration_s, profile, checked=False), refusal


def _next_best(
    robot: Robot,
    start: FloatArray,
    target: Target,
    solutions: Solutions | None,
    choose: Choice,
    best: FloatArray,
    may_go: Callable[[FloatArray], bool],
) -> FloatArray | None:
    """The first (n,) [rad] after the best to which the arm may go; None: none was found.

    Where a roll is free and none may be gone to as the criterion has it, the roll is turned.
    """
    if solutions is None:
        solutions = robot.inverse_kinematics.solve(target, DEFAULT_STEP, start)
    rows = _admitted(solutions, choose, start)
    row = first_possible(robot, start, rows, may_go, known=(best,))
    if row is None and isinstance(choose, str) and (roll := solutions.free_roll) is not None:
        rows = _with_rolls(rows[_different(rows)], roll, *robot.limits[roll].tolist())
        row = _first_clear(robot, start, rows, may_go)
    return None if row is None else rows[row]


def _admitted(solutions: Solutions, choose: Choice, start: FloatArray) -> FloatArray:
    """All configurations (k, n) [rad] that a criterion admits, the best first."""
    energy = solutions.energies(choose, start)
    order, q = np.argsort(energy, kind="stable"), solutions.q
    if isinstance(choose, str):
        name = checked_criterion(choose)
        order, q = solutions.order(name, start), solutions.taken(q, name, start)
    meets = np.isfinite(energy) & (solutions.residual_rad <= _TURNED)
    return q[order[meets[order]]]


def _with_rolls(q: FloatArray, roll: int, low: float, high: float) -> FloatArray:
    """Configurations (k, n) [rad] with other angles of joint ``roll``, those nearest to the present first."""
    kept = float(q[0, roll]) if len(q) else 0.0
    angles = np.arange(math.ceil((low - kept) / _ROLL_STEP), math.floor((high - kept) / _ROLL_STEP) + 1)
    angles = angles[np.argsort(np.abs(angles), kind="stable")][1:] * _ROLL_STEP + kept
    turned = np.tile(q, (len(angles), 1))
    turned[:, roll] = np.repeat(angles, len(q))
    return turned


def choose_end(
    robot: Robot,
    start: FloatArray,
    target: Target,
    choose: Choice = "least-rotation",
    duration_s: float | None = None,
    profile: Profile = "cubic",
    *,
    may_go: Callable[[FloatArray], bool] | None = None,
) -> FloatArray:
    """Where ``plan_target`` leads to, (n,) [rad]; the best of all solutions where the arm may go to none.

    ``may_go``: whether it may go to a solution, where it does not go there joint by joint.
    """
    best, solutions = _solved(robot, start, target, choose)
    ask = may_go or partial(may_go_to, robot, start, duration_s=duration_s, profile=profile)
    other = None if ask(best) else _next_best(robot, start, target, solutions, choose, best, ask)
    return best if other is None else other


def different_ends(robot: Robot, start: FloatArray, target: Target, choose: Choice) -> FloatArray:
    """Configurations (k, n) [rad] that meet a target and differ from each other, the best first.

    Whether the arm may go there is not asked. Raises as ``solve``.
    """
    best, solutions = _solved(robot, start, target, choose)
    if solutions is None:
        solutions = robot.inverse_kinematics.solve(target, DEFAULT_STEP, start)
    rows = _admitted(solutions, choose, start)
    return np.vstack([best, rows[_different(rows, (best,))]])


def not_the_best(refusal: MotionRefusedError) -> str:
    """That another solution than the best is gone to, and why."""
    return f"the best solution is refused ({refusal}); the arm goes to the next best to which it may go"
