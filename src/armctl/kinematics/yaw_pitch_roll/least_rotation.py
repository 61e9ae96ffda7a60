"""The exact least rotation: min Σ|θ| over the continuum of solutions of three pitch joints.

Between the points where a joint passes zero the sum is smooth, so a minimum lies

* where a joint is at a limit or at zero, or the elbow is straight: a lock, in closed form
  (``pitch_locks.py``), or
* where the sum is stationary along the self-motion: a curve (``live_curve.py``).
"""

from __future__ import annotations

import cmath
import itertools
import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import TWO_PI, into_limits, nearest_image
from armctl.kinematics.two_link import bend_angle, inner_angle
from armctl.kinematics.yaw_pitch_roll.geometry import BaseBranch, YawPitchRoll, base_angles

# One pitch joint of three held where |θ| has an end or a kink: what is left is a triangle.

Turned = tuple[float, float, float, float]
"""what the pitch joints turn in all, and their angles [rad]"""


class PitchJoint(NamedTuple):
    """θ = sense · (t - offset), t the plane angle; between limits [rad]."""

    sense: int
    offset: float
    low: float
    high: float


class Lock(NamedTuple):
    """One pitch joint held; the other two follow from a triangle."""

    spent: float
    """|θ| of the joint [rad]"""
    joint: int
    """0: first, 1: second, 2: third pitch joint"""
    angle: float
    """θ [rad]"""
    x: float
    y: float
    """with the first joint held, the end of its link [m]; else 0"""
    near: float
    far: float
    """the two links of the triangle [m]"""
    lag: float
    lead: float
    """plane angles of the free joints: the first angle less ``lag``, the bend and ``lead`` [rad]"""
    first: PitchJoint
    second: PitchJoint
    """the free joints"""


def pitch_locks(geometry: YawPitchRoll, joints: Sequence[PitchJoint]) -> list[Lock]:
    """The locks of an arm with three pitch joints, by how much the locked one turns, least first."""
    locks = [lock for k in range(3) for lock in _locks_of(geometry, k, joints)]
    return sorted(locks, key=lambda lock: lock.spent)


def _locks_of(geometry: YawPitchRoll, k: int, joints: Sequence[PitchJoint]) -> Iterator[Lock]:
    """A pitch joint at its limits and at zero; the second one also where sin t3 = 0."""
    _, _, low, high = joints[k]
    angles = {low, high, *((0.0,) if low < 0 < high else ())}
    if k == 1:
        straight = (geometry.joint_angle(1, v) for v in (0.0, math.pi))
        angles |= {a for v in straight if (a := nearest_image(v, low, high)) is not None}
    l2, l3, l4 = geometry.lengths
    free = [joint for i, joint in enumerate(joints) if i != k]
    for angle in angles:
        v = geometry.plane_angle(k, angle)
        before, behind = ((0.0, l2), (l2, l3), (l3, l4))[k]
        whole = before + behind * cmath.exp(1j * v)  # the links that the joint holds together, as one
        length, turn = abs(whole), cmath.phase(whole)
        if k == 0:
            yield Lock(abs(angle), 0, angle, whole.real, whole.imag, l3, l4, v, 0.0, *free)
        elif length > 1e-12 and k == 1:
            yield Lock(abs(angle), 1, angle, 0.0, 0.0, length, l4, turn, turn - v, *free)
        elif length > 1e-12:
            yield Lock(abs(angle), 2, angle, 0.0, 0.0, l2, length, 0.0, -turn, *free)


def bent_lock(lock: Lock, side: int, x: float, y: float) -> Turned | None:
    """The posture of a lock that reaches a point, if the free joints are inside their limits.

    Args:
        lock: which joint is held, and where.
        side: +1: the bend is positive, -1: negative; links in line are found with +1 alone.
        x: the point seen from the first pitch axis, forward [m].
        y: and upward [m].
    """
    spent, joint, angle, held_x, held_y, near, far, lag, lead, first, second = lock
    x, y = x - held_x, y - held_y
    bend = bend_angle(x * x + y * y, near, far)
    if bend is None or (side < 0 and (bend == 0.0 or bend == math.pi)):
        return None
    sense, offset, low, high = second
    b = nearest_image(sense * (side * bend + lead - offset), low, high)
    if b is None:
        return None
    sense, offset, low, high = first
    towards = math.atan2(y, x) - side * inner_angle(near, far, bend) - lag
    a = nearest_image(sense * (towards - offset), low, high)
    if a is None:
        return None
    turn = spent + abs(a) + abs(b)
    return (turn, angle, a, b) if joint == 0 else (turn, a, angle, b) if joint == 1 else (turn, a, b, angle)


