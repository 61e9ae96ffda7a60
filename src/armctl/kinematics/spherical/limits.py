"""Shoulder joint angles inside their limits."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, images, rest_angle
from armctl.kinematics.spherical.vectors import Vector, norm, plus, turned

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Angles = tuple[float, float, float]
"""θ1, θ2, θ3 [rad]"""
_NEARLY = 1e-5
"""how far outside a limit an angle may lie that rounding alone has put there [rad]: near a singular pose
1e-16 of the tip are 1e-8 rad and more"""
_ROUNDING = 1e-12
"""an angle clipped by less than this is as good as inside [rad]"""
_CLIPPED = 5e-10
"""how far from the target clipping by up to ``LIMIT_TOLERANCE`` may take the tip (unit vectors)"""
_UNFELT = 1e-10
"""how far from the target anything else may (unit vectors)"""


@dataclass(frozen=True, slots=True)
class ShoulderLimits:
    """Limits of the three shoulder joints."""

    pairs: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    """lower and upper [rad]"""

    @classmethod
    def of(cls, limits: FloatArray) -> ShoulderLimits:
        """From the joint limits (n, 2) of the arm [rad]."""
        first, second, third = ((float(low), float(high)) for low, high in limits[:3])
        return cls((first, second, third))

    def values(self, joint: int) -> list[float]:
        """Where |θ| of a joint has an end or a kink: its limits, and zero if that is inside [rad]."""
        low, high = self.pairs[joint]
        return [low, high, *((0.0,) if low < 0.0 < high else ())]

    def rest(self, joint: int) -> float:
        """The angle nearest to zero [rad]."""
        return rest_angle(*self.pairs[joint])

    def inside(
        self, angles: Angles, axes: tuple[Vector, Vector, Vector], hand: Vector, aim: Vector
    ) -> list[Angles]:
        """Every set of equal angles inside the limits, clipped onto them.

        Clipping by more than rounding is right only where the tip does not feel it: near a singular pose.
        There, too, a candidate may miss the target, and is dropped.

        Args:
            angles: candidate that turns ``hand`` onto ``aim`` [rad].
            axes: of the three joints.
            hand: unit vector from the shoulder to the tip, joints at zero.
            aim: unit vector from the shoulder to the target.
        """
        found: list[Angles] = []
        for first, second, third in self.nearly(angles):
            clipped = max(
                abs(math.remainder(kept - angle, TWO_PI))
                for kept, angle in zip((first, second, third), angles, strict=True)
            )
            tip = turned(turned(turned(hand, axes[2], third), axes[1], second), axes[0], first)
            allowed = _CLIPPED if _ROUNDING < clipped <= LIMIT_TOLERANCE else _UNFELT
            if norm(plus(tip, aim, -1.0)) > allowed:
                continue
            found.append((first, second, third))
        return found

    def nearly(self, angles: Angles) -> list[Angles]:
        """Every set of equal angles inside the limits or barely outside, clipped; the tip not looked at."""
        first, second, third = (
            images(angle, *pair, _NEARLY) for angle, pair in zip(angles, self.pairs, strict=True)
        )
        return list(itertools.product(first, second, third))

    def inside_arrays(self, joint: int, angles: FloatArray) -> list[tuple[FloatArray, BoolArray]]:
        """Images of angles (m,) of one joint, clipped onto its limits, and which of them are inside.

        One entry a whole turn of the joint's range.
        """
        low, high = self.pairs[joint]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        near = angles - TWO_PI * np.rint((angles - middle) / TWO_PI)
        more = max(0, math.ceil((half - math.pi) / TWO_PI))
        out: list[tuple[FloatArray, BoolArray]] = []
        for k in range(-more, more + 1):
            image = near + TWO_PI * k if k else near
            out.append((np.clip(image, low, high), np.abs(image - middle) <= half + 0.1 * LIMIT_TOLERANCE))
        return out
