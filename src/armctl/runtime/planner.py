"""Planning off the controller thread."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, StateError
from armctl.kinematics import Target
from armctl.motion import (
    PlannedStep,
    PlanState,
    Profile,
    Program,
    ProgramSource,
    Trajectory,
    begin_program,
    plan_again,
    plan_joints,
    plan_next,
    plan_target,
    require_clear,
    require_runnable,
)
from armctl.robot import Robot
from armctl.runtime.keep_clear import KeepClear
from armctl.runtime.live_goal import LiveGoal, live_goal
from armctl.runtime.ticket import Ticket

FloatArray = NDArray[np.float64]
P = ParamSpec("P")
T = TypeVar("T")
_START_TOLERANCE = 1e-6
_LOGGER = logging.getLogger("armctl.runtime")


@dataclass(frozen=True, slots=True, eq=False)
class BegunProgram:
    """A program that is checked, with its first steps planned."""

    source: ProgramSource
    steps: list[PlannedStep]
    state: PlanState
    """after those steps"""


@dataclass(frozen=True, slots=True)
class Pending:
    """A motion or a program that is being planned."""

    ticket: Ticket
    who: str
    start: FloatArray
    """(n,) where it was planned from [rad]"""
    label: str
    future: Future[Trajectory] | Future[BegunProgram]
    loops: int | None = 1
    """of a program"""
    first: int = 0
    """of a program: the step that it begins with"""


@dataclass(frozen=True, slots=True)
class PendingEdit:
    """Another version of the running program, which is being checked."""

    ticket: Ticket
    who: str
    program: Program
    future: Future[None]


class InlineExecutor(Executor):
    """Runs what is submitted at once, on the caller's thread: for tests and offline runs."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run ``fn`` and give its future, which is done."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Planner:
    """Solves, chooses, plans and checks on an executor, and wakes the controller when a plan is ready."""

    def __init__(self, robot: Robot, executor: Executor, wake: Callable[[], None]) -> None:
        self._robot = robot
        self._clear = KeepClear(robot)
        self._executor = executor
        self._wake = wake

    def joints(
        self, start: FloatArray, end: FloatArray, duration_s: float | None, profile: Profile
    ) -> Future[Trajectory]:
        """Plan to joint angles; arrays (n,) [rad]."""
        return self._submit(plan_joints, self._robot, start, end, duration_s, profile)

    def target(
        self, start: FloatArray, target: Target, choose: str, duration_s: float | None, profile: Profile
    ) -> Future[Trajectory]:
        """Plan to a target of the tool."""
        return self._submit(plan_target, self._robot, start, target, choose, duration_s, profile)

    def begin(
        self, program: Program, loops: int | None, first: int, count: int | None, start: FloatArray
    ) -> Future[BegunProgram]:
        """Check a program and plan its first steps."""
        return self._submit(_begun, self._robot, program, loops, first, count, start)

    def check_program(self, program: Program) -> Future[None]:
        """Check a program as far as that goes without planning."""
        return self._submit(require_runnable, self._robot, program)

    def ahead(self, source: ProgramSource, state: PlanState) -> Future[tuple[list[PlannedStep], PlanState]]:
        """Plan the next steps of a program."""
        return self._submit(plan_next, self._robot, source, state)

    def again(
        self, source: ProgramSource, states: Sequence[PlanState]
    ) -> Future[tuple[int, list[PlannedStep], PlanState] | None]:
        """Plan the next steps of a program from another place; see ``plan_again``."""
        return self._submit(plan_again, self._robot, source, states)

    def live_goal(self, q: FloatArray, target: Target, pitch: float | None) -> Future[LiveGoal]:
        """Solve for a target that is followed; see ``live_goal``."""
        return self._submit(live_goal, self._robot, self._clear, q, target, pitch)

    def check(self, start: FloatArray, trajectory: Trajectory) -> Future[Trajectory]:
        """Check somebody else's trajectory, and that it starts where the arm stands."""
        return self._submit(_checked, self._robot, start, trajectory)

    def _submit(self, plan: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        try:
            future = self._executor.submit(plan, *args, **kwargs)
        except RuntimeError as cause:  # the executor was shut down
            raise StateError(f"the planner is closed: {cause}") from cause
        future.add_done_callback(lambda _: self._wake())
        return future


def result_of(future: Future[T]) -> T:
    """What a planning future that is done holds.

    Raises:
        ArmctlError: what refused the plan; a defect of the planner itself comes out as one, too.
    """
    if future.cancelled():  # an executor that was shut down with work in its queue
        raise StateError("the planner dropped it; ask for it again")
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, ArmctlError):
        raise error
    _LOGGER.error("planning failed", exc_info=error)
    raise ArmctlError(f"planning failed: {type(error).__name__}: {error}") from error


def _begun(
    robot: Robot, program: Program, loops: int | None, first: int, count: int | None, start: FloatArray
) -> BegunProgram:
    source = ProgramSource(program)
    state = begin_program(robot, program, start, loops=loops, first=first, count=count)
    return BegunProgram(source, *plan_next(robot, source, state))


def _checked(robot: Robot, start: FloatArray, trajectory: Trajectory) -> Trajectory:
    require_clear(robot, trajectory)
    away = np.abs(trajectory.start - start)
    j = int(away.argmax())
    if away[j] > _START_TOLERANCE:
        raise StateError(
            f"the trajectory starts with {robot.joints[j].title} at {np.degrees(trajectory.start[j]):.2f}°, "
            f"the arm stands at {np.degrees(start[j]):.2f}°; go to its start first"
        )
    return trajectory
