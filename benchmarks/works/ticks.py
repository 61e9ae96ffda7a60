"""How late ticks begin at most, 99 of 100, while the arm moves and another thread solves."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from benchmarks.measure import Effort
from benchmarks.planar_arm import UZUNER
from benchmarks.row import Goal, Row
from benchmarks.works.sweep import STEP

from armctl import Arm, Robot, load_robot
from armctl.boards import SIMULATED, Boards
from armctl.runtime import Clock, Connect, Controller, Enable, MonotonicClock, MoveJoints

_RATES_HZ = (50.0, 200.0)
_LEAST_TICKS = 20
_PATIENCE_S = 10.0


class LateClock:
    """A clock that keeps how late each tick began, against ticks that follow on without a gap."""

    def __init__(self, clock: Clock, period: float) -> None:
        self._clock, self._period = clock, period
        self._due: float | None = None
        self.late: list[float] = []
        """[s] one a tick"""

    def now(self) -> float:
        return self._clock.now()

    def wait_until(self, deadline: float, wake: threading.Event) -> bool:
        if self._clock.wait_until(deadline, wake):
            self._due = None  # a tick that somebody asked for is no measure of the next one
            return True
        # the deadline after a tick that took too long is put off: that counts as late
        due = deadline if self._due is None else min(deadline, self._due)
        self.late.append(self._clock.now() - due)
        self._due = deadline + self._period
        return False


def rows(effort: Effort) -> Iterator[Row]:
    robot = load_robot("uzuner")
    for rate_hz in _RATES_HZ:
        ticks = max(_LEAST_TICKS, round(effort.seconds * rate_hz))
        bare, ours = (
            np.percentile(late, 99) for late in (_bare(robot, rate_hz, ticks), _ours(robot, rate_hz, ticks))
        )
        yield Row(
            f"lateness of a {rate_hz:.0f} Hz tick while a sweep runs, p99 of {ticks:,}",
            "a loop that does nothing",
            1e6 * float(bare),
            1e6 * float(ours),
            ratio=1e3 * float(ours),
            goal=Goal("lateness", 1.0),
        )


def _bare(robot: Robot, rate_hz: float, ticks: int) -> list[float]:
    """How late this machine wakes a thread that has nothing to do [s]."""
    clock, wake = LateClock(MonotonicClock(), 1.0 / rate_hz), threading.Event()
    Arm(robot).close()  # the interpreter then switches threads as often as in use
    with _sweeping(robot):
        deadline = clock.now()
        for _ in range(ticks):
            deadline = max(deadline + 1.0 / rate_hz, clock.now())
            clock.wait_until(deadline, wake)
    return clock.late


def _ours(robot: Robot, rate_hz: float, ticks: int) -> list[float]:
    """How late the ticks of a moving simulated arm begin [s]."""
    clock = LateClock(MonotonicClock(), 1.0 / rate_hz)
    Arm(robot).close()  # as above
    boards = Boards(robot, clock.now)
    try:
        with Controller(robot, boards.driver, clock, rate_hz) as controller, _sweeping(robot):
            seconds = ticks / rate_hz
            for command in (Connect(SIMULATED), Enable()):
                controller.submit(command).result(_PATIENCE_S)
            move = controller.submit(MoveJoints(robot.pose("home"), duration_s=seconds + 1.0))
            move.accepted.result(_PATIENCE_S)
            clock.late.clear()
            move.finished.result(seconds + _PATIENCE_S)
            return clock.late[:ticks]
    finally:
        boards.close()


@contextmanager
def _sweeping(robot: Robot) -> Iterator[None]:
    """Another thread that lists all solutions of one position after another."""
    positions = UZUNER.tip(UZUNER.random(np.random.default_rng(2017), 100))
    done = threading.Event()

    def sweep() -> None:
        while not done.is_set():
            for position in positions:
                robot.inverse(position, step=STEP)

    thread = threading.Thread(target=sweep, name="sweep")
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
