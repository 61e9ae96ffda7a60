from __future__ import annotations

from collections.abc import Callable

import pytest
from tests.hardware.lines import LoopTransport

from armctl.hardware import ByteModel, ChannelSettings
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.transport import Connection
from armctl.protocol import ManualClock

PINS = [9, 22]
CHANNELS = [ChannelSettings(pin, 1000.0, 2000.0) for pin in PINS]
FRAME_S = 0.02


class RecordingTransport(LoopTransport):
    """A loop that keeps what was written, and when."""

    def __init__(self, board: ByteModel, clock: ManualClock) -> None:
        super().__init__(board, clock.now, clock.advance)
        self._clock = clock
        self.written: list[tuple[float, bytes]] = []

    def write(self, data: bytes) -> None:
        self.written.append((self._clock.now(), data))
        super().write(data)

    @property
    def bursts(self) -> list[str]:
        return [data.hex(" ") for _, data in self.written]


class Session:
    """A driver over a recorded loop to a board, and the frames of whoever drives it."""

    def __init__(self, board: ByteModel, clock: ManualClock, **options) -> None:
        self.board, self.clock = board, clock
        self.transports: list[RecordingTransport] = []
        self.driver = FirmataDriver(
            Connection(self._open, clock.now, simulated=options.pop("simulated", False)), **options
        )

    def _open(self) -> RecordingTransport:
        self.transports.append(RecordingTransport(self.board, self.clock))
        return self.transports[-1]

    @property
    def line(self) -> RecordingTransport:
        return self.transports[-1]

    def frame(self, setpoints=None):
        """One tick of a controller: time goes on, setpoints are written, positions are read."""
        self.clock.advance(FRAME_S)
        if setpoints is not None:
            self.driver.write(setpoints)
        return self.driver.read()

    def switch_on(self, setpoints):
        """Write until every pin is on, as a controller that streams does."""
        for _ in range(40):
            readback = self.frame(setpoints)
            if all(readback.positions[pin] is not None for pin in setpoints):
                return readback
        raise AssertionError(f"still off: {readback.positions}")


@pytest.fixture
def connect(clock: ManualClock) -> Callable[..., Session]:
    """A session with a board: opened, and configured."""

    def connected(board: ByteModel, channels=CHANNELS, **options) -> Session:
        session = Session(board, clock, **options)
        session.driver.open()
        session.driver.configure(channels)
        return session

    return connected
