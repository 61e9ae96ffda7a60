"""The geometric Jacobian of uzuner over a million poses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from benchmarks.agreement import must_agree
from benchmarks.compiled import CArm
from benchmarks.measure import Effort, Work, compare
from benchmarks.planar_arm import UZUNER
from benchmarks.row import Goal, Row

from armctl import load_robot


def rows(effort: Effort) -> Iterator[Row]:
    robot = load_robot("uzuner")
    q = UZUNER.random(np.random.default_rng(2012), effort.count(1_000_000))

    def in_c() -> tuple[Work, Work]:
        arm = CArm(UZUNER)
        must_agree("the Jacobian in C", arm.jacobian(q[:1000]), robot.jacobian(q[:1000]), 1e-9)
        return lambda: arm.jacobian(q), lambda: robot.jacobian(q)

    work = f"uzuner, Jacobian 6×5, {len(q):,} poses, a pose"
    yield compare(work, "C limit", in_c, effort, each=len(q), goal=Goal("time", 3))
