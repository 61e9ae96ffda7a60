"""What takes long is done off the controller thread: planning, and opening a line."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any, ParamSpec, Protocol, TypeVar

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, StateError
from armctl.motion import Trajectory, require_clear
from armctl.robot import Robot
from armctl.runtime.commands import Order

P = ParamSpec("P")
T = TypeVar("T")
_START_TOLERANCE = 1e-6
_LOGGER = logging.getLogger("armctl.runtime")


@dataclass(frozen=True, slots=True, eq=False)
class Pending:
    """A motion that is being planned, a version of the running program being checked, a line being opened."""

    order: Order
    label: str
    future: Future[Any]
    start: FloatArray | None = None
    """(n,) where a motion is planned from [rad]"""
    take: Callable[[Any], Any] | None = None
    """makes an activity of the plan, or hands the version over; None: a trajectory is just followed"""


class Submit(Protocol):
    """Has a function called elsewhere."""

    def __call__(self, plan: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """The future of ``plan(*args, **kwargs)``."""
        ...


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


def planner(executor: Executor, wake: Callable[[], None]) -> Submit:
    """Has planning functions called on an executor; wakes the controller when one of them is done."""

    def submit(plan: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        try:
            future = executor.submit(plan, *args, **kwargs)
        except RuntimeError as cause:
            raise StateError(f"the planner is closed: {cause}") from cause
        future.add_done_callback(lambda _: wake())
        return future

    return submit


def result_of(future: Future[T], what: str = "planning") -> T:
    """The result of a future that is done; a defect of ``what`` it did is raised as ``ArmctlError``."""
    if future.cancelled():  # an executor that was shut down with work in its queue
        raise StateError(f"{what} was dropped; ask for it again")
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, ArmctlError):
        raise error
    _LOGGER.error("%s failed", what, exc_info=error)
    raise ArmctlError(f"{what} failed: {type(error).__name__}: {error}") from error


def checked_trajectory(robot: Robot, start: FloatArray, trajectory: Trajectory) -> Trajectory:
    """A caller's trajectory, if it passes the pre-flight and begins at ``start`` (n,) [rad]."""
    require_clear(robot, trajectory)
    away = np.abs(trajectory.start - start)
    j = int(away.argmax())
    if away[j] > _START_TOLERANCE:
        raise StateError(
            f"the trajectory starts with {robot.joints[j].title} at {np.degrees(trajectory.start[j]):.2f}°, "
            f"the arm stands at {np.degrees(start[j]):.2f}°; go to its start first"
        )
    return trajectory