# Which locks may hold the least rotation, by where in the plane of the pitch joints the target lies.
#
# The plane is cut into square cells. For each cell, each lock and each way to bend, the distances and
# directions of the cell's points give intervals of the two free angles, and these a lower bound of what the
# pitch joints turn in all. A target then tries the locks of its cell, least bound first, until a bound is no
# better than what is found: two or three locks of eighteen.

FloatArray = NDArray[np.float64]
_CELLS = 32
"""along a side of the map"""
_SPARE_LENGTH = 1e-9
"""by how much a cell is taken larger than it is [m]: far more than what triangles allow for rounding"""
_SPARE_ANGLE = 1e-8
"""by how much limits are taken wider, and bounds less [rad]: more than ``LIMIT_TOLERANCE``"""
_TINY = 1e-300
"""stands for a distance of nothing where one is divided by it [m]"""
Cell = Sequence[tuple[float, Lock, int]]
"""what the pitch joints turn in all at least [rad], with which lock, bent which way; least first"""


class LockMap:
    """The cells of one arm. Immutable."""

    def __init__(self, locks: Sequence[Lock], reach: float) -> None:
        """Draw the map of some locks; ``reach``: how far the stretched links come [m]."""
        self._half = reach + 2.0 * _SPARE_LENGTH
        self._scale = _CELLS / (2.0 * self._half)
        bounds = np.concatenate([self._bounds(lock) for lock in locks]).T
        order = bounds.argsort(axis=1)
        bounds = np.take_along_axis(bounds, order, axis=1)
        counts = np.isfinite(bounds).sum(axis=1)
        bent = [(lock, side) for lock in locks for side in (1, -1)]
        rows = zip(bounds.tolist(), order.tolist(), counts.tolist(), strict=True)
        self._cells: list[Cell] = [
            [(least, *bent[i]) for least, i in zip(some[:count], which, strict=False)]
            for some, which, count in rows
        ]

    def at(self, x: float, y: float) -> Cell:
        """The locks to try for a target seen from the first pitch axis [m]; none out of the links' reach."""
        half, scale = self._half, self._scale
        if -half < x < half and -half < y < half:
            return self._cells[int((x + half) * scale) * _CELLS + int((y + half) * scale)]
        return ()

    def _bounds(self, lock: Lock) -> FloatArray:
        """(2, cells) what the joints turn at least, bent either way [rad]; infinite out of reach."""
        a, b = lock.near, lock.far
        middle = (np.arange(_CELLS) + 0.5) / self._scale - self._half
        x, y = np.meshgrid(middle - lock.x, middle - lock.y, indexing="ij")
        distance = np.hypot(x, y).ravel()
        radius = math.sqrt(0.5) / self._scale + _SPARE_LENGTH  # of the circle around a cell
        some = np.flatnonzero((distance - radius <= a + b) & (distance + radius >= abs(a - b)))
        distance, direction = distance[some], np.arctan2(y, x).ravel()[some]
        # the distances of the cell's points that the two links reach
        ends = np.clip([distance - radius, distance + radius], abs(a - b), a + b)
        bend = _arccos((ends * ends - (a * a + b * b)) / (2.0 * a * b))
        inner = _arccos((ends * ends + (a * a - b * b)) / (2.0 * a * np.maximum(ends, _TINY)))
        least, most = np.minimum(*inner), np.maximum(*inner)
        if a > b:  # between the ends the inner angle may have its largest value
            widest = math.sqrt(a * a - b * b)
            most[(ends[0] < widest) & (widest < ends[1])] = math.asin(b / a)
        # half the angle that the cell takes up; seen from inside, it is everywhere
        half = np.where(distance > radius, np.arcsin(radius / np.maximum(distance, radius)), math.pi)
        towards = direction - half - lock.lag
        bounds = np.full((2, x.size), np.inf)
        for way, first, second in ((0, towards - most, bend[1]), (1, towards + least, -bend[0])):
            turn = _least_turn(lock.first, first, 2.0 * half + most - least)
            turn += _least_turn(lock.second, second + lock.lead, bend[0] - bend[1])
            bounds[way, some] = lock.spent + turn - _SPARE_ANGLE
        return bounds


