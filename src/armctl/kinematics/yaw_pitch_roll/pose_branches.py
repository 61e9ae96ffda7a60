"""Position, tool pitch and roll with three pitch joints: every branch of one pose, in plain floats.

The closed form of ``base_yaw.py`` and ``plane_postures.py`` in one piece, for what is solved most often:
joints that turn less than a whole turn, and a target off the base axis. What is special (any base angle
serves, the links are straight or fold onto the first pitch axis) is left to the general solver.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from math import acos, atan2, cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI
from armctl.kinematics.yaw_pitch_roll.branch_names import LEVEL
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.joint_windows import into_window, window

FloatArray = NDArray[np.float64]
Posture = tuple[int, tuple[float, ...]]
"""index into ``BRANCHES``, and the joint angles [rad]"""
UPRIGHT = 5e-13
"""how near to ±90° the two readings of a pitch are one [rad]"""
_EDGE = 1e-9
"""how near to the base axis the general solver takes over [m²]"""
_ROUNDING = 1e-9
"""how near to ±1 the elbow's cosine must come for rounding to decide"""
SURE = 1.0 - _ROUNDING
"""up to here it does not"""
REACHED = 1.0 + _ROUNDING
"""from here on the links do not reach, whatever the rounding"""


class PoseBranches:
    """One arm inside its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self._lateral, self._r0, self._z0 = geometry.lateral, geometry.shoulder.real, geometry.shoulder.imag
        self._yaw_sign, self._tool = geometry.yaw_sign, geometry.tool_angle or 0.0
        l2, l3, l4 = geometry.lengths
        self._lengths = l2, l3, l4
        self._squares, self._product = l2 * l2 + l3 * l3, 2.0 * l2 * l3
        self._senses = tuple(zip(geometry.signs, geometry.offsets, strict=True))
        self._windows = tuple(window(low, high) for low, high in limits[:4].tolist())
        self._local = geometry.local_of

    @staticmethod
    def serves(geometry: YawPitchRoll, limits: FloatArray) -> bool:
        """True with three pitch joints, a pitch to ask for, and joints that turn less than a turn."""
        narrow = limits[:4, 1] - limits[:4, 0] < TWO_PI - 2 * LIMIT_TOLERANCE
        return len(geometry.lengths) == 3 and geometry.tool_angle is not None and bool(narrow.all())

    def at(self, x: float, y: float, z: float, pitch: float, rolls: Sequence[float]) -> list[Posture] | None:
        """Every configuration inside the limits.

        Args:
            x: tool point in the base frame [m].
            y: tool point in the base frame [m].
            z: tool point in the base frame [m].
            pitch: of the approach axis above the horizontal [rad]; both readings within ±90°.
            rolls: what the roll joint may be at [rad]; empty for an arm without one.

        Returns:
            The postures in the order of ``YawPitchRollSolver.solve``, or None at a special place.
        """
        forward, left, up = self._local(x, y, z)
        height = up - self._z0
        d = self._lateral
        square = forward * forward + left * left - d * d
        if square < _EDGE:
            return None
        r, azimuth = sqrt(square), atan2(left, forward)
        aside = atan2(d, r) if d else 0.0
        readings = self._readings(pitch)
        out: list[Posture] = []
        for back, r_tip, turn in ((0, r, azimuth - aside), (4, -r, azimuth + aside - math.pi)):
            yaw = into_window(self._yaw_sign * turn, self._windows[0])
            if yaw is None:
                continue
            for outward, last, along, across in readings:
                found = self._in_plane(r_tip - self._r0 - along, height - across, last)
                if found is None:
                    return None
                inward = outward > LEVEL if back else outward < -LEVEL
                for bend, shoulder, elbow, wrist in found:
                    # a positive bend leaves the elbow down in front, up at the back
                    branch = back + (2 if (bend > 0) != (back > 0) else 0) + inward
                    if rolls:
                        out += [(branch, (yaw, shoulder, elbow, wrist, roll)) for roll in rolls]
                    else:
                        out.append((branch, (yaw, shoulder, elbow, wrist)))
        return out

    def _readings(self, pitch: float) -> list[tuple[float, float, float, float]]:
        """Each reading of a pitch: cosine of the approach axis, the last link's direction and coordinates."""
        l4, last, outward = self._lengths[2], pitch - self._tool, cos(pitch)
        first = (outward, last, l4 * cos(last), l4 * sin(last))
        if abs(pitch) > math.pi / 2 - UPRIGHT:
            return [first]
        last = math.pi - pitch - self._tool
        return [first, (-outward, last, l4 * cos(last), l4 * sin(last))]

    def _in_plane(
        self, x: float, y: float, last: float
    ) -> list[tuple[int, float, float, float]] | tuple[()] | None:
        """Sense of the bend, and pitch joint angles inside the limits, with the last link along ``last``.

        Args:
            x: end of the second link, forward of the first pitch axis [m].
            y: end of the second link, above it [m].
            last: direction of the last link [rad].

        Returns:
            What ``two_link`` gives, inside the limits; None where the links are in line.
        """
        cosine = (x * x + y * y - self._squares) / self._product
        if not -SURE < cosine < SURE:
            return None if abs(cosine) < REACHED else ()
        (s2, o2), (s3, o3), (s4, o4) = self._senses
        _, second, third, fourth = self._windows
        l2, l3, _ = self._lengths
        found: list[tuple[int, float, float, float]] = []
        angle, direction = acos(cosine), None
        inner = 0.0
        for sense in (1, -1):
            bend = sense * angle
            elbow = into_window(s3 * (bend - o3), third)
            if elbow is None:
                continue
            if direction is None:
                direction = atan2(y, x)
                inner = atan2(l3 * sqrt(1.0 - cosine * cosine), l2 + l3 * cosine)
            first = direction - sense * inner
            shoulder = into_window(s2 * (first - o2), second)
            if shoulder is None:
                continue
            wrist = into_window(s4 * (last - first - bend - o4), fourth)
            if wrist is not None:
                found.append((sense, shoulder, elbow, wrist))
        return found
