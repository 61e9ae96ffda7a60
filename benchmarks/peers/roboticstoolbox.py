"""Robotics Toolbox for Python: its Levenberg-Marquardt solver ``ik_LM`` is C++."""

from __future__ import annotations

import math

import numpy as np
from benchmarks.peers.joint_frames import FloatArray, check_forward, joint_frames
from benchmarks.peers.peer import load

from armctl import Robot

_POSITION = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
_EXACT = 1e-12
"""half the squared error that ends a search: a micrometre"""
_POSITION_FIRST = np.array([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])
"""of the weights 1 to 0.001 the ones that answer most where the orientation cannot be had"""
_LENIENT = 0.5 * 1e-3 * math.radians(0.5) ** 2
"""ends a search half a degree off in orientation"""


class RoboticsToolbox:
    """One arm as an elementary transform sequence, its joint limits kept."""

    name = "roboticstoolbox"

    def __init__(self, robot: Robot) -> None:
        rtb = load("roboticstoolbox")
        frames = joint_frames(robot)
        self._ets = rtb.ETS()
        for i, (step, limits) in enumerate(zip(frames.steps, robot.limits, strict=True)):
            self._ets = self._ets * rtb.ET.SE3(step) * rtb.ET.Rz(jindex=i, qlim=limits)
        self._ets = self._ets * rtb.ET.SE3(frames.tool)
        q = np.random.default_rng(7).uniform(-1.5, 1.5, (20, robot.n))
        check_forward(self.name, np.array([self._ets.eval(one) for one in q]), robot, q)

    def position_only(self, pose: FloatArray) -> tuple[FloatArray, bool]:
        """(n,) some configuration at the position of a (4, 4) pose, and whether it was found."""
        found = self._ets.ik_LM(pose, mask=_POSITION, tol=_EXACT)
        return found.q, found.success

    def answers(self, pose: FloatArray) -> FloatArray:
        """(1, n) where the search for a (4, 4) pose ends, found or not, the position weighing most."""
        return np.atleast_2d(self._ets.ik_LM(pose, mask=_POSITION_FIRST, tol=_LENIENT).q)
