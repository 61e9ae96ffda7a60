"""A smooth path through the paper's 58 points of an arc, in all five joints, built and sampled."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from benchmarks.agreement import must_agree
from benchmarks.measure import Effort, Work, compare
from benchmarks.row import Goal, Row
from scipy.interpolate import CubicSpline

from armctl import load_robot
from armctl.motion import arc
from armctl.motion.paths import spline_through

_TICKS = 1000


def rows(effort: Effort) -> Iterator[Row]:
    points = load_robot("uzuner").least_rotation(arc())
    path = spline_through(points)
    breaks, ticks = path.breaks, np.linspace(path.low, path.high, _TICKS)

    def sides() -> tuple[Work, Work]:
        def theirs() -> np.ndarray:
            return CubicSpline(breaks, points)(ticks)

        def ours() -> np.ndarray:
            return spline_through(points)(ticks)

        must_agree("a spline's samples", theirs(), ours(), 1e-9)
        return theirs, ours

    work = f"{len(points)}-point spline, built and sampled at {_TICKS:,} ticks"
    yield compare(work, "scipy's CubicSpline", sides, effort, goal=Goal("speed", 5))
