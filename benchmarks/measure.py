"""Timing two things against each other in one run: only the ratio counts, machines differ and are noisy."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from benchmarks.row import Goal, NotMeasuredError, Row
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Work = Callable[[], object]


@dataclass(frozen=True)
class Effort:
    """How much time and how many poses a run may spend."""

    seconds: float
    """for each row, both sides together"""
    scale: float
    """share of the full number of poses and targets"""

    def count(self, full: int, least: int = 1) -> int:
        """How many poses or targets of a full run's number."""
        return max(least, int(full * self.scale))


FULL = Effort(seconds=8.0, scale=1.0)
QUICK = Effort(seconds=1.0, scale=0.1)
_ROUNDS = 5
"""at least so many, however long a round takes"""


def compare(
    work: str,
    reference: str,
    sides: Callable[[], tuple[Work, Work]],
    effort: Effort,
    *,
    each: int = 1,
    ours_each: int | None = None,
    goal: Goal | None = None,
) -> Row:
    """Turn and turn about; the best round of each side counts.

    Args:
        work: what is done.
        reference: name of what armctl is held against.
        sides: makes one round of the reference and one of armctl's, and checks that they agree.
        effort: how long to go on.
        each: units of work in a round of the reference.
        ours_each: units of work in a round of armctl's, where that differs.
        goal: what armctl should reach.
    """
    try:
        rounds = _rounds(sides(), effort.seconds)
    except NotMeasuredError as missing:
        return Row(work, reference, goal=goal, missing=str(missing))
    units = (each, ours_each or each)
    reference_us, ours_us = (1e6 * min(times) / unit for times, unit in zip(rounds, units, strict=True))
    spread = max(statistics.median(times) / min(times) - 1.0 for times in rounds)
    share_of_time = goal is not None and goal.of == "time"
    ratio = ours_us / reference_us if share_of_time else reference_us / ours_us
    return Row(work, reference, reference_us, ours_us, spread, ratio, goal)


def _rounds(sides: tuple[Work, Work], seconds: float) -> tuple[list[float], list[float]]:
    taken: tuple[list[float], list[float]] = ([], [])
    for side in sides:
        side()  # caches, lazy imports and first pages are nobody's business
    gc.collect()
    gc.disable()
    try:
        end = time.perf_counter() + seconds
        while len(taken[0]) < _ROUNDS or time.perf_counter() < end:
            for side, times in zip(sides, taken, strict=True):
                start = time.perf_counter()
                side()
                times.append(time.perf_counter() - start)
    finally:
        gc.enable()
    return taken


def must_agree(what: str, one: FloatArray, other: FloatArray, within: float) -> None:
    """Both arrays are the same to ``within``, NaN where the other is NaN.

    Raises:
        ValueError: they are not; there is no sense in timing either.
    """
    if one.shape != other.shape or not np.array_equal(np.isnan(one), np.isnan(other)):
        raise ValueError(f"{what}: {one.shape} and {other.shape} do not answer the same targets")
    apart = float(np.nanmax(np.abs(one - other), initial=0.0))
    if not apart <= within:
        raise ValueError(f"{what}: results differ by {apart:.3g}, allowed is {within:.3g}")
