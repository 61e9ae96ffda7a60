"""One pass of a program as a single motion that can be drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ProgramError
from armctl.motion import Finding, GripperStep, Program, ProgramFinding, preflight
from armctl.motion.rehearsal import Rehearsal, rehearse
from armctl.robot import Robot
from armctl.ui.screens.trajectory_motion import PlannedMotion

FloatArray = NDArray[np.float64]
_MOST_STEPS = 400
_LONGEST_S = 600.0


def plan_program(robot: Robot, program: Program, start: FloatArray, opening: float | None) -> PlannedMotion:
    """Plan one pass as the arm would run it, as far as it can be drawn.

    Args:
        robot: the arm.
        program: what to draw.
        start: (n,) where the arm stands [rad].
        opening: of the gripper, 0..1; None: not known.

    Raises:
        ProgramError: none of its steps takes time, or the first cannot be planned.
    """
    whole = rehearse(
        robot, program, start, opening, longest_s=_LONGEST_S, most_steps=_MOST_STEPS, as_far=True
    )
    if whole.duration == 0:
        raise ProgramError(f"{program.name}: no step of it moves a joint, so there is nothing to show")
    # a drawing that is cut short may end in motion
    findings: list[Finding | ProgramFinding] = list(preflight(robot, whole.trajectory, at_rest=False))
    if whole.broken is not None:
        findings.insert(0, ProgramFinding(whole.broken.index, str(whole.broken.error)))
    return PlannedMotion(
        f"program {program.name}",
        whole.trajectory,
        tuple(findings),
        program=program,
        steps=tuple((step.begins, step.index) for step in whole.steps),
        note=_note(program, whole),
    )


def _note(program: Program, whole: Rehearsal) -> str:
    if whole.broken is not None:
        return f"Drawn as far as step {whole.broken.index + 1}, which cannot be run."
    if whole.cut:
        return f"The first {len(whole.steps)} steps of a pass; the rest is not drawn."
    untimed = sum(
        isinstance(program.steps[step.index], GripperStep) and step.duration == 0 for step in whole.steps
    )
    note = "One pass, with the durations of its own steps."
    if untimed:
        note += f" The time of {untimed} gripper step{'' if untimed == 1 else 's'} is not counted."
    return note
