from __future__ import annotations

from collections.abc import Callable

import pytest
from tests.hardware.pca9685.kit import CHANNELS, Session

from armctl.protocol import ManualClock


@pytest.fixture(params=["bus", "arduino"])
def connect(request: pytest.FixtureRequest, clock: ManualClock) -> Callable[..., Session]:
    """A session on each of the two ways: opened, and configured for channels 0 to 3."""

    def connected(chip=None, channels=CHANNELS, options=None, **more) -> Session:
        session = Session(request.param, clock, chip, options, **more)
        session.driver.open()
        session.driver.configure(channels)
        return session

    return connected
