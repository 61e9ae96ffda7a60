"""Which of the configurations that meet a target the arm goes to: the best of those to which it may go."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError, UnreachableError
from armctl.kinematics import DEFAULT_STEP, Choice, Target, checked_criterion
from armctl.motion.clearance import ends_clear
from armctl.robot import Robot


def admitted(robot: Robot, start: ArrayLike, target: Target, choose: Choice) -> FloatArray:
    """All configurations (k, n) [rad] that a criterion admits for a target, the best first."""
    begin = robot.chain.checked_one(start)
    solutions = robot.inverse_kinematics.solve(target, DEFAULT_STEP, begin)
    energy = solutions.energies(choose, begin)
    order, q = np.argsort(energy, kind="stable"), solutions.q
    if isinstance(choose, str):
        name = checked_criterion(choose)
        order, q = solutions.order(name, begin), solutions.taken(q, name, begin)
    meets = np.isfinite(energy) & (solutions.residual_rad <= _TURNED)
    return q[order[meets[order]]]


_ANOTHER_RAD, _MOST_TRIED, _MOST_LOOKED_AT = 0.2, 64, 2000
"""configurations that differ by less are not tried one by one, and no more than so many of so many"""
_AT_ONCE = 64
"""configurations whose ends are looked at together"""
_TURNED = 1e-6
"""rotations that differ by less are the same [rad]"""


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
    different = list(known)
    rows: list[int] = []
    for row in range(0, len(q), 1 + len(q) // _MOST_LOOKED_AT):
        if all(np.abs(q[row] - other).max() > _ANOTHER_RAD for other in different):
            different.append(q[row])
            rows.append(row)
    tried = 0
    for begin in range(0, len(rows), _AT_ONCE):
        some = rows[begin : begin + _AT_ONCE]
        for at in np.flatnonzero(ends_clear(robot, start, q[some])).tolist():
            if may_go(q[some[at]]):
                return some[at]
            tried += 1
            if tried == _MOST_TRIED:
                return None
    return None


def solve(robot: Robot, start: ArrayLike | None, target: Target, choose: Choice) -> FloatArray:
    """The configuration (n,) [rad] that a criterion chooses for a target.

    Raises ``InputError`` where there is no such criterion, ``UnreachableError`` where there is no solution:
    with the reason and the nearest point. A solver answers an orientation that cannot be had by the nearest;
    the arm is not sent there.
    """
    if not isinstance(target, Target):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"a target is made with Target.of(position), it is not {target!r}")
    solver = robot.inverse_kinematics
    position_only = target.pitch is None and target.roll is None and target.rotation is None
    own = not isinstance(choose, str) and callable(choose)
    if not own and checked_criterion(choose) == "least-rotation" and position_only and solver.direct:
        q = robot.least_rotation(target.position)  # the same without listing ten thousand others
        if np.isfinite(q).all():
            return q
    begin = None if start is None else robot.chain.checked_one(start)
    solutions = solver.solve(target, DEFAULT_STEP, begin)
    if not solutions.success:
        raise UnreachableError(solutions.explanation or "there is no solution")
    q = solutions.best(choose, start)
    turned_off = robot.turned_off(solutions, q)
    if turned_off is not None:
        raise UnreachableError(turned_off)
    return q
