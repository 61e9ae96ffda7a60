"""The least rotation: min Σ|θ| over the continuum, exact.

A minimum lies where a joint is at a limit or at zero, or sin t3 = 0: with that joint locked the arm is a
triangle. Or it lies where the sum is stationary: with senses e_k = ±1 of |θ_k| (times the weights w_k of a
weighted sum) the null vector of the planar Jacobian has no component along them,

    e4 l2 l3 sin t3 + (e2 - e3) l3 l4 sin t4 + (e4 - e3) l2 l4 sin(t3 + t4) = 0

e = (+,+,+) is sin t3 = 0. For the other three this and the distance of the target, both linear in cos t4 and
sin t4, leave a polynomial of degree 8 in exp(i t3). Each root is one more angle at which to lock the second
joint, so rounding in a root costs no accuracy of the tip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from math import acos, atan2, pi, sqrt

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.angles import TWO_PI, into_limits, nearest_image, trigonometric_zeros
from armctl.kinematics.families.yaw_pitch_roll.closed_form import bend_angle, cosines_within, inner_angle
from armctl.kinematics.families.yaw_pitch_roll.free_joint import joined
from armctl.kinematics.families.yaw_pitch_roll.geometry import BaseBranch
from armctl.kinematics.subproblems import ToolPlane

_PATTERNS = ((1, 1, -1), (1, -1, 1), (1, -1, -1))
_SAMPLES = 2001
_DEGREE = 4
_SURE = 1.0 - 1e-7
"""up to this cosine the angle from it is good to 1e-12 rad"""
_Turned = tuple[float, float, float, float]
"""what the pitch joints turn in all, and their angles [rad]"""
_Lock = tuple[float, ...]
"""One pitch joint held; the other two follow from a triangle. A plain tuple, unpacked in each round.

