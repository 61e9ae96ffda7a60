"""The values that a swept joint takes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError

FloatArray = NDArray[np.float64]
DEFAULT_STEP = math.radians(0.01)
"""the paper's step of the swept joint [rad]"""
_MOST_VALUES = 2_000_000
_SLACK = 1e-6
"""how far outside a limit a multiple of the step may lie by rounding, in steps"""


def grid_values(low: float, high: float, step: float) -> FloatArray:
    """Whole multiples of ``step`` within a joint's limits [rad], rising.

    Raises:
        InputError: ``step`` is not a positive angle, or so small that there are too many values.
    """
    if not (math.isfinite(step) and step > 0 and (high - low) / step <= _MOST_VALUES):
        least = math.degrees((high - low) / _MOST_VALUES)
        raise InputError(
            f"the step of the swept joint must be an angle of at least {least:.2g}°, got {step!r} rad"
        )
    first, last = math.ceil(low / step - _SLACK), math.floor(high / step + _SLACK)
    return np.clip(step * np.arange(first, last + 1, dtype=np.float64), low, high)
