"""A recording board and a controller on a manual clock: every test of the runtime stands on these."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from armctl.errors import StateError
from armctl.facts import State
from armctl.hardware import BoardIdentity, ChannelSettings, Readback, Source
from armctl.program import MoveStep, Step
from armctl.protocol import Command, Connect, Enable, ManualClock, Origin, Snapshot, Ticket
from armctl.robot import Robot, load_robot
from armctl.runtime import Controller, InlineExecutor, PoseFolder

ROBOT = load_robot("uzuner")
MIDDLE = ROBOT.pose("home") + np.radians([0, 0, 20, 0, 0])  # away from every limit
TICK = 0.02
TEST = Origin("test")


class RecordingDriver:
    """A board that keeps what it is told, unrounded, and fails when it is told to."""

    def __init__(self, clock: ManualClock) -> None:
        self._clock = clock
        self.positions: dict[int, float] = {}
        self.writes: list[tuple[float, dict[int, float]]] = []
        self.settings: tuple[ChannelSettings, ...] = ()
        self.calls: list[str] = []
        self.source = Source.TRANSMITTED
        self.errors: tuple[str, ...] = ()
        self.delay_s: float | None = None
        self.expired: tuple[int, ...] = ()
        self.sent = True
        self.dead: set[int] = set()
        """channels that never come on"""
        self.simulated = True
        self.fail: dict[str, Exception] = {}
        """by method; raised on every call until it is taken out"""

    def open(self) -> BoardIdentity:
        self._call("open")
        return BoardIdentity("recording board", "sim", simulated=self.simulated)

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        self._call("configure")
        self.settings = tuple(channels)

    def write(self, setpoints: Mapping[int, float]) -> None:
        self._call("write")
        by_channel = {one.channel: one for one in self.settings}
        for channel, value in setpoints.items():
            assert by_channel[channel].minimum <= value <= by_channel[channel].maximum
        self.writes.append((self._clock.now(), dict(setpoints)))
        self.positions |= {channel: us for channel, us in setpoints.items() if channel not in self.dead}

    def read(self) -> Readback:
        self._call("read")
        errors, self.errors = self.errors, ()
        expired, self.expired = self.expired, ()
        positions = {one.channel: self.positions.get(one.channel) for one in self.settings}
        return Readback(positions, self.source, errors, delay_s=self.delay_s, expired=expired, sent=self.sent)

    def stop(self) -> None:
        self._call("stop")

    def release(self) -> None:
        self._call("release")
        self.positions.clear()

    def close(self) -> None:
        self._call("close")

    def _call(self, name: str) -> None:
        self.calls.append(name)
        if name in self.fail:
            raise self.fail[name]


class LateExecutor(Executor):
    """Plans only when told to."""

    def __init__(self) -> None:
        self.waiting: list[tuple[Future[Any], Callable[[], Any]]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.waiting.append((future, lambda: fn(*args, **kwargs)))
        return future

    def work(self) -> None:
        waiting, self.waiting = self.waiting, []
        for future, plan in waiting:
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(plan())
                except Exception as error:
                    future.set_exception(error)


@dataclass
class Rig:
    """A controller that is ticked by hand."""

    clock: ManualClock
    driver: RecordingDriver
    controller: Controller
    robot: Robot = ROBOT
    executor: LateExecutor = field(default_factory=LateExecutor)
    """of a rig that plans late"""
    poses: PoseFolder | None = None
    history: list[Snapshot] = field(default_factory=list)

    @property
    def now(self) -> Snapshot:
        return self.controller.snapshot

    def tick(self, elapsed: float = TICK) -> Snapshot:
        if self.poses is not None:
            self.poses.wait(10.0)  # the disk is as fast as the ticks
        self.clock.advance(elapsed)
        self.controller.tick()
        self.history.append(self.controller.snapshot)
        return self.controller.snapshot

    def run(self, seconds: float) -> Snapshot:
        for _ in range(round(seconds / TICK)):
            self.tick()
        return self.now

    def until(self, condition: Callable[[Snapshot], bool], seconds: float = 60.0) -> Snapshot:
        for _ in range(round(seconds / TICK)):
            if condition(self.tick()):
                return self.now
        raise AssertionError(f"not within {seconds} s: {self.now.state} ({self.now.cause})")

    def rests(self, seconds: float = 60.0) -> Snapshot:
        return self.until(lambda s: s.state is State.HOLDING, seconds)

    def finishes(self, command: Command, seconds: float = 60.0) -> None:
        """Submit, and wait until the arm holds; it must have been carried out."""
        ticket = self.do(command)
        if self.now.state is not State.HOLDING:
            self.rests(seconds)
        ticket.result(0)

    def stops(self) -> None:
        self.controller.stop(TEST)
        self.rests(1.0)

    def sends_nothing(self, seconds: float) -> None:
        count = len(self.driver.writes)
        self.run(seconds)
        assert len(self.driver.writes) == count

    def do(self, command: Command, elapsed: float = TICK) -> Ticket:
        """Submit and tick once."""
        ticket = self.controller.submit(command, TEST)
        self.tick(elapsed)
        return ticket

    def refuses(self, command: Command, match: str, error: type[Exception] = StateError) -> None:
        """Submit and tick once; it must be refused with these words."""
        fails(self.do(command).finished, match, error)

    def enable(self, q: NDArray[np.float64] | None = None) -> Rig:
        """Connected and holding; the history begins here, and the writes with the pose."""
        connecting = self.do(Connect("sim"))
        self.executor.work()
        self.tick()
        connecting.finished.result(0)
        self.finishes(Enable(q))
        self.tick()
        if self.executor.waiting:  # a planner that is late has looked at the jaws where they are, too
            self.executor.work()
            self.tick()
        self.history.clear()
        joints = self.robot.output_map.channels if self.robot.output_map else ()
        pose = {channel: self.driver.positions[channel] for channel in joints}
        self.driver.writes[:] = [(self.clock.now(), pose)]
        return self

    @property
    def texts(self) -> list[str]:
        return [event.text for event in self.now.events]

    def stream(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times (k,) [s] and joint angles (k, n) [rad] of what left the driver."""
        servo_map = self.robot.output_map
        sent = [(t, values) for t, values in self.driver.writes if set(servo_map.channels) <= set(values)]
        return np.array([t for t, _ in sent]), np.array([servo_map.angles(values) for _, values in sent])


