from __future__ import annotations

import pytest
from tests.runtime.kit import LateExecutor, Rig, make_rig


@pytest.fixture
def rig() -> Rig:
    return make_rig()


@pytest.fixture
def holding() -> Rig:
    return make_rig().enable()


@pytest.fixture
def late() -> Rig:
    """Holding; it plans only when told to."""
    return make_rig(LateExecutor()).enable()


@pytest.fixture(autouse=True)
def on_a_manual_clock(real_gap: None) -> None:
    """No machine can stand still here but the tests' own."""
