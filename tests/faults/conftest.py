from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from tests.faults.kit import Bench


@pytest.fixture
def bench_of() -> Iterator[Callable[..., Bench]]:
    """Makes benches, and takes them down."""
    with ExitStack() as stack:

        def make(board: str, folder: Path | None = None, seed: int = 0) -> Bench:
            bench = Bench(board, seed, folder)
            stack.callback(bench.close)
            return bench

        yield make


@pytest.fixture(autouse=True)
def on_a_manual_clock(real_gap: None) -> None:
    """No machine can stand still here but the tests' own."""
