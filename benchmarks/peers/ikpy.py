"""ikpy: numeric inverse kinematics in Python over scipy's optimisers, the beginner's choice."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from benchmarks.peers.joint_frames import FloatArray, check_forward, joint_frames
from benchmarks.peers.peer import load

from armctl import Robot


class Ikpy:
    """One arm as an ikpy chain, its joint limits kept."""

    name = "ikpy"
    forward: Callable[[FloatArray], FloatArray]
    """(4, 4) tool pose of joint angles as ``padded`` gives them"""

    def __init__(self, robot: Robot) -> None:
        link = load("ikpy.link")
        frames = joint_frames(robot)
        links = [link.OriginLink()]
        for i, (step, limits) in enumerate(zip(frames.steps, robot.limits, strict=True)):
            links.append(
                link.URDFLink(
                    f"joint {i + 1}", step[:3, 3], _roll_pitch_yaw(step), rotation=np.array([0.0, 0.0, 1.0]),
                    bounds=tuple(limits), use_symbolic_matrix=False,
                )
            )  # fmt: skip
        tool = frames.tool
        links.append(
            link.URDFLink(
                "tool", tool[:3, 3], _roll_pitch_yaw(tool), use_symbolic_matrix=False, joint_type="fixed"
            )
        )
        mask = [False, *[True] * robot.n, False]
        self._chain = load("ikpy.chain").Chain(links, active_links_mask=mask)
        self.forward = self._chain.forward_kinematics
        self._middle = np.array([0.0, *robot.limits.mean(axis=1), 0.0])
        q = np.random.default_rng(7).uniform(-1.5, 1.5, (20, robot.n))
        check_forward(self.name, np.array([self.forward(self.padded(one)) for one in q]), robot, q)

    @staticmethod
    def padded(q: FloatArray) -> FloatArray:
        """(n + 2,) as ikpy counts its links: the base and the tool are links too."""
        return np.array([0.0, *q, 0.0])

    def position_only(self, position: FloatArray) -> FloatArray:
        """(n,) some configuration near a position (3,)."""
        return self._chain.inverse_kinematics(position, initial_position=self._middle)[1:-1]

    def answers(self, pose: FloatArray) -> FloatArray:
        """(1, n) where the search for a (4, 4) pose ends."""
        found = self._chain.inverse_kinematics_frame(pose, self._middle, orientation_mode="all")
        return np.atleast_2d(found[1:-1])


def _roll_pitch_yaw(T: FloatArray) -> FloatArray:
    """(3,) of a rotation whose pitch is not a right angle."""
    roll, pitch = math.atan2(T[2, 1], T[2, 2]), math.atan2(-T[2, 0], math.hypot(T[2, 1], T[2, 2]))
    return np.array([roll, pitch, math.atan2(T[1, 0], T[0, 0])])
