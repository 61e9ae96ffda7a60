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

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI
from armctl.kinematics.base_yaw import BaseBranch
from armctl.kinematics.stationary_curve import StationaryCurve, coefficients
from armctl.kinematics.two_link import two_link
from armctl.kinematics.yaw_pitch_roll import YawPitchRoll

FloatArray = NDArray[np.float64]


class LeastRotation:
    """The optimum for one arm and its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self.geometry = geometry
        self.l2, self.l3, self.l4 = geometry.lengths
        self.limits = tuple((float(low), float(high)) for low, high in limits[1:4])
        self._locked2 = self._locked_values(0)
        # two links locked at a bend v are one link: (v, length, its direction from the first)
        self._locked3 = [self._compound(self.l2, self.l3, v) for v in self._locked_values(1)]
        self._locked4 = [self._compound(self.l3, self.l4, v) for v in self._locked_values(2)]
        self._curves = [curve for pattern in _PATTERNS for curve in self._live_curves(pattern)]

    def _locked_values(self, k: int) -> list[float]:
        """Plane angles at which |θ_k| has an end or a kink; for the elbow also where sin t3 = 0."""
        low, high = self.limits[k]
        values = [self.geometry.plane_angle(k, v) for v in (low, high, *((0.0,) if low < 0 < high else ()))]
        return values + ([v for v in (0.0, math.pi) if v not in values] if k == 1 else [])

    @staticmethod
    def _compound(a: float, b: float, bend: float) -> tuple[float, float, float]:
        whole = a + b * cmath.exp(1j * bend)
        return bend, abs(whole), cmath.phase(whole)

    def solve(self, branches: list[BaseBranch], height: float) -> FloatArray | None:
        """The configuration of least rotation.

        Args:
            branches: base angles inside their limits.
            height: of the target above the base origin [m].

        Returns:
            (4,) base and pitch joint angles [rad], or None when no branch has a solution.
        """
        best, best_energy = None, math.inf
        for branch in branches:
            for angles in self.extremes(branch, height):
                energy = abs(branch.angle) + abs(angles[0]) + abs(angles[1]) + abs(angles[2])
                if energy < best_energy:
                    best, best_energy = (branch.angle, *angles), energy
        return None if best is None else np.array(best)

    def extremes(self, branch: BaseBranch, height: float) -> Iterator[tuple[float, float, float]]:
        """Pitch joint angles [rad] inside the limits with one at a limit or at zero, or the elbow straight.

        Among them are both ends of every continuum of solutions, and the points of least rotation.
        """
        shoulder = self.geometry.shoulder
        for plane in self._candidates(branch.r - shoulder.real, height - shoulder.imag):
            angles = self._inside(plane)
            if angles is not None:
                yield angles

    def _inside(self, plane: tuple[float, float, float]) -> tuple[float, float, float] | None:
        """Joint angles of plane angles, each the image of least magnitude inside its limits."""
        geometry = self.geometry
        angles: list[float] = []
        for k in range(3):
            angle = math.remainder(geometry.signs[k] * (plane[k] - geometry.offsets[k]), TWO_PI)
            low, high = self.limits[k]
            if angle < low - LIMIT_TOLERANCE:
                angle += TWO_PI * math.ceil((low - LIMIT_TOLERANCE - angle) / TWO_PI)
            elif angle > high + LIMIT_TOLERANCE:
                angle -= TWO_PI * math.ceil((angle - high - LIMIT_TOLERANCE) / TWO_PI)
            if not low - LIMIT_TOLERANCE <= angle <= high + LIMIT_TOLERANCE:
                return None
            angles.append(min(max(angle, low), high))
        return angles[0], angles[1], angles[2]

    def _candidates(self, x: float, y: float) -> Iterator[tuple[float, float, float]]:
        """Plane angles of every configuration that can be the least, for one base branch."""
        l2, l3, l4 = self.l2, self.l3, self.l4
        for v in self._locked2:
            for first, bend in two_link(x - l2 * math.cos(v), y - l2 * math.sin(v), l3, l4):
                yield v, first - v, bend
        for v, length, turn in self._locked3:
            if length > 1e-12:
                for first, bend in two_link(x, y, length, l4):
                    yield first - turn, v, bend + turn - v
        for v, length, turn in self._locked4:
            if length > 1e-12:
                for first, bend in two_link(x, y, l2, length):
                    yield first, bend - turn, v
        if self._curves:
            square, direction = x * x + y * y, math.atan2(y, x)
            for curve in self._curves:
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
