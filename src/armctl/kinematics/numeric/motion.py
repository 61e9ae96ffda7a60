"""Tool pose and motion of many configurations at once, for the numeric solver's small batches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.chain import DHChain

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ToolMotion:
    """Where the tool is and how each joint moves it, for k configurations, in the base frame."""

    rotation: FloatArray
    """(k, 3, 3) ``R_base_tool``"""
    position: FloatArray
    """(k, 3) [m]"""
    linear: FloatArray
    """(k, 3, n) velocity of the tool point for one rad/s of each joint [m/rad]"""
    axes: FloatArray
    """(k, 3, n) joint axes, unit vectors: the angular velocity for one rad/s of each joint"""

    @property
    def approach(self) -> FloatArray:
        """(k, 3) the tool's z axis."""
        return self.rotation[:, :, 2]


def tool_motion(chain: DHChain, q: FloatArray) -> ToolMotion:
    """Tool pose and Jacobian columns of configurations ``q`` (k, n) [rad] in one pass.

    One product of 4 x 4 matrices a joint: for the tens of configurations of a numeric search that is
    several times quicker than ``DHChain.forward`` and ``jacobian``, which are made for one or thousands.
    """
    c, s = np.cos(q)[..., None], np.sin(q)[..., None]
    segments = np.array(chain.segments)
    frame = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    origins = np.empty((len(q), 3, chain.n))
    axes = np.empty((len(q), 3, chain.n))
    for k in range(chain.n):
        ahead = frame @ segments[k]
        axes[:, :, k], origins[:, :, k] = ahead[:, :3, 2], ahead[:, :3, 3]
        frame = ahead.copy()
        frame[:, :, 0] = c[:, k] * ahead[:, :, 0] + s[:, k] * ahead[:, :, 1]
        frame[:, :, 1] = c[:, k] * ahead[:, :, 1] - s[:, k] * ahead[:, :, 0]
    tool = frame @ chain.tail
    position = tool[:, :3, 3]
    linear = crossed(axes, position[:, :, None] - origins)
    return ToolMotion(tool[:, :3, :3], position, linear, axes)


def crossed(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of (k, 3, n) or (k, 3, 1) columns; ``numpy.cross`` takes three times as long."""
    ax, ay, az = a[:, 0], a[:, 1], a[:, 2]
    bx, by, bz = b[:, 0], b[:, 1], b[:, 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def second_derivatives(motion: ToolMotion, weights: FloatArray, columns: FloatArray) -> FloatArray:
    """Second derivatives of ``weights · v`` by the joint angles: (k, n, n).

    Args:
        motion: the configurations.
        weights: (k, 3).
        columns: (k, 3, n) first derivatives of the vector v by the joint angles.

    For a vector v carried by the tool, joint i turns whatever joint j behind it does to v:
    ∂²v/∂q_i∂q_j = z_i x ∂v/∂q_j for i ≤ j.
    """
    upper = np.triu(np.swapaxes(crossed(weights[:, :, None], motion.axes), 1, 2) @ columns)
    return upper + np.swapaxes(np.triu(upper, 1), 1, 2)
