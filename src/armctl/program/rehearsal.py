"""A program over time before it is run: what each step does, and when."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, ProgramError
from armctl.lazy_dataclass import dataclass
from armctl.motion.analysis import TICK_S
from armctl.motion.plan import plan_joints
from armctl.motion.profiles import PointToPoint
from armctl.motion.trajectory import JoinedTrajectory, SlowedTrajectory, Trajectory
from armctl.program.base_steps import MotionStep, Question, Senses, Step
from armctl.program.calls import ALL_OF_IT, StepPlace, WholeProgram
from armctl.program.feed import PlannedStep, ProgramSource, begin_program, decided, plan_next
from armctl.program.program import Program, in_first_cells
from armctl.robot import CarriedPart, Robot

_SAME_S = 1e-9
"""two times that are as close are the same [s]"""


@dataclass(frozen=True, slots=True, eq=False)
class RehearsedStep:
    """One step as it is executed: a motion, or standing while time goes by or the gripper moves."""

    index: int
    """in the program"""
    begins: float
    """[s]"""
    trajectory: Trajectory
    """its motion; standing still where no joint moves"""
    opening: tuple[float | None, float | None]
    """gripper 0..1 at its begin and its end; None: not known"""
    part: CarriedPart | None = None
    """what is between the jaws, from its begin; None: nothing"""
    place: StepPlace = ALL_OF_IT
    """where in the step of the program it is"""
    grips: bool = False
    """it moves the gripper"""
    tool: str = ""
    """name of the tool that is on, from its begin; empty: the robot file names none"""

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.trajectory.duration


@dataclass(frozen=True, slots=True)
class RehearsedState:
    """What is shown at one time."""

    q: FloatArray
    opening: float | None
    index: int
    """of the step"""
    part: CarriedPart | None = None
    """what is between the jaws"""
    tool: str = ""
    """name of the tool that is on"""


@dataclass(frozen=True, slots=True, eq=False)
class Rehearsal:
    """Steps one after another, at least one."""

    steps: tuple[RehearsedStep, ...]
    cut: bool = False
    """there is more of the program than was asked for"""
    broken: PlannedStep | None = None
    """the step after these, which cannot be run; None: all can"""

    @property
    def duration(self) -> float:
        """Seconds at full speed."""
        return self.steps[-1].begins + self.steps[-1].duration

    @property
    def trajectory(self) -> JoinedTrajectory:
        """All of it as one motion."""
        parts: list[Trajectory] = []
        at = 0.0
        for step in self.steps:
            if step.begins - at > _SAME_S:  # it stands until a tick
                here = step.trajectory.start
                parts.append(PointToPoint.lasting(here, here, step.begins - at))
            parts.append(step.trajectory)
            at = step.begins + step.duration
        return JoinedTrajectory(parts)

    def sample(self, t: float) -> RehearsedState:
        """State at ``t`` [s]; outside the duration it holds the nearer end."""
        step = self.steps[max(bisect_right(self.steps, t, key=lambda step: step.begins) - 1, 0)]
        passed = min(max(t - step.begins, 0.0), step.duration)
        (begin, end), opening = step.opening, step.opening[1]
        if begin is not None and end is not None and step.duration > 0:
            opening = begin + (end - begin) * passed / step.duration
        return RehearsedState(step.trajectory.sample(passed).q, opening, step.index, step.part, step.tool)

    def by_tool(self, robot: Robot, times: FloatArray) -> Iterator[tuple[Robot, NDArray[np.bool_]]]:
        """The arm with each tool that is on at some of ``times`` (k,) [s], and (k,) at which of them."""
        begins = np.array([step.begins for step in self.steps])
        tools = np.array([step.tool for step in self.steps])[np.searchsorted(begins, times, "right") - 1]
        for tool in dict.fromkeys(tools.tolist()):
            yield robot.with_tool(tool), tools == tool

    def tool_path(self, robot: Robot, count: int = 400) -> FloatArray:
        """Tool points (count, 3) [m], evenly spaced in time."""
        times = np.linspace(0.0, self.duration, count)
        q, points = self.trajectory.sample(times).q, np.empty((count, 3))
        for arm, then in self.by_tool(robot, times):
            points[then] = arm.forward(q[then])[:, :3, 3]
        return points


def pose_after(robot: Robot, program: Program, row: int, start: FloatArray) -> FloatArray | None:
    """Where the step at ``row`` leads (n,) [rad], after those ahead of it; None: it moves no joint.

    The nearest step ahead whose end is known by itself comes first; where there is none, the arm begins at
    ``start``. Of a grid it is the first cell. Raises as ``MotionStep.path``.
    """
    whole = WholeProgram.of(program)
    moves = [k for k in whole.span(row) if isinstance(whole.flat.steps[k], MotionStep)]
    if not moves:
        return None
    steps = in_first_cells(whole.flat)
    arms = _with_tools(robot, steps)
    led = [moves[-1]]
    for index in range(moves[-1] - 1, -1, -1):
        step = steps[index]
        if isinstance(step, MotionStep):
            if (end := step.end(arms[index])) is not None:
                start = end
                break
            led.append(index)
    for index in reversed(led):
        step, ahead = steps[index], whole.place(index).index
        try:
            path = step.path(arms[index], start) if isinstance(step, MotionStep) else None
        except ArmctlError as cause:
            if ahead == row:
                raise
            raise ProgramError(cause.reason).about(f"step {ahead + 1}") from cause
        start = start if path is None else path(path.high)
    return start


def _with_tools(robot: Robot, steps: Sequence[Step]) -> list[Robot]:
    """The arm at each step, with the tool that the last step above it puts on."""
    arms: list[Robot] = []
    for step in steps:
        tool = "" if isinstance(step, MotionStep) else step.effect.tool
        if any(tool == one.name for one in robot.tools):
            robot = robot.with_tool(tool)
        arms.append(robot)
    return arms


def rehearse_pose(robot: Robot, start: FloatArray, end: FloatArray, opening: float | None) -> Rehearsal:
    """A planned movement to a pose (n,) [rad]; refused as in ``plan_joints``."""
    motion = plan_joints(robot, start, end)
    return Rehearsal((RehearsedStep(0, 0.0, motion, (opening, opening), robot.part, tool=robot.tool),))


def rehearse(
    robot: Robot,
    program: Program,
    start: FloatArray,
    opening: float | None = None,
    *,
    longest_s: float = math.inf,
    most_steps: int = 100_000,
    as_far: bool = False,
    go_on: Callable[[], bool] = lambda: True,
    answer: Callable[[Question, Senses], bool] = lambda question, senses: question.holds(senses),
) -> Rehearsal:
    """One pass of a program from ``start`` (n,) [rad] at an ``opening`` 0..1, cut at ``longest_s`` [s].

    A step that cannot be run is a ProgramError; with ``as_far`` it ends the rehearsal, but for the first.
    What begins from rest begins at a tick of the arm, and one step a tick: thirty short steps last half a
    second longer than their motions.
    ``go_on`` is asked before each step after the first: where it says no, the rehearsal is cut there.
    ``answer``: what steps that ask are told; as it is, counters are counted, and no input is known, so that
    nothing that is asked of one holds.
    """
    source, at = ProgramSource(program), 0.0
    state = begin_program(robot, program, start, opening=opening)
    steps: list[RehearsedStep] = []
    counters: dict[str, int] = {}
    goes_on = False
    while at < longest_s and len(steps) < most_steps and (not steps or go_on()):
        planned, state = plan_next(robot, source, state)
        if not planned:
            if not steps:
                raise ProgramError("there is nothing to rehearse")
            return Rehearsal(tuple(steps))
        for step in planned:
            if step.error is not None:
                if as_far and steps:
                    return Rehearsal(tuple(steps), broken=step)
                who = f"{step.program.name}: step {step.index + 1}: {step.place.words}"
                raise ProgramError(f"{who}{step.error}") from step.error
            done = _rehearsed(robot, step, start, opening, at)
            steps.append(done)
            start, opening, over = done.trajectory.end, done.opening[1], at + done.duration
            goes_on = step.goes_on if step.moves else goes_on
            at = over if goes_on else _tick_behind(at, over)
            effect = step.step.effect
            if effect.counts is not None:
                counters[effect.counts.counter] = effect.counts.after(counters.get(effect.counts.counter, 0))
            if effect.asks is not None:
                state = decided(state, answer(effect.asks, Senses({}, {}, counters=counters)))
    return Rehearsal(tuple(steps), cut=True)


def _tick_behind(begun: float, over: float) -> float:
    """The tick [s] at which what follows begins: the first when this is over, and later than its own."""
    return TICK_S * max(math.ceil((over - _SAME_S) / TICK_S), math.floor((begun + _SAME_S) / TICK_S) + 1)


def _rehearsed(
    robot: Robot, step: PlannedStep, q: FloatArray, opening: float | None, at: float
) -> RehearsedStep:
    if step.trajectory is not None:
        trajectory: Trajectory = step.trajectory
        if step.percent != 100.0:
            trajectory = SlowedTrajectory(trajectory, 100.0 / step.percent)
        before = step.before
        return RehearsedStep(
            step.index, at, trajectory, (opening, opening), before.part, step.place, tool=before.tool
        )
    robot, effect = robot.with_tool(step.before.tool), step.step.effect
    goal, takes = opening, effect.wait_s or 0.0
    if effect.opening is not None:
        goal = effect.opening
        if opening is not None and robot.gripper is not None:
            takes += abs(goal - opening) / robot.gripper.speed
    if step.after.tool != step.before.tool:
        goal = None
    standing, grips = PointToPoint.lasting(q, q, takes), effect.opening is not None
    ends, after = (opening, goal), step.after
    return RehearsedStep(step.index, at, standing, ends, after.part, step.place, grips, after.tool)
