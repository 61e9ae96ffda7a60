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

import math
from collections.abc import Sequence
from math import acos, atan2, pi, sqrt

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
_Pattern = tuple[int, int, int]
_Turned = tuple[float, float, float, float]
"""what the pitch joints turn in all, and their angles [rad]"""
_Free = tuple[int, float, float, float]
"""a free joint: sense and constant, θ = sense · plane angle + constant, and its limits [rad]"""
_Lock = tuple[
    float, float, float, float, float, float, float, float, float, int, float, *_Free, *_Free
]  # fmt: skip
"""One pitch joint held; the other two follow from a triangle. A plain tuple, unpacked in each round.

|θ| of the joint [rad]; x, y of the triangle's first corner [m]; squares and scale, with which the cosine of
the bend is scale · (squared distance from there - squares); the cosines between which the bend is inside its
limits; both links [m]; which joint is held, 0, 1 or 2, and at which θ [rad]; the free joints, the first with
its constant for the direction of the near link, the second for the bend.
"""


class LeastRotation:
    """The least rotation of one arm inside its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: ToolPlane, limits: FloatArray) -> None:
        self._geometry, self._limits = geometry, limits
        self._ranges: list[tuple[float, float]] = [(low, high) for low, high in limits[1:4].tolist()]
        self._locks = sorted(
            lock for k in range(3) for angle in self._rests(k) for lock in self._lock(k, angle)
        )
        self._bands = [(pattern, *band) for pattern in _PATTERNS if (band := self._band(pattern)) is not None]

    def solve(self, branches: list[BaseBranch], height: float) -> tuple[float, ...] | None:
        """The 4 base and pitch joint angles of least rotation [rad], or None when no branch has a solution.

        For base angles inside their limits and the height of the target above the base origin [m].
        """
        best, least = None, math.inf
        shoulder = self._geometry.shoulder
        y = height - shoulder.imag
        for _, yaw, r in branches:
            x, spent = r - shoulder.real, abs(yaw)
            found = _least_of(self._locks, x, y, least - spent)
            if self._bands:
                found = self._stationary(x, y, least - spent if found is None else found[0]) or found
            if found is not None:
                best, least = (yaw, *found[1:]), spent + found[0]
        return best

    def extremes(self, branch: BaseBranch, height: float) -> list[tuple[float, float, float]]:
        """Pitch joint angles [rad] inside the limits with one at a limit or at zero, or the elbow straight.

        Among them are both ends of every continuum of solutions.
        """
        shoulder = self._geometry.shoulder
        every: list[_Turned] = []
        _least_of(self._locks, branch.r - shoulder.real, height - shoulder.imag, math.inf, every)
        return [posture[1:] for posture in every]

    def _rests(self, k: int) -> set[float]:
        """Angles at which |θ| of a pitch joint has an end or a kink [rad]; of the second also sin t3 = 0."""
        low, high = self._ranges[k]
        angles = {low, high, *((0.0,) if low < 0 < high else ())}
        if k == 1:
            straight = (self._geometry.joint_angle(1, v) for v in (0.0, math.pi))
            angles |= {a for v in straight if (a := nearest_image(v, low, high)) is not None}
        return angles

    def _lock(self, k: int, angle: float) -> list[_Lock]:
        """A pitch joint held at an angle [rad]; none where it folds its two links onto each other."""
        geometry, (l2, l3, l4) = self._geometry, self._geometry.lengths
        v = geometry.plane_angle(k, angle)
        x, y, near, far, lag, lead = 0.0, 0.0, l3, l4, v, 0.0
        if k == 0:
            x, y = l2 * math.cos(v), l2 * math.sin(v)
        elif k == 1:
            near, lag = joined(l2, l3, v)
            lead = lag - v
        else:
            far, turn = joined(l3, l4, v)
            near, lag, lead = l2, 0.0, -turn
        if min(near, far) < 1e-12:
            return []
        (i, first), (j, second) = ((i, span) for i, span in enumerate(self._ranges) if i != k)
        sense, offset = geometry.signs[j], geometry.offsets[j] - lead
        cosines = cosines_within(*sorted(sense * limit + offset for limit in second))
        return [(
            abs(angle), x, y, near * near + far * far, 0.5 / (near * far), *cosines, near, far, k, angle,
            geometry.signs[i], -geometry.signs[i] * (lag + geometry.offsets[i]), *first,
            sense, -sense * offset, *second,
        )]  # fmt: skip

    def _stationary(self, x: float, y: float, least: float) -> _Turned | None:
        """The best posture with a stationary sum, if it turns the joints by less than ``least`` [rad]."""
        best, square = None, x * x + y * y
        for pattern, nearest, farthest, spent in self._bands:
            if nearest <= square <= farthest and spent < least:
                found = _least_of(self._stationary_locks(pattern, square), x, y, least)
                if found is not None:
                    best, least = found, found[0]
        return best

    def _stationary_locks(self, pattern: _Pattern, square: float) -> list[_Lock]:
        """Locks of the second joint where the sum of a pattern is stationary, at a squared distance [m²]."""
        l2, l3, l4 = self._geometry.lengths
        a, b, c = _coefficients(pattern, self._geometry.lengths)
        t3 = np.linspace(0.0, TWO_PI, 4 * _DEGREE, endpoint=False)
        cos, sin = np.cos(t3), np.sin(t3)
        # p cos t4 + q sin t4 = k from the distance, u cos t4 + v sin t4 = w from the condition
        p, q = l3 + l2 * cos, -l2 * sin
        k = (0.5 * (square - l2**2 - l3**2 - l4**2) - l2 * l3 * cos) / l4
        u, v, w = c * sin, b + c * cos, -a * sin
        value = (k * v - w * q) ** 2 + (p * w - u * k) ** 2 - (p * v - u * q) ** 2
        size = np.abs(value).max()
        if size == 0.0:
            return []
        spectrum = np.fft.fft(value / size)
        z = np.roots(spectrum[np.arange(_DEGREE, -_DEGREE - 1, -1)])
        roots = np.angle(z[np.abs(np.abs(z) - 1.0) < _CIRCLE]).tolist()
        angles = (nearest_image(self._geometry.joint_angle(1, t), *self._ranges[1]) for t in roots)
        return sorted(lock for angle in angles if angle is not None for lock in self._lock(1, angle))

    def _band(self, pattern: _Pattern) -> tuple[float, float, float] | None:
        """Where a pattern may hold a minimum, from samples of t3 and the ones next to them.

        The least and greatest squared distance from the first pitch axis [m²], and what the second and third
        joint turn there at least [rad]. The senses must agree with the pattern, both joints be inside their
        limits, and the sum not have a maximum. Without a band, as on uzuner, a target needs no eigenvalues.
        """
        geometry, (l2, l3, l4) = self._geometry, self._geometry.lengths
        a, b, c = _coefficients(pattern, geometry.lengths)
        low, high = geometry.plane_limits(1, self._limits)
        t3 = np.linspace(low, high, _SAMPLES)
        along, across = b + c * np.cos(t3), c * np.sin(t3)  # along sin t4 + across cos t4 = -a sin t3
        sine = -a * np.sin(t3) / np.maximum(np.hypot(along, across), 1e-300)
        lean = np.arcsin(np.clip(sine, -1.0, 1.0))
        t3, t4 = np.broadcast_arrays(t3, np.stack([lean, math.pi - lean]) - np.arctan2(across, along))
        (angle3, _), (angle4, inside) = self._image(1, t3), self._image(2, t4)
        sense3, sense4 = np.sign(angle3) * geometry.signs[1], np.sign(angle4) * geometry.signs[2]
        agree = sense3 * sense4 * pattern[1] * pattern[2] >= 0
        # second derivative along the null vector (…, n3, n4) of the planar Jacobian
        n3 = -(l2 * l4 * np.sin(t3 + t4) + l3 * l4 * np.sin(t4))
        n4 = l2 * l3 * np.sin(t3) + l2 * l4 * np.sin(t3 + t4)
        slope3 = a * np.cos(t3) + c * np.cos(t3 + t4)
        slope4 = b * np.cos(t4) + c * np.cos(t3 + t4)
        curvature = (slope3 * n3 + slope4 * n4) * sense3 * pattern[1]
        alive = inside & agree & (np.abs(sine) <= 1.0) & (curvature >= -1e-9 * (l2 + l3 + l4) ** 4)
        if not alive.any():
            return None
        alive[:, 1:] |= alive[:, :-1].copy()
        alive[:, :-1] |= alive[:, 1:].copy()
        cosines = l2 * l3 * np.cos(t3) + l3 * l4 * np.cos(t4) + l2 * l4 * np.cos(t3 + t4)
        square = (l2**2 + l3**2 + l4**2 + 2 * cosines)[alive]
        slack = 2.0 * (high - low) / (_SAMPLES - 1)
        room = slack * (l2 + l3 + l4) ** 2
        spent = float((np.abs(angle3) + np.abs(angle4))[alive].min()) - slack
        return float(square.min()) - room, float(square.max()) + room, spent

    def _image(self, k: int, plane: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Joint angles nearest to zero inside the limits of pitch joint k, and where there is one."""
        low, high = self._ranges[k]
        angle = self._geometry.signs[k] * (plane - self._geometry.offsets[k])
        return angle, into_limits(angle, low - 1e-6, high + 1e-6)

    # Many points at once: the same locks, one after the other, over arrays of points.

    def solve_many(self, position: FloatArray) -> FloatArray:
        """``solve`` for tool points (k, 3) in the base frame [m]: (k, 4) [rad], NaN where out of reach."""
        geometry, count = self._geometry, len(position)
        forward, left, height = np.ascontiguousarray(((position - geometry.origin) @ geometry.frame).T)
        q, least = np.full((4, count), np.nan), np.full(count, np.inf)
        doubtful = np.zeros(count, dtype=np.bool_)
        low, high = self._limits[0].tolist()
        with np.errstate(invalid="ignore", divide="ignore"):
            yaw, r, faces = base_angles(geometry, forward, left, (low, high))
            np.clip(yaw, low, high, out=yaw)
            x, y = r - geometry.shoulder.real, height - geometry.shoulder.imag
            for side in (0, 1):
                rows = np.flatnonzero(faces[side])
                energy, angles, close = self._least_of(x[side, rows], y[rows])
                energy += np.abs(yaw[side, rows])
                better = energy < least[rows]
                least[rows[better]] = energy[better]
                q[:, rows[better]] = np.vstack([yaw[side, rows], *angles])[:, better]
                doubtful[rows[close]] = True
            for _, nearest, farthest, spent in self._bands:
                square = x * x + y * y
                near = (nearest <= square) & (square <= farthest) & faces
                doubtful |= (near & (spent + np.abs(yaw) < least)).any(axis=0)
        for i in np.flatnonzero(doubtful).tolist():
            sides = np.flatnonzero(faces[:, i]).tolist()
            branches = [BaseBranch(side == 0, float(yaw[side, i]), float(r[side, i])) for side in sides]
            found = self.solve(branches, float(height[i]))
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
        for lock in self._locks:
            spent, held_x, held_y, squares, scale, _, _, near, far, joint, angle, *free = lock
            sense1, c1, low1, high1, sense2, c2, low2, high2 = free
            dx, dy = x - held_x, y - held_y
            cosine = (dx * dx + dy * dy - squares) * scale
            doubtful |= np.abs(np.abs(cosine) - 1.0) < 1.0 - _SURE
            bend, towards = np.arccos(cosine), np.arctan2(dy, dx)
            inner = np.arctan2(far * np.sqrt(1.0 - cosine * cosine), near + far * cosine)
            for side in (1, -1):
                first, second = sense1 * (towards - side * inner) + c1, (sense2 * side) * bend + c2
                inside = into_limits(first, low1, high1)
                inside &= into_limits(second, low2, high2)
                turn = spent + np.abs(first) + np.abs(second)
                better = np.flatnonzero(inside & (turn < energy))
                energy[better] = turn[better]
                posture = [np.clip(first[better], low1, high1), np.clip(second[better], low2, high2)]
                posture.insert(joint, np.full(len(better), angle))
                for row, values in zip(angles, posture, strict=True):
                    row[better] = values
        return energy, angles, doubtful


