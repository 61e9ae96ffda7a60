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
from armctl.kinematics import roll_pitch_yaw, rotation_from_rpy

_QUARTER = math.pi / 2
_UNSEEN_M = 1e-9
_NOISE = 1e-6
"""angles [rad] and components of unit vectors below this are a rounded zero"""
_FEWEST_DECIMALS = 4
"""that a rounded quarter turn has: 1.57 may be meant"""
_MOST_QUARTERS = 4
NOISY = math.radians(0.1)
"""angles this near to right ones are noise of CAD programs, or 1.57, where the user says so [rad]"""
NOISY_M = 5e-5
"""the same of offsets near to zero [m]"""


@dataclass(frozen=True, slots=True)
class Rounding:
    """What was taken as exact, and how far that is from what is written."""

    quarters: tuple[str, ...] = ()
    """rounded quarter turns as written, signs left out"""
    zeros: int = 0
    """numbers that are a rounded zero"""
    shift: float = 0.0
    """how far a point one metre off is moved by it, at most [m]"""
    moved: float = 0.0
    """how far every point is moved by it, besides [m]"""
    noise: tuple[str, ...] = ()
    """joints that were noisy, with the angle or the length"""

    def __add__(self, other: Rounding) -> Rounding:
        return Rounding(
            self.quarters + other.quarters,
            self.zeros + other.zeros,
            self.shift + other.shift,
            self.moved + other.moved,
            self.noise + other.noise,
        )


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


def without_noise(name: str, origin: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray, Rounding]:
    """Origin (4, 4) and axis (3,) of a joint with what is within ``NOISY`` of right angles taken as right."""
    exact, direction = origin.copy(), axis.copy()
    exact[:3, :3] = _square(origin[:3, :3])
    exact[:3, 3][np.abs(origin[:3, 3]) < NOISY_M] = 0.0
    direction[np.abs(axis) < NOISY] = 0.0
    if np.any(axis):
        direction /= np.linalg.norm(direction)
    turn = float(np.linalg.norm(exact[:3, :3] - origin[:3, :3])) / math.sqrt(2)
    leans = float(np.linalg.norm(direction - axis))
    moved = float(np.linalg.norm(exact[:3, 3] - origin[:3, 3]))
    if turn < _NOISE and leans < _NOISE and moved < _UNSEEN_M:
        return origin, axis, Rounding()
    angle = max(turn, float(np.linalg.norm(exact[:3, :3] @ direction - origin[:3, :3] @ axis)))
    size = f"{math.degrees(angle):.2g}°" if angle >= _NOISE else f"{1000 * moved:.2g} mm"
    return exact, direction, Rounding((), 0, turn + 2 * leans, moved, (f"{name} {size}",))


def _square(rotation: FloatArray) -> FloatArray:
    """A rotation near to quarter turns as these; of another one, each of roll, pitch and yaw that is near."""
    nearest = np.rint(rotation)
    if np.linalg.norm(nearest - rotation) < math.sqrt(2) * NOISY and np.linalg.det(nearest) == 1.0:
        return nearest
    angles = roll_pitch_yaw(rotation)
    quarters = _QUARTER * np.rint(angles / _QUARTER)
    return rotation_from_rpy(*np.where(np.abs(angles - quarters) < NOISY, quarters, angles).tolist())
