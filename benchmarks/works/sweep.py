"""All solutions of a position at 0.01°: what the paper's program computes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from benchmarks.measure import Effort, Work, compare, must_agree
from benchmarks.naive_sweep import naive_sweep
from benchmarks.paper_loop import PaperLoop
from benchmarks.planar_arm import UZUNER, FloatArray
from benchmarks.row import Goal, Row

from armctl import Robot, load_robot

STEP = math.radians(0.01)
Sweep = Callable[[FloatArray], FloatArray]


def rows(effort: Effort) -> Iterator[Row]:
    robot = load_robot("uzuner")
    targets = effort.count(200, least=20)
    positions = list(UZUNER.tip(UZUNER.random(np.random.default_rng(2013), targets)))

    def naive() -> tuple[Work, Work]:
        return _sides(lambda position: naive_sweep(UZUNER, position, STEP), robot, positions)

    def paper() -> tuple[Work, Work]:
        loop = PaperLoop(UZUNER, STEP)
        return _sides(loop.solutions, robot, positions)

    work = "uzuner, all solutions at 0.01°, a point"
    yield compare(work, "naive numpy", naive, effort, each=targets, goal=Goal("speed", 15))
    yield compare(work, "the paper's own loop in C", paper, effort, each=targets, goal=Goal("speed", 5))


def _sides(reference: Sweep, robot: Robot, positions: list[FloatArray]) -> tuple[Work, Work]:
    for position in positions[:20]:
        theirs, ours = reference(position)[:, :4], robot.inverse(position, step=STEP).q[:, :4]
        must_agree("solutions of one position", _ordered(theirs), _ordered(ours), 1e-6)

    def sweep() -> None:
        for position in positions:
            reference(position)

    def solve() -> None:
        for position in positions:
            robot.inverse(position, step=STEP)

    return sweep, solve


def _ordered(q: FloatArray) -> FloatArray:
    """By way to face, elbow and swept joint, so that two lists of the same solutions are the same arrays."""
    return q[np.lexsort((np.round(q[:, 1] / STEP), q[:, 3] > 0.0, np.round(q[:, 0], 6)))]
