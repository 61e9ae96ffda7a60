from __future__ import annotations

from collections.abc import Callable

import pytest
from tests.hardware.lines import LoopTransport

from armctl.hardware import ByteModel, ChannelSettings
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.transport import Connection
from armctl.runtime.clock import ManualClock

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
