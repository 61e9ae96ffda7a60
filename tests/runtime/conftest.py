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
