"""What takes long is done off the controller thread: planning, and opening a line.

A plan may take minutes, and Python cannot kill a thread. So a plan that nobody waits for any more is left:
another thread plans what is asked for next, and the one that was left ends with its plan. It is not
interrupted: an exception from outside could strike it while it holds a lock that others need.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any, ParamSpec, Protocol, TypeVar

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, StateError
from armctl.lazy_dataclass import dataclass
from armctl.motion import Trajectory, require_clear
from armctl.robot import CarriedPart, Robot
from armctl.runtime.activity import Order

P = ParamSpec("P")
T = TypeVar("T")
LONGEST_PLAN_S = 120.0
"""A motion, or an edit, that is not planned by then is refused: the largest program takes 8 s, on a Raspberry
Pi four times as long."""
_MOST_WAITING = 16
"""plans that wait for their turn"""
_MOST_LEFT = 4
"""threads that were left and have not ended yet"""
_MOST_OPENING = 4
"""lines that are being opened at once"""
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


@dataclass(frozen=True, slots=True, eq=False)
class Grip:
    """A gripper command that waits until the motion under way is known to be clear with it."""

    order: Order
    opening: float
    part: CarriedPart | None
    checked: object = None
    """the activity whose rest is checked; None: none yet"""
    check: Future[None] | None = None


class Submit(Protocol):
    """Has a function called elsewhere."""

    def __call__(self, plan: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """The future of ``plan(*args, **kwargs)``."""
        ...


class _Plan(Future[Any]):
    """A plan; ``cancel`` leaves it, where it has begun already."""

    def __init__(self, planner: Planner, work: Callable[[], Any]) -> None:
        super().__init__()
        self._planner, self.work = planner, work

    def cancel(self) -> bool:
        """Nobody waits for it any more."""
        return super().cancel() or self._planner.leave(self)


class Planner(Executor):
    """Plans one after the other, on a thread that can be left. Any thread may use it."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._waiting: deque[_Plan] = deque()
        self._thread: threading.Thread | None = None
        """the one that plans now, or waits for something to plan"""
        self._running: _Plan | None = None
        self._left: list[threading.Thread] = []
        self._closed = False

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Have ``fn`` called; ``StateError``: too many plans wait, or were dropped and have not ended."""
        plan = _Plan(self, lambda: fn(*args, **kwargs))
        with self._changed:
            if self._closed:
                raise StateError("the planner is closed")
            self._left = [one for one in self._left if one.is_alive()]
            if len(self._left) >= _MOST_LEFT:
                raise StateError(
                    f"{len(self._left)} motions that were dropped are still being given up; wait a moment"
                )
            self._waiting = deque(one for one in self._waiting if not one.cancelled())
            if len(self._waiting) >= _MOST_WAITING:
                raise StateError(f"{_MOST_WAITING} motions wait to be planned already; wait for them")
            self._waiting.append(plan)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="armctl-planner", daemon=True)
                self._thread.start()
            self._changed.notify_all()
        return plan

    def leave(self, plan: Future[Any]) -> bool:
        """Leave the thread that works at ``plan``, if one does; whether it did."""
        with self._changed:
            thread = self._thread
            if self._running is not plan or thread is None:
                return False
            self._left.append(thread)
            self._thread = self._running = None
            if self._waiting and not self._closed:
                self._thread = threading.Thread(target=self._run, name="armctl-planner", daemon=True)
                self._thread.start()
        plan.set_exception(StateError("planning was dropped; ask for it again"))
        return True

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Plan nothing more, and leave what is being planned; never waits."""
        del wait, cancel_futures
        with self._changed:
            self._closed = True
            dropped, running = list(self._waiting), self._running
            self._waiting.clear()
            self._changed.notify_all()
        for plan in dropped:
            plan.cancel()
        if running is not None:
            running.cancel()

    def _run(self) -> None:
        me = threading.current_thread()
        while (plan := self._next(me)) is not None:
            result: Any = None
            error: BaseException | None = None
            try:
                result = plan.work()
            except BaseException as broken:  # whatever it is, who waits for it learns it
                error = broken
            with self._changed:
                if self._thread is not me:
                    return
                self._running = None
            if error is None:
                plan.set_result(result)
            else:
                plan.set_exception(error)
            plan = result = error = None  # not to be kept until there is another one

    def _next(self, me: threading.Thread) -> _Plan | None:
        """The next plan; None: this thread was left, or the planner is closed."""
        with self._changed:
            while self._thread is me and not self._closed:
                while self._waiting:
                    plan = self._waiting.popleft()
                    if plan.set_running_or_notify_cancel():
                        self._running = plan
                        return plan
                self._changed.wait()
            return None


class Openers(Executor):
    """Opens each line on a thread of its own: one that hangs keeps nothing else from being done."""

    def __init__(self) -> None:
        self._threads: list[threading.Thread] = []

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Have ``fn`` called; ``StateError``: several lines hang already."""
        self._threads = [one for one in self._threads if one.is_alive()]
        if len(self._threads) >= _MOST_OPENING:
            raise StateError(f"{_MOST_OPENING} lines are still being opened; unplug what does not answer")
        opened: Future[T] = Future()
        opened.set_running_or_notify_cancel()

        def run() -> None:
            try:
                result = fn(*args, **kwargs)
            except BaseException as error:
                opened.set_exception(error)
            else:
                opened.set_result(result)

        thread = threading.Thread(target=run, name="armctl-opener", daemon=True)
        self._threads.append(thread)
        thread.start()
        return opened


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
        joint = robot.joints[j]
        raise StateError(
            f"the trajectory starts with {joint.title} at {joint.said(float(trajectory.start[j]))}, the arm "
            f"stands at {joint.said(float(start[j]))}; go to its start first"
        )
    return trajectory
