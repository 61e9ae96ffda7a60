"""What it means for the tool that a board takes its setpoints in whole steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.hardware.boards import board_type
from armctl.robot import OutputMap, Robot
from armctl.ui.widgets.html import fixed, muted
from armctl.ui.widgets.joint_angles import held_at

FloatArray = NDArray[np.float64]


def joint_steps(robot: Robot) -> FloatArray:
    """(n,) by how much each joint turns with one step of its setpoint [rad]; 0 for one that is held."""
    outputs = robot.output_map or OutputMap.stand_in(robot.limits)
    held = np.array([held_at(joint) is not None for joint in robot.joints])
    return np.where(held, 0.0, board_type(robot.board).scale.step / np.abs(outputs.per_rad))


def rounding_off_m(robot: Robot, q: FloatArray) -> float:
    """How far off its target the tool point may be at ``q`` (n,) [rad], each joint half a step off [m]."""
    return float(np.linalg.norm(robot.jacobian(q)[:3], axis=0) @ (0.5 * joint_steps(robot)))


def rounding_note(robot: Robot, q: FloatArray) -> str:
    """One line that says why a tool that was sent to 300 mm may show 299.9 mm; ``q`` (n,) [rad]."""
    board, steps = board_type(robot.board), np.degrees(joint_steps(robot))
    turning = steps[steps > 0]
    if not len(turning):
        return ""
    low, high = (fixed(float(step), 3) for step in (turning.min(), turning.max()))
    span = f"{low}°" if low == high else f"{low} … {high}°"
    counted = "Encoder steps", "1 count"
    scale = board.scale
    what, step = counted if board.homing else ("Servo steps", f"{scale.step:g} {scale.unit}")
    off = fixed(1000 * rounding_off_m(robot, q), 2)
    return muted(f"{what} of {span} ({step}): the tool may stop up to {off} mm beside its target.")
