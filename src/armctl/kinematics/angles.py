"""Angles: wrapping, images inside limits, fast cosine and sine of arrays."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray

TWO_PI = 2.0 * math.pi
LIMIT_TOLERANCE = 1e-9
"""How far rounding may carry an angle over its limit [rad]; what is accepted is clipped back onto it."""


def wrap(angle: float) -> float:
    """``angle`` [rad] brought into (-pi, pi]."""
    wrapped = math.remainder(angle, TWO_PI)
    return math.pi if wrapped <= -math.pi else wrapped


def rest_angle(low: float, high: float) -> float:
    """The angle between limits that is nearest to zero [rad]."""
    return min(max(0.0, low), high)


def central_image(angle: float, low: float, high: float) -> float:
    """The ``angle + 2 pi k`` nearest to the middle of limits [rad]."""
    middle = 0.5 * (low + high)
    return middle + math.remainder(angle - middle, TWO_PI)


def nearest_angle(angle: float, low: float, high: float) -> float:
    """The angle between limits that is nearest to any image of another one [rad]."""
    return min(max(central_image(angle, low, high), low), high)


def images(angle: float, low: float, high: float, tolerance: float = LIMIT_TOLERANCE) -> list[float]:
    """Every ``angle + 2 pi k`` inside ``[low, high]``, clipped onto the limits [rad]."""
    if high - low < TWO_PI - 2.0 * tolerance:  # the common case, at most one image
        if low <= angle <= high:
            return [angle]
        angle = central_image(angle, low, high)
        return [min(max(angle, low), high)] if low - tolerance <= angle <= high + tolerance else []
    first = math.ceil((low - tolerance - angle) / TWO_PI)
    last = math.floor((high + tolerance - angle) / TWO_PI)
    return [min(max(angle + TWO_PI * k, low), high) for k in range(first, last + 1)]


def half_angle_cos_sin(angle: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cosine and sine of an array [rad] from one tangent of the half angle.

    numpy vectorises float64 tan but not sin and cos; a large half-angle tangent (near a whole odd
    turn of pi) loses nothing: c = 2/(1+t²) - 1 and s = t·2/(1+t²) stay within 2 ulp of 1.
    """
    t = np.tan(0.5 * angle)
    g = 2.0 / (1.0 + t * t)
    return g - 1.0, t * g


# Angles brought into joint limits: one, or arrays of them.


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
