"""The motions of a program in the order they run, planned piece by piece ahead of the arm."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, InputError, MotionRefusedError, ProgramError
from armctl.facts import ToolGripsNot, ToolHoldsPart
from armctl.facts.commands import NoSuchStep
from armctl.lazy_dataclass import dataclass
from armctl.motion.blend import Entry, Leg, blend
from armctl.motion.preflight import preflight
from armctl.motion.profiles import stopping_s
from armctl.motion.time_optimal import TooFastError
from armctl.motion.trajectory import Trajectory
from armctl.program.base_steps import Effect, MotionStep, Step
from armctl.program.calls import ALL_OF_IT, StepPlace, WholeProgram
from armctl.program.check import check_program
from armctl.program.program import Cursor, Program
from armctl.robot import CarriedPart, Robot

_AHEAD_S, _STOPS = 1.0, 6.0
"""A blend looks ahead at least so long [s], and so many times what the slowest joint needs to stand."""
_ENOUGH_LEGS = 3
"""So many are enough behind each other, however short the later ones are."""
_MOST_STEPS = 256


class ProgramSource:
    """The program as it is edited now: each pass begins with the newest."""

    _whole: WholeProgram | None = None

    def __init__(self, program: Program) -> None:
        self.program = program

    def whole(self) -> WholeProgram:
        """The same with all that it calls. Takes long programs apart: for who plans."""
        program, known = self.program, self._whole  # read once: it may be edited at any time
        if known is None or known.written is not program:
            self._whole = known = WholeProgram.of(program)
        return known

    def edit(self, program: Program) -> None:
        """Another version, from the next pass on."""
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
    whole: WholeProgram | None = None
    """of the present pass, likewise"""
    cursor: Cursor | None = None
    first: int = 0
    """step that the next pass begins with"""
    opening: float | None = None
    """of the gripper, 0..1; None: not known"""
    part: CarriedPart | None = None
    """what it carries; None: nothing"""
    tool: str = ""
    """name of the tool that is on; empty: the robot file names none"""
    entry: Entry | None = None
    """how the next leg is begun; None: from rest"""
    known: tuple[PlannedStep, ...] = ()
    """steps beyond that have their legs already, because a blended motion had to look at them"""

    @property
    def asks(self) -> bool:
        """Which step comes next is decided when the last one runs (``decided``); no more is planned."""
        return self.cursor is not None and self.cursor.asked is not None

    @property
    def ended(self) -> bool:
        """Nothing is left."""
        return self.program is None and 0 in (self.steps_left, self.loops_left) and not self.known


@dataclass(frozen=True, slots=True, eq=False)
class PlannedStep:
    """One step on its way to be run."""

    index: int
    """of the step as written"""
    step: Step
    program: Program
    passes: int
    """passes finished before it"""
    percent: float
    before: PlanState
    """the state that planning it began with"""
    after: PlanState
    leg: Leg | None = None
    """its path; None where no joint moves"""
    trajectory: Trajectory | None = None
    """its motion; None where no joint moves"""
    goes_on: bool = False
    """its motion does not end at rest: that of the next moving step goes on"""
    error: ArmctlError | None = None
    """why it cannot be run"""
    place: StepPlace = ALL_OF_IT
    """where in the step as written it is"""
    share: tuple[float, float] = (0.0, 1.0)
    """of the step as written: how much is ahead of it, and how much it is itself"""

    @property
    def moves(self) -> bool:
        """Whether joints move in it."""
        return self.trajectory is not None and self.trajectory.duration > 0


def begin_program(
    robot: Robot,
    program: Program,
    start: FloatArray,
    *,
    loops: int | None = 1,
    first: int = 0,
    count: int | None = None,
    opening: float | None = None,
    whole: WholeProgram | None = None,
) -> PlanState:
    """Check it, stand before step ``first`` at ``start`` (n,) [rad]. InputError: no such step or count.

    ``opening`` of the gripper, 0..1; None: not known. ``robot`` carries what it does as it begins. ``whole``:
    the program taken apart, where it was before.
    """
    first = whole_number(first, "the first step")
    loops = None if loops is None else whole_number(loops, "how often a program runs")
    count = None if count is None else whole_number(count, "how many steps to run")
    require_runnable(robot, program, whole)
    if not 0 <= first < len(program.steps):
        raise InputError(NoSuchStep(program.name, first + 1, len(program.steps)))
    if loops is not None and loops < 1:
        raise InputError(f"a program runs once or more often, not {loops} times")
    if count is not None and count < 1:
        raise InputError(f"a program runs one step or more, not {count}")
    return PlanState(start, loops, count, first=first, opening=opening, part=robot.part, tool=robot.tool)


def whole_number(value: int, what: str) -> int:
    """``value`` as an integer; ``InputError`` for a fraction, or what is no number."""
    try:
        return operator.index(value)
    except TypeError as cause:
        raise InputError(f"{what} must be a whole number, got {value!r}") from cause


def require_runnable(robot: Robot, program: Program, whole: WholeProgram | None = None) -> None:
    """ProgramError: another robot's program, no steps, or a step that cannot be run: all without planning."""
    for finding in check_program(program, robot, motions=False, whole=whole):
        if finding.severity == "error":
            raise ProgramError(f"{program.name}: {finding}")


