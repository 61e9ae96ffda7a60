"""The straightforward full-grid sweep of the swept joint: what armctl is measured and tested against.

Written from the geometry in the uzuner paper alone; it shares no code with armctl.
"""

from __future__ import annotations

import math

import numpy as np
from benchmarks.planar_arm import UZUNER, PlanarArm
from numpy.typing import NDArray

__all__ = ["UZUNER", "PlanarArm", "into", "naive_sweep"]

FloatArray = NDArray[np.float64]
LIMIT_TOLERANCE = 1e-9
"""what rounding may carry an angle over its limit [rad]; a cosine over 1 likewise"""


def into(angle: FloatArray, low: float, high: float) -> FloatArray:
    """The image of each angle that lies nearest to the middle of its limits."""
    middle = 0.5 * (low + high)
    return (angle - middle + math.pi) % (2 * math.pi) - math.pi + middle


def naive_sweep(arm: PlanarArm, position: FloatArray, step: float) -> FloatArray:
    """All solutions (k, 4) inside the limits with the first pitch joint on whole multiples of ``step``.

    Each of the two ways to face and the two elbows is solved on the whole grid; a mask throws away what
    is infeasible. Limits may not span more than one turn.
    """
    x, y, _ = position.tolist()
    inside = x * x + y * y - arm.lateral**2
    if inside < 0.0:
        return np.empty((0, 4))
    r = math.sqrt(inside)
    return np.concatenate(
        [_one_branch(arm, position, forward, elbow, step) for forward in (r, -r) for elbow in (1, -1)]
    )


def _one_branch(arm: PlanarArm, position: FloatArray, r: float, elbow: int, step: float) -> FloatArray:
    x, y, z = position.tolist()
    (low1, high1), (low2, high2), (low3, high3), (low4, high4) = arm.limits.tolist()
    l2, l3, l4 = arm.lengths
    s2, s3, s4 = arm.signs
    o2, o3, o4 = arm.offsets
    q1 = into(arm.yaw_sign * (np.arctan2(y, x) - np.arctan2(arm.lateral, r)), low1, high1)
    first, last = math.ceil(low2 / step - 1e-6), math.floor(high2 / step + 1e-6)
    q2 = np.clip(step * np.arange(first, last + 1), low2, high2)
    t2 = s2 * q2 + o2
    X = r - arm.shoulder_r - l2 * np.cos(t2)
    Y = z - arm.shoulder_z - l2 * np.sin(t2)
    c4 = (X**2 + Y**2 - l3**2 - l4**2) / (2 * l3 * l4)
    sin4 = elbow * np.sqrt(np.maximum(0.0, 1 - c4**2))
    t4 = np.arctan2(sin4, c4)
    t3 = np.arctan2(Y, X) - np.arctan2(l4 * sin4, l3 + l4 * c4) - t2
    q3 = into(s3 * (t3 - o3), low3, high3)
    q4 = into(s4 * (t4 - o4), low4, high4)
    e = LIMIT_TOLERANCE
    ok = (np.abs(c4) <= 1 + e) & (low1 - e <= q1) & (q1 <= high1 + e)
    ok &= (q3 >= low3 - e) & (q3 <= high3 + e) & (q4 >= low4 - e) & (q4 <= high4 + e)
    return np.stack([np.full(ok.sum(), q1), q2[ok], q3[ok], q4[ok]], axis=1)
