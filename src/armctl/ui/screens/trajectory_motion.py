"""The motions that the Trajectory screen can show, planned off the event loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, ProgramError
from armctl.kinematics import Target
from armctl.motion import (
    CubicTrajectory,
    GripperStep,
    JoinedTrajectory,
    Profile,
    Program,
    Trajectory,
    WaitStep,
    arc,
    line,
    plan_joints,
    plan_step,
    plan_target,
)
from armctl.motion.point_path import plan_through, solve_points
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
TO_POINT = "present pose to X Y Z"
PROGRAM = "Program on the desk"
ARC = "Arc (58 points)"
LINE = "Line (29 points)"
_COARSE_STEP = 0.02
"""[rad] of a swept joint, where it only matters whether there is a solution"""
JOINT_BY_JOINT = "Joint by joint (study)"
TEST_PATHS = {ARC: arc, LINE: line}
"""the paper's test paths, by their labels"""


@dataclass(frozen=True, slots=True, eq=False)
class MotionRequest:
    """What the screen asks for."""

    motion: str
    start: FloatArray
    """(n,) where the arm stands [rad]"""
    profile: Profile
    duration_s: float | None
    choose: str
    target: Target | None = None
    program: Program | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PlannedMotion:
    """A motion that was planned and checked."""

    title: str
    trajectory: Trajectory
    points: FloatArray | None = None
    """(k, 3) points that it goes through [m]; None: none are prescribed"""
    solved: FloatArray | None = None
    """(k, n) joint angles in those points [rad]"""
    program: Program | None = None
    """run this instead of the trajectory: it has waits and gripper steps"""
    note: str = ""


def to_pose(name: str) -> str:
    """Label of the motion to a named pose."""
    return f"present pose to {name}"


def motion_labels(robot: Robot) -> tuple[str, ...]:
    """All motions, in the order in which they are offered."""
    return (*(to_pose(name) for name in robot.poses), TO_POINT, ARC, LINE, PROGRAM, JOINT_BY_JOINT)


def why_not(robot: Robot, points: FloatArray) -> str | None:
    """Why a path cannot be followed: its first point (of (k, 3) [m]) that is out of reach; None: it can."""
    for number, point in enumerate(points, 1):
        solutions = robot.inverse(point, step=_COARSE_STEP)
        if not solutions.success:
            return f"point {number} of {len(points)}: {solutions.reason}"
    return None


def plan_motion(robot: Robot, asked: MotionRequest) -> PlannedMotion:
    """Plan what is asked for.

    Raises:
        ArmctlError: it cannot be planned; says why.
    """
    start, profile, duration = asked.start, asked.profile, asked.duration_s
    if asked.motion in TEST_PATHS:
        return _plan_path(robot, asked, TEST_PATHS[asked.motion]())
    if asked.motion == PROGRAM:
        if asked.program is None or not asked.program.steps:
            raise ProgramError("the program on the desk has no steps; record some in Manual → Serial motion")
        return _plan_program(robot, asked.program, start)
    if asked.target is not None:
        trajectory = plan_target(robot, start, asked.target, asked.choose, duration, profile)
    else:
        name = next(name for name in robot.poses if to_pose(name) == asked.motion)
        trajectory = plan_joints(robot, start, robot.pose(name), duration, profile)
    note = "" if trajectory.duration > 0 else "The arm is there already."
    return PlannedMotion(asked.motion, trajectory, note=note)


def _plan_path(robot: Robot, asked: MotionRequest, points: FloatArray) -> PlannedMotion:
    solved = solve_points(robot, points, asked.choose, asked.start)
    trajectory = plan_through(robot, list(solved), asked.duration_s, asked.profile)
    note = "At rest for an instant in each point. Run goes to the first point first."
    return PlannedMotion(asked.motion, trajectory, points, solved, note=note)


def _plan_program(robot: Robot, program: Program, start: FloatArray) -> PlannedMotion:
    parts: list[Trajectory] = []
    grips = 0
    at = start
    for number, step in enumerate(program.steps, 1):
        if isinstance(step, GripperStep):
            grips += 1
            continue
        try:
            part = (
                CubicTrajectory(at, at, step.seconds)
                if isinstance(step, WaitStep)
                else plan_step(robot, at, step)
            )
        except ArmctlError as cause:
            raise ProgramError(f"{program.name}: step {number}: {cause}") from cause
        parts.append(part)
        at = part.end
    if not parts:
        raise ProgramError(f"{program.name}: no step of it moves a joint, so there is nothing to show")
    note = "One pass, with the durations of its own steps."
    if grips:
        note += f" The time of {grips} gripper step{'' if grips == 1 else 's'} is not counted."
    return PlannedMotion(f"program {program.name}", JoinedTrajectory(parts), program=program, note=note)
