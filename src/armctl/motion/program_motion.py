"""The motions of a program in the order they run, planned piece by piece ahead of the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, InputError, MotionRefusedError, ProgramError
from armctl.motion.blend import Entry, Leg, blend
from armctl.motion.preflight import preflight_batch
from armctl.motion.program import Cursor, MotionStep, Program, SpeedStep, Step
from armctl.motion.program_check import check_program
from armctl.motion.step_plan import leg_of, plan_step
from armctl.motion.timing import TooFastError, stopping_s
from armctl.motion.trajectory import Trajectory
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_AHEAD_S, _STOPS = 1.0, 6.0
"""How far a blended motion looks ahead: at least so long, and so many times what the slowest joint needs
to stand."""
_FEWEST_LEGS = 3
_MOST_STEPS = 256


class ProgramSource:
    """The program as it is edited now: each pass begins with the newest."""

    def __init__(self, program: Program) -> None:
        self.program = program


@dataclass(frozen=True, slots=True, eq=False)
class PlanState:
    """Up to where a program is planned."""

    q: FloatArray
    """(n,) where the next motion begins [rad]; of a blended one, the point that it turns off from"""
    loops_left: int | None
    """passes that have not begun; None: without end"""
    steps_left: int | None = None
    """how many steps shall still run; None: all"""
    passes: int = 0
    """passes finished"""
    program: Program | None = None
    """of the present pass; None: the next pass takes the newest"""
    cursor: Cursor | None = None
    first: int = 0
    """step that the next pass begins with"""
    percent: float = 100.0
    """what the last speed step asks for"""
    entry: Entry | None = None
    """how the next leg is begun; None: from rest"""
    known: tuple[_Drawn, ...] = ()
    """steps beyond that are solved already, because a blended motion had to look at them"""

    @property
    def ended(self) -> bool:
        """Nothing is left."""
        if self.known:
            return False
        if self.steps_left == 0:
            return True
        return self.program is None and self.loops_left == 0


@dataclass(frozen=True, slots=True, eq=False)
class PlannedStep:
    """One step on its way to be run."""

    index: int
    step: Step
    program: Program
    passes: int
    """passes finished before it"""
    percent: float
    before: PlanState
    """the state that planning it began with"""
    trajectory: Trajectory | None = None
    """its motion; None where no joint moves"""
    goes_on: bool = False
    """its motion does not end at rest: that of the next moving step goes on"""
    error: ArmctlError | None = None
    """why it cannot be run"""


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """A step that is drawn from a program, not planned yet."""

    step: PlannedStep
    leg: Leg | None
    """its path, where it moves"""
    after: PlanState
    """the state after it"""


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
    require_runnable(robot, program)
    if not 0 <= first < len(program.steps):
        raise InputError(f"{program.name} has no step {first + 1}; it has {len(program.steps)}")
    if loops is not None and loops < 1:
        raise InputError(f"a program runs once or more often, not {loops} times")
    if count is not None and count < 1:
        raise InputError(f"a program runs one step or more, not {count}")
    return PlanState(start, loops, count, first=first)


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
    draft = _draw(robot, source, state)
    moving = [k for k, drawn in enumerate(draft.steps) if drawn.leg is not None]
    if not moving:
        after = draft.steps[-1].after if draft.steps else state
        return [drawn.step for drawn in draft.steps], after
    try:
        motions = _motions(robot, draft, [draft.steps[k] for k in moving], state.entry)
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


@dataclass(frozen=True, slots=True, eq=False)
class _Draft:
    """Steps up to one that interrupts the motion, or as many as are needed to look ahead."""

    steps: list[_Drawn]
    closed: bool
    """the last motion ends at rest"""


def _draw(robot: Robot, source: ProgramSource, state: PlanState) -> _Draft:
    steps = list(state.known)
    legs = [drawn.leg for drawn in steps if drawn.leg is not None]
    state = steps[-1].after if steps else replace(state, entry=None)
    ahead = sum(_least_time(robot, leg) for leg in legs)
    while len(steps) < _MOST_STEPS:
        if len(legs) >= _FEWEST_LEGS and ahead >= _ahead_s(robot):
            return _Draft(steps, closed=False)
        found = _next_step(source, state)
        if found is None:
            break
        step, after = found
        if isinstance(step.step, SpeedStep):
            after = replace(after, percent=step.step.percent)
            steps.append(_Drawn(step, None, after))
        elif isinstance(step.step, MotionStep):
            try:
                leg = leg_of(robot, state.q, step.step)
            except ArmctlError as cause:
                if not legs:
                    steps.append(_Drawn(replace(step, error=cause), None, after))
                break
            if leg is not None:
                after = replace(after, q=leg.path(leg.path.high))
                legs.append(leg)
                ahead += _least_time(robot, leg)
            steps.append(_Drawn(step, leg, after))
            if leg is not None and leg.blend_m == 0:
                break
        else:
            if not legs:
                steps.append(_Drawn(step, None, after))
            break
        state = after
    return _Draft(steps, closed=True)


def _next_step(source: ProgramSource, state: PlanState) -> tuple[PlannedStep, PlanState] | None:
    """The next step and the state after it, its motion aside; None at the end."""
    if state.ended:
        return None
    before = state
    if state.program is None or state.cursor is None:
        program = source.program  # read once: it may be edited at any time
        cursor = Cursor(program, state.first)
        left = None if state.loops_left is None else state.loops_left - 1
        state = replace(state, program=program, loops_left=left, first=0, percent=100.0)
    else:
        program, cursor = state.program, state.cursor.copy()
    found = cursor.next()
    if found is None:
        if before.first == 0:
            return None  # a program with nothing to do
        # nor has what is behind the step that this pass began with
        return _next_step(source, replace(state, program=None, cursor=None, passes=state.passes + 1))
    index, step = found
    steps_left = None if state.steps_left is None else state.steps_left - 1
    planned = PlannedStep(index, step, program, state.passes, state.percent, before)
    if cursor.copy().next() is None:
        state = replace(state, steps_left=steps_left, program=None, cursor=None, passes=state.passes + 1)
    else:
        state = replace(state, steps_left=steps_left, cursor=cursor)
    return planned, state


def _motions(
    robot: Robot, draft: _Draft, moving: list[_Drawn], entry: Entry | None
) -> list[tuple[Trajectory, Entry | None]]:
    """The motions of the first moving steps, as many as are certain, and how the one after each begins.

    Raises:
        ArmctlError: the first of them cannot be run.
    """
    first = moving[0].step
    if len(moving) == 1 and draft.closed and entry is None and isinstance(first.step, MotionStep):
        return [(plan_step(robot, first.before.q, first.step), None)]
    legs, closed = [drawn.leg for drawn in moving if drawn.leg is not None], draft.closed
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
        bad = _first_refused(robot, found.trajectories)
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


def _first_refused(robot: Robot, trajectories: Sequence[Trajectory]) -> tuple[int, ArmctlError] | None:
    for k, findings in enumerate(preflight_batch(robot, trajectories, at_rest=False)):
        for finding in findings:
            if finding.severity == "error":
                return k, MotionRefusedError(str(finding))
    return None


def _certain(robot: Robot, legs: list[Leg]) -> int:
    """How many legs may be run before more are known: what is left is long enough to brake in."""
    left, count = 0.0, len(legs)
    while count > 1 and (left < 0.5 * _ahead_s(robot) or count == len(legs)):
        count -= 1
        left += _least_time(robot, legs[count])
    return count


def _ahead_s(robot: Robot) -> float:
    return max(_AHEAD_S, _STOPS * stopping_s(robot))


def _least_time(robot: Robot, leg: Leg) -> float:
    """What a leg takes at least [s], as the slowest joint's straight way."""
    way = np.abs(leg.path(leg.path.high) - leg.path(leg.path.low))
    return max(float((way / robot.speed_limits).max()), (leg.path.high - leg.path.low) / leg.rate_cap)
