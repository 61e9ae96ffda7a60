"""Distances between straight segments, and from boxes: many at once, entry by entry in memory."""

from __future__ import annotations

import math

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.subproblems import dot

_PARALLEL = 1e-12
"""squared sine of the angle between two segments below which they count as parallel"""


def segment_distance(p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray) -> FloatArray:
    """Smallest distance (...) between the segments ``p + s u`` and ``q + t v``, s and t in 0 … 1.

    All are (3, ...) [m]. After Ericson, *Real-Time Collision Detection* (2005), section 5.1.9: the nearest
    points of the two lines, then t clipped and s fitted to it. A segment of no length is a point.
    """
    r = p - q
    a, e, b = dot(u, u), dot(v, v), dot(u, v)
    c, f = dot(u, r), dot(v, r)
    crossing = a * e - b * b
    skew = crossing > _PARALLEL * a * e
    s = np.where(skew, np.clip((b * f - c * e) / np.where(skew, crossing, 1.0), 0.0, 1.0), 0.0)
    t = np.clip(np.where(e > 0.0, (b * s + f) / np.where(e > 0.0, e, 1.0), 0.0), 0.0, 1.0)
    s = np.clip(np.where(a > 0.0, (b * t - c) / np.where(a > 0.0, a, 1.0), 0.0), 0.0, 1.0)
    gap = r + s * u - t * v
    return np.sqrt(dot(gap, gap))


def segment_box_distance(p: FloatArray, u: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Smallest signed distance (...) of the segments ``p + s u``, (3, ...) [m], to a box as ``box_distance``.

    The signed distance to a convex body is convex along a line, so a golden section search finds its
    minimum; it ends within 1e-9 of the segment's length.
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
    """Signed distance (...) of points (3, ...) to a box, corners (3,); inside, minus the depth."""
    shape = (3, *[1] * (points.ndim - 1))
    middle, half = 0.5 * (low + high).reshape(shape), 0.5 * (high - low).reshape(shape)
    beyond = np.abs(points - middle) - half
    outside = np.maximum(beyond, 0.0)
    return np.sqrt(dot(outside, outside)) + np.minimum(beyond.max(axis=0), 0.0)
