"""Checks of numbers at the door."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError

FloatArray = NDArray[np.float64]


def as_numbers(value: ArrayLike, what: str) -> FloatArray:
    """``value`` as an array of floats of any shape.

    Raises:
        InputError: anything but whole or real numbers: text, booleans, complex numbers, ragged lists.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as cause:
        raise InputError(f"{what} must be numbers, got {value!r}") from cause
    if array.dtype.kind not in "iuf":
        raise InputError(f"{what} must be numbers, got {value!r}")
    return array.astype(np.float64)


def checked_number(value: float, what: str) -> float:
    """``value`` as one finite float.

    Raises:
        InputError: text, an array, NaN or infinity.
    """
    array = as_numbers(value, what)
    if array.ndim != 0:
        raise InputError(f"{what} must be one number, got {value!r}")
    if not np.isfinite(array):
        raise InputError(f"{what} must be a finite number, got {value!r}")
    return float(array)
