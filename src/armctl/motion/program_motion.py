"""The motions of a program in the order they run, planned piece by piece ahead of the arm."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, InputError, MotionRefusedError, ProgramError
from armctl.motion.blend import Entry, Leg, blend
from armctl.motion.preflight import preflight_batch
from armctl.motion.program import Program
from armctl.motion.program_check import check_program
from armctl.motion.program_draft import DrawnMotion, ahead_s, draw, least_time
from armctl.motion.program_state import PlannedStep, PlanState, ProgramSource
from armctl.motion.step_plan import leads_tool, plan_leg
from armctl.motion.timing import TooFastError
from armctl.motion.trajectory import Trajectory
from armctl.robot import Robot

FloatArray = NDArray[np.float64]


def begin_program(
    robot: Robot,
    program: Program,
    start: FloatArray,
    *,
    loops: int | None = 1,
    first: int = 0,
    count: int | None = None,
) -> PlanState:
    """Check a program and stand before its first step.

    Args:
        robot: the arm.
        program: what to run.
        start: (n,) where the arm stands [rad].
        loops: how many passes; None: without end.
        first: index of the step that the first pass begins with.
        count: how many steps to run; None: all.

    Raises:
        InputError: ``loops``, ``first`` or ``count`` that cannot be.
        ProgramError: as ``require_runnable``.
    """
    first = _whole(first, "the first step")
    loops = None if loops is None else _whole(loops, "how often a program runs")
    count = None if count is None else _whole(count, "how many steps to run")
    require_runnable(robot, program)
    if not 0 <= first < len(program.steps):
        raise InputError(f"{program.name} has no step {first + 1}; it has {len(program.steps)}")
    if loops is not None and loops < 1:
        raise InputError(f"a program runs once or more often, not {loops} times")
    if count is not None and count < 1:
        raise InputError(f"a program runs one step or more, not {count}")
    return PlanState(start, loops, count, first=first)


def _whole(value: int, what: str) -> int:
    try:
        return operator.index(value)
    except TypeError as cause:
        raise InputError(f"{what} must be a whole number, got {value!r}") from cause


def require_runnable(robot: Robot, program: Program) -> None:
    """Refuse what can be refused without planning.

    Raises:
        ProgramError: another robot's program, no steps, or a step that this arm cannot run.
    """
    errors = [f for f in check_program(program, robot, motions=False) if f.severity == "error"]
    if errors:
        raise ProgramError(f"{program.name}: {errors[0]}")


def plan_next(robot: Robot, source: ProgramSource, state: PlanState) -> tuple[list[PlannedStep], PlanState]:
    """Plan the next steps: one, or as many as one blended motion needs to look ahead.

    What cannot be blended (a corner through the floor, the step after it refused) stops at its point.

    Args:
        robot: the arm.
        source: where a new pass takes its program from.
        state: what was planned before.

    Returns:
        The steps, and the state after them; no steps: the program has ended. A step that cannot be run
        comes last, with its error.
    """
    draft = draw(robot, source, state)
    moving = [k for k, drawn in enumerate(draft.steps) if drawn.leg is not None]
    if not moving:
        after = draft.steps[-1].after if draft.steps else state
        return [drawn.step for drawn in draft.steps], after
    try:
        motions = _motions(robot, draft.motions, state.entry, closed=draft.closed)
    except ArmctlError as cause:
        refused = draft.steps[moving[0]]
        before = [drawn.step for drawn in draft.steps[: moving[0]]]
        return [*before, replace(refused.step, error=cause)], refused.after
    planned = [drawn.step for drawn in draft.steps]
    entry = state.entry
    for k, (trajectory, leaves) in zip(moving, motions, strict=False):
        step = planned[k]
        before = replace(step.before, entry=entry)
        goes_on = leaves is not None
        planned[k] = replace(step, trajectory=trajectory, before=before, goes_on=goes_on)
        entry = leaves
    last = moving[len(motions) - 1]
    known = draft.steps[last + 1 :] if len(motions) < len(moving) else []
    return planned[: last + 1], replace(draft.steps[last].after, entry=entry, known=tuple(known))


def plan_again(
    robot: Robot, source: ProgramSource, states: Sequence[PlanState]
) -> tuple[int, list[PlannedStep], PlanState] | None:
    """Plan the next steps from the first of some states from which the arm can go on.

    A moving arm may be too fast to be braked for what comes now, where something else came before.

    Args:
        robot: the arm.
        source: where a new pass takes its program from.
        states: each before a moving step; see ``PlannedStep.again``.

    Returns:
        Which state it was, and what ``plan_next`` gives from there; None: none of them.
    """
    for number, state in enumerate(states):
        steps, after = plan_next(robot, source, state)
        if steps and steps[-1].error is None:
            return number, steps, after
    return None


def _motions(
    robot: Robot, steps: Sequence[DrawnMotion], entry: Entry | None, *, closed: bool
) -> list[tuple[Trajectory, Entry | None]]:
    """The motions of the first moving steps, as many as are certain, and how the one after each begins.

    Raises:
        ArmctlError: the first of them cannot be run.
    """
    if len(steps) == 1 and closed and entry is None:
        return [(plan_leg(robot, steps[0].step, steps[0].leg), None)]
    legs, tool_paths = [step.leg for step in steps], [leads_tool(step.step) for step in steps]
    while True:
        try:
            found = blend(robot, legs, entry)
        except TooFastError:
            # The corner before the newest leg asks for less speed than the arm has by now; without that leg
            # it can be braked: so it was planned.
            if len(legs) == 1:
                raise
            legs, closed = legs[:-1], True
            continue
        bad = _first_refused(robot, found.trajectories, tool_paths[: len(legs)])
        if bad is None:
            count = len(legs) if closed else _certain(robot, legs)
            return list(zip(found.trajectories[:count], found.entries[:count], strict=True))
        leg, cause = bad
        if legs[leg].blend_m > 0 and leg < len(legs) - 1:  # without its corner it may do
            legs = [*legs[:leg], replace(legs[leg], blend_m=0.0)]
        elif leg > 0:
            legs = legs[:leg]
        else:
            raise cause
        closed = True


def _first_refused(
    robot: Robot, trajectories: Sequence[Trajectory], tool_paths: Sequence[bool]
) -> tuple[int, ArmctlError] | None:
    found = preflight_batch(robot, trajectories, tool_paths=tool_paths, at_rest=False)
    for k, findings in enumerate(found):
        for finding in findings:
            if finding.severity == "error":
                return k, MotionRefusedError(str(finding))
    return None


def _certain(robot: Robot, legs: list[Leg]) -> int:
    """How many legs may be run before more are known: what is left is long enough to brake in."""
    left, count = 0.0, len(legs)
    while count > 1 and (left < 0.5 * ahead_s(robot) or count == len(legs)):
        count -= 1
        left += least_time(robot, legs[count])
    return count
