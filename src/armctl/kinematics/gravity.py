"""Static gravity torque of an arm at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.chain import DHChain

FloatArray = NDArray[np.float64]
STANDARD_GRAVITY = 9.80665
"""m/s² (CGPM 1901)"""


@dataclass(frozen=True, slots=True)
class Body:
    """A point mass that moves with a joint."""

    joint: int
    """index of the joint that carries it"""
    mass_kg: float
    com_m: tuple[float, float, float]
    """in the frame of the joint's DH row"""


@dataclass(frozen=True, slots=True)
class GravityModel:
    """Masses of an arm; gravity points along -z of the base frame."""

    chain: DHChain
    bodies: tuple[Body, ...]
    payload_kg: float = 0.0
    """held at the tool point"""

    def torque(self, q: FloatArray) -> FloatArray:
        """Torque that each joint must hold against gravity.

        Args:
            q: (..., n) joint angles [rad].

        Returns:
            (..., n) [N·m], positive where gravity would turn the joint to smaller angles.

        The sum over all masses beyond the joint of ``m g (z_axis x lever)_z``: the gradient of the
        potential energy.
        """
        q = self.chain.checked(q)
        frames = self.chain.frames(q)
        if self.chain.convention == "modified":
            axis_frames = frames[..., [row + 1 for row in self.chain.joint_rows], :, :]
        else:
            axis_frames = frames[..., list(self.chain.joint_rows), :, :]
        axes, points = axis_frames[..., :3, 2], axis_frames[..., :3, 3]
        torque = np.zeros(q.shape)
        masses = [(body.joint, body.mass_kg, self._point(frames, body)) for body in self.bodies]
        masses.append((self.chain.n - 1, self.payload_kg, frames[..., -1, :3, 3]))
        for joint, mass, point in masses:
            lever = point[..., None, :] - points[..., : joint + 1, :]
            z = axes[..., : joint + 1, :]
            lift = z[..., 0] * lever[..., 1] - z[..., 1] * lever[..., 0]
            torque[..., : joint + 1] += mass * STANDARD_GRAVITY * lift
        return torque

    def _point(self, frames: FloatArray, body: Body) -> FloatArray:
        frame = frames[..., self.chain.joint_rows[body.joint] + 1, :, :]
        return frame[..., :3, :3] @ np.array(body.com_m) + frame[..., :3, 3]
