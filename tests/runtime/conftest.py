from __future__ import annotations

import pytest
from tests.runtime.kit import Rig, make_rig


@pytest.fixture
def rig() -> Rig:
    return make_rig()


@pytest.fixture
def holding() -> Rig:
    return make_rig().enable()
