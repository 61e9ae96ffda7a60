"""A mark: one reading of a joint's angle, and what the board was told when it was taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import CalibrationError

FloatArray = NDArray[np.float64]
LEAST_MARKS = 3
LEAST_SPREAD = math.radians(10.0)
"""half a degree of reading error over less than this is more than 5 % of scale"""
_SAME_PLACE = 0.01
"""outputs nearer to each other than this fraction of their spread are one place"""


@dataclass(frozen=True, slots=True)
class Mark:
    """One reading."""

    output: float
    """what the board was told, or what its encoder said [µs or counts]"""
    angle: float
    """the joint's angle as somebody read it [rad]"""


def checked_marks(marks: Sequence[Mark], unit: str) -> tuple[FloatArray, FloatArray]:
    """Outputs (n,) and angles (n,) [rad] of marks that a line can be laid through.

    Raises:
        CalibrationError: fewer than three, not finite, or not spread over enough places and degrees.
    """
    if len(marks) < LEAST_MARKS:
        raise CalibrationError(
            f"{len(marks)} marks are too few: {LEAST_MARKS} are needed, far apart; with 4 or more a wrong "
            "one is named"
        )
    outputs = np.array([mark.output for mark in marks], dtype=np.float64)
    angles = np.array([mark.angle for mark in marks], dtype=np.float64)
    for number, (output, angle) in enumerate(zip(outputs.tolist(), angles.tolist(), strict=True), 1):
        if not (math.isfinite(output) and math.isfinite(angle)):
            raise CalibrationError(
                f"mark {number} is no pair of finite numbers: {output:g} {unit}, {math.degrees(angle):g}°"
            )
    spread = float(np.ptp(outputs))
    if spread <= 0:
        raise CalibrationError(
            f"all marks are at one place, {outputs[0]:.1f} {unit}: move the joint between the marks"
        )
    found = 1 + int(np.sum(np.diff(np.sort(outputs)) > _SAME_PLACE * spread))
    if found < LEAST_MARKS:
        raise CalibrationError(
            f"the marks are at {found} places only: take them at {LEAST_MARKS} or more, spread over the "
            "joint's range"
        )
    require_spread(angles)
    return outputs, angles


def require_spread(angles: FloatArray) -> None:
    """Refuse angles (n,) [rad] that lie too close together to say anything of the scale.

    Raises:
        CalibrationError: with how far they spread and how far they must.
    """
    spread = math.degrees(float(np.ptp(angles)))
    least = math.degrees(LEAST_SPREAD)
    if spread < least:
        raise CalibrationError(
            f"the angles of the marks spread over {spread:.1f}° only: take them further apart, over "
            f"{least:.0f}° at least, better over the whole range of the joint"
        )
