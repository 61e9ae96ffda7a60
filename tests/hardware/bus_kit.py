"""An arm on a simulated servo bus, and its driver, all of it on one manual clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from tests.hardware.lines import LoopTransport

from armctl.errors import ArmctlError, BoardTimeoutError
from armctl.hardware import Readback, Setup
from armctl.hardware.board_type import nothing_kept
from armctl.hardware.boards import board_type, channel_settings
from armctl.hardware.bus.driver import BusDriver
from armctl.hardware.bus.plant import PlantJoint
from armctl.hardware.bus.simulated import BusServo, SimulatedBus
from armctl.hardware.faults import FaultyModel
from armctl.hardware.transport import Connection
from armctl.protocol import ManualClock
from armctl.robot import Robot, load_robot

TICK_S = 0.02
BITS_OF_A_BYTE = 10
LEAD_S = 0.07
"""A goal is ahead of the shaft by what the joint turns in this time at its speed: P control turns no motor
without that, and the last tick comes on top. So far an arm goes on whose host dies."""
ADAPTER_S = 0.0004  # from a question to its answer, beside the bytes


class TimedLoop(LoopTransport):
    """A loop on which bytes take as long as on a line of ``baud``."""

    def __init__(self, model: Any, clock: ManualClock, baud: float) -> None:
        super().__init__(model, clock.now, clock.advance)
        self._clock, self._byte_s = clock, BITS_OF_A_BYTE / baud

    def write(self, data: bytes) -> None:
        self._clock.advance(len(data) * self._byte_s)
        super().write(data)

    def read(self, count: int, timeout_s: float) -> bytes:
        data = super().read(count, timeout_s)
        self._clock.advance(len(data) * self._byte_s + (ADAPTER_S if timeout_s and data else 0.0))
        return data


class BusBench:
    """A robot on its simulated bus; the driver as the runtime would use it."""

    def __init__(
        self, robot: str | Robot = "so101", options: Mapping[str, Any] | None = None, **timing: Any
    ) -> None:
        self.robot = load_robot(robot) if isinstance(robot, str) else robot
        board = board_type(self.robot.board)
        self.setup = Setup(
            channel_settings(self.robot),
            self.robot.board_settings,
            self.robot,
            timing.get("kept", nothing_kept),
        )
        model = board.simulated(self.setup, options or {})
        assert isinstance(model, SimulatedBus)
        self.bus = model
        self.faulty = FaultyModel(model)
        self.clock = ManualClock(100.0)
        self.line = TimedLoop(self.faulty, self.clock, timing.get("baud", board.baud))
        driver = board.driver(self.setup, Connection(lambda: self.line, self.clock.now))
        assert isinstance(driver, BusDriver)
        self.driver = driver
        self.ids = [one.channel for one in self.setup.channels]

    def open(self) -> BusBench:
        """Connected, and read twice, as before Enable."""
        self.identity = self.driver.open()
        self.driver.configure(self.setup.channels)
        self.back = self.ticks(2)
        return self

    def ticks(self, count: int = 1) -> Readback:
        for _ in range(count):
            with suppress(BoardTimeoutError):  # as the runtime does: for a second it goes on without
                self.back = self.driver.read()
            self.clock.advance(TICK_S)
        return self.back

    def enable(self) -> ArmctlError | None:
        """Switch all servos on where they were measured; what refused it."""
        inside = {
            one.channel: min(one.maximum, max(one.minimum, self.back.positions[one.channel] or 2048.0))
            for one in self.setup.channels
        }
        try:
            self.driver.write(inside)
        except ArmctlError as error:
            return error
        self.ticks()
        return None

    def move(self, goals: Mapping[int, float], seconds: float) -> Readback:
        """A stream of setpoints to ``goals`` in a straight line; the servos that are not named stay."""
        start = {servo: float(self.back.positions[servo] or 0.0) for servo in goals}
        count = round(seconds / TICK_S)
        for k in range(1, count + 1):
            self.driver.write({s: start[s] + (goals[s] - start[s]) * k / count for s in goals})
            self.ticks()
        return self.back

    def joint(self, servo: int) -> PlantJoint:
        return self.bus.servo(servo).joint

    @contextmanager
    def held(self) -> Iterator[None]:
        """Somebody holds the whole arm still."""
        for one in self.bus.plant.joints:
            one.hand = 0.0
        yield
        for one in self.bus.plant.joints:
            one.hand = None

    def stand(self, angles: np.ndarray) -> None:
        """Put the arm into a pose [rad], held there."""
        for joint, angle in zip(self.bus.plant.joints, angles.tolist(), strict=False):
            joint.angle, joint.speed, joint.lies_at = angle, 0.0, None
        self.bus.plant.weigh()
        for servo in self.bus.servos:
            servo.measure()


class Moments:
    """Notes how far the goal was from the shaft at each moment at which a torque came on [steps]."""

    def __init__(self, bus: SimulatedBus) -> None:
        self.jumps: list[tuple[int, float]] = []
        for servo in bus.servos:
            self._watch(servo)

    def _watch(self, servo: BusServo) -> None:
        written = servo.written

        def watched(address: int, data: bytes) -> int:
            before = servo.driven
            error = written(address, data)
            if servo.driven and not before:
                servo.measure()
                away = servo.get("goal_position") - servo.get("present_position")
                self.jumps.append((servo.id, float(abs(away))))
            return error

        servo.written = watched  # type: ignore[method-assign]
