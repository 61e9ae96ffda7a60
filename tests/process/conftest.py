from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.process.kit import served
from tests.runtime.kit import make_rig

from armctl.protocol import Snapshot


@pytest.fixture
def holding_snapshot() -> Snapshot:
    """One in which a joint is not known."""
    snapshot = make_rig().enable().tick()
    q = snapshot.q.copy()
    q[1] = np.nan
    return replace(snapshot, q=q)


@pytest.fixture
def address(tmp_path: Path) -> Iterator[Path | tuple[str, int]]:
    with served(tmp_path) as address:
        yield address
