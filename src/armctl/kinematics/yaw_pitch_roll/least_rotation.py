"""The exact least rotation: min Σ|θ| over the continuum of solutions of three pitch joints.

Between the points where a joint passes zero the sum is smooth, so a minimum lies

* where a joint is at a limit or at zero (closed form: the two-link triangle of what is left), or
* where the sum is stationary along the self-motion. With plane angles t and senses e_k = ±1 of |θ_k| the
  condition is that the null vector of the planar Jacobian has no component along the senses:

      e2 l3 l4 sin t4 - e3 (l4 l2 sin(t3+t4) + l4 l3 sin t4) + e4 (l2 l3 sin t3 + l2 l4 sin(t3+t4)) = 0

  which up to a common sign is

      e = (+,+,+):  sin t3 = 0
      e = (+,+,-):  l3 sin t3 + 2 l4 sin(t3+t4) = 0
      e = (+,-,+):  l2 l3 sin t3 + 2 l3 l4 sin t4 + 2 l2 l4 sin(t3+t4) = 0
      e = (+,-,-):  2 l4 sin t4 = l2 sin t3

  These curves depend on the arm alone, and only their distance from the first pitch axis on the target.
  Where a curve is never a minimum inside the limits it is dropped once and for all.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import TWO_PI
from armctl.kinematics.two_link import bend_angle, inner_angle
from armctl.kinematics.yaw_pitch_roll.base_yaw import BaseBranch
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.joint_windows import nearest_image
from armctl.kinematics.yaw_pitch_roll.stationary_curve import StationaryCurve, coefficients

FloatArray = NDArray[np.float64]


class Lock(NamedTuple):
    """One pitch joint held where |θ| has an end or a kink; the other two follow from a triangle."""

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


_FREE = ((1, 2), (0, 2), (0, 1))
"""the pitch joints that are free while one is locked"""


class LeastRotation:
    """The optimum for one arm and its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self.geometry, self.lengths = geometry, geometry.lengths
        self.limits = tuple((float(low), float(high)) for low, high in limits[1:4])
        self._joints = [
            (sense, offset, *pair)
            for sense, offset, pair in zip(geometry.signs, geometry.offsets, self.limits, strict=True)
        ]
        self.locks = sorted((lock for k in range(3) for lock in self._locks(k)), key=lambda lock: lock.spent)
        """by how much the locked joint turns, least first"""
        live = [curve for pattern in _PATTERNS for curve in self._live_curves(pattern)]
        self.curves = [(curve, self._least_spent(curve)) for curve in live]
        """parts of the stationary curves that may hold a minimum, and what the joints turn there at least"""

    def _locks(self, k: int) -> Iterator[Lock]:
        """A pitch joint at its limits and at zero; the second one also where sin t3 = 0."""
        low, high = self.limits[k]
        angles = {low, high, *((0.0,) if low < 0 < high else ())}
        if k == 1:
            straight = (self.geometry.joint_angle(1, v) for v in (0.0, math.pi))
            angles |= {a for v in straight if (a := nearest_image(v, low, high)) is not None}
        l2, l3, l4 = self.lengths
        for angle in angles:
            v = self.geometry.plane_angle(k, angle)
            before, behind = ((0.0, l2), (l2, l3), (l3, l4))[k]
            whole = before + behind * cmath.exp(1j * v)  # the links that the joint holds together, as one
            length, turn = abs(whole), cmath.phase(whole)
            if k == 0:
                yield Lock(abs(angle), 0, angle, whole.real, whole.imag, l3, l4, v, 0.0)
            elif length > 1e-12 and k == 1:
                yield Lock(abs(angle), 1, angle, 0.0, 0.0, length, l4, turn, turn - v)
            elif length > 1e-12:
                yield Lock(abs(angle), 2, angle, 0.0, 0.0, l2, length, 0.0, -turn)

    def solve(self, branches: list[BaseBranch], height: float) -> tuple[float, ...] | None:
        """The configuration of least rotation.

        Args:
            branches: base angles inside their limits.
            height: of the target above the base origin [m].

        Returns:
            The 4 base and pitch joint angles [rad], or None when no branch has a solution.
        """
        best: tuple[float, ...] | None = None
        least = math.inf
        for branch in branches:
            rest = least - abs(branch.angle)
            if rest > 0.0:
                found = self._solve_branch(branch, height, rest)
                if found is not None:
                    least = abs(branch.angle) + abs(found[0]) + abs(found[1]) + abs(found[2])
                    best = (branch.angle, *found)
        return best

    def _solve_branch(
        self, branch: BaseBranch, height: float, least: float
    ) -> tuple[float, float, float] | None:
        """The best of one branch, if it turns the pitch joints by less than ``least`` [rad] in all."""
        shoulder = self.geometry.shoulder
        x, y = branch.r - shoulder.real, height - shoulder.imag
        square, direction = x * x + y * y, math.atan2(y, x)
        best: tuple[float, float, float] | None = None
        for lock in self.locks:
            if lock.spent >= least:
                break  # the rest spend more still
            for angles in self._at_lock(lock, x, y, square, direction, least):
                energy = abs(angles[0]) + abs(angles[1]) + abs(angles[2])
                if energy < least:
                    best, least = angles, energy
        for curve, spent in self.curves:
            if spent < least and curve.nearest <= square <= curve.farthest:
                for plane in self._on_curve(curve, square, direction):
                    angles = self._inside(plane)
                    energy = math.inf if angles is None else sum(map(abs, angles))
                    if energy < least:
                        best, least = angles, energy
        return best

    def _inside(self, plane: tuple[float, float, float]) -> tuple[float, float, float] | None:
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
        shoulder = self.geometry.shoulder
        x, y = branch.r - shoulder.real, height - shoulder.imag
        square, direction = x * x + y * y, math.atan2(y, x)
        for lock in self.locks:
            yield from self._at_lock(lock, x, y, square, direction, math.inf)
        for curve, _ in self.curves:
            for plane in self._on_curve(curve, square, direction):
                angles = self._inside(plane)
                if angles is not None:
                    yield angles

    def _at_lock(
        self, lock: Lock, x: float, y: float, square: float, direction: float, least: float
    ) -> list[tuple[float, float, float]]:
        """Joint angles inside the limits that reach a point and turn by less than ``least`` [rad] in all."""
        spent, joint, angle, held_x, held_y, near, far, lag, lead = lock
        if joint == 0:
            x, y = x - held_x, y - held_y
            square = x * x + y * y
        bend = bend_angle(square, near, far)
        found: list[tuple[float, float, float]] = []
        if bend is None:
            return found
        i, j = _FREE[joint]
        sense, offset, low, high = self._joints[j]
        for turn in (bend,) if bend == 0.0 or bend == math.pi else (bend, -bend):
            b = nearest_image(sense * (turn + lead - offset), low, high)
            if b is None or spent + abs(b) >= least:
                continue  # most end here, before anything else is computed
            towards = math.atan2(y, x) if joint == 0 else direction
            along, origin, lowest, highest = self._joints[i]
            first = towards - inner_angle(near, far, turn) - lag
            a = nearest_image(along * (first - origin), lowest, highest)
            if a is not None:
                found.append((angle, a, b) if joint == 0 else (a, angle, b) if joint == 1 else (a, b, angle))
        return found

    def _on_curve(
        self, curve: StationaryCurve, square: float, direction: float
    ) -> Iterator[tuple[float, float, float]]:
        l2, l3, l4 = self.lengths
        for t3, t4 in curve.at(square):
            whole = l2 + cmath.exp(1j * t3) * (l3 + l4 * cmath.exp(1j * t4))
            yield direction - cmath.phase(whole), t3, t4

    def _live_curves(self, pattern: _Pattern) -> list[StationaryCurve]:
        """The parts of one family's two curves t4(t3) that can be a minimum inside the limits."""
        geometry = self.geometry
        low, high = geometry.plane_limits(1, np.array([(0, 0), *self.limits]))
        curves: list[StationaryCurve] = []
        for root in (0, 1):
            whole = StationaryCurve.over(pattern, geometry.lengths, root, low, high)
            curves += [part for piece in whole for part in piece.parts(self._may_be_minimum(pattern, piece))]
        return curves

    def _least_spent(self, curve: StationaryCurve) -> float:
        """A lower bound of |θ3| + |θ4| along a curve [rad]: the least sample, and a step of the table off."""
        (angle3, _), (angle4, _) = self._image(1, curve.t3), self._image(2, curve.t4)
        step = np.abs(np.diff(angle3)).max() + np.abs(np.diff(angle4)).max()
        return float((np.abs(angle3) + np.abs(angle4)).min() - step)

    def _may_be_minimum(self, pattern: _Pattern, curve: StationaryCurve) -> NDArray[np.bool_]:
        """Senses that agree with the pattern, the wrist inside its limits, and not a maximum."""
        t3, t4 = curve.t3, curve.t4
        angle3, _ = self._image(1, t3)
        angle4, inside = self._image(2, t4)
        sense3, sense4 = (np.sign(a) * self.geometry.signs[k] for k, a in ((1, angle3), (2, angle4)))
        agree = sense3 * sense4 * pattern[1] * pattern[2] >= 0
        # second derivative along the null vector (l3 l4 s4, -(l2 l4 s34 + l3 l4 s4), l2 l3 s3 + l2 l4 s34)
        a, b, c = coefficients(pattern, self.geometry.lengths)
        l2, l3, l4 = self.geometry.lengths
        n3 = -(l2 * l4 * np.sin(t3 + t4) + l3 * l4 * np.sin(t4))
        n4 = l2 * l3 * np.sin(t3) + l2 * l4 * np.sin(t3 + t4)
        slope3 = a * np.cos(t3) + c * np.cos(t3 + t4)
        slope4 = b * np.cos(t4) + c * np.cos(t3 + t4)
        curvature = (slope3 * n3 + slope4 * n4) * sense3 * pattern[1]
        return inside & agree & (curvature >= -1e-9 * (l2 + l3 + l4) ** 4)

    def _image(self, k: int, plane: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Joint angle of least magnitude inside its limits for plane angles (m,), and where there is one."""
        low, high = self.limits[k]
        angle = self.geometry.signs[k] * (plane - self.geometry.offsets[k])
        angle -= TWO_PI * np.rint(angle / TWO_PI)
        angle += TWO_PI * np.ceil(np.maximum(0.0, low - 1e-6 - angle) / TWO_PI)
        angle -= TWO_PI * np.ceil(np.maximum(0.0, angle - high - 1e-6) / TWO_PI)
        return angle, (angle >= low - 1e-6) & (angle <= high + 1e-6)


_Pattern = tuple[int, int, int]
_PATTERNS: tuple[_Pattern, ...] = ((1, 1, -1), (1, -1, 1), (1, -1, -1))
