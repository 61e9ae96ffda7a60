"""From what is asked for to a trajectory that has passed its pre-flight."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import UnreachableError
from armctl.kinematics import DEFAULT_STEP, Target, YawPitchRollSolver, checked_criterion
from armctl.motion.preflight import require_clear
from armctl.motion.profiles import PointToPoint, ProfileName
from armctl.motion.trajectory import Trajectory
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
Profile = ProfileName | Literal["normal"]
"""A law for all joints together; or "normal": each joint at its own speed (takes no duration)."""


def plan_joints(
    robot: Robot,
    start: ArrayLike,
    end: ArrayLike,
    duration_s: float | None = None,
    profile: Profile = "cubic",
    *,
    checked: bool = True,
) -> Trajectory:
    """Plan a motion to joint angles and check it.

    Args:
        robot: the arm.
        start: (n,) where it stands [rad].
        end: (n,) where to go [rad].
        duration_s: seconds; None: the shortest that the limits allow.
        profile: a law, or "normal", which goes at each joint's own speed; with a duration that is a cubic.
        checked: run the pre-flight; False only for who runs it over many motions at once.

    Raises:
        InputError: a value that is not finite, or a wrong shape.
        MotionRefusedError: outside the joint limits, too short a duration, or through the floor.
    """
    end = robot.check_limits(end)
    trajectory: Trajectory
    if profile == "normal" and duration_s is None:
        trajectory = PointToPoint.each_for_itself(robot, start, end)
    else:
        law = "cubic" if profile == "normal" else profile
        trajectory = PointToPoint.plan(robot, start, end, duration_s, law)
    if checked:
        require_clear(robot, trajectory)
    return trajectory


def plan_target(
    robot: Robot,
    start: ArrayLike,
    target: Target,
    choose: str = "least-rotation",
    duration_s: float | None = None,
    profile: Profile = "cubic",
    *,
    checked: bool = True,
) -> Trajectory:
    """Plan a motion of the tool to a target by inverse kinematics and check it.

    Args:
        robot: the arm.
        start: (n,) where it stands [rad].
        target: where the tool shall go.
        choose: criterion for the choice among the solutions.
        duration_s: seconds; None: the shortest that the limits allow.
        profile: as in ``plan_joints``.
        checked: as in ``plan_joints``.

    Raises:
        InputError: no such criterion.
        UnreachableError: no solution; says why, and which point is the nearest.
        MotionRefusedError: as in ``plan_joints``.
    """
    end = solve(robot, start, target, choose)
    return plan_joints(robot, start, end, duration_s, profile, checked=checked)


def solve(robot: Robot, start: ArrayLike | None, target: Target, choose: str) -> FloatArray:
    """The configuration (n,) [rad] that the criterion chooses for a target.

    Raises:
        InputError: no such criterion.
        UnreachableError: no solution; says why, and which point is the nearest.
    """
    solver = robot.inverse_kinematics
    anyhow = target.pitch is None and target.roll is None and target.rotation is None
    if checked_criterion(choose) == "least-rotation" and anyhow and isinstance(solver, YawPitchRollSolver):
        q = robot.least_rotation(target.position)  # the same without listing ten thousand others
        if np.isfinite(q).all():
            return q
    solutions = solver.solve(target, DEFAULT_STEP)
    if not solutions.success:
        raise UnreachableError(solutions.explanation or "there is no solution")
    return solutions.best(choose, start)
