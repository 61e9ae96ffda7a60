"""Distances between straight segments, many at once, entry by entry in memory."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_PARALLEL = 1e-12
"""squared sine of the angle between two segments below which they count as parallel"""


def segment_distance(p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray) -> FloatArray:
    """Smallest distance between the segments ``p + s u`` and ``q + t v``, s and t in 0 … 1.

    After Ericson, *Real-Time Collision Detection* (2005), section 5.1.9: the nearest points of the two
    lines, then t clipped and s fitted to it. A segment of no length is a point.

    Args:
        p: (3, ...) start of the first [m].
        u: (3, ...) from its start to its end [m].
        q: (3, ...) start of the second [m].
        v: (3, ...) from its start to its end [m].

    Returns:
        (...) [m].
    """
    r = p - q
    a, e, b = _dot(u, u), _dot(v, v), _dot(u, v)
    c, f = _dot(u, r), _dot(v, r)
    crossing = a * e - b * b
    skew = crossing > _PARALLEL * a * e
    s = np.where(skew, np.clip((b * f - c * e) / np.where(skew, crossing, 1.0), 0.0, 1.0), 0.0)
    t = np.clip(np.where(e > 0.0, (b * s + f) / np.where(e > 0.0, e, 1.0), 0.0), 0.0, 1.0)
    s = np.clip(np.where(a > 0.0, (b * t - c) / np.where(a > 0.0, a, 1.0), 0.0), 0.0, 1.0)
    gap = r + s * u - t * v
    return np.sqrt(_dot(gap, gap))


def segment_box_distance(p: FloatArray, u: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Smallest signed distance between the segments ``p + s u`` and a box; inside, minus the depth.

    The signed distance to a convex body is convex along a line, so a golden section search finds its
    minimum; it ends within 1e-9 of the segment's length.

    Args:
        p: (3, ...) starts [m].
        u: (3, ...) from start to end [m].
        low: (3,) lower corner of the box [m].
        high: (3,) upper corner [m].

    Returns:
        (...) [m].
    """
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    left, right = np.zeros(p.shape[1:]), np.ones(p.shape[1:])
    near, far = left + (1.0 - ratio), left + ratio
    at_near, at_far = box_distance(p + near * u, low, high), box_distance(p + far * u, low, high)
    for _ in range(44):
        lower = at_near < at_far
        left, right = np.where(lower, left, near), np.where(lower, far, right)
        step: FloatArray = ratio * (right - left)
        fresh: FloatArray = np.where(lower, right - step, left + step)
        value = box_distance(p + fresh * u, low, high)
        near, far = np.where(lower, fresh, far), np.where(lower, near, fresh)
        at_near, at_far = np.where(lower, value, at_far), np.where(lower, at_near, value)
    ends = np.minimum(box_distance(p, low, high), box_distance(p + u, low, high))
    return np.minimum(np.minimum(at_near, at_far), ends)


def box_distance(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Signed distance (...) [m] of points (3, ...) to an axis-aligned box; inside, minus the depth."""
    shape = (3, *[1] * (points.ndim - 1))
    middle, half = 0.5 * (low + high).reshape(shape), 0.5 * (high - low).reshape(shape)
    beyond = np.abs(points - middle) - half
    outside = np.maximum(beyond, 0.0)
    return np.sqrt(_dot(outside, outside)) + np.minimum(beyond.max(axis=0), 0.0)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
