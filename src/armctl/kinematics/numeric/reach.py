"""How far and how near any arm can reach by its links alone: bounds that hold whatever the limits."""

from __future__ import annotations

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.chain import Chain
from armctl.kinematics.solutions import too_far, too_near

_ROUNDING = 1e-9
_ROUNDS = 60


class LinkBound:
    """A shell about a fixed point of the first joint's axis that the tool point can never leave.

    One point is chosen on each joint axis; neighbours keep their distance. So the tool point is no farther
    from the first than the sum of the distances, and no nearer than the longest less all others.
    """

    def __init__(self, chain: Chain) -> None:
        points, axes = chain.axes()
        nodes = _shortest_polyline(points, axes, chain.forward(np.zeros(chain.n))[:3, 3])
        links = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
        self.centre: FloatArray = nodes[0]
        """(3,) the point of the first axis, base frame [m]"""
        self.outer = float(links.sum())
        """[m]"""
        self.inner = max(0.0, 2.0 * float(links.max()) - self.outer)
        """[m]"""

    def violation(self, point: FloatArray, first_joint: str) -> str | None:
        """Why a point (3,) [m] cannot be reached, in words; None where the links alone do not forbid it."""
        distance = float(np.linalg.norm(point - self.centre))
        x, y, z = 1000.0 * self.centre + 0.0
        place = f"({x:z.1f}, {y:z.1f}, {z:z.1f}) mm on the axis of {first_joint}"
        where = f"the target is {1000 * distance:.1f} mm from {place}"
        if distance > self.outer + _ROUNDING:
            return too_far(distance - self.outer, where, "the links together reach", self.outer)
        if distance < self.inner - _ROUNDING:
            return too_near(self.inner - distance, where, "the links fold no closer than", self.inner)
        return None


def _shortest_polyline(points: FloatArray, axes: FloatArray, tip: FloatArray) -> FloatArray:
    """(n + 1, 3) a point on each axis and the tip, joined by the shortest way (to about 1e-6 m)."""
    # Weiszfeld's method: least squares of the segments, each weighted by one over its last length.
    n = len(points)
    offsets = np.diff(np.vstack([points, tip]), axis=0)
    moves = np.zeros((n, 3, n))  # of each segment, as a point slides along its axis
    for k, axis in enumerate(axes):
        moves[k, :, k] = -axis
        if k > 0:
            moves[k - 1, :, k] = axis
    segments: FloatArray = offsets
    for _ in range(_ROUNDS):
        weights = 1.0 / np.maximum(np.linalg.norm(segments, axis=1), 1e-6)
        weighted: FloatArray = (moves * weights[:, None, None]).reshape(-1, n).T
        A: FloatArray = weighted @ moves.reshape(-1, n)
        b: FloatArray = -weighted @ offsets.ravel()
        along = np.linalg.lstsq(A, b, rcond=1e-12)[0]  # parallel axes may slide together
        segments = offsets + moves @ along
    return tip - np.vstack([np.cumsum(segments[::-1], axis=0)[::-1], np.zeros(3)])
