"""Following a curve on one branch, step by step: each step leaves a polynomial that keeps to the curve.

A step goes ahead by the Taylor series of the last knot, is brought onto the curve by Newton's method, and is
kept if the quintic between the two knots stays on the curve. Else it is halved. A step that stays refused
however small it is marks the place where the branch ends: there the joints would have to turn without bound.
A jump onto another branch is refused by the same test, since no smooth polynomial leads there on the curve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE
from armctl.kinematics.tool_plane import ToolPlane
from armctl.kinematics.yaw_pitch_roll.geometry import bend_sense
from armctl.motion.paths.tool_curve import ToolCurve
from armctl.motion.paths.tool_task import Knot, ToolTask, reaches_forward
from armctl.motion.polynomial import PiecewisePolynomial, cubic_spline, quintic

FloatArray = NDArray[np.float64]
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


# A tool pitch that leads an arm with three parallel pitch joints along a curve inside its joint limits.
#
# Where the pitch is free, the least motion may run into a limit that another pitch would have avoided. Here
# the whole way is looked at: over a grid of places on the curve and angles of the tool in the arm's plane, on
# the branch that the arm is on, dynamic programming finds the way of least joint motion that keeps inside the
# limits, and a smoothing spline makes it a pitch to be led along.

_PLACES = 49
_ANGLES = 360
_REACH = 12
"""by how many angles of the grid the tool may turn from one place to the next"""
_SHIFTS = np.arange(-_REACH, _REACH + 1)
_MARGIN = math.radians(5.0)
"""how near to a limit a place begins to cost more [rad]"""
_CLOSE = 0.03
"""what a place on a limit costs, in squared radians of joint motion"""
_BENT, _STRAIGHT = 0.98, 0.9995
"""cosines of the elbow from which a place costs more, and at which it is too nearly straight or folded"""
SMOOTHINGS = (30.0, 3.0, 0.3)
"""tried in this order: how much a smooth way counts against a near one"""


@dataclass(frozen=True, slots=True, eq=False)
class PitchGrid:
    """The arm on its branch, at places of a curve and angles of the tool."""

    places: FloatArray
    """(m,) [m]"""
    turns: FloatArray
    """(a,) angle of the tool from that at the start, a whole turn in even steps [rad]"""
    q: FloatArray
    """(m, 3, a) pitch joints [rad], any number where the links do not reach"""
    toll: FloatArray
    """(m, a) what it costs to be there; infinite where the links do not reach and outside the limits"""

    @classmethod
    def of(cls, geometry: ToolPlane, limits: FloatArray, q: FloatArray, curve: ToolCurve) -> PitchGrid:
        """Lay it out.

        Args:
            geometry: of an arm with three pitch joints.
            limits: (n, 2) joint limits [rad].
            q: (n,) where it stands [rad]: tells the branch and the angle of the tool.
            curve: that begins there.
        """
        places = np.linspace(0.0, curve.length, _PLACES)
        turns = 2.0 * math.pi * np.arange(_ANGLES) / _ANGLES
        forward, left, up = ((curve.positions(places) - geometry.origin) @ geometry.frame).T
        r = np.sqrt(np.maximum(forward**2 + left**2 - geometry.lateral**2, 0.0))
        if not reaches_forward(geometry, q, curve.positions(0.0)):
            r = -r
        at_start = [geometry.plane_angle(k, float(q[1 + k])) for k in range(3)]
        last = sum(at_start) + turns
        first_length, second_length, third_length = geometry.lengths
        wrist = (r + 1j * up - geometry.shoulder)[:, None] - third_length * np.exp(1j * last)
        cosine = np.abs(wrist) ** 2 - first_length**2 - second_length**2
        cosine /= 2.0 * first_length * second_length
        bend = bend_sense(at_start[1]) * np.arccos(np.clip(cosine, -1.0, 1.0))
        first = np.angle(wrist) - np.angle(first_length + second_length * np.exp(1j * bend))
        plane = np.stack([first, bend, last - first - bend], axis=1)
        signs, offsets = np.array(geometry.signs)[:, None], np.array(geometry.offsets)[:, None]
        low, high = limits[1:4].T[..., None]
        whole_turns = np.rint((signs * (plane - offsets) - 0.5 * (low + high)) / (2.0 * math.pi))
        angles = signs * (plane - offsets) - 2.0 * math.pi * whole_turns
        room = np.minimum(angles - low, high - angles)
        toll = _CLOSE * (np.maximum(1.0 - room / _MARGIN, 0.0) ** 2).sum(axis=1)
        toll += _CLOSE * (np.maximum(np.abs(cosine) - _BENT, 0.0) / (_STRAIGHT - _BENT)) ** 2
        toll[(room.min(axis=1) < -LIMIT_TOLERANCE) | (np.abs(cosine) > _STRAIGHT)] = np.inf
        return cls(places, turns, angles, toll)

    def way(self, weights: FloatArray) -> FloatArray:
        """The way of least joint motion that leads farthest, from the first angle on.

        Args:
            weights: (3,) of the squared motion of the pitch joints.

        Returns:
            (m,) angle of the tool at each place, from that at the start [rad]; where nothing leads on, it
            stays what it was.
        """
        count = len(self.turns)
        weighted = self.q * np.sqrt(weights)[:, None]
        # for each shift and angle, the angle that lies the shift away
        around = (np.arange(count) + _SHIFTS[:, None]) % count
        cost = np.where(np.arange(count) == 0, 0.0, np.inf)
        choices: list[NDArray[np.intp]] = []
        for here, ahead, toll in zip(weighted[:-1], weighted[1:], self.toll[1:], strict=True):
            open_ = np.flatnonzero(np.isfinite(toll))  # mostly few: the limits close the rest
            near = around.take(open_, axis=1)
            moved = ahead.take(open_, axis=1)[:, None] - here.take(near, axis=1)
            moved *= moved
            total = moved.sum(axis=0)
            total += cost.take(near)
            best, reached = np.zeros(count, dtype=np.intp), np.full(count, np.inf)
            best[open_] = total.argmin(axis=0)
            reached[open_] = total.min(axis=0) + toll[open_]
            if not np.isfinite(reached).any():
                break
            cost = reached
            choices.append(best)
        at = int(cost.argmin())
        steps = np.zeros(len(self.places), dtype=np.intp)
        for i in range(len(choices), 0, -1):
            shift = int(_SHIFTS[choices[i - 1][at]])
            steps[i] = -shift
            at = (at + shift) % count
        return np.cumsum(steps) * self.turns[1]


def led_pitch(grid: PitchGrid, way: FloatArray, start: float, smoothing: float) -> PiecewisePolynomial:
    """A smooth curve near a way, as a sum of joint angles that begins at ``start`` [rad], over the places."""
    count = len(way)
    second = np.diff(np.eye(count), 2, axis=0)
    rows = np.eye(count) + smoothing * second.T @ second
    values = np.zeros(count)  # the first one is given
    values[1:] = np.linalg.solve(rows[1:, 1:], way[1:])
    return cubic_spline(grid.places, (start + values)[:, None])


def motion_weights(speeds: FloatArray) -> FloatArray:
    """(3,) of the pitch joints, from the largest speeds (n,) of all joints."""
    return (speeds[1:4].max() / speeds[1:4]) ** 2
