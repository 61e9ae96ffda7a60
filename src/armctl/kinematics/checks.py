"""Checks of numbers at the door."""

from __future__ import annotations

import math

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


def require_finite(array: FloatArray, what: str, first_row: int = 0, *, rows: bool = False) -> None:
    """Refuse NaN and infinity.

    Args:
        array: of any shape.
        what: what it is called in the message.
        first_row: what its first row is called, where it is a part of a larger array.
        rows: whether a flat array holds a number a row, not one row.

    Raises:
        InputError: names the first entry that is not finite.
    """
    finite = np.isfinite(array)
    if finite.all():
        return
    if array.ndim == 0 or (array.ndim == 1 and not rows):
        raise InputError(f"{what} must be finite numbers, got {array.tolist()}")
    row = int(np.argwhere(~finite)[0, 0])
    raise InputError(f"{what} must be finite numbers, got {array[row].tolist()} in row {first_row + row}")


def checked_number(value: float, what: str) -> float:
    """``value`` as one finite float.

    Raises:
        InputError: text, an array, NaN or infinity.
    """
    if type(value) is float and math.isfinite(value):
        return value
    array = as_numbers(value, what)
    if array.ndim != 0:
        raise InputError(f"{what} must be one number, got {value!r}")
    if not np.isfinite(array):
        raise InputError(f"{what} must be a finite number, got {value!r}")
    return float(array)
