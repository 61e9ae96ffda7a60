"""How the tool moves: position, velocity and acceleration of the tool point from those of the joints."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_PROBE_S = 1e-4
_PARALLEL = 1e-6


@dataclass(frozen=True, slots=True)
class ToolMotion:
    """State of the tool point in the base frame."""

    position: FloatArray
    """(3,) [m]"""
    velocity: FloatArray
    """(3,) [m/s]"""
    acceleration: FloatArray
    """(3,) [m/s²]"""
    pitch: float
    """angle of the approach axis (tool z) above the horizontal [rad]"""
    roll: float | None
    """angle of the joint that turns the tool about that axis [rad]; None where there is none"""


def tool_motion(robot: Robot, q: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> ToolMotion:
    """State of the tool point: ``v = J q̇`` and ``a = J q̈ + J̇ q̇``.

    ``J̇`` is the central difference of the Jacobian along ``q̇``.

    Args:
        robot: the arm.
        q: (n,) joint angles [rad].
        velocity: (n,) [rad/s].
        acceleration: (n,) [rad/s²].
    """
    T = robot.forward(q)
    J = robot.jacobian(q)
    probes = robot.jacobian(np.stack([q + _PROBE_S * velocity, q - _PROBE_S * velocity]))[:, :3]
    J_dot = (probes[0] - probes[1]) / (2 * _PROBE_S)
    approach = T[:3, 2]
    turns_tool = float(np.linalg.norm(np.cross(J[3:, -1], approach))) < _PARALLEL
    return ToolMotion(
        position=T[:3, 3].copy(),
        velocity=J[:3] @ velocity,
        acceleration=J[:3] @ acceleration + J_dot @ velocity,
        pitch=math.asin(min(1.0, max(-1.0, float(approach[2])))),
        roll=float(q[-1]) if turns_tool else None,
    )
