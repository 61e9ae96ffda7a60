"""Pinocchio (``pin``): rigid body dynamics in C++, the usual choice for forward kinematics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from benchmarks.peers.joint_frames import FloatArray, check_forward, joint_frames
from benchmarks.peers.peer import load

from armctl import Robot


class Pinocchio:
    """One arm as a Pinocchio model; both functions give the (4, 4) tool pose of q (n,)."""

    name = "Pinocchio"
    forward: Callable[[FloatArray], FloatArray]
    """the documented way: all frames, then the tool's"""
    forward_tool_only: Callable[[FloatArray], FloatArray]
    """the shortest way there is from Python: the joints, then one frame"""

    def __init__(self, robot: Robot) -> None:
        pin = load("pinocchio")
        frames = joint_frames(robot)
        model, joint = pin.Model(), 0
        for i, step in enumerate(frames.steps):
            joint = model.addJoint(joint, pin.JointModelRZ(), pin.SE3(step), f"joint {i + 1}")
        tool = model.addFrame(pin.Frame("tool", joint, 0, pin.SE3(frames.tool), pin.FrameType.OP_FRAME))
        data = model.createData()
        all_frames, placed = pin.framesForwardKinematics, data.oMf
        joints, one_frame = pin.forwardKinematics, pin.updateFramePlacement

        def forward(q: FloatArray) -> FloatArray:
            all_frames(model, data, q)
            return placed[tool].homogeneous

        def forward_tool_only(q: FloatArray) -> FloatArray:
            joints(model, data, q)
            return one_frame(model, data, tool).homogeneous

        self.forward, self.forward_tool_only = forward, forward_tool_only
        q = np.random.default_rng(7).uniform(-1.5, 1.5, (20, robot.n))
        for way in (forward, forward_tool_only):
            check_forward(self.name, np.array([way(one) for one in q]), robot, q)
