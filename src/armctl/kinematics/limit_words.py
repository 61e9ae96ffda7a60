"""What is said of a joint that would have to leave its limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_UNSEEN = math.radians(0.005)
"""an excess that two decimals do not show: what a search for the least excess leaves [rad]"""


def all_needs(titles: Sequence[str], limits: NDArray[np.float64], needed: Sequence[tuple[int, float]]) -> str:
    """What some joints would have to do at once: index and angle [rad] of each, ``limits`` (n, 2)."""
    seen = [
        (joint, angle)
        for joint, angle in needed
        if not limits[joint, 0] - _UNSEEN <= angle <= limits[joint, 1] + _UNSEEN
    ]
    return " and ".join(needs(titles[joint], limits[joint], angle) for joint, angle in seen or needed)


def needs(title: str, limits: NDArray[np.float64] | Sequence[float], angle: float) -> str:
    """What a joint would have to do, and what it may: ``limits`` (2,) and ``angle`` [rad]."""
    low, high, needed = (math.degrees(float(value)) for value in (*limits, angle))
    digits = next((k for k in range(2, 10) if f"{needed:.{k}f}" not in (f"{low:.{k}f}", f"{high:.{k}f}")), 2)
    return f"{title} needs {needed:.{digits}f}°, its limits are {low:.{digits}f}° … {high:.{digits}f}°"
