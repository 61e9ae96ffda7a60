"""Why a spherical shoulder and elbow cannot reach a target, with numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, central_image
from armctl.kinematics.length_words import millimetres
from armctl.kinematics.limit_words import all_needs, needs
from armctl.kinematics.spherical.orientation import ToolPosture
from armctl.kinematics.spherical.shoulder import SphericalShoulder
from armctl.kinematics.spherical.swivel import Swivel

FloatArray = NDArray[np.float64]
_ROUNDS = 3
_VALUES = (1441, 401)
"""values of θ1 in the first round, a quarter of a degree apart, and in the finer ones about the best"""


class SphericalReach:
    """Explains refusals of one arm. Immutable; safe in several threads."""

    def __init__(self, geometry: SphericalShoulder, limits: FloatArray, titles: Sequence[str]) -> None:
        self._geometry, self._limits, self._titles = geometry, limits, titles

    def of_position(self, distance: float, postures: list[tuple[float, Swivel]]) -> str:
        """Why a position has no solution.

        Args:
            distance: of the target from the shoulder [m].
            postures: elbow angles inside their limits that have this distance, each with its swivel.
        """
        nearest, farthest = self._geometry.reach
        where = f"the target would be {1000 * distance:.1f} mm from the shoulder"
        bends = self._geometry.bends(distance)
        if not bends and distance > farthest:
            return (
                f"too far by {millimetres(distance - farthest)} mm: {where}, "
                f"the arm reaches {1000 * farthest:.1f} mm"
            )
        if not bends:
            return (
                f"inside the dead zone, too near by {millimetres(nearest - distance)} mm: {where}, "
                f"the arm folds no closer than {1000 * nearest:.1f} mm"
            )
        if postures:
            said = all_needs(self._titles, self._limits, self._least_excess(postures))
            said = said or "a shoulder joint would have to leave them by less than 0.01°"
        else:
            limits = self._limits[3].tolist()
            angles = (central_image(bend - self._geometry.offset, *limits) for bend in bends)
            said = needs(self._titles[3], self._limits[3], *angles)
        return f"within the links' reach, but joint limits forbid it: {said}"

    def of_pitch(self, ends: list[tuple[float, ToolPosture]], roll: float | None) -> str:
        """Why a pitch has no solution at a position that has some.

        Args:
            ends: pitches [rad] at the ends of what the arm can hold, each with its posture.
            roll: angle of the roll joint [rad], where it makes a difference to the pitch.
        """
        pitches = [math.degrees(pitch) for pitch, _ in ends]
        nearest = math.degrees(min(ends, key=lambda end: end[1].miss)[0])
        said = f"{min(pitches) + 0.0:.2f}° … {max(pitches) + 0.0:.2f}°"
        held = "" if roll is None else f" with {self._titles[4]} at {math.degrees(roll) + 0.0:.2f}°"
        return (
            f"that pitch is impossible here: at this point the arm holds its tool at {said}{held}, "
            f"the nearest to it is {nearest + 0.0:.2f}°"
        )

    def _least_excess(self, postures: list[tuple[float, Swivel]]) -> list[tuple[int, float]]:
        """Joints outside their limits, and what they need [rad], where the sum of it is least."""
        low, high = self._limits[:3, :1], self._limits[:3, 1:]
        middle = 0.5 * (low + high)
        best, least = np.zeros(3), math.inf
        for _, swivel in postures:
            centre, reach = float(middle[0, 0]), math.pi
            for k in range(_ROUNDS):
                count = _VALUES[min(k, 1)]
                first = np.linspace(centre - reach, centre + reach, count)
                for q in swivel.sheets(first):
                    if not q.size:
                        continue
                    near = q - TWO_PI * np.rint((q - middle) / TWO_PI)
                    excess = np.maximum(0.0, np.maximum(low - near, near - high)).sum(axis=0)
                    i = int(np.argmin(excess))
                    if excess[i] < least:
                        best, least, centre = near[:, i], float(excess[i]), float(q[0, i])
                reach *= 2.0 / (count - 1)
        return [
            (joint, float(best[joint]))
            for joint in range(3)
            if not low[joint, 0] - LIMIT_TOLERANCE <= best[joint] <= high[joint, 0] + LIMIT_TOLERANCE
        ]
