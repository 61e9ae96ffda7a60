"""How large an arm is, and to which side it works: what drawing and camera go by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.robot import Robot
from armctl.robot.shape import reach as chain_reach

FloatArray = NDArray[np.float64]
_ABOVE_BASE = 0.02
"""A tool nearer to the base axis than this fraction of the reach is to no side of it."""


def reach(robot: Robot) -> float:
    """The length of the arm from its base frame to the tool point, all links stretched [m]."""
    return chain_reach(robot.chain)


def front(robot: Robot) -> FloatArray:
    """The horizontal direction (2,) from the base axis to the tool in the home pose, of length 1."""
    tool = robot.forward(robot.pose("home"))[:2, 3]
    distance = float(np.linalg.norm(tool))
    return np.array([1.0, 0.0]) if distance < _ABOVE_BASE * reach(robot) else tool / distance
