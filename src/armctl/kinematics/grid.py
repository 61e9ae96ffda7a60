"""The values that a swept joint takes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.kinematics.angles import rest_angle
from armctl.kinematics.target import checked_number

FloatArray = NDArray[np.float64]
DEFAULT_STEP = math.radians(0.01)
"""the paper's step of the swept joint [rad]"""
_MOST_VALUES = 2_000_000
_SLACK = 1e-6
"""how far outside a limit a multiple of the step may lie by rounding, in steps"""


def checked_step(step: float) -> float:
    """A sweep's step [rad] as a float.

    Raises:
        InputError: not a positive finite number.
    """
    step = checked_number(step, "the step of the swept joint")
    if step <= 0.0:
        raise InputError(f"the step of the swept joint must be a positive angle, got {step!r} rad")
    return step


def grid_values(low: float, high: float, step: float) -> FloatArray:
    """Whole multiples of ``step`` within a joint's limits [rad], rising.

    Limits too narrow for one, such as those of a held joint, have the angle that is nearest to zero.

    Args:
        low: lower limit [rad].
        high: upper limit [rad].
        step: ``checked_step`` [rad].

    Raises:
        InputError: ``step`` is so small that there are too many values.
    """
    if (high - low) / step > _MOST_VALUES:
        least = math.degrees((high - low) / _MOST_VALUES)
        raise InputError(
            f"the step of the swept joint must be an angle of at least {least:.2g}°, got {step!r} rad"
        )
    first, last = math.ceil(low / step - _SLACK), math.floor(high / step + _SLACK)
    if first > last:
        return np.array([rest_angle(low, high)])
    return np.clip(step * np.arange(first, last + 1, dtype=np.float64), low, high)
