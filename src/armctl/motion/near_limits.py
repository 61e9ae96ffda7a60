"""Which limits a motion comes near to: those that are worth drawing beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armctl.motion.analysis import MotionAnalysis
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
Derivative = Literal["position", "velocity", "acceleration", "jerk"]
_NEAR = 0.7
"""a limit is drawn where the motion comes to this share of it"""
_POSITION_ROOM = 0.2
"""a joint limit is drawn where the motion comes this near, as a share of the joint's range"""


@dataclass(frozen=True, slots=True, eq=False)
class Limit:
    """A limit that a motion comes near to."""

    value: float
    """[°], with [s] for its derivatives"""
    joint: int
    is_upper: bool
    """not to be passed upwards, or not downwards"""


def near_limits(
    robot: Robot, motion: MotionAnalysis, quantity: Derivative, *, every: bool = False
) -> list[Limit]:
    """The joint limits that a motion comes near to, in degrees and seconds.

    Args:
        robot: the arm.
        motion: the motion.
        quantity: of the joints, whose limits.
        every: all of them, near or not.
    """
    if quantity == "position":
        return _near_ends(robot, motion.q, every=every)
    values, most = {
        "velocity": (motion.velocity, robot.speed_limits),
        "acceleration": (motion.acceleration, robot.acceleration_limits),
        "jerk": (motion.jerk, robot.jerk_limits),
    }[quantity]
    found: list[Limit] = []
    for joint, limit in enumerate(most.tolist()):
        for sign in (1, -1):
            if every or float((sign * values[:, joint]).max()) >= _NEAR * limit:
                found.append(Limit(sign * float(np.degrees(limit)), joint, is_upper=sign > 0))
    return found


def _near_ends(robot: Robot, q: FloatArray, *, every: bool) -> list[Limit]:
    found: list[Limit] = []
    for joint, (low, high) in enumerate(robot.limits.tolist()):
        room = _POSITION_ROOM * (high - low)
        if every or float(q[:, joint].min()) <= low + room:
            found.append(Limit(float(np.degrees(low)), joint, is_upper=False))
        if every or float(q[:, joint].max()) >= high - room:
            found.append(Limit(float(np.degrees(high)), joint, is_upper=True))
    return found
