"""The same target has the same answer in any order and any thread."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from tests.kinematics.kit import FloatArray, random_q, solver_of
from tests.kinematics.spherical_kit import HUMANOID, HUMANOID_LIMITS
from tests.kinematics.test_numeric import PANDA

from armctl import load_robot
from armctl.kinematics import Target

UZUNER = load_robot("uzuner")
LONG = bool(os.environ.get("ARMCTL_LONG"))
ARMS = {
    "uzuner": (UZUNER.chain, UZUNER.limits, 60 if LONG else 20),
    "humanoid": (HUMANOID, np.vstack([HUMANOID_LIMITS[:4], [[-1.5, 1.5]]]), 12 if LONG else 4),
    "panda": (*PANDA, 4 if LONG else 2),
}


@pytest.mark.parametrize("name", ARMS)
def test_the_same_target_has_the_same_answer_in_any_order_and_any_thread(name: str) -> None:
    chain, limits, count = ARMS[name]
    solver = solver_of(chain, limits)
    jobs: list[tuple[Target, float]] = []
    for i, T in enumerate(chain.forward(random_q(np.random.default_rng(71), limits, count))):
        step = math.radians((0.05, 0.1)[i % 2])
        point = T[:3, 3]
        jobs += [(Target.of(point), step), (Target.of(point, rotation=T[:3, :3]), step)]
        jobs += [(Target.of(point, 0.3), step), (Target.of(3 * point + [0, 0, 0.5]), step)]

    def solve(job: tuple[Target, float], solver=solver) -> list[FloatArray]:
        found = solver.solve(*job)
        return [found.q, found.best() if found.success else found.nearest_q]

    alone = [solve(job) for job in jobs]
    fresh = solver_of(chain, limits)
    backwards = [solve(job, fresh) for job in jobs[::-1]][::-1]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(solve, jobs * 2))
    for one, *others in zip(alone, backwards, together[: len(jobs)], together[len(jobs) :], strict=True):
        for other in others:
            assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_solutions_of_one_target_survive_the_next() -> None:
    first = UZUNER.inverse([0.2, 0.0, 0.1])
    before = first.q.copy()
    UZUNER.inverse([0.22, 0.03, 0.12])
    assert np.array_equal(first.q, before)
    with pytest.raises(ValueError, match="read-only"):
        first.q[:] = 0.0