def fails(future: Future[None], match: str, error: type[Exception] = StateError) -> None:
    """It carries this error."""
    with pytest.raises(error, match=match):
        future.result(0)


def swings(blend_mm: float, *away: float | Sequence[float]) -> list[Step]:
    """Moves to ``MIDDLE`` turned by some angle [rad] at all joints, or at each."""
    return [MoveStep(joints_deg=tuple(np.degrees(MIDDLE + d).tolist()), blend_mm=blend_mm) for d in away]


def steps_seen(rig: Rig) -> list[tuple[int, int]]:
    """(loop, step) in the order in which they were shown, without repeats."""
    shown = [(s.program.loop, s.program.step) for s in rig.history if s.program is not None]
    return [here for here, _ in groupby(shown)]


def make_rig(
    executor: Executor | None = None,
    robot: Robot = ROBOT,
    rate_hz: float = 50.0,
    black_boxes: Path | None = None,
    poses: PoseFolder | None = None,
) -> Rig:
    clock = ManualClock(10.0)
    driver = RecordingDriver(clock)
    planner = executor or InlineExecutor()
    controller = Controller(
        robot, lambda _port: driver, clock, rate_hz, planner, black_boxes=black_boxes, poses=poses
    )
    rig = Rig(clock, driver, controller, robot, poses=poses)
    if isinstance(executor, LateExecutor):
        rig.executor = executor
    return rig


def assert_stream_keeps_limits(rig: Rig, first: int = 0) -> None:
    """Every target inside the joint limits, no step faster than the speed limits."""
    times, q = rig.stream()
    low, high = rig.robot.limits[:, 0], rig.robot.limits[:, 1]
    assert (q >= low - 1e-9).all()
    assert (q <= high + 1e-9).all()
    times, q = times[first:], q[first:]
    allowed = rig.robot.speed_limits * np.diff(times)[:, None]
    assert (np.abs(np.diff(q, axis=0)) <= allowed * (1 + 1e-9) + 1e-9).all()


def assert_keeps_limits(rig: Rig) -> None:
    """All of it but the jump of enabling."""
    assert_stream_keeps_limits(rig, 1)
    assert_accelerations_keep_limits(rig)


def assert_accelerations_keep_limits(rig: Rig, tolerance: float = 1e-6) -> None:
    """What the controller says of itself, and the second differences of even stretches of the stream."""
    for snapshot in rig.history:
        assert (
            np.abs(snapshot.acceleration_command) <= rig.robot.acceleration_limits * (1 + tolerance) + 1e-9
        ).all()
    stamps = np.array([snapshot.stamp for snapshot in rig.history])
    q = np.array([snapshot.q_command for snapshot in rig.history])
    steps = np.diff(stamps)
    even = np.flatnonzero((np.abs(steps[1:] - TICK) < 1e-9) & (np.abs(steps[:-1] - TICK) < 1e-9))
    second = np.abs(q[even + 2] - 2 * q[even + 1] + q[even]) / TICK**2
    assert (second <= rig.robot.acceleration_limits * (1 + 1e-3) + 1e-6).all()
