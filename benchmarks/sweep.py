"""All solutions of a position at 0.01°, and the least rotation, against the full-grid sweep."""

from __future__ import annotations

import math

import numpy as np
from benchmarks.measure import Ratio, compare
from benchmarks.naive_sweep import UZUNER, naive_sweep

from armctl import Robot

STEP = math.radians(0.01)
TARGETS = 200


def sweep_ratios(robot: Robot, targets: int = TARGETS) -> list[Ratio]:
    rng = np.random.default_rng(2011)
    q = rng.uniform(UZUNER.limits[:, 0], UZUNER.limits[:, 1], (targets, 4))
    positions = list(UZUNER.tip(q))
    solved = [robot.inverse(position, step=STEP) for position in positions[:20]]

    def naive() -> None:
        for position in positions:
            naive_sweep(UZUNER, position, STEP)

    def ours() -> None:
        for position in positions:
            robot.inverse(position, step=STEP)

    def naive_best() -> None:
        for position in positions[:20]:
            found = naive_sweep(UZUNER, position, STEP)
            found[np.abs(found).sum(axis=1).argmin()]

    def exact() -> None:
        for solutions in solved:
            solutions.best("least-rotation")

    return [
        compare("uzuner, all solutions at 0.01°, a point", naive, ours, each=targets, goal=15.0, rounds=5),
        compare("uzuner, exact least rotation, a point", naive_best, exact, each=20),
    ]
