"""Goals of speed that no timing loop can show: listed, so that none is forgotten."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.measure import Effort
from benchmarks.row import Row


def rows(effort: Effort) -> Iterator[Row]:
    del effort
    yield Row(
        "lateness of a 50 Hz tick, five pages open", "p99 ≤ 1 ms", missing="not measured here: needs browsers"
    )
    yield Row("STOP, click to bytes on the wire", "p99 ≤ 50 ms", missing="not measured here: needs a browser")
