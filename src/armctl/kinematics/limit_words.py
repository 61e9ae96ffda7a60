"""What is said of a joint that would have to leave its limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def needs(title: str, limits: NDArray[np.float64] | Sequence[float], angle: float) -> str:
    """What a joint would have to do, and what it may: ``limits`` (2,) and ``angle`` [rad]."""
    low, high, needed = (math.degrees(float(value)) for value in (*limits, angle))
    return f"{title} needs {needed:.2f}°, its limits are {low:.2f}° … {high:.2f}°"
