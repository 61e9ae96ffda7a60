"""How far and how near any arm can reach by its links alone: bounds that hold whatever the limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.chain import DHChain
from armctl.kinematics.length_words import millimetres

FloatArray = NDArray[np.float64]
_ROUNDING = 1e-9
_ROUNDS = 60


class LinkBound:
    """A shell about a fixed point of the first joint's axis that the tool point can never leave.

    One point is chosen on each joint axis. Two neighbours are both fixed to the link between their joints, so
    their distance never changes: the tool point is no farther from the first than the sum of the distances,
    and no nearer than the longest less all others. That holds for any points; those of the least sum
    bound best.
    """

    def __init__(self, chain: DHChain) -> None:
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
        where = f"{1000 * distance:.1f} mm from ({x:.1f}, {y:.1f}, {z:.1f}) mm on the axis of {first_joint}"
        if distance > self.outer + _ROUNDING:
            return (
                f"too far by {millimetres(distance - self.outer)} mm: the target is {where}, "
                f"the links together reach {1000 * self.outer:.1f} mm"
            )
        if distance < self.inner - _ROUNDING:
            return (
                f"inside the dead zone, too near by {millimetres(self.inner - distance)} mm: the target is "
                f"{where}, the links fold no closer than {1000 * self.inner:.1f} mm"
            )
        return None


def _shortest_polyline(points: FloatArray, axes: FloatArray, tip: FloatArray) -> FloatArray:
    """(n + 1, 3) a point on each axis and the tip, joined by the shortest way (to about 1e-6 m).

    Weiszfeld's method: least squares of the segments, each weighted by one over its last length; a system of
    n equations in the places along the axes.
    """
    n = len(points)
    along = np.zeros(n)
    for _ in range(_ROUNDS):
        nodes = np.vstack([points + along[:, None] * axes, tip])
        weights = 1.0 / np.maximum(np.linalg.norm(np.diff(nodes, axis=0), axis=1), 1e-6)
        A, b = np.zeros((n, n)), np.zeros(n)
        for k, weight in enumerate(weights):
            last = k == n - 1
            offset = (tip if last else points[k + 1]) - points[k]
            A[k, k] += weight
            b[k] += weight * (axes[k] @ offset)
            if not last:
                A[k + 1, k + 1] += weight
                A[k, k + 1] = A[k + 1, k] = -weight * (axes[k] @ axes[k + 1])
                b[k + 1] -= weight * (axes[k + 1] @ offset)
        along = np.linalg.lstsq(A, b, rcond=1e-12)[0]  # parallel axes may slide together
    return np.vstack([points + along[:, None] * axes, tip])
