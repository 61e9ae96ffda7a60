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


def needs(title: str, limits: NDArray[np.float64] | Sequence[float], *angles: float) -> str:
    """What a joint would have to do, and what it may: ``limits`` (2,) and alternative ``angles`` [rad]."""
    low, high, *needed = (math.degrees(float(value)) for value in (*limits, *angles))
    digits = max(_digits(angle, low, high) for angle in needed)
    said = " or ".join(f"{angle:.{digits}f}°" for angle in needed)
    return f"{title} needs {said}, its limits are {low:.{digits}f}° … {high:.{digits}f}°"


def _digits(angle: float, low: float, high: float) -> int:
    """How many decimals tell an angle from both limits."""
    shown = ((k, f"{angle:.{k}f}", (f"{low:.{k}f}", f"{high:.{k}f}")) for k in range(2, 10))
    return next((k for k, text, limits in shown if text not in limits), 2)
