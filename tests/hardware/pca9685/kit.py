"""A PCA9685 on both ways to it: over an I²C bus, and behind an Arduino; and an arm that has one."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.hardware.lines import LoopTransport

from armctl.documents import shipped_folder
from armctl.hardware import ChannelSettings
from armctl.hardware.pca9685 import Pca9685Options
from armctl.hardware.pca9685.driver import Pca9685Driver
from armctl.hardware.pca9685.simulated import SimulatedI2cBus, SimulatedPca9685, SimulatedPca9685Board
from armctl.hardware.transport import Connection
from armctl.protocol import ManualClock
from armctl.robot import Robot, load_robot

CHANNELS = [ChannelSettings(channel, 1000.0, 2000.0, speed=600.0) for channel in range(4)]
TICK_S = 0.02
STEP_US = 122 / 25
"""of the chip at 50 Hz"""


def robot_text(board: str = 'kind = "pca9685"') -> str:
    """The robot file of an arm on a PCA9685: that of uzuner, with another board."""
    text = (shipped_folder("robots") / "uzuner.toml").read_text(encoding="utf-8")
    return text.replace("[dh]\n", f"[board]\n{board}\n\n[dh]\n", 1)


def robot_on(board: str = 'kind = "pca9685"') -> Robot:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "hat.toml"
        file.write_text(robot_text(board), encoding="utf-8")
        return load_robot(file)


class RecordingLine(LoopTransport):
    """A loop that keeps what was written."""

    def __init__(self, model: Any, clock: ManualClock, name: str) -> None:
        super().__init__(model, clock.now, clock.advance, name)
        self.written: list[str] = []

    def write(self, data: bytes) -> None:
        self.written.append(data.hex(" "))
        super().write(data)


class Session:
    """A driver on one of the two ways, and the ticks of whoever drives it.

    ``wrap`` puts a bad line between the driver and the board.
    """

    def __init__(
        self,
        way: str,
        clock: ManualClock,
        chip: SimulatedPca9685 | None = None,
        options: Pca9685Options | None = None,
        wrap: Callable[[Any], Any] = lambda model: model,
        port: str = "i2c://1",
    ) -> None:
        self._port = port if way == "bus" else "loop"
        self.clock, self.chip, self.way = clock, chip or SimulatedPca9685(), way
        self.board = model_of(way, self.chip)
        self.bus = self.board if isinstance(self.board, SimulatedI2cBus) else self.board.bus
        self.model = wrap(self.board)
        self.lines: list[RecordingLine] = []
        self.driver = Pca9685Driver(Connection(self._open, clock.now), options)

    def _open(self) -> RecordingLine:
        self.lines.append(RecordingLine(self.model, self.clock, self._port))
        return self.lines[-1]

    @property
    def line(self) -> RecordingLine:
        return self.lines[-1]

    def tick(self, setpoints: dict[int, float] | None = None):
        """Time goes on, setpoints are written, the board is read."""
        self.clock.advance(TICK_S)
        if setpoints is not None:
            self.driver.write(setpoints)
        return self.driver.read()

    def settle(self, setpoints: dict[int, float] | None = None, ticks: int = 8):
        """The reading once everything has come through."""
        for _ in range(ticks):
            readback = self.tick(setpoints)
        return readback


def model_of(way: str, chip: SimulatedPca9685) -> SimulatedI2cBus | SimulatedPca9685Board:
    return SimulatedI2cBus([chip]) if way == "bus" else SimulatedPca9685Board(chip)
