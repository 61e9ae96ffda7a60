"""The motions of a program in the order they run, planned piece by piece ahead of the arm."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, InputError, MotionRefusedError, ProgramError
from armctl.motion.blend import Entry, Leg, blend
from armctl.motion.preflight import preflight
from armctl.motion.profiles import stopping_s
from armctl.motion.timing import TooFastError
from armctl.motion.trajectory import Trajectory
from armctl.program.check import check_program
from armctl.program.program import Cursor, Program
from armctl.program.steps import MotionStep, Step
from armctl.robot import Robot


class ProgramSource:
    """The program as it is edited now: each pass begins with the newest."""

    def __init__(self, program: Program) -> None:
        self.program = program

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
    cursor: Cursor | None = None
    first: int = 0
    """step that the next pass begins with"""
    percent: float = 100.0
    """what the last speed step asks for"""
    entry: Entry | None = None
    """how the next leg is begun; None: from rest"""
    known: tuple[DrawnStep, ...] = ()
    """steps beyond that are solved already, because a blended motion had to look at them"""

    def begun(self, program: Program, cursor: Cursor) -> PlanState:
        """The next pass begins, with this version, at this place in it."""
        left = None if self.loops_left is None else self.loops_left - 1
        return replace(self, program=program, cursor=cursor, loops_left=left, first=0, percent=100.0)

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

    @property
    def moves(self) -> bool:
        """Whether joints move in it."""
        return self.trajectory is not None and self.trajectory.duration > 0


@dataclass(frozen=True, slots=True, eq=False)
class DrawnStep:
    """A step that is drawn from a program, not planned yet."""

    step: PlannedStep
    leg: Leg | None
    """its path, where it moves"""
    after: PlanState
    """the state after it"""


# The steps of a program that come next, drawn as far as a blended motion has to look ahead.

_AHEAD_S, _STOPS = 1.0, 6.0
"""How far a blended motion looks ahead: at least so long, and so many times what the slowest joint needs
to stand."""
_ENOUGH_LEGS = 3
"""So many are enough behind each other, however short the later ones are."""
_MOST_STEPS = 256


@dataclass(frozen=True, slots=True, eq=False)
class DrawnMotion:
    """A moving step and its path."""

    step: MotionStep
    leg: Leg


@dataclass(frozen=True, slots=True, eq=False)
class Draft:
    """Steps up to one that interrupts the motion, or as many as are needed to look ahead."""

    steps: list[DrawnStep]
    closed: bool
    """the last motion ends at rest"""

    @property
    def motions(self) -> list[DrawnMotion]:
        """Those of the steps that move."""
        return [
            DrawnMotion(drawn.step.step, drawn.leg)
            for drawn in self.steps
            if drawn.leg is not None and isinstance(drawn.step.step, MotionStep)
        ]


def draw(robot: Robot, source: ProgramSource, state: PlanState) -> Draft:
    """Draw the next steps; what is known in the state is not solved again.

    Args:
        robot: the arm.
        source: where a new pass takes its program from.
        state: what was planned before.

    Returns:
        No steps: the program has ended. Where the first moving step cannot be solved, it is the last one
        and says why; where a later one cannot, the motion ends before it.
    """
    steps = list(state.known)
    state = steps[-1].after if steps else replace(state, entry=None)
    times = [least_time(robot, drawn.leg) for drawn in steps if drawn.leg is not None]
    while len(steps) < _MOST_STEPS:
        if _far_enough(robot, times):
            return Draft(steps, closed=False)
        found = _next_step(source, state)
        if found is None:
            break
        step, after = found
        if isinstance(step.step, MotionStep):
            try:
                leg = step.step.leg(robot, state.q)
            except ArmctlError as cause:
                if not times:
                    steps.append(DrawnStep(replace(step, error=cause), None, after))
                break
            if leg is not None:
                after = replace(after, q=leg.path(leg.path.high))
                times.append(least_time(robot, leg))
            steps.append(DrawnStep(step, leg, after))
            if leg is not None and leg.blend_m == 0:
                break
        elif step.step.effect.stands:
            if not times:
                steps.append(DrawnStep(step, None, after))
            break
        else:
            percent = step.step.effect.percent
            after = after if percent is None else replace(after, percent=percent)
            steps.append(DrawnStep(step, None, after))
        state = after
    return Draft(steps, closed=True)


def _far_enough(robot: Robot, times: Sequence[float]) -> bool:
    """Whether legs of these times [s] leave the first one to be planned for good: it can be braked behind."""
    ahead = ahead_s(robot)
    return sum(times) >= ahead and (len(times) >= _ENOUGH_LEGS or sum(times[1:]) >= 0.5 * ahead)


def _next_step(source: ProgramSource, state: PlanState) -> tuple[PlannedStep, PlanState] | None:
    """The next step and the state after it, its motion aside; None at the end."""
    if state.ended:
        return None
    before = state
    if state.program is None or state.cursor is None:
        program = source.program  # read once: it may be edited at any time
        cursor = Cursor(program, state.first)
        state = state.begun(program, cursor)
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


def ahead_s(robot: Robot) -> float:
    """How much motion must be known behind what is planned for good, twice over [s]."""
    return max(_AHEAD_S, _STOPS * stopping_s(robot))


def least_time(robot: Robot, leg: Leg) -> float:
    """What a leg takes at least [s], as the slowest joint's straight way."""
    way = np.abs(leg.path(leg.path.high) - leg.path(leg.path.low))
    return max(float((way / robot.speed_limits).max()), (leg.path.high - leg.path.low) / leg.rate_cap)


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


def _motions(
    robot: Robot, steps: Sequence[DrawnMotion], entry: Entry | None, *, closed: bool
) -> list[tuple[Trajectory, Entry | None]]:
    """The motions of the first moving steps, as many as are certain, and how the one after each begins.

    Raises:
        ArmctlError: the first of them cannot be run.
    """
    if len(steps) == 1 and closed and entry is None:
        return [(steps[0].step.plan_leg(robot, steps[0].leg), None)]
    legs, tool_paths = [step.leg for step in steps], [step.step.leads_tool for step in steps]
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
    for k, (trajectory, tool_path) in enumerate(zip(trajectories, tool_paths, strict=True)):
        for finding in preflight(robot, trajectory, tool_path=tool_path, at_rest=False):
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
