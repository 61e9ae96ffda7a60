"""ik-geo: closed-form inverse kinematics in Rust by subproblems, for arms of six joints.

An arm of five gets a sixth axis through the tool point, across the roll axis. Its angle is left out of the
answer, which keeps the position and turns the tool by that angle only: the best that this solver can do.
"""

from __future__ import annotations

import numpy as np
from benchmarks.peers.joint_frames import FloatArray, check_forward, joint_frames
from benchmarks.peers.peer import load

from armctl import Robot


class IkGeo:
    """One arm of five joints, the second to the fourth parallel, in ik-geo."""

    name = "ik-geo"

    def __init__(self, robot: Robot) -> None:
        zero = joint_frames(robot).zero
        self._zero_rotation = zero[-1, :3, :3]
        axes = np.vstack([zero[:-1, :3, 2], self._zero_rotation[:, 0]])
        points = np.vstack([np.zeros(3), zero[:-1, :3, 3], zero[-1, :3, 3], zero[-1, :3, 3]])
        make = load("ik_geo").Robot.three_parallel_two_intersecting
        self._robot = make(axes, np.diff(points, axis=0))
        q = np.random.default_rng(7).uniform(-1.5, 1.5, (20, robot.n))
        check_forward(self.name, np.array([self._forward(one) for one in q]), robot, q)

    def _forward(self, q: FloatArray) -> FloatArray:
        rotation, position = self._robot.forward_kinematics(np.append(q, 0.0))
        T = np.eye(4)
        T[:3, :3] = (
            np.array(rotation).T @ self._zero_rotation
        )  # its rotations are handed over column by column
        T[:3, 3] = position
        return T

    def answers(self, pose: FloatArray) -> FloatArray:
        """(k, 5) every finite configuration that ik-geo offers for a (4, 4) pose."""
        turned = np.ascontiguousarray(self._zero_rotation @ pose[:3, :3].T)
        found = np.array([q[:5] for q, _ in self._robot.get_ik(turned, pose[:3, 3])]).reshape(-1, 5)
        return found[np.isfinite(found).all(axis=1)]
