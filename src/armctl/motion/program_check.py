"""What is wrong with a program, told before it is run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, ProgramError
from armctl.motion.plan import plan_step, solve, step_target
from armctl.motion.program import GripperStep, MoveStep, PointStep, Program, Step, WaitStep
from armctl.motion.program.program import LONGEST_WAIT_S
from armctl.robot import Robot

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ProgramFinding:
    """One thing that is wrong with a program."""

    step: int | None
    """index of the step; None: the program as a whole"""
    what: str

    def __str__(self) -> str:
        return self.what if self.step is None else f"step {self.step + 1}: {self.what}"


def check_program(program: Program, robot: Robot, *, motions: bool = True) -> list[ProgramFinding]:
    """Check a program against an arm.

    Args:
        program: the program.
        robot: the arm that shall run it.
        motions: also solve every point and plan every motion whose start is known, as far as the floor
            and the durations (slower). Where the first motion starts is not known, and so not checked.

    Returns:
        What was found, in the order of the steps; empty if it may be run.
    """
    findings: list[ProgramFinding] = []
    if program.robot != robot.name:
        findings.append(
            ProgramFinding(None, f"it is for the robot {program.robot!r}, this one is {robot.name!r}")
        )
    if not program.steps:
        findings.append(ProgramFinding(None, "it has no steps"))
    start: FloatArray | None = None
    for index, step in enumerate(program.steps):
        try:
            _check_values(step, robot)
            if motions and isinstance(step, MoveStep | PointStep):
                start = _after(step, robot, start)
        except ArmctlError as cause:
            findings.append(ProgramFinding(index, str(cause)))
            start = None
    return findings


def _check_values(step: Step, robot: Robot) -> None:
    # A file's numbers were checked when it was decoded; a program made in Python is checked here only.
    match step:
        case MoveStep():
            robot.check_limits(np.radians(step.joints_deg))
        case PointStep():
            step_target(step)
        case GripperStep(open_percent=percent):
            if robot.gripper is None:
                raise ProgramError(f"{robot.name} has no gripper; delete the step")
            if not 0 <= percent <= 100:
                raise ProgramError(f"the gripper opens 0 … 100 %, not {percent}")
        case WaitStep(seconds=seconds):
            if not 0 <= seconds <= LONGEST_WAIT_S:
                raise ProgramError(f"a wait takes 0 … {LONGEST_WAIT_S:.0f} s, not {seconds}")


def _after(step: MoveStep | PointStep, robot: Robot, start: FloatArray | None) -> FloatArray | None:
    if start is not None:
        return plan_step(robot, start, step).end
    if isinstance(step, MoveStep):
        return robot.check_limits(np.radians(step.joints_deg))
    if (
        step.choose == "least-travel"
    ):  # depends on a start that is not known: reachable is all that can be said
        solve(robot, None, step_target(step), "least-rotation")
        return None
    return solve(robot, None, step_target(step), step.choose)
