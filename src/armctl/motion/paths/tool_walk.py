"""Following a curve on one branch, step by step: each step leaves a polynomial that keeps to the curve.

A step goes ahead by the Taylor series of the last knot, is brought onto the curve by Newton's method, and is
kept if the quintic between the two knots stays on the curve. Else it is halved. A step that stays refused
however small it is marks the place where the branch ends: there the joints would have to turn without bound.
A jump onto another branch is refused by the same test, since no smooth polynomial leads there on the curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from armctl.arrays import FloatArray
from armctl.kinematics import Chain
from armctl.motion.paths.tool_curve import ToolCurve
from armctl.motion.paths.tool_pitch import PitchRows, carried
from armctl.motion.polynomial import PiecewisePolynomial, quintic

DEVIATION_M = 0.01e-3
"""how far the tool may stray from the curve between the knots [m]"""
TILT = math.radians(0.01)
"""the same for a held pitch [rad]"""
SLOWEST_M_S = 1e-4
"""where a joint at its largest speed leaves the tool slower than this, it counts as singular [m/s]"""
_AIM = 0.3
"""what share of the deviation a step aims at"""
_SHARES = np.array([0.15, 0.35, 0.5, 0.65, 0.85])
_POWERS = np.arange(6)
_SHARES_POWERS = _SHARES[:, None] ** _POWERS
_DENSE = np.arange(1, 16) / 16
_LONGEST, _SHORTEST = 1 / 2, 1e-6
"""steps, as shares of the whole curve"""
_FIRST, _FARTHEST = 0.2, 1.2
"""most that a joint may turn in the first step, and in any [rad]"""


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """How far a curve could be followed, limits not looked at."""

    knots: tuple[Knot, ...]
    """at least the one at the start, if there is one"""
    complete: bool
    """whether the last one is at the end of the curve"""

    @property
    def s(self) -> float:
        """How far it leads [m]."""
        return self.knots[-1].s if self.knots else 0.0

    @property
    def polynomial(self) -> PiecewisePolynomial | None:
        """Quintics through all knots; None where there is no way between two."""
        return hermite(self.knots) if len(self.knots) > 1 else None


def walk(task: ToolTask, q_start: FloatArray, limits: FloatArray | None = None) -> Walk:
    """Follow a task's curve as far as it goes, from ``q_start`` (n,) [rad], which meets its beginning.

    Args:
        task: what to follow.
        q_start: (n,) [rad].
        limits: (n, 2) joint limits [rad]: no farther than a knot beyond them; None: limits do not matter.
    """
    length = task.curve.length
    here = _settled(task, q_start, 0.0)
    if here is None:
        return Walk((), complete=False)
    knots = [here]
    step = _turning(_FIRST, here)
    while here.s < length:
        step = min(step, _LONGEST * length, _turning(_FARTHEST, here))
        left = length - here.s
        if left <= 1.001 * step:
            ahead = length
        else:
            ahead = here.s + min(step, 0.5 * left)  # two even steps rather than one and a rest
        found = _step(task, here, ahead)
        if found is None:
            step *= 0.5
            if step < _SHORTEST * length:
                return Walk(tuple(knots), complete=False)
            continue
        there, share = found
        if share > 1.0:
            step = (there.s - here.s) * max(0.3, 0.85 * share ** (-1 / 6))
            if step < _SHORTEST * length:
                return Walk(tuple(knots), complete=False)
            continue
        step = (there.s - here.s) * min(2.0, 0.85 * max(share, 1e-9) ** (-1 / 6))
        knots.append(there)
        here = there
        if limits is not None and not ((here.q >= limits[:, 0]) & (here.q <= limits[:, 1])).all():
            return Walk(tuple(knots), complete=here.s >= length)
    return _verified(task, knots)


def _turning(angle: float, knot: Knot) -> float:
    """The way on which the fastest joint turns by an angle [rad], at the rate of a knot [m]."""
    return angle / max(float(np.abs(knot.slope).max()), 1e-9)


def hermite(knots: Sequence[Knot]) -> PiecewisePolynomial:
    """Quintics that meet value, slope and bend of all knots (two at least)."""
    s = np.array([knot.s for knot in knots])
    h = s[1:] - s[:-1]
    states = np.array([(knot.q, knot.slope, knot.bend) for knot in knots]).swapaxes(0, 1)
    unit = quintic(_over(h[:, None], states[:, :-1]), _over(h[:, None], states[:, 1:]))
    return PiecewisePolynomial(s, (unit / h[:, None] ** _POWERS[:, None, None]).swapaxes(0, 1))


def _over(h: float | FloatArray, states: FloatArray) -> FloatArray:
    """Value, slope and bend (3, ..., n) over a way that is 1 instead of ``h``, a number or (..., 1) [m]."""
    value, slope, bend = states
    return np.array([value, h * slope, h * h * bend])


def deviation(task: ToolTask, q: FloatArray, s: FloatArray) -> FloatArray:
    """(k,) how far ``q`` (k, n) strays from the task at ``s`` (k,), as a share of what is allowed."""
    poses = task.chain.forward(q)
    away = np.linalg.norm(poses[:, :3, 3] - task.curve.positions(s), axis=1) / DEVIATION_M
    if task.pitch is None:
        return away
    return np.maximum(away, task.pitch.tilt(q, poses, s) / TILT)


def _settled(task: ToolTask, q: FloatArray, s: float) -> Knot | None:
    """The knot at a configuration, unless some joint would have to turn without bound there."""
    knot = task.knot(q, s)
    if knot is None or not np.isfinite(knot.bend).all():
        return None
    return knot if (np.abs(knot.slope) * SLOWEST_M_S <= task.speeds).all() else None


def _step(task: ToolTask, here: Knot, s: float) -> tuple[Knot, float] | None:
    """The knot at ``s`` and by what share of the aim the quintic to it strays; None: no step so long."""
    h = s - here.s
    ahead = here.q + h * here.slope + 0.5 * h * h * here.bend
    there = _arrived(task, ahead, s)
    if there is not None and task.redundant:
        # Obreshkov's implicit rule of fourth order, so that the free motion keeps to its equation too
        ahead = here.q + 0.5 * h * (here.slope + there.slope) + h * h / 12.0 * (here.bend - there.bend)
        there = _arrived(task, ahead, s)
    if there is None:
        return None
    ends = [_over(h, np.array([knot.q, knot.slope, knot.bend])) for knot in (here, there)]
    between = _SHARES_POWERS @ quintic(*ends)
    return there, float(deviation(task, between, here.s + h * _SHARES).max()) / _AIM


def _arrived(task: ToolTask, guess: FloatArray, s: float) -> Knot | None:
    q = task.corrected(guess, s) if np.isfinite(guess).all() else None
    return None if q is None else _settled(task, q, s)


def _verified(task: ToolTask, knots: list[Knot]) -> Walk:
    """With knots put between where a dense look finds the tool astray."""
    while True:
        path = hermite(knots)
        widths = np.diff(path.breaks)
        s = path.breaks[:-1, None] + widths[:, None] * _DENSE
        worst = deviation(task, path(s.ravel()), s.ravel()).reshape(s.shape).max(axis=1)
        astray = np.flatnonzero(worst > 1.0)
        if not len(astray):
            return Walk(tuple(knots), complete=True)
        for i in map(int, astray[::-1]):
            s_middle = 0.5 * (knots[i].s + knots[i + 1].s)
            middle = _arrived(task, path(s_middle), s_middle)
            if middle is None or widths[i] < _SHORTEST * task.curve.length:
                del knots[i + 1 :]
                return Walk(tuple(knots), complete=False)
            knots.insert(i + 1, middle)


# What the joints must do while the tool follows a curve: equations in the joint angles, and their solution.
#
# With the rows ``c(q) = w(s)`` (the tool point on the curve, the pitch where it is held), A = ∂c/∂q over the
# joints that move freely and h the joints that are led (the roll joint, and what the limits hold):
#
#     A q' = w' - A_h h'          A q'' = w'' - Ȧ (q', h')
#
# Where there are as many rows as joints these are solved; where there are fewer, q' is the least motion,
# weighted by the joints' speeds, that serves: the least of ½ q'ᵀ W q' + gᵀ q', where g, if asked for, pushes
# away from the joint limits. q'' is then the exact derivative of that q' along the path, so that a polynomial
# through q, q', q'' at its knots is smooth.

_RANK = 1e-9
"""singular values below this share of the largest count as none"""
_WELL = 1e6
"""rows whose inverse is smaller than this, for entries of 1, are solved without their singular values"""
_CONSISTENT = 1e-6
"""how much of the way may be left undone where a direction is lost, and still count as done (share)"""
_CONVERGED = 1e-10
"""a correction this small leaves less than a hundredth of itself to do [rad]"""
_SLOW = 0.01
"""a correction that is a larger share of the one before calls for a new inverse"""
_TOO_FAR = 1.0
"""a correction this large leads to some other place, not to the next one [rad]"""
_CORRECTIONS = 8


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


@dataclass(frozen=True, slots=True, eq=False)
class Repulsion:
    """A push away from the joint limits, smooth and bounded."""

    limits: FloatArray
    """(n, 2) [rad]"""
    margin: FloatArray
    """(n,) how far from a limit it begins [rad]"""
    strength: float
    """how fast it would drive a joint that stands on its limit [rad/m]; 0: not at all"""

    def push(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) the push as dq/ds [rad/m], positive near the upper limit, and its derivative by q."""
        if self.strength == 0.0:
            return np.zeros(len(q)), np.zeros(len(q))
        low = np.maximum(1.0 - (q - self.limits[:, 0]) / self.margin, 0.0)
        high = np.maximum(1.0 - (self.limits[:, 1] - q) / self.margin, 0.0)
        change = 3.0 * self.strength * (low**2 + high**2) / self.margin
        return self.strength * (high**3 - low**3), change


