from __future__ import annotations

import pytest

from armctl.protocol import ManualClock


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock(start=100.0)
