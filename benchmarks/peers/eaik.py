"""EAIK: closed-form inverse kinematics in C++ from the arm's joint axes; it knows no joint limits."""

from __future__ import annotations

import math
import os
from collections.abc import Callable

import numpy as np
from benchmarks.peers.joint_frames import FloatArray, check_forward, joint_frames
from benchmarks.peers.peer import load

from armctl import Robot


class Eaik:
    """One arm in EAIK."""

    name = "EAIK"
    all_solutions: Callable[[FloatArray], object]
    """what EAIK returns for one (4, 4) pose, as it returns it"""

    def __init__(self, robot: Robot) -> None:
        self._robot = load("eaik.IK_Homogeneous").HomogeneousRobot(joint_frames(robot).zero)
        self.all_solutions = self._robot.IK
        self._low, self._high = robot.limits.T
        self._workers = os.cpu_count() or 1
        q = np.random.default_rng(7).uniform(-1.5, 1.5, (20, robot.n))
        check_forward(self.name, np.array([self._robot.fwdKin(one) for one in q]), robot, q)

    def batch(self, poses: list[FloatArray]) -> object:
        """What EAIK returns for many poses, on all cores."""
        return self._robot.IK_batched(poses, num_worker_threads=self._workers)

    def inside_limits(self, pose: FloatArray) -> FloatArray:
        """(k, n) the exact ones for a pose, at every whole turn that the arm's limits allow, in numpy."""
        found = self._robot.IK(pose)
        q = np.atleast_2d(found.Q)[np.logical_not(found.is_LS)]
        turns, last = np.ceil((self._low - q) / math.tau), np.floor((self._high - q) / math.tau)
        inside = (turns <= last).all(axis=1)
        q, more = q[inside] + math.tau * turns[inside], (last - turns)[inside]
        for joint in np.flatnonzero(more.any(axis=0)):
            while (again := more[:, joint] > 0).any():
                further, left = q[again], more[again]
                further[:, joint] += math.tau
                left[:, joint] -= 1.0
                more[:, joint] = 0.0
                q, more = np.vstack([q, further]), np.vstack([more, left])
        return q

    def answers(self, pose: FloatArray) -> FloatArray:
        """(k, n) every configuration that EAIK offers for a pose, least-squares ones among them."""
        return np.atleast_2d(self._robot.IK(pose).Q)
