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
from armctl.kinematics import Solutions, Target
from armctl.motion import Profile, Trajectory, plan_joints, plan_target, require_clear
from armctl.program import (
    PlannedStep,
    PlanState,
    Program,
    ProgramSource,
    begin_program,
    plan_again,
    plan_next,
    require_runnable,
)
from armctl.robot import Robot
from armctl.runtime.joint_servo import KeepClear
from armctl.runtime.ticket import Ticket

# Where the joints shall go for a target that is being dragged.

FloatArray = NDArray[np.float64]
_STEP = float(np.radians(0.05))
"""of a joint that is free [rad]"""
_SAME_POSTURE = float(np.radians(20.0))
"""A change of branch with less travel than this passes through the pose where the branches meet [rad]."""
_DETOUR_M, _DETOUR_SHARE = 0.02, 0.1
"""How much farther from the target the tool may come on its way there, and as a share of its distance."""
_ROUND_M, _ROUND_SHARE = 0.03, 1.4
"""How long the way of the tool may be: a turn of the base by 150 degrees is 1.36 times its chord."""
_LOOKS = 24
_SHORT_M = 1e-3


@dataclass(frozen=True, slots=True)
class LiveGoal:
    """What came of one target."""

    q: FloatArray | None
    """(n,) where to go [rad]; None: stay with the goal before"""
    note: str | None = None
    """what is not as it was asked for"""


def live_goal(robot: Robot, clear: KeepClear, q: FloatArray, target: Target, pitch: float | None) -> LiveGoal:
    """The configuration to go to for ``target``: the nearest one, on the branch on which the arm is.

    The joints go straight there, so the way is looked at, too: a way that swings the tool round, away from
    the target before it comes nearer, is none to be taken while somebody drags; one that leads into the
    floor, an obstacle or the arm itself ends before it.

    Args:
        robot: the arm.
        clear: what it must stay out of.
        q: (n,) where the arm is [rad].
        target: where the tool shall be; a roll that it does not give stays as it is.
        pitch: the tool pitch to keep where the target gives none and the arm can [rad]; None: any.
    """
    goal, note = _wanted(robot, q, target, pitch)
    if goal is None:
        return LiveGoal(None, note)
    way = clear.line(q, goal)
    found = clear.blocked(way)
    if found is not None:
        row, why = found
        return LiveGoal(way[row - 1], why)
    return LiveGoal(goal, note)


def _wanted(
    robot: Robot, q: FloatArray, target: Target, pitch: float | None
) -> tuple[FloatArray | None, str | None]:
    """The nearest configuration on the arm's branch, or a reason why not."""
    found = _solutions(robot, q, target, pitch)
    if not found.success:
        return _toward_nearest(robot, q, found, pitch)
    goal, branch = _nearest(robot, q, found)
    if branch is not None:
        return None, f"it can be reached only with {branch}; the arm keeps its posture and waits"
    return _swing_checked(robot, q, goal, target.position, None)


def _toward_nearest(
    robot: Robot, q: FloatArray, found: Solutions, pitch: float | None
) -> tuple[FloatArray | None, str | None]:
    """To the reachable point that comes nearest to a target without a solution.

    Or just short of it: at the edge of its reach the arm is singular, and its branches meet.
    """
    if found.nearest_q is None or found.nearest_m is None:
        return None, f"{found.reason}; the arm waits"
    note = f"{found.reason}; following the nearest point"
    point, target = found.nearest_m, found.target
    back = robot.forward(q)[:3, 3] - point
    back *= min(_SHORT_M / max(float(np.linalg.norm(back)), _SHORT_M), 1.0)
    short = _solutions(robot, q, Target.of(point + back, target.pitch, target.roll, target.rotation), pitch)
    if short.success:
        goal, branch = _nearest(robot, q, short)
        if branch is not None:
            return (
                None,
                f"{found.reason}; the nearest point needs {branch}: the arm keeps its posture and waits",
            )
        return _swing_checked(robot, q, goal, point, note)
    return _swing_checked(robot, q, found.nearest_q, point, note)


def _solutions(robot: Robot, q: FloatArray, target: Target, pitch: float | None) -> Solutions:
    """With the present pitch and roll where nothing else is asked for; else with any."""
    roll = target.roll
    if roll is None and target.rotation is None:
        roll = robot.inverse_kinematics.pitch_and_roll(q)[1]
    if target.pitch is None and target.rotation is None and pitch is not None:
        kept = robot.inverse(target.position, pitch, roll, step=_STEP)
        if kept.success:
            return kept
    return robot.inverse(target.position, target.pitch, roll, target.rotation, step=_STEP)


def _nearest(robot: Robot, q: FloatArray, found: Solutions) -> tuple[FloatArray, str | None]:
    """The solution of least travel on the arm's branch, and None; else that of another branch, named."""
    travel = found.energies("least-travel", q)
    order = int(np.argmin(travel))
    if len(found.branch_names) > 1:
        pitch, roll = robot.inverse_kinematics.pitch_and_roll(q)
        here = robot.inverse(robot.forward(q)[:3, 3], pitch, roll, step=_STEP)
        if here.success:
            mine = found.branch == here.branch_of(q)
            if mine.any():
                order = int(np.argmin(np.where(mine, travel, np.inf)))
            elif np.abs(found.q[order] - q).max() > _SAME_POSTURE:
                return found.q[order], str(found.branch[order])
    return found.q[order].copy(), None


def _swing_checked(
    robot: Robot, q: FloatArray, goal: FloatArray, point: FloatArray, note: str | None
) -> tuple[FloatArray | None, str | None]:
    """``goal``, unless the tool goes a long way round to it, or first away from ``point`` (3,) [m]."""
    way = robot.forward(q + np.linspace(0.0, 1.0, _LOOKS)[:, None] * (goal - q))[:, :3, 3]
    distance = np.linalg.norm(way - point, axis=1)
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    straight = float(np.linalg.norm(way[-1] - way[0]))
    away = float(distance.max() - distance[0])
    if away > _DETOUR_M + _DETOUR_SHARE * float(distance[0]) or length > _ROUND_M + _ROUND_SHARE * straight:
        return None, (
            f"the way there would swing the tool round, {1000 * length:.0f} mm for {1000 * straight:.0f} mm; "
            "the arm waits: lead the target round, or go there with Inverse"
        )
    return goal, note


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
