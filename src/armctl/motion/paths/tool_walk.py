"""Following a curve on one branch, step by step: each step leaves a polynomial that keeps to the curve.

A step goes ahead by the Taylor series of the last knot, is brought onto the curve by Newton's method, and is
kept if the quintic between the two knots stays on the curve. Else it is halved. A step that stays refused
however small it is marks the place where the branch ends. So is a jump onto another branch refused.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics import Chain
from armctl.kinematics.angles import LIMIT_TOLERANCE
from armctl.lazy_dataclass import dataclass
from armctl.motion.paths.tool_curve import ToolCurve
from armctl.motion.paths.tool_orientation import TurnRows, carried
from armctl.motion.polynomial import PiecewisePolynomial, first_crossing, quintic

DEVIATION_M = 0.01e-3
"""how far the tool may stray from the curve between the knots [m]"""
TILT = 1e-6
"""the same for a pitch or an orientation that is asked for [rad]"""
SLOWEST_M_S = 1e-4
"""where a joint at its largest speed leaves the tool slower than this, it counts as singular [m/s]"""
_AIM = 0.3
"""what share of the deviation a step aims at"""
_SHARES = np.array([0.15, 0.35, 0.5, 0.65, 0.85])
_POWERS = np.arange(6)
_BETWEEN: FloatArray = (_SHARES[:, None] ** _POWERS) @ quintic(*np.eye(6).reshape(2, 3, 6))
"""(5, 6) at these shares of a way of 1, by value, slope and bend at both ends"""
_DENSE = np.arange(1, 16) / 16
_LONGEST, SHORTEST, _SHORTEST_TRIED = 1 / 2, 1e-6, 1e-4
"""steps, as shares of the whole curve; the shortest of a walk that is only tried"""
_FIRST, _FARTHEST = 0.2, 1.2
"""most that a joint may turn in the first step, and in any [rad]"""


@dataclass(slots=True)
class StepBudget:
    """How many more steps may be spent on some walks: one takes about a millisecond.

    Counted, not timed, so that the same question has the same answer on every machine.
    """

    left: int
    shortest: float = _SHORTEST_TRIED
    """step, as a share of the whole curve, below which a branch counts as ended"""


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """How far a curve could be followed."""

    knots: Sequence[Knot]
    """at least the one at the start, if there is one"""
    complete: bool
    """whether the last one is at the end of the curve"""
    path: PiecewisePolynomial | None
    """quintics through all knots; None where there is no way between two"""
    crossing: tuple[float, int] | None
    """where a joint first leaves its limits [m], and which; None: they are kept"""
    tries: Sequence[int] = ()
    """how many steps were tried from each knot; of the first one, in earlier walks with a wider aim too"""
    step: float = 0.0
    """the one to try next [m]"""
    aim: float = _AIM
    """what share of the deviation the steps aim at"""

    @property
    def reach(self) -> float:
        """How far it leads inside the limits [m]."""
        if self.crossing is not None:
            return self.crossing[0]
        return self.knots[-1].s if self.knots else 0.0


def walk(
    task: ToolTask,
    q_start: FloatArray,
    *,
    only_inside: bool,
    effort: StepBudget | None = None,
    before: Walk | None = None,
) -> Walk:
    """Follow a curve from ``q_start`` (n,) [rad]; ``only_inside``: at most to a knot beyond the limits.

    With an ``effort`` the walk is given up where that ends. Steps of a walk of the same task that was given
    up ``before`` are not made again, but an effort is spent on them all the same.
    """
    start = task.knot(q_start, 0.0)
    if start is None:
        return Walk([], complete=False, path=None, crossing=None)
    effort = StepBudget(sys.maxsize, SHORTEST) if effort is None else effort
    knots, tries, step, aim = [start], [0], _turning(_FIRST, start), _AIM
    if before is not None:
        made, step, aim = np.cumsum(before.tries), before.step, before.aim
        reached = 1 + int(np.count_nonzero(made[:-1] <= effort.left))
        knots, tries = [*before.knots[:reached]], [*before.tries[:reached]]
        effort.left -= min(effort.left, int(made[-1]))
    while True:
        step = _walked(task, knots, tries, step, aim, effort, task.bounds if only_inside else None)
        complete, path = knots[-1].s >= task.curve.length, hermite(knots) if len(knots) > 1 else None
        if path is None or not complete:
            break
        s = (path.breaks[:-1, None] + np.diff(path.breaks)[:, None] * _DENSE).ravel()
        if not (task.deviation(path(s), s) > 1.0).any():
            break  # else it is astray between the places that a step looks at
        knots, tries, step, aim = [start], [sum(tries)], _turning(_FIRST, start), 0.1 * aim
    crossing = None if path is None else first_crossing(path, task.bounds)
    return Walk(knots, complete, path, crossing, tries, step, aim)


def _walked(
    task: ToolTask,
    knots: list[Knot],
    tries: list[int],
    step: float,
    aim: float,
    effort: StepBudget,
    bounds: FloatArray | None,
) -> float:
    """Add the knots that lead on, to the end if they can, and their tries; the step to try next [m]."""
    length, here = task.curve.length, knots[-1]
    while here.s < length and effort.left > 0:
        effort.left -= 1
        tries[-1] += 1
        step = min(step, _LONGEST * length, _turning(_FARTHEST, here))
        left = length - here.s
        if left <= 1.001 * step:
            ahead = length
        else:
            ahead = here.s + min(step, 0.5 * left)  # two even steps rather than one and a rest
        there, share = _step(task, here, ahead, aim)
        if there is None or share > 1.0:
            step = 0.5 * step if there is None else (ahead - here.s) * max(0.3, 0.85 * share ** (-1 / 6))
            if step < effort.shortest * length:
                break
            continue
        step = (ahead - here.s) * min(2.0, 0.85 * max(share, 1e-9) ** (-1 / 6))
        here = there
        knots.append(here)
        tries.append(0)
        if bounds is not None and not ((here.q >= bounds[:, 0]) & (here.q <= bounds[:, 1])).all():
            break
    return step


def _turning(angle: float, knot: Knot) -> float:
    """The way on which the fastest joint turns by an angle [rad], at the rate of a knot [m]."""
    return angle / max(float(np.abs(knot.slope).max()), 1e-9)


def _step(task: ToolTask, here: Knot, s: float, aim: float) -> tuple[Knot | None, float]:
    """The knot at ``s`` and by what share of the aim the quintic to it strays; None: no step so long."""
    h = s - here.s
    turn, curl = h * here.slope, 0.5 * h * h * here.bend
    # Beside a singular pose the series says nothing so far ahead: with the curl it leads to another branch.
    ahead = here.q + turn + (curl if np.abs(curl).max() <= np.abs(turn).max() else 0.0)
    there = task.arrived(ahead, s)
    if there is not None and task.redundant:
        # Obreshkov's implicit rule of fourth order, so that the free motion keeps to its equation too
        ahead = here.q + 0.5 * h * (here.slope + there.slope) + h * h / 12.0 * (here.bend - there.bend)
        there = task.arrived(ahead, s, there.inverse)
    if there is None:
        return None, math.inf
    scale = np.array([1.0, h, h * h, 1.0, h, h * h])
    between = (_BETWEEN * scale) @ np.array([here.q, here.slope, here.bend, there.q, there.slope, there.bend])
    return there, float(task.deviation(between, here.s + h * _SHARES).max()) / aim


def hermite(knots: Sequence[Knot]) -> PiecewisePolynomial:
    """Quintics that meet value, slope and bend of all knots (two at least)."""
    s = np.array([knot.s for knot in knots])
    h = s[1:] - s[:-1]
    states = np.array([(knot.q, knot.slope, knot.bend) for knot in knots]).swapaxes(0, 1)
    over = np.array([np.ones(len(h)), h, h * h])[..., None]  # a way that is 1 instead of h
    unit = quintic(over * states[:, :-1], over * states[:, 1:])
    return PiecewisePolynomial(s, (unit / h[:, None] ** _POWERS[:, None, None]).swapaxes(0, 1))


# What the joints must do while the tool follows a curve: equations in the joint angles, and their solution.
#
# With the rows ``c(q) = w(s)`` (the tool point on the curve, and its pitch or orientation where one is asked
# for) and A = ∂c/∂q over the joints that move:
#
#     A q' = w'          A q'' = w'' - Ȧ q'
#
# Where there are fewer rows than joints, q' is the least of ½ q'ᵀ W q' + gᵀ q': W are weights by the joints'
# speeds, and g pushes away from the limits. q'' is the exact derivative of that q' along the path. Where
# there are more rows than joints, q' is that of least squares, and counts where it meets all rows.

_RANK = 1e-9
"""singular values below this share of the largest count as none"""
_WELL = 1e6
"""rows whose inverse is smaller than this, for entries of 1, are solved without their singular values"""
_CONSISTENT = 1e-6
"""how much of the way may be left undone where a direction is lost, and still count as done (share)"""
_CONVERGED = 1e-10
"""a correction this small leaves less than a hundredth of itself to do [rad]"""
_LEFT = 1e-12
"""what may be left to do [rad]"""
_SLOW = 0.01
"""a correction that is a larger share of the one before calls for a new inverse"""
_TOO_FAR = 1.0
"""a correction this large, or twice the one before, leads elsewhere or nowhere [rad]"""
_CORRECTIONS = 8
_MARGIN = 0.35
"""how far from a limit the push begins [rad], or a quarter of the joint's range"""


