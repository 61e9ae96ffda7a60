from __future__ import annotations

from collections.abc import Callable

import pytest
from tests.hardware.lines import LoopTransport

from armctl.hardware import ByteModel, ChannelSettings
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.transport import Connection
from armctl.protocol import ManualClock

CHANNELS = [ChannelSettings(channel, 1000.0, 2000.0) for channel in range(4)]


@pytest.fixture
def connect(clock: ManualClock) -> Callable[..., MaestroDriver]:
    """A driver over a loop to a simulated board: opened, and configured for channels 0 to 3."""

    def connected(board: ByteModel, channels=CHANNELS, **options) -> MaestroDriver:
        driver = MaestroDriver(
            Connection(lambda: LoopTransport(board, clock.now, clock.advance), lambda: 0.0), **options
        )
        driver.open()
        driver.configure(channels)
        return driver

    return connected


class ScriptedTransport:
    """Fails on a wrong byte, on a missing one and on one that nobody reads.

    Args:
        exchanges: what the host must write in one go, and what the board answers to it, in hex.
    """

    name = "scripted"

    def __init__(self, *exchanges: tuple[str, str]) -> None:
        self._exchanges = list(exchanges)
        self._reply = b""
        self.closed = 0

    def write(self, data: bytes) -> None:
        assert self._reply == b"", f"nobody read {self._reply.hex(' ')}"
        assert self._exchanges, f"unexpected {data.hex(' ')}"
        expected, reply = self._exchanges.pop(0)
        assert data.hex(" ") == " ".join(expected.split())
        self._reply = bytes.fromhex(reply)

    def read(self, count: int, timeout_s: float) -> bytes:
        assert 0.0 < timeout_s <= 1.0
        taken, self._reply = self._reply[:count], self._reply[count:]
        return taken

    def discard_input(self) -> None:
        assert self._reply == b"", f"{self._reply.hex(' ')} thrown away unread"

    def close(self) -> None:
        self.closed += 1

    def assert_done(self) -> None:
        assert self._exchanges == [], "the driver did not send all of it"
        assert self._reply == b"", f"nobody read {self._reply.hex(' ')}"
