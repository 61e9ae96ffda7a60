from __future__ import annotations

import pytest
from tests.hardware.encoder.kit import Bench

from armctl.protocol import ManualClock


@pytest.fixture
def bench(clock: ManualClock) -> Bench:
    """A driver that is connected to a simulated board, motors off, not homed."""
    return Bench(clock).connect()


@pytest.fixture
def homed(bench: Bench) -> Bench:
    """The same, homed and holding."""
    bench.home()
    return bench