def _arccos(cosine: FloatArray) -> FloatArray:
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def _least_turn(joint: PitchJoint, start: FloatArray, width: FloatArray) -> FloatArray:
    """The least |θ| [rad] that plane angles from ``start`` on give inside the limits; infinite if none."""
    start = start - joint.offset if joint.sense > 0 else joint.offset - start - width
    start = start - TWO_PI * np.rint(start * (1.0 / TWO_PI))
    low, high = joint.low - _SPARE_ANGLE, joint.high + _SPARE_ANGLE
    least = np.full(len(start), np.inf)
    for turns in range(math.ceil((low - 5 * math.pi) / TWO_PI), math.floor((high + math.pi) / TWO_PI) + 1):
        begin = np.maximum(start + TWO_PI * turns, low)
        end = np.minimum(start + (width + TWO_PI * turns), high)
        size = np.maximum(np.maximum(begin, -end), 0.0)
        np.minimum(least, np.where(begin <= end, size, np.inf), out=least)
    return least


# Curves in the plane of (t3, t4) along which the sum of joint angles is stationary.
#
# The condition ``a sin t3 + b sin t4 + c sin(t3 + t4) = 0`` (least_rotation.py derives it) is linear in
# (sin t4, cos t4), so it has two roots t4 at each t3 where it has any.

_SAMPLES = 2001
_STEPS = 60
"""of a search for a root, at most"""


def coefficients(pattern: tuple[int, int, int], lengths: tuple[float, ...]) -> tuple[float, float, float]:
    """a, b, c of the condition for a pattern of senses and the three links."""
    e2, e3, e4 = pattern
    l2, l3, l4 = lengths
    return e4 * l2 * l3, (e2 - e3) * l3 * l4, (e4 - e3) * l2 * l4


class StationaryCurve:
    """A stretch of one root, tabulated over t3 by its squared distance from the first pitch axis."""

    squares: FloatArray
    """(m,) squared distances [m²], one a sample"""

    def __init__(
        self, pattern: tuple[int, int, int], lengths: tuple[float, ...], root: int, t3: FloatArray
    ) -> None:
        self._pattern, self._lengths, self._root, self.t3 = pattern, lengths, root, t3
        self._abc = coefficients(pattern, lengths)
        ratio, along, across = _ratios(self._abc, t3)
        angle = np.arcsin(np.clip(ratio, -1.0, 1.0))
        self.t4: FloatArray = (angle if root == 0 else math.pi - angle) - np.arctan2(across, along)
        l2, l3, l4 = lengths
        cosines = l2 * l3 * np.cos(t3) + l3 * l4 * np.cos(self.t4) + l2 * l4 * np.cos(t3 + self.t4)
        self._rounding = 1e-15 * sum(lengths) ** 2
        self.squares = l2 * l2 + l3 * l3 + l4 * l4 + 2 * cosines

    @classmethod
    def over(
        cls, pattern: tuple[int, int, int], lengths: tuple[float, ...], root: int, low: float, high: float
    ) -> list[StationaryCurve]:
        """The stretches of one root between two t3 [rad], each up to the very point where it ends."""
        t3 = np.linspace(low, high, _SAMPLES)
        abc = coefficients(pattern, lengths)
        real = np.abs(_ratios(abc, t3)[0]) <= 1.0
        edges = np.flatnonzero(np.diff(np.concatenate([[0], real.astype(np.int8), [0]])))
        stretches: list[StationaryCurve] = []
        for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            inside = t3[start:stop]
            ends = [_end(abc, float(t3[i]), float(t3[o])) for i, o in ((start, start - 1), (stop - 1, stop))
                    if 0 <= o < _SAMPLES]  # fmt: skip
            inside = np.unique(np.concatenate([inside, ends]))
            if len(inside) > 1:
                stretches.append(cls(pattern, lengths, root, inside))
        return stretches

    def parts(self, alive: NDArray[np.bool_]) -> list[StationaryCurve]:
        """The stretches where a mask over the samples holds, and one sample more at each end.

        Each is cut where the distance turns, so that along each it only grows or only falls.
        """
        kept = alive[:-1] | alive[1:]  # the steps between samples
        grows = np.diff(self.squares) >= 0.0
        goes_on = kept[:-1] & kept[1:] & (grows[:-1] == grows[1:])
        starts = np.flatnonzero(kept & ~np.concatenate([[False], goes_on]))
        ends = np.flatnonzero(kept & ~np.concatenate([goes_on, [False]])) + 1
        return [
            StationaryCurve(self._pattern, self._lengths, self._root, self.t3[start : end + 1])
            for start, end in zip(starts.tolist(), ends.tolist(), strict=True)
        ]

    def between(self, i: int, square: float) -> tuple[float, float]:
        """The point (t3, t4) at a squared distance [m²] that lies between those of sample i and the next.

        False position; an end that stays twice is taken for half as far off (the Illinois rule).
        """
        low, high = float(self.t3[i]), float(self.t3[i + 1])
        below, above = float(self.squares[i]) - square, float(self.squares[i + 1]) - square
        t3, t4, stayed = low, float(self.t4[i]), 0
        for _ in range(_STEPS):
            if below == above:
                break  # so short a step that rounding alone tells its ends apart
            t3 = (low * above - high * below) / (above - below)
            t4, reached = self._point(t3)
            off = reached - square
            if abs(off) <= self._rounding or not low < t3 < high:
                break
            if (off < 0.0) == (below < 0.0):
                low, below, above = t3, off, 0.5 * above if stayed > 0 else above
                stayed = 1
            else:
                high, above, below = t3, off, 0.5 * below if stayed < 0 else below
                stayed = -1
        return t3, t4

    def _point(self, t3: float) -> tuple[float, float]:
        """t4 and the squared distance at one t3, in plain floats: as the table, but forty times faster."""
        ratio, along, across = _ratio(self._abc, t3)
        angle = math.asin(ratio if -1.0 <= ratio <= 1.0 else math.copysign(1.0, ratio))
        t4 = (angle if self._root == 0 else math.pi - angle) - math.atan2(across, along)
        l2, l3, l4 = self._lengths
        square = l2 * l2 + l3 * l3 + l4 * l4 + 2 * (
            l2 * l3 * math.cos(t3) + l3 * l4 * math.cos(t4) + l2 * l4 * math.cos(t3 + t4)
        )  # fmt: skip
        return t4, square


