"""Numbers as texts that tell them apart."""

from __future__ import annotations

import math

UNITS = {"speed": "°/s", "acceleration": "°/s²", "jerk": "°/s³"}
"""of the rates of a joint, as people read them"""


def decimals_apart(value: float, *others: float, least: int = 2) -> int:
    """With how many decimals a number and each of some others read differently."""
    for k in range(least, 10):
        if f"{value:.{k}f}" not in {f"{other:.{k}f}" for other in others}:
            return k
    return least


def degrees_apart(value: float, *others: float) -> tuple[str, ...]:
    """Angles [rad] as texts in degrees, with so many decimals that the first reads unlike the others."""
    first, *rest = (math.degrees(angle) + 0.0 for angle in (value, *others))
    digits = decimals_apart(first, *rest)
    return tuple(f"{angle:z.{digits}f}°" for angle in (first, *rest))
