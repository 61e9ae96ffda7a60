"""From what is asked for to a trajectory that has passed its pre-flight."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import UnreachableError
from armctl.kinematics import DEFAULT_STEP, Target
from armctl.motion.preflight import require_clear
from armctl.motion.profiles.cubic import CubicTrajectory
from armctl.motion.profiles.trapezoid import TrapezoidTrajectory
from armctl.motion.program import MoveStep, PointStep
from armctl.motion.trajectory import Trajectory
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
Profile = Literal["planned", "normal"]
"""planned: cubic, synchronised. normal: each joint at its own speed (takes no duration)."""


def plan_joints(
    robot: Robot,
    start: ArrayLike,
    end: ArrayLike,
    duration_s: float | None = None,
    profile: Profile = "planned",
) -> Trajectory:
    """Plan a motion to joint angles and check it.

    Args:
        robot: the arm.
        start: (n,) where it stands [rad].
        end: (n,) where to go [rad].
        duration_s: seconds; None: the shortest that the limits allow.
        profile: "planned", or "normal", which goes at each joint's own speed and takes no duration.

    Raises:
        InputError: a value that is not finite, or a wrong shape.
        MotionRefusedError: outside the joint limits, too short a duration, or through the floor.
    """
    end = robot.check_limits(end)
    trajectory: Trajectory
    if profile == "normal" and duration_s is None:
        trajectory = TrapezoidTrajectory.plan(robot, start, end)
    else:
        trajectory = CubicTrajectory.plan(robot, start, end, duration_s)
    require_clear(robot, trajectory)
    return trajectory


def plan_target(
    robot: Robot,
    start: ArrayLike,
    target: Target,
    choose: str = "least-rotation",
    duration_s: float | None = None,
    profile: Profile = "planned",
) -> Trajectory:
    """Plan a motion of the tool to a target by inverse kinematics and check it.

    Args:
        robot: the arm.
        start: (n,) where it stands [rad].
        target: where the tool shall go.
        choose: criterion for the choice among the solutions.
        duration_s: seconds; None: the shortest that the limits allow.
        profile: as in ``plan_joints``.

    Raises:
        InputError: no such criterion.
        UnreachableError: no solution; says why, and which point is the nearest.
        MotionRefusedError: as in ``plan_joints``.
    """
    return plan_joints(robot, start, solve(robot, start, target, choose), duration_s, profile)


def solve(robot: Robot, start: ArrayLike | None, target: Target, choose: str) -> FloatArray:
    """The configuration (n,) [rad] that the criterion chooses for a target.

    Raises:
        InputError: no such criterion.
        UnreachableError: no solution; says why, and which point is the nearest.
    """
    solutions = robot.inverse_kinematics.solve(target, DEFAULT_STEP)
    if not solutions.success:
        raise UnreachableError(solutions.explanation or "there is no solution")
    return solutions.best(choose, start)


def plan_step(robot: Robot, start: ArrayLike, step: MoveStep | PointStep) -> Trajectory:
    """Plan one moving step of a program.

    Raises:
        InputError: a value that is not finite, or the wrong number of joints.
        UnreachableError: no solution.
        MotionRefusedError: as in ``plan_joints``.
    """
    if isinstance(step, MoveStep):
        return plan_joints(robot, start, np.radians(step.joints_deg), step.duration_s)
    return plan_target(robot, start, step_target(step), step.choose, step.duration_s)


def step_target(step: PointStep) -> Target:
    """The target of a point step, in metres and radians.

    Raises:
        InputError: a value that is not finite.
    """
    pitch = None if step.pitch_deg is None else math.radians(step.pitch_deg)
    roll = None if step.roll_deg is None else math.radians(step.roll_deg)
    return Target.of(np.array([step.x_mm, step.y_mm, step.z_mm]) / 1000, pitch, roll)