def _ratios(abc: tuple[float, float, float], t3: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the sine of t4, turned, must be at t3 (m,); and the two factors that turn it."""
    a, b, c = abc
    along, across = b + c * np.cos(t3), c * np.sin(t3)  # along sin t4 + across cos t4 = -a sin t3
    size = np.hypot(along, across)
    return (
        np.divide(-a * np.sin(t3), size, out=np.full_like(t3, np.inf), where=size > 0.0),
        along,
        across,
    )


def _ratio(abc: tuple[float, float, float], t3: float) -> tuple[float, float, float]:
    """The same at one t3."""
    a, b, c = abc
    along, across = b + c * math.cos(t3), c * math.sin(t3)
    size = math.hypot(along, across)
    return (-a * math.sin(t3) / size if size > 0.0 else math.inf), along, across


def _end(abc: tuple[float, float, float], inside: float, outside: float) -> float:
    """The last t3 that has a root, between one that has and one that has none."""
    for _ in range(_STEPS):
        middle = 0.5 * (inside + outside)
        if abs(_ratio(abc, middle)[0]) <= 1.0:
            inside = middle
        else:
            outside = middle
    return inside


# Where along the self-motion of three pitch joints the sum of their turns is stationary, and a minimum.
#
# With plane angles t and senses e_k = ±1 of |θ_k| the condition is that the null vector of the planar
# Jacobian has no component along the senses:
#
# e2 l3 l4 sin t4 - e3 (l4 l2 sin(t3+t4) + l4 l3 sin t4) + e4 (l2 l3 sin t3 + l2 l4 sin(t3+t4)) = 0
#
# which up to a common sign is
#
# e = (+,+,+):  sin t3 = 0
# e = (+,+,-):  l3 sin t3 + 2 l4 sin(t3+t4) = 0
# e = (+,-,+):  l2 l3 sin t3 + 2 l3 l4 sin t4 + 2 l2 l4 sin(t3+t4) = 0
# e = (+,-,-):  2 l4 sin t4 = l2 sin t3
#
# The first is a lock (``pitch_locks.py``). The others are curves that depend on the arm alone, and only their
# distance from the first pitch axis on the target. Where a curve is never a minimum inside the limits it is
# dropped once and for all; along what lives, tables of what the joints turn spare most targets the rest.

_Pattern = tuple[int, int, int]
_PATTERNS: tuple[_Pattern, ...] = ((1, 1, -1), (1, -1, 1), (1, -1, -1))


class LiveCurve:
    """A part of a stationary curve that may hold a minimum: its distance only grows or only falls."""

    def __init__(
        self, curve: StationaryCurve, joints: Sequence[PitchJoint], lengths: tuple[float, ...]
    ) -> None:
        """Tabulate a part; ``joints`` are the three pitch joints, ``lengths`` the links behind them [m]."""
        l2, l3, l4 = lengths
        whole = l2 + np.exp(1j * curve.t3) * (l3 + l4 * np.exp(1j * curve.t4))
        phase = np.unwrap(np.angle(whole))
        turns = _turns(joints[1], curve.t3) + _turns(joints[2], curve.t4)
        # between two samples a smooth function is no farther off than they are apart, or their neighbours
        step = np.diff(curve.t3)
        spent = np.minimum(turns[:-1], turns[1:]) - _wider(np.abs(np.diff(turns))) - step
        slack = _wider(np.abs(np.diff(phase))) + step
        self._curve, self._lengths = curve, lengths
        self._falls = bool(curve.squares[-1] < curve.squares[0])
        order = slice(None, None, -1 if self._falls else 1)  # rows by growing distance
        self._squares: FloatArray = curve.squares[order]
        self._spent, self._slack = spent[order], slack[order]
        self._phase = (phase[:-1] + joints[0].offset)[order]
        self._ascending: list[float] = self._squares.tolist()
        self._rows = list(zip(self._spent.tolist(), self._phase.tolist(), self._slack.tolist(), strict=True))
        self.nearest, self.farthest = self._ascending[0], self._ascending[-1]
        """squared distances [m²] between which the curve has points, but for what falls between samples"""
        self.spent = float(self._spent.min())
        """what the second and the third joint turn at least [rad]"""

    def bound(self, square: float, direction: float) -> float:
        """What the joints turn at least [rad], for a target between ``nearest`` and ``farthest``."""
        spent, phase, slack = self._rows[self._segment(square)]
        return spent + max(0.0, abs(math.remainder(direction - phase, TWO_PI)) - slack)

    def bounds(self, square: FloatArray, direction: FloatArray) -> FloatArray:
        """``bound`` of many targets (k,)."""
        i = np.clip(np.searchsorted(self._squares, square, side="right") - 1, 0, len(self._rows) - 1)
        first = direction - self._phase[i]
        first -= TWO_PI * np.rint(first / TWO_PI)
        return self._spent[i] + np.maximum(0.0, np.abs(first) - self._slack[i])

    def at(self, square: float, direction: float) -> tuple[float, float, float]:
        """The plane angles for a target between ``nearest`` and ``farthest``, to machine precision [rad]."""
        i, (l2, l3, l4) = self._segment(square), self._lengths
        t3, t4 = self._curve.between(len(self._rows) - 1 - i if self._falls else i, square)
        whole = l2 + cmath.exp(1j * t3) * (l3 + l4 * cmath.exp(1j * t4))
        return direction - cmath.phase(whole), t3, t4

    def _segment(self, square: float) -> int:
        return min(max(bisect_right(self._ascending, square) - 1, 0), len(self._rows) - 1)


def live_curves(geometry: YawPitchRoll, joints: Sequence[PitchJoint]) -> list[LiveCurve]:
    """The parts of the stationary curves that can be a minimum inside the limits."""
    low, high = sorted(geometry.plane_angle(1, angle) for angle in (joints[1].low, joints[1].high))
    return sorted(
        (
            LiveCurve(part, joints, geometry.lengths)
            for pattern in _PATTERNS
            for root in (0, 1)
            for piece in StationaryCurve.over(pattern, geometry.lengths, root, low, high)
            for part in piece.parts(_may_be_minimum(pattern, piece, geometry, joints))
        ),
        key=lambda curve: curve.spent,
    )


def _turns(joint: PitchJoint, plane: FloatArray) -> FloatArray:
    """(m,) |θ| [rad] at neighbouring samples; outside the limits as at the last sample inside."""
    angle, inside = _image(joint, plane)
    return np.interp(np.arange(len(angle)), np.flatnonzero(inside), np.abs(angle[inside]))


def _wider(steps: FloatArray) -> FloatArray:
    """The largest of each step and its two neighbours."""
    wide = steps.copy()
    np.maximum(wide[1:], steps[:-1], out=wide[1:])
    np.maximum(wide[:-1], steps[1:], out=wide[:-1])
    return wide


def _may_be_minimum(
    pattern: _Pattern, curve: StationaryCurve, geometry: YawPitchRoll, joints: Sequence[PitchJoint]
) -> NDArray[np.bool_]:
    """Senses that agree with the pattern, the wrist inside its limits, and not a maximum."""
    t3, t4 = curve.t3, curve.t4
    angle3, _ = _image(joints[1], t3)
    angle4, inside = _image(joints[2], t4)
    sense3, sense4 = (np.sign(a) * geometry.signs[k] for k, a in ((1, angle3), (2, angle4)))
    agree = sense3 * sense4 * pattern[1] * pattern[2] >= 0
    # second derivative along the null vector (l3 l4 s4, -(l2 l4 s34 + l3 l4 s4), l2 l3 s3 + l2 l4 s34)
    a, b, c = coefficients(pattern, geometry.lengths)
    l2, l3, l4 = geometry.lengths
    n3 = -(l2 * l4 * np.sin(t3 + t4) + l3 * l4 * np.sin(t4))
    n4 = l2 * l3 * np.sin(t3) + l2 * l4 * np.sin(t3 + t4)
    slope3 = a * np.cos(t3) + c * np.cos(t3 + t4)
    slope4 = b * np.cos(t4) + c * np.cos(t3 + t4)
    curvature = (slope3 * n3 + slope4 * n4) * sense3 * pattern[1]
    return inside & agree & (curvature >= -1e-9 * (l2 + l3 + l4) ** 4)


def _image(joint: PitchJoint, plane: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Joint angle of least magnitude inside its limits for plane angles (m,), and where there is one."""
    sense, offset, low, high = joint
    angle = sense * (plane - offset)
    angle -= TWO_PI * np.rint(angle / TWO_PI)
    angle += TWO_PI * np.ceil(np.maximum(0.0, low - 1e-6 - angle) / TWO_PI)
    angle -= TWO_PI * np.ceil(np.maximum(0.0, angle - high - 1e-6) / TWO_PI)
    return angle, (angle >= low - 1e-6) & (angle <= high + 1e-6)


class LeastRotation:
    """The optimum for one arm and its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self.geometry, self.lengths = geometry, geometry.lengths
        self._shoulder = geometry.shoulder.real, geometry.shoulder.imag
        self._joints = [
            PitchJoint(sense, offset, low, high)
            for sense, offset, (low, high) in zip(
                geometry.signs, geometry.offsets, limits[1:4].tolist(), strict=True
            )
        ]
        self.locks = pitch_locks(geometry, self._joints)
        self.curves = live_curves(geometry, self._joints)
        """what the second and third joint turn there at least, least first"""

    @cached_property
    def _map(self) -> LockMap:
        return LockMap(self.locks, sum(self.lengths))

    def solve(self, branches: list[BaseBranch], height: float) -> tuple[float, ...] | None:
        """The configuration of least rotation.

        Args:
            branches: base angles inside their limits.
            height: of the target above the base origin [m].

        Returns:
            The 4 base and pitch joint angles [rad], or None when no branch has a solution.
        """
        best: Turned | None = None
        base, least = 0.0, math.inf
        for _, yaw, r in branches:
            found = self._in_plane(r, height, least - abs(yaw))
            if found is not None:
                best, base, least = found, yaw, abs(yaw) + found[0]
        return None if best is None else (base, *best[1:])

    def _in_plane(self, r: float, height: float, least: float) -> Turned | None:
        """The best posture for one base angle, if it turns the pitch joints by less than ``least`` [rad]."""
        x, y = r - self._shoulder[0], height - self._shoulder[1]
        best: Turned | None = None
        for bound, lock, side in self._map.at(x, y):
            if bound >= least:
                break  # the rest turn more still
            found = bent_lock(lock, side, x, y)
            if found is not None and found[0] < least:
                best, least = found, found[0]
        if self.curves:
            square, direction = x * x + y * y, math.atan2(y, x)
            for curve in self.curves:
                if curve.spent >= least:
                    break
                if curve.nearest <= square <= curve.farthest and curve.bound(square, direction) < least:
                    angles = self.inside(curve.at(square, direction))
                    energy = math.inf if angles is None else sum(map(abs, angles))
                    if angles is not None and energy < least:
                        best, least = (energy, *angles), energy
        return best

    def inside(self, plane: tuple[float, float, float]) -> tuple[float, float, float] | None:
        """Joint angles of plane angles, if they are inside the limits."""
        angles: list[float] = []
        for t, (sense, offset, low, high) in zip(plane, self._joints, strict=True):
            angle = nearest_image(sense * (t - offset), low, high)
            if angle is None:
                return None
            angles.append(angle)
        return angles[0], angles[1], angles[2]

    def extremes(self, branch: BaseBranch, height: float) -> Iterator[tuple[float, float, float]]:
        """Pitch joint angles [rad] inside the limits with one at a limit or at zero, or the elbow straight.

        Among them are both ends of every continuum of solutions, and the points of least rotation.
        """
        x, y = branch.r - self._shoulder[0], height - self._shoulder[1]
        for lock, side in itertools.product(self.locks, (1, -1)):
            found = bent_lock(lock, side, x, y)
            if found is not None:
                yield found[1:]
        square, direction = x * x + y * y, math.atan2(y, x)
        for curve in self.curves:
            if curve.nearest <= square <= curve.farthest:
                angles = self.inside(curve.at(square, direction))
                if angles is not None:
                    yield angles


# The exact least rotation of many points at once; ``least_rotation.py`` derives the candidates.
#
# Every lock (a joint at a limit or at zero) of every point is solved together, a row a lock and a column a
# point and way to face it. Where rounding weighs on the cosine rule (links nearly in line) and where a
# stationary curve may hold the optimum, the point goes to the scalar solver.

_CHUNK = 512
"""points worked on at a time"""
_NEARLY_STRAIGHT = 1e-7
"""how near to ±1 a cosine may come before the angle from it is worth less than 1e-12 rad"""


class _Locks(NamedTuple):
    """The locks of one joint, as columns (locks, 1); ``Lock`` says what they are."""

    joint: int
    spent: FloatArray
    angle: FloatArray
    x: FloatArray
    y: FloatArray
    near: FloatArray
    far: FloatArray
    lag: FloatArray
    lead: FloatArray


class LeastRotationBatch:
    """The optimum for one arm and its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray, scalar: LeastRotation) -> None:
        self._geometry, self._scalar = geometry, scalar
        self._limits = [(float(low), float(high)) for low, high in limits[:4]]
        self._families = [self._family(k) for k in range(3)]

    def _family(self, joint: int) -> _Locks:
        numbers = [lock[:9] for lock in self._scalar.locks if lock.joint == joint]
        spent, _, *rest = np.array(numbers, dtype=np.float64).reshape(-1, 9).T[:, :, None]
        return _Locks(joint, spent, *rest)

    def solve(self, position: FloatArray) -> FloatArray:
        """The least rotation of each point.

        Args:
            position: (k, 3) tool points in the base frame [m].

        Returns:
            (k, 4) base and pitch joint angles [rad]; NaN where a point is out of reach.
        """
        q = np.full((4, len(position)), np.nan)
        geometry = self._geometry
        forward, left, height = np.ascontiguousarray(((position - geometry.origin) @ geometry.frame).T)
        with np.errstate(invalid="ignore", divide="ignore"):
            yaw, r, faces = base_angles(geometry, forward, left, self._limits[0])
            np.clip(yaw, *self._limits[0], out=yaw)
            for at in range(0, len(position), _CHUNK):
                cut = slice(at, at + _CHUNK)
                self._solve_chunk(yaw[:, cut], r[:, cut], faces[:, cut], height[cut], q[:, cut])
        return q.T

    def _solve_chunk(
        self, yaw: FloatArray, r: FloatArray, faces: NDArray[np.bool_], height: FloatArray, q: FloatArray
    ) -> None:
        m, shoulder = len(height), self._geometry.shoulder
        columns = np.flatnonzero(faces)
        back = columns >= m
        point = columns - m * back
        base = yaw.ravel()[columns]
        x, y = r.ravel()[columns] - shoulder.real, height[point] - shoulder.imag
        square, direction = x * x + y * y, np.arctan2(y, x)
        energy, angles, doubtful = self._least(x, y, square, direction)
        rest = np.abs(base)
        energy += rest
        least = np.full((2, m), np.inf)
        least[back.astype(np.intp), point] = energy
        for side in (0, 1):  # each point is found at most once on each side
            better = np.flatnonzero((back == side) & (energy < np.inf) & (energy <= least[1 - side, point]))
            q[0, point[better]] = base[better]
            for k in range(3):
                q[1 + k, point[better]] = angles[k][better]
        rest = least.min(axis=0)[point] - rest  # what a curve must stay below to matter
        for curve in self._scalar.curves:
            reached = (square >= curve.nearest) & (square <= curve.farthest)
            some = np.flatnonzero(reached & (rest > curve.spent))
            if len(some):
                doubtful[some] |= rest[some] > curve.bounds(square[some], direction[some])
        for i in np.unique(point[doubtful]).tolist():
            branches = [
                BaseBranch(side == 0, float(yaw[side, i]), float(r[side, i]))
                for side in (0, 1)
                if faces[side, i]
            ]
            found = self._scalar.solve(branches, float(height[i]))
            q[:, i] = math.nan if found is None else found

    def _least(
        self, x: FloatArray, y: FloatArray, square: FloatArray, direction: FloatArray
    ) -> tuple[FloatArray, list[FloatArray], NDArray[np.bool_]]:
        """Energy of the pitch joints (infinite out of reach), their angles, and where to look closer."""
        count = len(x)
        energy = np.full(count, np.inf)
        angles = [np.full(count, np.nan) for _ in range(3)]
        doubtful = np.zeros(count, dtype=np.bool_)
        every = np.arange(count)
        for locks in self._families:
            if not len(locks.spent):
                continue
            found, free, near = self._candidates(locks, x, y, square, direction)
            doubtful |= near
            row = found.argmin(axis=0)
            value = found[row, every]
            better = np.flatnonzero(value < energy)
            energy[better] = value[better]
            row, others = row[better], [k for k in range(3) if k != locks.joint]
            angles[locks.joint][better] = locks.angle[row % len(locks.spent), 0]
            for k, values in zip(others, free, strict=True):
                angles[k][better] = np.clip(values[row, better], *self._limits[1 + k])
        return energy, angles, doubtful

    def _candidates(
        self, locks: _Locks, x: FloatArray, y: FloatArray, square: FloatArray, direction: FloatArray
    ) -> tuple[FloatArray, list[FloatArray], NDArray[np.bool_]]:
        """Energies (2 · locks, m), the two free joints' angles (the same shape), and where to look closer."""
        if locks.joint == 0:
            x, y = x - locks.x, y - locks.y
            square, direction = x * x + y * y, np.arctan2(y, x)
        rows = len(locks.spent)
        a, b = locks.near, locks.far
        bend = square - (a * a + b * b)
        bend *= 0.5 / (a * b)
        size = np.abs(bend)
        near = np.any(np.abs(size - 1.0) < _NEARLY_STRAIGHT, axis=0)
        np.arccos(bend, out=bend)
        inner = square + (a * a - b * b)
        inner /= np.sqrt(square) * (2.0 * a)
        np.arccos(inner, out=inner)
        first = np.empty((2 * rows, bend.shape[1]))
        second = np.empty_like(first)
        direction = direction - locks.lag
        np.subtract(direction, inner, out=first[:rows])
        np.add(direction, inner, out=first[rows:])
        np.add(locks.lead, bend, out=second[:rows])
        np.subtract(locks.lead, bend, out=second[rows:])
        geometry, free = self._geometry, [k for k in range(3) if k != locks.joint]
        inside = np.ones(first.shape, dtype=np.bool_)
        energy = np.empty_like(first)
        energy[:rows], energy[rows:] = locks.spent, locks.spent
        for k, angle in zip(free, (first, second), strict=True):
            if geometry.offsets[k]:
                angle -= geometry.offsets[k]
            if geometry.signs[k] < 0:
                np.negative(angle, out=angle)
            inside &= into_limits(angle, *self._limits[1 + k])
            energy += np.abs(angle)
        energy[~inside] = np.inf
        return energy, [first, second], near
