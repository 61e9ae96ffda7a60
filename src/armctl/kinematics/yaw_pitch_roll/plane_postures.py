"""Postures of the pitch joints that bring the tip to a point of the tool plane."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import TWO_PI, images
from armctl.kinematics.two_link import ON_JOINT, two_link
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll

FloatArray = NDArray[np.float64]
_PITCH_TOLERANCE = 1e-6
"""how far from the pitch asked for two pitch joints may leave the tool [rad]"""


class PlanePostures:
    """The closed form in the tool plane of one arm. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self._geometry = geometry
        self._limits = [(float(low), float(high)) for low, high in limits[1 : 1 + len(geometry.lengths)]]

    def at(self, x: float, y: float, tool_angle: float | None) -> list[tuple[float, ...]]:
        """Plane angles [rad], limits not looked at.

        Args:
            x: the tip, forward of the first pitch axis [m].
            y: the tip, above it [m].
            tool_angle: plane angle of the approach axis [rad]; None: any (with two pitch joints).

        Folded onto its own first axis the arm may point anywhere: then the directions are given at which
        a joint is at zero or at a limit, so that one is inside the limits if any is.
        """
        lengths = self._geometry.lengths
        if tool_angle is None:
            return self._unfolded(x, y, None) if len(lengths) == 2 else []
        last = tool_angle - (self._geometry.tool_angle or 0.0)  # absolute direction of the last link
        if len(lengths) == 2:
            return [
                pair
                for pair in self._unfolded(x, y, last)
                if abs(math.remainder(sum(pair) - last, TWO_PI)) < _PITCH_TOLERANCE
            ]
        return self.reaching(x - lengths[2] * math.cos(last), y - lengths[2] * math.sin(last), last)

    def reaching(self, x: float, y: float, last: float | None) -> list[tuple[float, ...]]:
        """``at`` for the end of the second link, with the direction of the third [rad] if there is one."""
        pairs = self._unfolded(x, y, last)
        return pairs if last is None else [(*pair, last - sum(pair)) for pair in pairs]

    def _unfolded(self, x: float, y: float, last: float | None) -> list[tuple[float, ...]]:
        """The two-link triangle of the first links; ``last`` is the direction of the arm's last link."""
        pairs = two_link(x, y, self._geometry.lengths[0], self._geometry.lengths[1])
        if not pairs or math.hypot(x, y) > ON_JOINT:
            return list(pairs)
        bend = pairs[0][1]
        firsts = [self._geometry.plane_angle(0, way) for way in (0.0, *self._limits[0])]
        if last is not None and len(self._geometry.lengths) == 2:
            firsts.append(last - bend)
        elif last is not None:
            firsts += [last - bend - self._geometry.plane_angle(2, way) for way in (0.0, *self._limits[2])]
        return [(first, bend) for first in firsts]

    def joint_images(self, plane: tuple[float, ...]) -> list[tuple[float, ...]]:
        """Every set of joint angles inside the limits that has these plane angles [rad]."""
        choices = [
            images(self._geometry.joint_angle(k, angle), *self._limits[k]) for k, angle in enumerate(plane)
        ]
        return list(itertools.product(*choices))

    def inside(self, r: float, z: float, last: float | None) -> tuple[float, ...] | None:
        """Joint angles inside the limits for a point of the tool plane, or None.

        Args:
            r: the tip, forward of the base axis [m].
            z: the tip, above the base origin [m].
            last: direction of the last link to be kept [rad]; None: any.
        """
        shoulder = self._geometry.shoulder
        tool_angle = None if last is None else last + (self._geometry.tool_angle or 0.0)
        for plane in self.at(r - shoulder.real, z - shoulder.imag, tool_angle):
            for angles in self.joint_images(plane):
                return angles
        return None
