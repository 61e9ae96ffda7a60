"""What is wrong with a program, found before it is run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from armctl.documents import Document
from armctl.errors import ArmctlError
from armctl.facts import FrameNamedBase, NoSteps, OtherRobot, Reason
from armctl.motion.preflight import Finding
from armctl.program.base_steps import Step
from armctl.program.calls import WholeProgram
from armctl.program.frames import BASE
from armctl.program.motion_steps import MoveStep
from armctl.program.paths import PathWalk
from armctl.program.program import PROGRAM_FILES, Blocks, Program
from armctl.program.steps import AnyStep
from armctl.robot import Robot


def check_program(
    program: Program,
    robot: Robot,
    *,
    motions: bool = True,
    start: ArrayLike | None = None,
    payload_kg: float | None = None,
    progress: Callable[[int, int], None] | None = None,
    whole: WholeProgram | None = None,
) -> list[Finding]:
    """What is wrong with a program for an arm, in the order of the steps; without errors it may be run.

    A blended step is checked as if it stopped: a corner that is refused when it is run
    becomes a stop, and warnings that only a corner gives are missed.
    ``motions``: also plan and check every motion whose start is known, on every path (``paths.py``; slower):
    each branch that conditions may lead to, and each pass of a loop until no pass is new.
    ``start``: (n,) where the first begins [rad]; None: not known. As it begins, the gripper is where that of
    ``robot`` is, and carries the same (``Robot.gripping``, ``Robot.carrying``).
    ``payload_kg``: None: as in the robot file.
    ``progress`` is called with the steps checked and all steps; what it raises ends the check.
    ``whole``: the program taken apart, where it was before.
    """
    findings: list[Finding] = []
    if program.robot != robot.name:
        findings.append(Finding(OtherRobot(program.robot, robot.name)))
    if not program.steps:
        findings.append(Finding(NoSteps()))
    findings += _frame_findings(program)
    whole = WholeProgram.of(program) if whole is None else whole
    wrong: dict[int, Reason] = {}
    """by index among the steps that run: what is wrong in itself"""
    in_steps: list[Finding] = []
    for index, why in _value_findings(program.steps, robot):
        in_steps.append(Finding(why, step=index))
        wrong |= dict.fromkeys(whole.span(index), why)
    for called in whole.files:
        for index, why in _value_findings(called.steps, robot):
            places = list(whole.where(called.file, index))
            in_steps.append(whole.called(places[0], why))
            wrong |= dict.fromkeys(places, why)
    blocks, placing = whole.blocks if whole.flat is program else Blocks.of(program.steps), whole.placing
    broken = blocks.findings
    for index, why in placing.unknown.items():
        in_steps.append(whole.told(Finding(why, step=index)))
        wrong[index] = why
    if not wrong:
        wrong |= placing.no_cell
        in_steps += [whole.told(Finding(why, step=index)) for index, why in wrong.items()]
    in_steps += [Finding(why, step=index) for index, why in (*broken, *whole.findings)]
    if motions and not broken:
        begin = None if start is None else robot.chain.checked(start)
        walk = PathWalk(whole, robot, {*wrong, *placing.lost}, payload_kg)
        walk.run(begin, progress)
        in_steps += map(whole.told, walk.found)
    return findings + sorted(in_steps, key=lambda finding: -1 if finding.step is None else finding.step)


def _frame_findings(program: Program) -> Iterator[Finding]:
    if BASE in program.frames:
        yield Finding(FrameNamedBase())
    try:  # as of the steps below: one that was made in Python is checked here only
        Document(PROGRAM_FILES, {"robot": "", "frames": msgspec.to_builtins(program.frames)}).convert(Program)
    except ArmctlError as cause:
        yield Finding(cause.reason)


_STEPS: msgspec.json.Decoder[tuple[Step, ...]] = msgspec.json.Decoder(tuple[AnyStep, ...])


def _has_plain_values(steps: Sequence[Step]) -> bool:
    """Whether all steps hold what a file could: right types, in range, finite. 10,000 steps take 10 ms."""
    try:
        return _STEPS.decode(msgspec.json.encode(steps)) == tuple(steps)  # what is not finite becomes null
    except (msgspec.MsgspecError, TypeError, ValueError):
        return False


def _is_sound(steps: Sequence[Step], robot: Robot) -> bool:
    """Whether no step is wrong in itself: all at once, or the start of a long program waits for it."""
    if not _has_plain_values(steps):
        return False
    try:
        for step in steps:
            if not isinstance(step, MoveStep):
                step.check(robot)
        poses = np.array([step.joints_deg for step in steps if isinstance(step, MoveStep)], dtype=np.float64)
        for corner in (poses.min(axis=0), poses.max(axis=0)) if len(poses) else ():
            robot.check_limits(robot.read(corner))
        if len(poses) and not robot.chain.keeps_turns(robot.read(poses)).all():
            return False
    except (ArmctlError, ValueError):  # poses of different lengths
        return False
    return True


def _value_findings(steps: Sequence[Step], robot: Robot) -> Iterator[tuple[int, Reason]]:
    for index, step in () if _is_sound(steps, robot) else enumerate(steps):
        try:
            # A file's values were checked when it was decoded; a program made in Python is checked here only.
            Document(PROGRAM_FILES, msgspec.to_builtins(step)).convert(type(step))
            step.check(robot)
        except ArmctlError as cause:
            yield index, cause.reason