@dataclass(frozen=True, slots=True, eq=False)
class ToolTask:
    """The equations of one path. Immutable."""

    chain: Chain
    curve: ToolCurve
    moving: NDArray[np.intp]
    """(f,) the joints that are solved for"""
    led_start: FloatArray
    """(n,) angles of the other joints at the start [rad]; 0 for those that are solved for"""
    led_rate: FloatArray
    """(n,) how fast they go [rad/m]"""
    pitch: PitchRows | None
    speeds: FloatArray
    """(n,) the joints' largest speeds: the weights of the least motion [rad/s]"""
    repulsion: Repulsion

    @property
    def rows(self) -> int:
        """How many equations."""
        return 3 + (0 if self.pitch is None else self.pitch.count)

    @property
    def redundant(self) -> bool:
        """Whether there are more joints than equations."""
        return self.rows < len(self.moving)

    def corrected(self, q: FloatArray, s: float) -> FloatArray | None:
        """The configuration next to ``q`` (n,) that meets the equations at ``s`` [m]; None: not found."""
        led = self.led_start + self.led_rate * s
        led[self.moving] = q[self.moving]
        q = led
        wanted = self.curve.positions(s)
        if self.pitch is not None:
            wanted = np.append(wanted, self.pitch.wanted(s)[0])
        speeds, inverse, before, size = self.speeds[self.moving], None, np.inf, np.inf
        for _ in range(_CORRECTIONS):
            pose = self.chain.forward(q)
            if inverse is None or size > _SLOW * before:
                inverse = _Inverse.of(self._scaled(self._jacobian_rows(pose, self.chain.jacobian(q))))
                if inverse is None:
                    return None
            before = size
            step = speeds * inverse.solve(wanted - self._values(q, pose))
            size = float(np.abs(step).max())
            if not size < _TOO_FAR:
                return None
            q[self.moving] += step
            if size < _CONVERGED:
                return q
        return None

    def knot(self, q: FloatArray, s: float) -> Knot | None:
        """The derivatives at a configuration that meets the equations; None where the rates are infinite."""
        pose, jacobian = self.chain.forward(q), self.chain.jacobian(q)
        A, move = self._jacobian_rows(pose, jacobian), self.moving
        inverse = _Inverse.of(self._scaled(A))
        if inverse is None:
            return None
        _, first, second = self.curve.derivatives(s)
        if self.pitch is not None:
            _, pitch_first, pitch_second = self.pitch.wanted(s)
            first, second = np.append(first, pitch_first), np.append(second, pitch_second)
        first = first - A @ self.led_rate
        speed = self.speeds[move]
        slope, bend = self.led_rate.copy(), np.zeros(len(q))
        if not self.redundant:
            slope[move] = speed * inverse.solve(first)
            if not inverse.meets(slope[move] / speed, first):
                return None
            turned = self._turned_rows(pose, jacobian, slope)
            bend[move] = speed * inverse.solve(second - turned @ slope)
            return Knot(s, q, slope, bend)
        push, push_change = self.repulsion.push(q)
        push, push_change = push[move] / speed**2, push_change[move] / speed**2  # as the gradient g
        multiplier = inverse.multipliers(first + A[:, move] @ (speed**2 * push))
        slope[move] = speed * (inverse.solve(first) - inverse.null(speed * push))
        if not inverse.meets(slope[move] / speed, first):
            return None
        turned = self._turned_rows(pose, jacobian, slope)
        change = turned[:, move].T @ multiplier - push_change * slope[move]
        bend[move] = speed * (inverse.solve(second - turned @ slope) + inverse.null(speed * change))
        return Knot(s, q, slope, bend)

    def _values(self, q: FloatArray, pose: FloatArray) -> FloatArray:
        point = pose[:3, 3]
        return point if self.pitch is None else np.append(point, self.pitch.value(q, pose))

    def _jacobian_rows(self, pose: FloatArray, jacobian: FloatArray) -> FloatArray:
        """(m, n)."""
        if self.pitch is None:
            return jacobian[:3]
        return np.concatenate([jacobian[:3], self.pitch.rows(pose, jacobian)])

    def _turned_rows(self, pose: FloatArray, jacobian: FloatArray, rates: FloatArray) -> FloatArray:
        """(m, n) derivative of the rows along joint rates."""
        rows = carried(jacobian[:3], jacobian[3:], rates)
        return rows if self.pitch is None else np.append(rows, self.pitch.turned(pose, jacobian, rates), 0)

    def _scaled(self, rows: FloatArray) -> FloatArray:
        """The columns of the joints solved for, in units of their speeds."""
        return rows[:, self.moving] * self.speeds[self.moving]


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
        if not math.isfinite(_largest(rows)):
            return None
        # most poses: good enough for the normal equations, twice as quick as the singular values
        square = rows.shape[0] == rows.shape[1]
        matrix: FloatArray = rows if square else rows @ rows.T
        inverse = _inverted(matrix)
        if inverse is not None and _largest(matrix) * _largest(inverse) < _WELL:
            least: FloatArray = inverse if square else rows.T @ inverse
            return cls(rows, least, whole=True)
        u, sizes, vt = np.linalg.svd(rows, full_matrices=False)
        rank = int(np.count_nonzero(sizes > _RANK * sizes[0]))
        if not rank:
            return None
        return cls(rows, (vt[:rank].T / sizes[:rank]) @ u[:, :rank].T, whole=rank == len(rows))

    def solve(self, right: FloatArray) -> FloatArray:
        """The least solution."""
        return self.least @ right

    def multipliers(self, right: FloatArray) -> FloatArray:
        """Solution of ``rows rowsᵀ x = right``."""
        return self.least.T @ (self.least @ right)

    def null(self, vector: FloatArray) -> FloatArray:
        """The part of a vector that the rows do not see."""
        return vector - self.least @ (self.rows @ vector)

    def meets(self, solution: FloatArray, right: FloatArray) -> bool:
        """Whether a solution does what is asked for, in lost directions too."""
        if self.whole:
            return True
        missed = float(np.abs(self.rows @ solution - right).max())
        return missed <= _CONSISTENT * max(1.0, float(np.abs(right).max()))


def _inverted(matrix: FloatArray) -> FloatArray | None:
    """None where elimination meets a zero; ``numpy.linalg.inv`` takes nearly twice as long."""
    dgesv = cast("Callable[..., tuple[object, object, FloatArray, int]]", lapack.dgesv)  # pyright: ignore
    _, _, inverse, info = dgesv(matrix, np.eye(len(matrix)))
    return None if info else inverse


def _largest(matrix: FloatArray) -> float:
    """Largest entry without its sign; not a number where one is none."""
    return cast("Callable[..., float]", lapack.dlange)("M", matrix)  # pyright: ignore
