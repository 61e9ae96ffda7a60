"""The least rotation: min Σ|θ| over the continuum, exact.

Between the points where a joint passes zero the sum is smooth along the self-motion, so a minimum lies

* where a joint is at a limit or at zero, or sin t3 = 0: the arm with that joint locked is a triangle; or
* where the sum is stationary. With senses e_k = ±1 of |θ_k| the null vector of the planar Jacobian has no
  component along the senses there:

      e4 l2 l3 sin t3 + (e2 - e3) l3 l4 sin t4 + (e4 - e3) l2 l4 sin(t3 + t4) = 0

  e = (+,+,+) is sin t3 = 0. For the other three this and the distance of the target, both linear in cos t4
  and sin t4, leave a polynomial of degree 8 in exp(i t3), whose roots are eigenvalues. Each root is one more
  angle at which to lock the second joint, so that rounding in a root costs no accuracy of the tip.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from math import acos, atan2, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import TWO_PI, into_limits, nearest_image
from armctl.kinematics.tool_plane import ToolPlane
from armctl.kinematics.yaw_pitch_roll.closed_form import bend_angle, cosines_within, inner_angle
from armctl.kinematics.yaw_pitch_roll.free_joint import joined
from armctl.kinematics.yaw_pitch_roll.geometry import BaseBranch, base_angles

_PATTERNS = ((1, 1, -1), (1, -1, 1), (1, -1, -1))
_SAMPLES = 2001
_DEGREE = 4
_CIRCLE = 1e-2
"""how far off the unit circle a root may lie, for rounding splits a double one: one too many is harmless"""
_SURE = 1.0 - 1e-7
"""up to this cosine the angle from it is good to 1e-12 rad"""
Turned = tuple[float, float, float, float]
"""what the pitch joints turn in all, and their angles [rad]"""


class _PitchJoint(NamedTuple):
    """θ = sense · (t - offset), t the plane angle; between limits [rad]."""

    sense: int
    offset: float
    low: float
    high: float


class _Triangle(NamedTuple):
    """What is left of the arm with one pitch joint held."""

    near: float
    far: float
    """its two links [m]"""
    joint: int
    """which joint is held, 0, 1 or 2: first, second or third pitch joint"""
    angle: float
    """at which θ [rad]"""
    lag: float
    lead: float
    """plane angles of the free joints: the first angle less ``lag``, the bend and ``lead`` [rad]"""
    first: _PitchJoint
    second: _PitchJoint
    """the free joints"""


class _Lock(NamedTuple):
    """One pitch joint held; the other two follow from a triangle."""

    spent: float
    """|θ| of the joint [rad]"""
    x: float
    y: float
    """with the first joint held, the end of its link [m]; else 0"""
    squares: float
    scale: float
    """cosine of the bend = scale · (squared distance from there - squares)"""
    sharpest: float
    slightest: float
    """cosines between which the bend is inside its limits"""
    triangle: _Triangle


class _Band(NamedTuple):
    """Targets for which one pattern of senses may hold the least rotation."""

    pattern: tuple[int, int, int]
    nearest: float
    farthest: float
    """squared distances from the first pitch axis [m²]"""
    spent: float
    """what the second and third joint turn there at least [rad]"""


class LeastRotation:
    """The least rotation of one arm inside its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: ToolPlane, limits: FloatArray) -> None:
        self._geometry, self._limits = geometry, limits
        self._joints = [
            _PitchJoint(sense, offset, low, high)
            for sense, offset, (low, high) in zip(
                geometry.signs, geometry.offsets, limits[1:4].tolist(), strict=True
            )
        ]
        self._locks = sorted(
            lock for k in range(3) for angle in self._rests(k) if (lock := self._lock(k, angle)) is not None
        )
        self._bands = [band for pattern in _PATTERNS for band in self._bands_of(pattern)]

    def solve(self, branches: list[BaseBranch], height: float) -> tuple[float, ...] | None:
        """The configuration of least rotation.

        Args:
            branches: base angles inside their limits.
            height: of the target above the base origin [m].

        Returns:
            The 4 base and pitch joint angles [rad], or None when no branch has a solution.
        """
        best, least = None, math.inf
        for _, yaw, r in branches:
            found = self._in_plane(r, height, least - abs(yaw))
            if found is not None:
                best, least = (yaw, *found[1:]), abs(yaw) + found[0]
        return best

    def extremes(self, branch: BaseBranch, height: float) -> list[tuple[float, float, float]]:
        """Pitch joint angles [rad] inside the limits with one at a limit or at zero, or the elbow straight.

        Among them are both ends of every continuum of solutions.
        """
        x, y = branch.r - self._geometry.shoulder.real, height - self._geometry.shoulder.imag
        every: list[Turned] = []
        _least_of(self._locks, x, y, math.inf, every)
        return [posture[1:] for posture in every]

    def _rests(self, k: int) -> set[float]:
        """Angles at which |θ| of a pitch joint has an end or a kink [rad]; of the second also sin t3 = 0."""
        _, _, low, high = self._joints[k]
        angles = {low, high, *((0.0,) if low < 0 < high else ())}
        if k == 1:
            straight = (self._geometry.joint_angle(1, v) for v in (0.0, math.pi))
            angles |= {a for v in straight if (a := nearest_image(v, low, high)) is not None}
        return angles

    def _lock(self, k: int, angle: float) -> _Lock | None:
        """A pitch joint held at an angle [rad]; None where it folds its two links onto each other."""
        l2, l3, l4 = self._geometry.lengths
        v = self._geometry.plane_angle(k, angle)
        first, second = (joint for i, joint in enumerate(self._joints) if i != k)
        x, y, near, far, lag, lead = 0.0, 0.0, l3, l4, v, 0.0
        if k == 0:
            x, y = l2 * math.cos(v), l2 * math.sin(v)
        elif k == 1:
            near, turn = joined(l2, l3, v)
            lag, lead = turn, turn - v
        else:
            far, turn = joined(l3, l4, v)
            near, lag, lead = l2, 0.0, -turn
        if min(near, far) < 1e-12:
            return None
        ends = sorted(second.sense * limit + second.offset - lead for limit in second[2:])
        cosines = cosines_within(ends[0], ends[1])
        triangle = _Triangle(near, far, k, angle, lag, lead, first, second)
        return _Lock(abs(angle), x, y, near * near + far * far, 0.5 / (near * far), *cosines, triangle)

    def _in_plane(self, r: float, height: float, least: float) -> Turned | None:
        """The best posture for one base angle, if it turns the pitch joints by less than ``least`` [rad]."""
        x, y = r - self._geometry.shoulder.real, height - self._geometry.shoulder.imag
        best = _least_of(self._locks, x, y, least)
        if best is not None:
            least = best[0]
        if self._bands:
            square = x * x + y * y
            near = [band for band in self._bands if band.nearest <= square <= band.farthest]
            for pattern in {band.pattern for band in near if band.spent < least}:
                found = _least_of(self._stationary(pattern, square), x, y, least)
                if found is not None:
                    best, least = found, found[0]
        return best

    def _stationary(self, pattern: tuple[int, int, int], square: float) -> list[_Lock]:
        """Locks of the second joint where the sum of a pattern is stationary, at a squared distance [m²]."""
        l2, l3, l4 = self._geometry.lengths
        a, b, c = _coefficients(pattern, self._geometry.lengths)
        t3 = np.linspace(0.0, TWO_PI, 4 * _DEGREE, endpoint=False)
        cos, sin = np.cos(t3), np.sin(t3)
        # p cos t4 + q sin t4 = k from the distance, u cos t4 + v sin t4 = w from the condition
        p, q, k = (
            l3 + l2 * cos,
            -l2 * sin,
            (0.5 * (square - l2**2 - l3**2 - l4**2) - l2 * l3 * cos) / l4,
        )
        u, v, w = c * sin, b + c * cos, -a * sin
        value = (k * v - w * q) ** 2 + (p * w - u * k) ** 2 - (p * v - u * q) ** 2
        size = np.abs(value).max()
        if size == 0.0:
            return []
        spectrum = np.fft.fft(value / size)
        z = np.roots(spectrum[np.arange(_DEGREE, -_DEGREE - 1, -1)])
        _, _, low, high = self._joints[1]
        angles = (
            nearest_image(self._geometry.joint_angle(1, angle), low, high)
            for angle in np.angle(z[np.abs(np.abs(z) - 1.0) < _CIRCLE]).tolist()
        )
        locks = (self._lock(1, angle) for angle in angles if angle is not None)
        return sorted(lock for lock in locks if lock is not None)

    def _bands_of(self, pattern: tuple[int, int, int]) -> Iterator[_Band]:
        """Where a pattern may hold a minimum: runs of samples of t3, and the ones next to them.

        The senses must agree with the pattern, both joints be inside their limits, and the sum not have a
        maximum. Without a band, as on uzuner, a target needs no eigenvalues.
        """
        l2, l3, l4 = self._geometry.lengths
        a, b, c = _coefficients(pattern, self._geometry.lengths)
        low, high = self._geometry.plane_limits(1, self._limits)
        t3 = np.linspace(low, high, _SAMPLES)
        along, across = b + c * np.cos(t3), c * np.sin(t3)  # along sin t4 + across cos t4 = -a sin t3
        sine = -a * np.sin(t3) / np.maximum(np.hypot(along, across), 1e-300)
        lean = np.arcsin(np.clip(sine, -1.0, 1.0))
        slack = 2.0 * (high - low) / (_SAMPLES - 1)
        for root in (lean, math.pi - lean):
            t4 = root - np.arctan2(across, along)
            (angle3, _), (angle4, inside) = self._image(1, t3), self._image(2, t4)
            sense3, sense4 = np.sign(angle3) * self._joints[1].sense, np.sign(angle4) * self._joints[2].sense
            agree = sense3 * sense4 * pattern[1] * pattern[2] >= 0
            # second derivative along the null vector (…, n3, n4) of the planar Jacobian
            n3 = -(l2 * l4 * np.sin(t3 + t4) + l3 * l4 * np.sin(t4))
            n4 = l2 * l3 * np.sin(t3) + l2 * l4 * np.sin(t3 + t4)
            slope3 = a * np.cos(t3) + c * np.cos(t3 + t4)
            slope4 = b * np.cos(t4) + c * np.cos(t3 + t4)
            curvature = (slope3 * n3 + slope4 * n4) * sense3 * pattern[1]
            alive = inside & agree & (np.abs(sine) <= 1.0) & (curvature >= -1e-9 * (l2 + l3 + l4) ** 4)
            wide = np.zeros(_SAMPLES + 2, dtype=np.int8)
            for shift in range(3):
                wide[shift : shift + _SAMPLES] |= alive
            wide[[0, -1]] = 0
            cosines = l2 * l3 * np.cos(t3) + l3 * l4 * np.cos(t4) + l2 * l4 * np.cos(t3 + t4)
            square, spent = l2**2 + l3**2 + l4**2 + 2 * cosines, np.abs(angle3) + np.abs(angle4)
            edges = np.flatnonzero(np.diff(wide)).tolist()
            for start, stop in zip(edges[::2], edges[1::2], strict=True):
                run, room = slice(start, stop), slack * (l2 + l3 + l4) ** 2
                nearest, farthest = float(square[run].min()) - room, float(square[run].max()) + room
                yield _Band(pattern, nearest, farthest, float(spent[run].min()) - slack)

    def _image(self, k: int, plane: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Joint angles nearest to zero inside the limits of pitch joint k, and where there is one."""
        sense, offset, low, high = self._joints[k]
        angle = sense * (plane - offset)
        inside = into_limits(angle, low - 1e-6, high + 1e-6)
        return angle, inside

    # Many points at once: the same locks, one after the other, over arrays of points.

    def solve_many(self, position: FloatArray) -> FloatArray:
        """The least rotation of many points.

        Args:
            position: (k, 3) tool points in the base frame [m].

        Returns:
            (k, 4) base and pitch joint angles [rad]; NaN where a point is out of reach.
        """
        geometry, count = self._geometry, len(position)
        forward, left, height = np.ascontiguousarray(((position - geometry.origin) @ geometry.frame).T)
        q, least = np.full((4, count), np.nan), np.full(count, np.inf)
        doubtful = np.zeros(count, dtype=np.bool_)
        low, high = self._limits[0].tolist()
        with np.errstate(invalid="ignore", divide="ignore"):
            yaw, r, faces = base_angles(geometry, forward, left, (low, high))
            np.clip(yaw, low, high, out=yaw)
            for side in (0, 1):
                rows = np.flatnonzero(faces[side])
                x, y = r[side, rows] - geometry.shoulder.real, height[rows] - geometry.shoulder.imag
                energy, angles, close = self._least_of(x, y)
                energy += np.abs(yaw[side, rows])
                better = energy < least[rows]
                least[rows[better]] = energy[better]
                q[:, rows[better]] = np.vstack([yaw[side, rows], *angles])[:, better]
                doubtful[rows[close]] = True
            for side, band in itertools.product((0, 1), self._bands):
                square = (r[side] - geometry.shoulder.real) ** 2 + (height - geometry.shoulder.imag) ** 2
                near = (band.nearest <= square) & (square <= band.farthest) & faces[side]
                doubtful |= near & (band.spent + np.abs(yaw[side]) < least)
        for i in np.flatnonzero(doubtful).tolist():
            ways = zip((True, False), yaw[:, i].tolist(), r[:, i].tolist(), faces[:, i].tolist(), strict=True)
            found = self.solve([BaseBranch(*way[:3]) for way in ways if way[3]], float(height[i]))
            q[:, i] = math.nan if found is None else found
        return q.T

    def _least_of(
        self, x: FloatArray, y: FloatArray
    ) -> tuple[FloatArray, list[FloatArray], NDArray[np.bool_]]:
        """Σ|θ| of the pitch joints over all locks (infinite out of reach), and their angles.

        And where a triangle is so nearly flat that the scalar formulas must decide.
        """
        energy, doubtful = np.full(len(x), np.inf), np.zeros(len(x), dtype=np.bool_)
        angles = [np.full(len(x), np.nan) for _ in range(3)]
        for spent, held_x, held_y, squares, scale, _, _, triangle in self._locks:
            dx, dy, (near, far, joint, angle, lag, lead, first_joint, second_joint) = (
                x - held_x,
                y - held_y,
                triangle,
            )
            cosine = (dx * dx + dy * dy - squares) * scale
            doubtful |= np.abs(np.abs(cosine) - 1.0) < 1.0 - _SURE
            bend = np.arccos(cosine)
            inner = np.arctan2(far * np.sqrt(1.0 - cosine * cosine), near + far * cosine)
            towards = np.arctan2(dy, dx) - lag
            for side in (1, -1):
                first = first_joint.sense * (towards - side * inner - first_joint.offset)
                second = second_joint.sense * (side * bend + lead - second_joint.offset)
                inside = into_limits(first, *first_joint[2:])
                inside &= into_limits(second, *second_joint[2:])
                turn = spent + np.abs(first) + np.abs(second)
                better = np.flatnonzero(inside & (turn < energy))
                energy[better] = turn[better]
                free = iter((np.clip(first, *first_joint[2:]), np.clip(second, *second_joint[2:])))
                for k in range(3):
                    angles[k][better] = angle if k == joint else next(free)[better]
        return energy, angles, doubtful


def _coefficients(pattern: tuple[int, int, int], lengths: Sequence[float]) -> tuple[float, float, float]:
    """Factors of sin t3, sin t4 and sin(t3 + t4) in the condition for a pattern of senses."""
    e2, e3, e4 = pattern
    l2, l3, l4 = lengths
    return e4 * l2 * l3, (e2 - e3) * l3 * l4, (e4 - e3) * l2 * l4


def _least_of(
    locks: Sequence[_Lock], x: float, y: float, least: float, every: list[Turned] | None = None
) -> Turned | None:
    """The least turned posture that reaches a point with one of some locks, inside the limits.

    Args:
        locks: by what the locked joint turns, least first.
        x: the point, seen from the first pitch axis, forward [m].
        y: and upward [m].
        least: only what turns the joints by less counts [rad].
        every: takes every posture that counts, if given; then no best one is looked for.
    """
    best: Turned | None = None
    for spent, held_x, held_y, squares, scale, sharpest, slightest, triangle in locks:
        if spent >= least:
            break  # the rest turn more still
        dx, dy = x - held_x, y - held_y
        cosine = (dx * dx + dy * dy - squares) * scale
        if not sharpest < cosine < slightest:
            continue
        near, far, joint, angle, lag, lead, (sense1, o1, low1, high1), (sense2, o2, low2, high2) = triangle
        sure = -_SURE < cosine < _SURE
        bend = acos(cosine) if sure else bend_angle(dx * dx + dy * dy, near, far)
        if bend is None:
            continue
        towards: float | None = None
        inner = 0.0
        for side in (1, -1) if sure or 0.0 < bend < pi else (1,):
            b: float | None = sense2 * (side * bend + lead - o2)
            if not (low2 <= b <= high2 and -pi <= b <= pi):
                b = nearest_image(b, low2, high2)
            if b is None or spent + abs(b) >= least:
                continue
            if towards is None:
                towards = atan2(dy, dx) - lag
                inner = (
                    atan2(far * sqrt(1.0 - cosine * cosine), near + far * cosine)
                    if sure
                    else inner_angle(near, far, bend)
                )
            a: float | None = sense1 * (towards - side * inner - o1)
            if not (low1 <= a <= high1 and -pi <= a <= pi):
                a = nearest_image(a, low1, high1)
            if a is None:
                continue
            turn = spent + abs(a) + abs(b)
            if turn < least:
                best = (
                    (turn, angle, a, b)
                    if joint == 0
                    else (turn, a, angle, b)
                    if joint == 1
                    else (turn, a, b, angle)
                )
                if every is None:
                    least = turn
                else:
                    every.append(best)
    return best