def _coefficients(pattern: _Pattern, lengths: Sequence[float]) -> tuple[float, float, float]:
    """Factors of sin t3, sin t4 and sin(t3 + t4) in the condition for a pattern of senses."""
    e2, e3, e4 = pattern
    l2, l3, l4 = lengths
    return e4 * l2 * l3, (e2 - e3) * l3 * l4, (e4 - e3) * l2 * l4


def _least_of(
    locks: Sequence[_Lock], x: float, y: float, least: float, every: list[_Turned] | None = None
) -> _Turned | None:
    """The least turned posture inside the limits, with one of some locks (the least turned first).

    For a point x forward, y up of the first pitch axis [m]; only what turns the joints by less than ``least``
    [rad] counts. ``every`` takes every posture that counts, if given; then no best one is looked for.
    """
    best: _Turned | None = None
    for (
        spent, held_x, held_y, squares, scale, sharpest, slightest, near, far, joint, angle,
        sense1, c1, low1, high1, sense2, c2, low2, high2,
    ) in locks:  # fmt: skip
        if spent >= least:
            break  # the rest turn more still
        dx, dy = x - held_x, y - held_y
        square = dx * dx + dy * dy
        cosine = (square - squares) * scale
        if not sharpest < cosine < slightest:
            continue
        sure = -_SURE < cosine < _SURE
        bend = acos(cosine) if sure else bend_angle(square, near, far)
        if bend is None:
            continue
        towards: float | None = None
        inner = 0.0
        for side in (1, -1) if sure or 0.0 < bend < pi else (1,):
            b: float | None = sense2 * side * bend + c2
            if not (low2 <= b <= high2 and -pi <= b <= pi):
                b = nearest_image(b, low2, high2)
            if b is None or spent + abs(b) >= least:
                continue
            if towards is None:
                towards = atan2(dy, dx)
                if sure:
                    inner = atan2(far * sqrt(1.0 - cosine * cosine), near + far * cosine)
                else:
                    inner = inner_angle(near, far, bend)
            a: float | None = sense1 * (towards - side * inner) + c1
            if not (low1 <= a <= high1 and -pi <= a <= pi):
                a = nearest_image(a, low1, high1)
            if a is None:
                continue
            turn = spent + abs(a) + abs(b)
            if turn < least:
                if joint == 0:
                    best = (turn, angle, a, b)
                elif joint == 1:
                    best = (turn, a, angle, b)
                else:
                    best = (turn, a, b, angle)
                if every is None:
                    least = turn
                else:
                    every.append(best)
    return best
