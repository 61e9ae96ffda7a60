"""Two threads that solve with one spherical shoulder at once get what each gets alone."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from tests.kinematics.kit import FloatArray, random_q
from tests.kinematics.spherical_kit import HUMANOID, HUMANOID_LIMITS, STEP, spherical_solver

from armctl.kinematics import Target


def test_two_threads_get_what_they_get_alone() -> None:
    limits = np.vstack([HUMANOID_LIMITS[:4], [[-1.5, 1.5]]])
    ik = spherical_solver(HUMANOID, limits)
    rng = np.random.default_rng(111)
    poses = [HUMANOID.forward(random_q(rng, limits)) for _ in range(60)]

    def solve(T: FloatArray) -> list[FloatArray]:
        swept = ik.solve(Target.of(T[:3, 3]), STEP)
        posed = ik.solve(Target.of(T[:3, 3], rotation=T[:3, :3]), STEP)
        far = ik.solve(Target.of(3 * T[:3, 3]), STEP)
        assert far.nearest_q is not None
        return [swept.q, swept.best(), posed.q, far.nearest_q]

    alone = [solve(T) for T in poses]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(solve, poses))
    for one, other in zip(alone, together, strict=True):
        for a, b in zip(one, other, strict=True):
            assert np.array_equal(a, b)
