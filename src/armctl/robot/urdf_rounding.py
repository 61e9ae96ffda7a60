"""Right angles that a URDF file rounds: taken as what they were before somebody wrote them down.

Exporters write a quarter turn as 1.5708 and a zero as -9.4e-08. Read to the letter, axes that are parallel in
the machine are not in the file, and no closed form fits the arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import rotation_from_rpy

FloatArray = NDArray[np.float64]
QUARTER = math.pi / 2
NOISE = 1e-6
"""angles [rad] and components of unit vectors below this are a rounded zero"""
_FEWEST = 4
"""decimals that a rounded quarter turn has at least: 1.57 may be meant"""
_MOST_QUARTERS = 4


@dataclass(frozen=True, slots=True)
class Rounding:
    """What was taken as exact, and how far that is from what is written."""

    quarters: tuple[str, ...] = ()
    """rounded quarter turns as written, signs left out"""
    zeros: int = 0
    """numbers that are a rounded zero"""
    shift: float = 0.0
    """how far a point one metre off is moved by it, at most [m]"""

    def __add__(self, other: Rounding) -> Rounding:
        return Rounding(self.quarters + other.quarters, self.zeros + other.zeros, self.shift + other.shift)


def exact_angle(text: str) -> float:
    """An angle as written [rad], or the whole number of quarter turns that it is when rounded or cut off.

    That needs four decimals, or to be within ``NOISE`` of it. Twice 1.57079 is 3.14158: a multiple may be off
    by so many units of the last decimal.
    """
    value = float(text)
    quarters = round(value / QUARTER)
    exponent = Decimal(text).as_tuple().exponent
    allowed = NOISE
    if isinstance(exponent, int) and exponent <= -_FEWEST and abs(quarters) <= _MOST_QUARTERS:
        allowed = max(NOISE, abs(quarters) * 10.0**exponent)
    return quarters * QUARTER if abs(value - quarters * QUARTER) < allowed else value


def exact_rotation(texts: list[str]) -> tuple[FloatArray, Rounding]:
    """A rotation (3, 3) from roll, pitch and yaw as written [rad]."""
    written, exact = [float(text) for text in texts], [exact_angle(text) for text in texts]
    if written == exact:
        return rotation_from_rpy(*exact), Rounding()
    changed = [k for k in range(3) if written[k] != exact[k]]
    rotation = rotation_from_rpy(*exact)
    chord = float(np.linalg.norm(rotation - rotation_from_rpy(*written))) / math.sqrt(2)
    quarters = tuple(texts[k].lstrip("+-") for k in changed if exact[k] != 0.0)
    return rotation, Rounding(quarters, len(changed) - len(quarters), chord)


def exact_axis(axis: FloatArray) -> tuple[FloatArray, Rounding]:
    """A unit vector (3,), without components that are a rounded zero."""
    noise = (axis != 0.0) & (np.abs(axis) < NOISE)
    if not noise.any():
        return axis, Rounding()
    exact = np.where(noise, 0.0, axis)
    exact /= np.linalg.norm(exact)
    # turning about the other axis: the way there, the turn, the way back
    return exact, Rounding((), int(noise.sum()), 2 * float(np.linalg.norm(exact - axis)))
