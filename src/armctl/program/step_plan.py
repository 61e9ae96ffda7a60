"""One moving step of a program, as a motion of its own or as a leg of a blended one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.kinematics import Target
from armctl.motion.blend import Leg
from armctl.motion.plan import (
    NOWHERE,
    follow_arc,
    follow_line,
    plan_arc,
    plan_joints,
    plan_line,
    plan_path,
    plan_target,
    solve,
)
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.trajectory import Trajectory
from armctl.program.program import ArcStep, LineStep, MotionStep, MoveStep, PointStep
from armctl.robot import Robot

FloatArray = NDArray[np.float64]


def plan_step(robot: Robot, start: ArrayLike, step: MotionStep, *, checked: bool = True) -> Trajectory:
    """Plan one moving step that starts and ends at rest, and check it (``checked``: as in ``plan_joints``).

    Raises:
        InputError: a value that is not finite, or the wrong number of joints.
        UnreachableError: no solution, or a line or arc that the arm cannot follow; says where and why.
        MotionRefusedError: as in ``plan_joints``.
    """
    match step:
        case MoveStep():
            end = np.radians(step.joints_deg)
            return plan_joints(robot, start, end, step.duration_s, step.profile, checked=checked)
        case PointStep():
            return plan_target(
                robot, start, step_target(step), step.choose, step.duration_s, step.profile, checked=checked
            )
        case LineStep():
            return plan_line(
                robot,
                start,
                _metres(step.x_mm, step.y_mm, step.z_mm),
                pitch=step.pitch,
                end_pitch=_radians(step.pitch_deg),
                speed=_speed(step),
                duration_s=step.duration_s,
                checked=checked,
            )
        case ArcStep():
            return plan_arc(
                robot,
                start,
                _metres(step.via_x_mm, step.via_y_mm, step.via_z_mm),
                _metres(step.x_mm, step.y_mm, step.z_mm),
                pitch=step.pitch,
                end_pitch=_radians(step.pitch_deg),
                speed=_speed(step),
                duration_s=step.duration_s,
                checked=checked,
            )


def leg_of(robot: Robot, start: FloatArray, step: MotionStep) -> Leg | None:
    """One moving step as a leg of a blended motion; None where it goes nowhere.

    In a blended motion the step's profile gives way to the speed plan over all legs, and its duration is
    a shortest one.

    Raises:
        InputError: a value that is not finite, or the wrong number of joints.
        UnreachableError: as in ``plan_step``.
        MotionRefusedError: outside the joint limits.
    """
    if isinstance(step, LineStep | ArcStep):
        path = _tool_path(robot, start, step)
        cap = math.inf if (speed := _speed(step)) is None else speed
    else:
        end = (
            robot.check_limits(np.radians(step.joints_deg))
            if isinstance(step, MoveStep)
            else solve(robot, start, step_target(step), step.choose)
        )
        moves = float(np.abs(end - start).max()) > NOWHERE
        path = PiecewisePolynomial([0.0, 1.0], np.stack([start, end - start])[None]) if moves else None
        cap = math.inf
    if path is None:
        return None
    if step.duration_s is not None and step.duration_s > 0:
        cap = min(cap, (path.high - path.low) / step.duration_s)
    return Leg(path, step.blend_mm / 1000, cap)


def plan_leg(robot: Robot, step: MotionStep, leg: Leg) -> Trajectory:
    """As ``plan_step``, for a step whose way is known from ``leg_of``.

    Raises:
        MotionRefusedError: as in ``plan_joints``.
    """
    start = leg.path(leg.path.low)
    if isinstance(step, MoveStep | PointStep):
        return plan_joints(robot, start, leg.path(leg.path.high), step.duration_s, step.profile)
    return plan_path(robot, start, leg.path, speed=_speed(step), duration_s=step.duration_s)


def leads_tool(step: MotionStep) -> bool:
    """Whether a step leads the tool along a path, and not each joint to its goal."""
    return isinstance(step, LineStep | ArcStep)


def step_target(step: PointStep) -> Target:
    """The target of a point step, in metres and radians.

    Raises:
        InputError: a value that is not finite.
    """
    return Target.of(
        _metres(step.x_mm, step.y_mm, step.z_mm), _radians(step.pitch_deg), _radians(step.roll_deg)
    )


def _tool_path(robot: Robot, start: FloatArray, step: LineStep | ArcStep) -> PiecewisePolynomial | None:
    end, end_pitch = _metres(step.x_mm, step.y_mm, step.z_mm), _radians(step.pitch_deg)
    if isinstance(step, LineStep):
        return follow_line(robot, start, end, step.pitch, end_pitch)
    via = _metres(step.via_x_mm, step.via_y_mm, step.via_z_mm)
    return follow_arc(robot, start, via, end, step.pitch, end_pitch)


def _metres(x_mm: float, y_mm: float, z_mm: float) -> FloatArray:
    return np.array([x_mm, y_mm, z_mm]) / 1000


def _radians(angle_deg: float | None) -> float | None:
    return None if angle_deg is None else math.radians(angle_deg)


def _speed(step: LineStep | ArcStep) -> float | None:
    """Largest speed of the tool [m/s]."""
    return None if step.speed_mm_s is None else step.speed_mm_s / 1000
