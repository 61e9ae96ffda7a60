"""The steps of a program that come next, drawn as far as a blended motion has to look ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armctl.errors import ArmctlError
from armctl.motion.blend import Leg
from armctl.motion.program import Cursor, MotionStep, SpeedStep
from armctl.motion.program_state import DrawnStep, PlannedStep, PlanState, ProgramSource
from armctl.motion.step_plan import leg_of
from armctl.motion.timing import stopping_s
from armctl.robot import Robot

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
        if isinstance(step.step, SpeedStep):
            after = replace(after, percent=step.step.percent)
            steps.append(DrawnStep(step, None, after))
        elif isinstance(step.step, MotionStep):
            try:
                leg = leg_of(robot, state.q, step.step)
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
        else:
            if not times:
                steps.append(DrawnStep(step, None, after))
            break
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