def plan_next(robot: Robot, source: ProgramSource, state: PlanState) -> tuple[list[PlannedStep], PlanState]:
    """Plan the next steps: one, or as many as one blended motion needs to look ahead.

    Gives the steps and the state after them; no steps: the program has ended, or its last step
    asks. What cannot be blended (a corner through the floor, the step after it refused) stops at its point. A
    step that cannot be run comes last, with its error.
    """
    robot = robot.with_tool(state.tool)
    steps, closed = _draw(robot, source, state)
    moving = [k for k, step in enumerate(steps) if step.leg is not None]
    if not moving:
        return steps, steps[-1].after if steps else state
    held = steps[moving[0]].before  # it does not change while joints move
    robot = robot.gripping(held.opening).carrying(held.part)
    try:
        motions = _motions(robot, steps, state.entry, closed=closed)
    except ArmctlError as cause:
        refused = steps[moving[0]]
        return [*steps[: moving[0]], replace(refused, error=cause)], refused.after
    entry = state.entry
    for k, (trajectory, leaves) in zip(moving, motions, strict=False):
        before = replace(steps[k].before, entry=entry)
        goes_on = leaves is not None
        steps[k] = replace(steps[k], trajectory=trajectory, before=before, goes_on=goes_on)
        entry = leaves
    last = moving[len(motions) - 1]
    known = tuple(steps[last + 1 :]) if len(motions) < len(moving) else ()
    return steps[: last + 1], replace(steps[last].after, entry=entry, known=known)


def _draw(robot: Robot, source: ProgramSource, state: PlanState) -> tuple[list[PlannedStep], bool]:
    """The next steps with their legs, as far as a blend looks ahead; whether it ends at rest there."""
    steps = list(state.known)
    state = steps[-1].after if steps else replace(state, entry=None)
    times = [_least_time(robot, step.leg) for step in steps if step.leg is not None]
    ahead = _ahead_s(robot)
    while len(steps) < _MOST_STEPS:
        if sum(times) >= ahead and (len(times) >= _ENOUGH_LEGS or sum(times[1:]) >= 0.5 * ahead):
            return steps, False  # the first leg can be planned for good: behind it there is room to brake
        step = _next_step(source, state)
        if step is None:
            break
        if isinstance(step.step, MotionStep):
            try:
                leg = step.step.leg(robot, state.q)
            except ArmctlError as cause:
                if not times:
                    steps.append(replace(step, error=cause))
                break
            if leg is not None:
                step = replace(step, leg=leg, after=replace(step.after, q=leg.path(leg.path.high)))
                times.append(_least_time(robot, leg))
            steps.append(step)
            if leg is not None and leg.blend_m == 0:
                break
        else:
            effect = step.step.effect
            if not (effect.stands and times):
                try:
                    step = replace(step, after=_handled(robot, effect, step.after))
                except ArmctlError as cause:
                    step = replace(step, error=cause)
                steps.append(step)
            if effect.stands or step.error is not None:
                break
        state = steps[-1].after
    return steps, True


def _handled(robot: Robot, effect: Effect, after: PlanState) -> PlanState:
    """The state behind a step that moves the gripper, or changes the tool; ``ArmctlError``: it cannot."""
    if effect.opening is not None:
        if robot.gripper is None:
            raise ProgramError(ToolGripsNot(robot.tool))
        return replace(after, opening=effect.opening, part=effect.part)
    if effect.tool and effect.tool != after.tool:
        if after.part is not None:
            raise ProgramError(ToolHoldsPart(str(after.part)))
        return replace(after, opening=None, tool=robot.with_tool(effect.tool).tool)
    return after


