"""What the twin does: a program or a motion, planned as for the arm and sampled at any time."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, ProgramError
from armctl.motion import (
    GripperStep,
    MoveStep,
    PointStep,
    Program,
    Trajectory,
    WaitStep,
    check_program,
    plan_joints,
    plan_step,
)
from armctl.robot import Robot

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TwinPart:
    """One step: a motion, or standing while time goes by or the gripper moves."""

    step: int
    """index in the program"""
    duration: float
    """[s]"""
    q: FloatArray
    """(n,) where it begins [rad]"""
    trajectory: Trajectory | None
    opening: tuple[float | None, float | None]
    """gripper 0..1 at its begin and its end"""


@dataclass(frozen=True, slots=True)
class TwinState:
    """The twin at one time."""

    q: FloatArray
    opening: float | None
    step: int


class TwinPlan:
    """Parts one after the other. Immutable."""

    def __init__(self, parts: tuple[TwinPart, ...]) -> None:
        self.parts = parts
        self._starts: list[float] = np.cumsum([0.0, *(part.duration for part in parts)])[:-1].tolist()

    @property
    def duration(self) -> float:
        """Seconds at full speed."""
        return self._starts[-1] + self.parts[-1].duration

    def sample(self, t: float) -> TwinState:
        """State at ``t`` [s]; outside the duration it holds the nearer end."""
        k = max(bisect_right(self._starts, t) - 1, 0)
        part = self.parts[k]
        passed = min(max(t - self._starts[k], 0.0), part.duration)
        q = part.q if part.trajectory is None else part.trajectory.sample(passed).q
        return TwinState(q, _opening(part, passed), part.step)

    def tool_path(self, robot: Robot, count: int = 400) -> FloatArray:
        """Tool points (count, 3) [m], evenly spaced in time."""
        times = np.linspace(0.0, self.duration, count)
        return robot.forward(np.array([self.sample(t).q for t in times.tolist()]))[:, :3, 3]


def plan_pose(robot: Robot, start: FloatArray, end: FloatArray, opening: float | None) -> TwinPlan:
    """A planned movement to a pose (n,) [rad].

    Raises:
        MotionRefusedError: outside the limits, or through the floor.
    """
    trajectory = plan_joints(robot, start, end)
    return TwinPlan((TwinPart(0, trajectory.duration, start, trajectory, (opening, opening)),))


def plan_program(robot: Robot, program: Program, start: FloatArray, opening: float | None) -> TwinPlan:
    """One pass of a program, as the arm would run it from ``start`` (n,) [rad].

    Raises:
        ProgramError: names the step that cannot be run.
    """
    findings = check_program(program, robot, motions=False)
    if findings:
        raise ProgramError(f"{program.name}: {findings[0]}")
    parts: list[TwinPart] = []
    for index, step in enumerate(program.steps):
        match step:
            case MoveStep() | PointStep():
                trajectory = _planned(robot, start, step, index)
                parts.append(TwinPart(index, trajectory.duration, start, trajectory, (opening, opening)))
                start = trajectory.end
            case WaitStep():
                parts.append(TwinPart(index, step.seconds, start, None, (opening, opening)))
            case GripperStep():
                goal = step.open_percent / 100
                takes = _gripper_time(robot, opening, goal)
                parts.append(TwinPart(index, takes, start, None, (opening, goal)))
                opening = goal
    return TwinPlan(tuple(parts))


def _planned(robot: Robot, start: FloatArray, step: MoveStep | PointStep, index: int) -> Trajectory:
    try:
        return plan_step(robot, start, step)
    except ArmctlError as cause:
        raise ProgramError(f"step {index + 1}: {cause}") from cause


def _gripper_time(robot: Robot, opening: float | None, goal: float) -> float:
    if opening is None or robot.gripper is None:
        return 0.0
    return abs(goal - opening) / robot.gripper.speed


def _opening(part: TwinPart, passed: float) -> float | None:
    begin, end = part.opening
    if begin is None or end is None or part.duration == 0:
        return end
    return begin + (end - begin) * passed / part.duration