@dataclass(frozen=True, slots=True, eq=False)
class Knot:
    """One place of the path, with exact derivatives over the way."""

    s: float
    """[m]"""
    q: FloatArray
    """(n,) [rad]"""
    slope: FloatArray
    """(n,) dq/ds [rad/m]"""
    bend: FloatArray
    """(n,) d²q/ds² [rad/m²]"""
    inverse: _Inverse
    """of the rows there: beside the place they hardly differ"""


def repulsion(q: FloatArray, limits: FloatArray, strength: float) -> tuple[FloatArray, FloatArray]:
    """(..., n) smooth push dq/ds [rad/m] off limits (n, 2), ``strength`` on the upper one, and its d/dq."""
    low, high = limits.T
    margin = np.maximum(np.minimum(_MARGIN, 0.25 * (high - low)), 1e-6)
    near = np.maximum(1.0 - np.array([q - low, high - q]) / margin, 0.0)
    square = near * near
    near_low, near_high = square * near
    return strength * (near_high - near_low), 3.0 * strength * (square[0] + square[1]) / margin


@dataclass(frozen=True, slots=True, eq=False)
class ToolTask:
    """The equations of one path. Immutable."""

    chain: Chain
    curve: ToolCurve
    moving: NDArray[np.intp]
    """(f,) the joints that are solved for; the others stand"""
    turn: TurnRows | None
    speeds: FloatArray
    """(n,) the joints' largest speeds: the weights of the least motion [rad/s]"""
    limits: FloatArray
    """(n, 2) [rad]"""
    push: float = 0.0
    """how strongly a free joint keeps away from its limits [rad/m]"""
    drift: FloatArray | None = None
    """(f,) rates, in units of the joints' speeds, that a free joint is led at besides [1/m]"""
    _moved: NDArray[np.intp] | slice = field(init=False)
    """``moving``; all of them: a slice, as a tenth of a step went into indices"""
    _scale: FloatArray = field(init=False)
    """(f,) their speeds"""

    def __post_init__(self) -> None:
        every = len(self.moving) == len(self.speeds)
        object.__setattr__(self, "_moved", slice(None) if every else self.moving)
        object.__setattr__(self, "_scale", self.speeds[self.moving])

    @property
    def rows(self) -> int:
        """How many equations."""
        return 3 + (0 if self.turn is None else self.turn.count)

    @property
    def redundant(self) -> bool:
        """Whether there are more joints than equations."""
        return self.rows < len(self.moving)

    @property
    def overdetermined(self) -> bool:
        """Whether there are more equations than joints."""
        return self.rows > len(self.moving)

    @property
    def bounds(self) -> FloatArray:
        """(n, 2) the limits, with what rounding may take [rad]."""
        return self.limits + np.array([-LIMIT_TOLERANCE, LIMIT_TOLERANCE])

    def nears_limits(self, knots: Sequence[Knot]) -> bool:
        """Whether a push away from the limits is felt anywhere."""
        q = np.array([knot.q[self._moved] for knot in knots])
        return len(q) > 0 and bool(repulsion(q, self.limits[self._moved], 1.0)[0].any())

    def deviation(self, q: FloatArray, s: FloatArray) -> FloatArray:
        """(k,) how far ``q`` (k, n) is off the curve or the turn at ``s`` (k,) (1: as far as allowed)."""
        few = len(q) <= len(_SHARES)  # as in a step: each by itself is twice as quick
        poses = np.array([self.chain.forward(one) for one in q]) if few else self.chain.forward(q)
        away = np.linalg.norm(poses[:, :3, 3] - self.curve.positions(s), axis=1) / DEVIATION_M
        return away if self.turn is None else np.maximum(away, self.turn.tilt(q, poses, s) / TILT)

    def arrived(self, guess: FloatArray, s: float, inverse: _Inverse | None = None) -> Knot | None:
        """The knot at ``s`` [m] next to ``guess`` (n,) [rad]; None: not found, or as ``knot``.

        ``inverse``: of the rows near by, to begin with.
        """
        q, point = guess.copy(), self.curve.positions(s)
        before, size = _TOO_FAR, _TOO_FAR
        for k in range(_CORRECTIONS):
            if inverse is None or (k and size > _SLOW * before):
                pose, jacobian = self.chain.pose_and_jacobian(q)
                inverse = _Inverse.of(self._scaled_rows(pose, jacobian))
                if inverse is None:
                    return None
            else:
                pose = self.chain.forward(q)
            before = size
            missing = point - pose[:3, 3]
            if self.turn is not None:
                missing = np.concatenate([missing, self.turn.missing(q, pose, s)])
            step = self._scale * (inverse.least @ missing)
            size = float(np.abs(step).max())
            if not size < min(_TOO_FAR, 2.0 * before):
                return None
            q[self._moved] += step
            if size < _CONVERGED or size * size < _LEFT * before:  # the next one is as much smaller again
                off = self.overdetermined and self.deviation(q[None], np.array([s]))[0] > _AIM
                return None if off else self.knot(q, s)
        return None

    def knot(self, q: FloatArray, s: float) -> Knot | None:
        """The derivatives where ``q`` (n,) meets the equations; None: a joint would turn without bound."""
        (pose, jacobian), move = self.chain.pose_and_jacobian(q), self._moved
        inverse = _Inverse.of(self._scaled_rows(pose, jacobian))
        if inverse is None:
            return None
        wanted = self.curve.derivatives(s)[1:]
        if self.turn is not None:
            wanted = np.concatenate([wanted, self.turn.rates(s)], axis=1)
        first, second = wanted
        speed, least = self._scale, inverse.least @ first
        lean, push_change = self._lean(q) if self.redundant else (None, None)
        rates = least if lean is None else least - inverse.null(lean)
        if not (_largest(rates) * SLOWEST_M_S <= 1.0 and inverse.meets(rates, first)):
            return None
        slope, bend = np.zeros(len(q)), np.zeros(len(q))
        slope[move] = speed * rates
        turned = self._turned(pose, q, jacobian, slope)
        bends = inverse.least @ (second - turned @ slope)
        if self.redundant:
            # Lagrange's multipliers: the solution of A Aᵀ x = w' + A g
            right = least if lean is None else inverse.least @ (first + inverse.rows @ lean)
            pulled = turned[:, move].T @ (inverse.least.T @ right)
            if push_change is not None:
                pulled -= push_change * slope[move]
            bends += inverse.null(speed * pulled)
        bend[move] = speed * bends
        return Knot(s, q, slope, bend, inverse) if math.isfinite(bend.sum()) else None

    def _lean(self, q: FloatArray) -> tuple[FloatArray | None, FloatArray | None]:
        """(f,) the gradient g in units of the speeds, and how the push changes by q; None: zero."""
        lean = change = None
        if self.push:
            push, by_turn = repulsion(q[self._moved], self.limits[self._moved], self.push)
            if push.any():
                lean, change = push / self._scale, by_turn / self._scale**2
        if self.drift is not None:
            lean = -self.drift if lean is None else lean - self.drift
        return lean, change

    def _turned(self, pose: FloatArray, q: FloatArray, jacobian: FloatArray, slope: FloatArray) -> FloatArray:
        """(m, n) derivative of the rows along joint rates ``slope`` (n,)."""
        coupling, rates = self.chain.coupling, slope
        if coupling is not None:  # a link is turned by the links before it, not by their joints
            jacobian, rates = self.chain.links_alone.jacobian(coupling @ q), coupling @ slope
        turned = carried(jacobian[:3], jacobian[3:], rates)
        if self.turn is not None:
            turned = np.concatenate([turned, self.turn.turned(pose, jacobian, rates)])
        return turned if coupling is None else turned @ coupling

    def free_rates(self, q: FloatArray) -> FloatArray:
        """(k, f) rates that no equation sees at ``q`` (n,), in units of the speeds: unit vectors."""
        rows = self._scaled_rows(self.chain.forward(q), self.chain.jacobian(q))
        return np.linalg.svd(rows)[2][self.rows :]

    def _scaled_rows(self, pose: FloatArray, jacobian: FloatArray) -> FloatArray:
        """(m, f) derivatives of the rows by the joints solved for, in units of their speeds."""
        rows = jacobian[:3]
        if self.turn is not None:
            rows = np.concatenate([rows, self.turn.rows(pose, jacobian)])
        return rows[:, self._moved] * self._scale