def _next_step(source: ProgramSource, before: PlanState) -> PlannedStep | None:
    """The next step, its motion aside; None at the end."""
    if before.ended or before.asks:
        return None
    state = before
    if state.program is None or state.whole is None or state.cursor is None:
        whole = source.whole()
        known = whole.placing, whole.blocks.required()
        program, cursor = whole.written, Cursor(whole.flat, whole.begins[state.first], whole.marks, known)
        left = None if state.loops_left is None else state.loops_left - 1
        state = replace(state, program=program, whole=whole, loops_left=left, first=0)
    else:
        program, whole, cursor = state.program, state.whole, state.cursor.copy()
    begun = cursor.begun
    next_pass = replace(state, program=None, whole=None, cursor=None, passes=state.passes + 1)
    found = cursor.next()
    if found is None:
        # A program with nothing to do, or a pass that began behind all that there is to do.
        return None if before.first == 0 else _next_step(source, next_pass)
    left = None if state.steps_left is None else state.steps_left - (cursor.begun - begun)
    flat, step = found
    place, share = whole.place(flat), whole.share(flat)
    after = _at(replace(state, steps_left=left), cursor)
    return PlannedStep(
        place.index, step, program, state.passes, cursor.percent, before, after, place=place, share=share
    )


def _at(state: PlanState, cursor: Cursor) -> PlanState:
    """The state in a pass where its cursor stands; that before the next pass where nothing is left of it.

    Where no more steps shall run it is over, once the last one is, with all that it is made of.
    """
    if cursor.asked is not None:
        return replace(state, cursor=cursor)
    over = replace(state, program=None, whole=None, cursor=None)
    ahead = cursor.copy()
    if ahead.next() is None:
        return replace(over, passes=state.passes + 1)
    return over if state.steps_left == 0 and ahead.begun > cursor.begun else replace(state, cursor=cursor)


def decided(state: PlanState, holds: bool) -> PlanState:
    """The state in which the question that planning waits for is answered."""
    if state.cursor is None or not state.asks:
        raise ProgramError("no step asks anything")
    cursor = state.cursor.copy()
    cursor.decide(holds)
    return _at(state, cursor)


def _motions(
    robot: Robot, steps: Sequence[PlannedStep], entry: Entry | None, *, closed: bool
) -> list[tuple[Trajectory, Entry | None]]:
    """The motions of the first moving steps, as many as are certain, and how the one after each begins."""
    moving = [
        (one.step, one.leg) for one in steps if one.leg is not None and isinstance(one.step, MotionStep)
    ]
    if len(moving) == 1 and closed and entry is None:
        step, leg = moving[0]
        return [(step.plan_leg(robot, leg), None)]
    legs = [leg for _, leg in moving]
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
        bad = _first_refused(robot, found.trajectories, [step.leads_tool for step, _ in moving])
        if bad is None:
            count = len(legs) if closed else _certain(robot, legs)
            return list(zip(found.trajectories[:count], found.entries[:count], strict=True))
        k, cause = bad
        if legs[k].blend_m > 0 and k < len(legs) - 1:  # without its corner it may do
            legs = [*legs[:k], replace(legs[k], blend_m=0.0)]
        elif k > 0:
            legs = legs[:k]
        else:
            raise cause
        closed = True


def _first_refused(
    robot: Robot, trajectories: Sequence[Trajectory], tool_paths: Sequence[bool]
) -> tuple[int, ArmctlError] | None:
    for k, (trajectory, tool_path) in enumerate(zip(trajectories, tool_paths, strict=False)):
        for finding in preflight(robot, trajectory, tool_path=tool_path, at_rest=False):
            if finding.severity == "error":
                return k, MotionRefusedError(finding.fact)
    return None


def _certain(robot: Robot, legs: list[Leg]) -> int:
    """How many legs may be run before more are known: what is left is long enough to brake in."""
    left, count = 0.0, len(legs)
    while count > 1 and (left < 0.5 * _ahead_s(robot) or count == len(legs)):
        count -= 1
        left += _least_time(robot, legs[count])
    return count


def _ahead_s(robot: Robot) -> float:
    """How much motion must be known behind what is planned for good, twice over [s]."""
    return max(_AHEAD_S, _STOPS * stopping_s(robot))


def _least_time(robot: Robot, leg: Leg) -> float:
    """What a leg takes at least [s], as the slowest joint's straight way."""
    way = np.abs(leg.path(leg.path.high) - leg.path(leg.path.low))
    return max(float((way / robot.speed_limits).max()), (leg.path.high - leg.path.low) / leg.rate_cap)
