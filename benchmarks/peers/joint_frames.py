"""An arm's DH rows as what every peer can be built from: where each joint stands, by plain 4 x 4 products."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from benchmarks.measure import must_agree
from numpy.typing import NDArray

from armctl import Robot
from armctl.kinematics import DHRow

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class JointFrames:
    """Every joint turns about the z axis of its frame."""

    steps: FloatArray
    """(n, 4, 4) from each joint's turn, or the base, to the next joint's frame [m]"""
    tool: FloatArray
    """(4, 4) from the last joint's turn to the tool frame [m]"""

    @property
    def zero(self) -> FloatArray:
        """(n + 1, 4, 4) joint frames and the tool frame in the base frame, all joints at zero [m]."""
        frames = [np.eye(4)]
        for step in (*self.steps, self.tool):
            frames.append(frames[-1] @ step)
        return np.array(frames[1:])


def joint_frames(robot: Robot) -> JointFrames:
    """The frames that a robot's DH rows give."""
    steps: list[FloatArray] = []
    ahead = np.eye(4)
    for row in robot.chain.rows:
        x, z = _about_x(row), _about_z(row)
        if robot.chain.convention == "modified":
            ahead = ahead @ x
        if row.joint:
            steps.append(ahead)
            ahead = np.eye(4)
        ahead = ahead @ z
        if robot.chain.convention == "standard":
            ahead = ahead @ x
    return JointFrames(np.array(steps), ahead)


def _about_x(row: DHRow) -> FloatArray:
    c, s = math.cos(row.alpha_rad), math.sin(row.alpha_rad)
    return np.array([[1, 0, 0, row.a_m], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def _about_z(row: DHRow) -> FloatArray:
    c, s = math.cos(row.theta_rad), math.sin(row.theta_rad)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, row.d_m], [0, 0, 0, 1.0]])


def check_forward(name: str, peer: FloatArray, robot: Robot, q: FloatArray) -> None:
    """A peer that is another arm would be measured for nothing: tool poses (k, 4, 4) at q (k, n).

    Raises:
        ValueError: they differ by more than 1e-9.
    """
    must_agree(f"{name}, forward kinematics of {robot.name}", peer, robot.forward(q), 1e-9)