|θ| of the joint [rad]; x, y of the triangle's first corner [m]; squares and scale, with which the cosine of
the bend is scale · (squared distance from there - squares); the cosines between which the bend is inside its
limits; both links [m]; which joint is held, 0, 1 or 2, and at which θ [rad]. Then of either free joint sense
and constant, θ = sense · plane angle + constant, and limits [rad]: the near link's direction, the bend.
"""


class LeastRotation:
    """The least rotation of one arm inside its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: ToolPlane, limits: FloatArray) -> None:
        self._geometry, self._limits = geometry, limits
        self._ranges: list[tuple[float, float]] = [(low, high) for low, high in limits[1:4].tolist()]
        self._locks = sorted(
            lock for k in range(3) for angle in self._rests(k) for lock in self._lock(k, angle)
        )

    @cached_property
    def _bands(self) -> list[tuple[float, ...]]:
        return [band for pattern in _PATTERNS if (band := self._band(*pattern)) is not None]

    def solve(self, branches: Sequence[BaseBranch], height: float) -> tuple[float, ...] | None:
        """The 4 base and pitch joint angles of least rotation [rad], or None when no branch has a solution.

        For base angles inside their limits and the height of the target above the base origin [m].
        """
        best, least = None, math.inf
        shoulder = self._geometry.shoulder
        y = height - shoulder.imag
        for _, yaw, r in branches:
            x, spent = r - shoulder.real, abs(yaw)
            found = _least_of(self._locks, x, y, least - spent)
            for *factors, nearest, farthest, turned in self._bands:
                bound = least - spent if found is None else found[0]
                if turned < bound and nearest <= x * x + y * y <= farthest:
                    locks = self._stationary_locks(factors, x * x + y * y)
                    found = _least_of(locks, x, y, bound) or found
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

    def candidates(
        self, branches: Sequence[BaseBranch], height: float, weights: Sequence[float]
    ) -> list[tuple[float, ...]]:
        """The 4 base and pitch joint angles [rad] of postures among which Σ weight · |θ| is least.

        For branches and a height as ``solve`` has them, and positive weights of the 4 joints.
        """
        shoulder, (w2, w3, w4) = self._geometry.shoulder, weights[1:]
        found: list[tuple[float, ...]] = []
        for _, yaw, r in branches:
            x, y = r - shoulder.real, height - shoulder.imag
            every: list[_Turned] = []
            _least_of(self._locks, x, y, math.inf, every)
            for e2, e3, e4 in ((1, 1, 1), *_PATTERNS):
                locks = self._stationary_locks(self._factors(e2 * w2, e3 * w3, e4 * w4), x * x + y * y)
                _least_of(locks, x, y, math.inf, every)
            found += [(yaw, *posture[1:]) for posture in every]
        return found

    def _factors(self, e2: float, e3: float, e4: float) -> tuple[float, float, float]:
        """Of the sines of t3, t4 and t3 + t4 in the condition."""
        l2, l3, l4 = self._geometry.lengths
        return e4 * l2 * l3, (e2 - e3) * l3 * l4, (e4 - e3) * l2 * l4

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

    def _stationary_locks(self, factors: Sequence[float], square: float) -> list[_Lock]:
        """Locks of the second joint where the sum of a pattern is stationary, at a squared distance [m²]."""
        (l2, l3, l4), (a, b, c) = self._geometry.lengths, factors
        t3 = np.linspace(0.0, TWO_PI, 4 * _DEGREE, endpoint=False)
        cos, sin = np.cos(t3), np.sin(t3)
        # p cos t4 + q sin t4 = k from the distance, u cos t4 + v sin t4 = w from the condition
        p, q = l3 + l2 * cos, -l2 * sin
        k = (0.5 * (square - l2**2 - l3**2 - l4**2) - l2 * l3 * cos) / l4
        u, v, w = c * sin, b + c * cos, -a * sin
        value = (k * v - w * q) ** 2 + (p * w - u * k) ** 2 - (p * v - u * q) ** 2
        roots = trigonometric_zeros(value, _DEGREE).tolist()
        angles = (nearest_image(self._geometry.joint_angle(1, t), *self._ranges[1]) for t in roots)
        return sorted(lock for angle in angles if angle is not None for lock in self._lock(1, angle))

    def _band(self, e2: int, e3: int, e4: int) -> tuple[float, ...] | None:
        """Where a pattern of senses may hold a minimum, from samples of t3 and the ones next to them.

        The factors of the condition, the least and greatest squared distance from the first pitch axis [m²],
        and what the second and third joint turn there at least [rad]. The senses must agree with the pattern,
        both joints be inside their limits, and the sum not have a maximum. Without a band, as on uzuner, no
        target needs the roots: they cost fifty times the rest of "least rotation, one point".
        """
        geometry, (l2, l3, l4) = self._geometry, self._geometry.lengths
        a, b, c = self._factors(e2, e3, e4)
        low, high = geometry.plane_limits(1, self._limits)
        t3 = np.linspace(low, high, _SAMPLES)
        along, across = b + c * np.cos(t3), c * np.sin(t3)  # along sin t4 + across cos t4 = -a sin t3
        sine = -a * np.sin(t3) / np.maximum(np.hypot(along, across), 1e-300)
        lean = np.arcsin(np.clip(sine, -1.0, 1.0))
        t3, t4 = np.broadcast_arrays(t3, np.stack([lean, math.pi - lean]) - np.arctan2(across, along))
        angle3, angle4 = (geometry.signs[k] * (t - geometry.offsets[k]) for k, t in ((1, t3), (2, t4)))
        _, inside = (
            into_limits(angle, low - 1e-6, high + 1e-6)
            for angle, (low, high) in zip((angle3, angle4), self._ranges[1:], strict=True)
        )
        sense3, sense4 = np.sign(angle3) * geometry.signs[1], np.sign(angle4) * geometry.signs[2]
        # second derivative along the null vector (…, n3, n4) of the planar Jacobian
        n3 = -(l2 * l4 * np.sin(t3 + t4) + l3 * l4 * np.sin(t4))
        n4 = l2 * l3 * np.sin(t3) + l2 * l4 * np.sin(t3 + t4)
        slope3 = a * np.cos(t3) + c * np.cos(t3 + t4)
        slope4 = b * np.cos(t4) + c * np.cos(t3 + t4)
        curvature = (slope3 * n3 + slope4 * n4) * sense3 * e3
        alive = inside & (sense3 * sense4 * e3 * e4 >= 0) & (np.abs(sine) <= 1.0)
        alive &= curvature >= -1e-9 * (l2 + l3 + l4) ** 4
        if not alive.any():
            return None
        alive[:, 1:] |= alive[:, :-1].copy()
        alive[:, :-1] |= alive[:, 1:].copy()
        cosines = l2 * l3 * np.cos(t3) + l3 * l4 * np.cos(t4) + l2 * l4 * np.cos(t3 + t4)
        square = (l2**2 + l3**2 + l4**2 + 2 * cosines)[alive]
        slack = 2.0 * (high - low) / (_SAMPLES - 1)
        room = slack * (l2 + l3 + l4) ** 2
        spent = float((np.abs(angle3) + np.abs(angle4))[alive].min()) - slack
        return a, b, c, float(square.min()) - room, float(square.max()) + room, spent


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