@dataclass(frozen=True, slots=True, eq=False)
class _Inverse:
    """The pseudo-inverse of some rows; lost directions are left out."""

    rows: FloatArray
    """(m, f)"""
    least: FloatArray
    """(f, m) gives the least solution"""
    whole: bool
    """no direction is lost"""

    @classmethod
    def of(cls, rows: FloatArray) -> _Inverse | None:
        """None where the rows are not finite or all zero."""
        if not math.isfinite(largest := _largest(rows)):
            return None
        # most poses: good enough for the normal equations, twice as quick as the singular values
        square = rows.shape[0] == rows.shape[1]
        matrix: FloatArray = rows if square else rows @ rows.T
        if rows.shape[0] <= rows.shape[1]:
            with suppress(np.linalg.LinAlgError):  # elimination meets a zero
                inverse = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
                if (largest if square else _largest(matrix)) * _largest(inverse) < _WELL:
                    return cls(rows, inverse if square else rows.T @ inverse, whole=True)
        u, sizes, vt = np.linalg.svd(rows, full_matrices=False)
        rank = int(np.count_nonzero(sizes > _RANK * sizes[0]))
        if not rank:
            return None
        return cls(rows, (vt[:rank].T / sizes[:rank]) @ u[:, :rank].T, whole=rank == len(rows))

    def null(self, vector: FloatArray) -> FloatArray:
        """The part of a vector that the rows do not see."""
        return vector - self.least @ (self.rows @ vector)

    def meets(self, solution: FloatArray, right: FloatArray) -> bool:
        """Whether a solution does what is asked for, in lost directions too."""
        if self.whole:
            return True
        missed = float(np.abs(self.rows @ solution - right).max())
        return missed <= _CONSISTENT * max(1.0, float(np.abs(right).max()))


def _largest(matrix: FloatArray) -> float:
    """Largest entry without its sign; not a number where one is none."""
    return float(np.abs(matrix).max())
