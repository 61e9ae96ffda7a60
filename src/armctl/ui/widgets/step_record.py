"""Steps made of where the arm stands."""

from __future__ import annotations

import numpy as np

from armctl.errors import StateError
from armctl.motion import usual_pitch
from armctl.motion.program import ArcStep, LineStep, MoveStep, PointStep, Step
from armctl.robot import Robot

POINT, LINE, SET_VIA, ARC = "Point", "Line", "Set via", "Arc"
"""labels of the buttons"""
Point = tuple[float, float, float]
_POINT_DIGITS = 3


def tool_point_mm(robot: Robot, pose_deg: tuple[float, ...]) -> Point:
    """Where the tool is at a pose [mm], to a micrometre."""
    x, y, z = np.round(1000 * robot.forward(np.radians(pose_deg))[:3, 3], _POINT_DIGITS).tolist()
    return x + 0.0, y + 0.0, z + 0.0


def step_here(kind: str, robot: Robot, pose_deg: tuple[float, ...], via_mm: Point | None) -> Step:
    """A step of a kind that leads to where the arm stands.

    Args:
        kind: a button's label; anything but point, line and arc gives a move to the angles.
        robot: the arm.
        pose_deg: (n,) where it stands.
        via_mm: the point on the arc, as set before.

    Raises:
        StateError: an arc without a via point.
    """
    x, y, z = tool_point_mm(robot, pose_deg)
    if kind == POINT:
        pitch, roll = robot.inverse_kinematics.pitch_and_roll(np.radians(pose_deg))
        if usual_pitch(robot) == "free":  # the place decides about it
            pitch = None
        return PointStep(x_mm=x, y_mm=y, z_mm=z, pitch_deg=_degrees(pitch), roll_deg=_degrees(roll))
    if kind == LINE:
        return LineStep(x_mm=x, y_mm=y, z_mm=z, pitch=usual_pitch(robot))
    if kind == ARC:
        if via_mm is None:
            raise StateError(
                f"an arc needs a point on its way: bring the tool there and press {SET_VIA!r}, "
                f"then go on to its end and press {ARC!r}"
            )
        via_x, via_y, via_z = via_mm
        return ArcStep(
            via_x_mm=via_x,
            via_y_mm=via_y,
            via_z_mm=via_z,
            x_mm=x,
            y_mm=y,
            z_mm=z,
            pitch=usual_pitch(robot),
        )
    return MoveStep(joints_deg=pose_deg)


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else round(float(np.degrees(angle)), _POINT_DIGITS) + 0.0
