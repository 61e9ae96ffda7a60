"""Nothing is timed before it is known to do the same work."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def must_agree(what: str, one: FloatArray, other: FloatArray, within: float) -> None:
    """Both arrays are the same to ``within``, NaN where the other is NaN.

    Raises:
        ValueError: they are not; there is no sense in timing either.
    """
    if one.shape != other.shape or not np.array_equal(np.isnan(one), np.isnan(other)):
        raise ValueError(f"{what}: {one.shape} and {other.shape} do not answer the same targets")
    apart = float(np.nanmax(np.abs(one - other), initial=0.0))
    if not apart <= within:
        raise ValueError(f"{what}: results differ by {apart:.3g}, allowed is {within:.3g}")
