"""Right angles that exporters have rounded, taken as exact.

Exporters write a quarter turn as 1.5708 and a zero as -9.4e-08. Read to the letter, axes that are parallel in
the machine are not in the file, and no closed form fits the arm. So each joint tells how far what is taken is
from what is written.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics import rotation_from_rpy

_QUARTER = math.pi / 2
_NOISE = 1e-6
"""angles [rad] and components of unit vectors below this are a rounded zero"""
_FEWEST_DECIMALS = 4
"""that a rounded quarter turn has: 1.57 may be meant"""
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

    That needs four decimals, or to be within 1e-6 of it. Twice 1.57079 is 3.14158: a multiple may be off
    by so many units of the last decimal.
    """
    value = float(text)
    quarters = round(value / _QUARTER)
    exponent = Decimal(text).as_tuple().exponent
    allowed = _NOISE
    if isinstance(exponent, int) and exponent <= -_FEWEST_DECIMALS and abs(quarters) <= _MOST_QUARTERS:
        allowed = max(_NOISE, abs(quarters) * 10.0**exponent)
    return quarters * _QUARTER if abs(value - quarters * _QUARTER) < allowed else value


def exact_rotation(texts: Sequence[str]) -> tuple[FloatArray, Rounding]:
    """A rotation (3, 3) from roll, pitch and yaw as written [rad]."""
    written, exact = [float(text) for text in texts], [exact_angle(text) for text in texts]
    rotation = rotation_from_rpy(*exact)
    changed = [k for k in range(3) if written[k] != exact[k]]
    if not changed:
        return rotation, Rounding()
    chord = float(np.linalg.norm(rotation - rotation_from_rpy(*written))) / math.sqrt(2)
    quarters = tuple(texts[k].lstrip("+-") for k in changed if exact[k] != 0.0)
    return rotation, Rounding(quarters, len(changed) - len(quarters), chord)


def exact_axis(axis: FloatArray) -> tuple[FloatArray, Rounding]:
    """A unit vector (3,), without components that are a rounded zero."""
    noise = (axis != 0.0) & (np.abs(axis) < _NOISE)
    if not noise.any():
        return axis, Rounding()
    exact = np.where(noise, 0.0, axis)
    exact /= np.linalg.norm(exact)
    # turning about the other axis: the way there, the turn, the way back
    return exact, Rounding((), int(noise.sum()), 2 * float(np.linalg.norm(exact - axis)))
