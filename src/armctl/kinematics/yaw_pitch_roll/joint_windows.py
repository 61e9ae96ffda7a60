"""Angles brought into joint limits: one, or arrays of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI

FloatArray = NDArray[np.float64]


Window = tuple[float, float, float]
"""lower limit, upper limit and what lies midway [rad]"""


def window(low: float, high: float) -> Window:
    """Limits that span a turn at most."""
    return low, high, 0.5 * (low + high)


def into_window(angle: float, limits: Window) -> float | None:
    """The image of an angle [rad] inside limits that span a turn at most, clipped onto them; or None."""
    low, high, middle = limits
    angle = middle + math.remainder(angle - middle, TWO_PI)
    if angle < low:
        return low if angle >= low - LIMIT_TOLERANCE else None
    if angle > high:
        return high if angle <= high + LIMIT_TOLERANCE else None
    return angle


def nearest_image(angle: float, low: float, high: float) -> float | None:
    """The image of an angle [rad] inside the limits that is nearest to zero, clipped onto them; or None."""
    angle = math.remainder(angle, TWO_PI)
    if angle < low:
        if angle >= low - LIMIT_TOLERANCE:
            return low
        angle += TWO_PI * math.ceil((low - LIMIT_TOLERANCE - angle) / TWO_PI)
        return min(max(angle, low), high) if angle <= high + LIMIT_TOLERANCE else None
    if angle > high:
        if angle <= high + LIMIT_TOLERANCE:
            return high
        angle -= TWO_PI * math.ceil((angle - high - LIMIT_TOLERANCE) / TWO_PI)
        return min(max(angle, low), high) if angle >= low - LIMIT_TOLERANCE else None
    return angle


def into_limits(angle: FloatArray, low: float, high: float) -> NDArray[np.bool_]:
    """Move angles in place onto their images inside the limits, the one nearest to zero where there are more.

    Args:
        angle: any shape [rad]; changed.
        low: lower limit [rad].
        high: upper limit [rad].

    Returns:
        Where there is an image inside the limits, or outside by no more than ``LIMIT_TOLERANCE``: clip
        what is used. False where the angle is NaN.
    """
    if high - low < TWO_PI:
        middle = 0.5 * (low + high)
        near = angle - middle  # only one image can be inside, and none nearer to the middle than this one
        near *= 1.0 / TWO_PI
        np.rint(near, out=near)
        near *= TWO_PI
        angle -= near
    else:
        angle -= TWO_PI * np.rint(angle * (1.0 / TWO_PI))
        if low > -math.pi:
            angle += TWO_PI * np.ceil(np.maximum(0.0, low - LIMIT_TOLERANCE - angle) / TWO_PI)
        if high < math.pi:
            angle -= TWO_PI * np.ceil(np.maximum(0.0, angle - high - LIMIT_TOLERANCE) / TWO_PI)
    inside = angle >= low - LIMIT_TOLERANCE
    inside &= angle <= high + LIMIT_TOLERANCE
    return inside
