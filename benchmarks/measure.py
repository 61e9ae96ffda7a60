"""Timing two things against each other in one run: only the ratio counts, machines differ and are noisy."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Ratio:
    """How much faster armctl does a piece of work than the plain way does."""

    work: str
    plain_us: float
    armctl_us: float
    ratio: float
    goal: float | None

    def as_json(self) -> dict[str, object]:
        return asdict(self)


def compare(
    work: str,
    plain: Callable[[], object],
    ours: Callable[[], object],
    *,
    each: int,
    goal: float | None = None,
    rounds: int = 7,
) -> Ratio:
    """Turn and turn about; the best round of each counts, a unit of work is one of ``each``."""
    plain(), ours()
    best = [float("inf"), float("inf")]
    for _ in range(rounds):
        for i, run in enumerate((plain, ours)):
            start = time.perf_counter()
            run()
            best[i] = min(best[i], time.perf_counter() - start)
    plain_us, ours_us = (1e6 * seconds / each for seconds in best)
    return Ratio(work, plain_us, ours_us, plain_us / ours_us, goal)
