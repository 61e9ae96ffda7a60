"""Two threads that solve at once get what each gets alone."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from benchmarks.naive_sweep import UZUNER
from tests.kinematics.kit import FloatArray, random_q
from tests.kinematics.spherical_kit import HUMANOID, HUMANOID_LIMITS, STEP, spherical_solver

from armctl import load_robot
from armctl.kinematics import Target

STEPS = (math.radians(0.01), math.radians(0.02))  # the grid is cached: let them fight over it


def test_two_threads_get_what_they_get_alone() -> None:
    robot = load_robot("uzuner")
    rng = np.random.default_rng(71)
    jobs = [(UZUNER.tip(random_q(rng, UZUNER.limits)), STEPS[i % 2]) for i in range(120)]

    def solve(job: tuple[FloatArray, float]) -> tuple[FloatArray, FloatArray, FloatArray]:
        position, step = job
        solutions = robot.inverse(position, step=step)
        far = robot.inverse(3 * position + [0, 0, 0.5], step=step)
        return solutions.q, solutions.best(), np.zeros(3) if far.nearest_m is None else far.nearest_m

    alone = [solve(job) for job in jobs]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(solve, jobs))
    for one, other in zip(alone, together, strict=True):
        for a, b in zip(one, other, strict=True):
            assert np.array_equal(a, b)


def test_solutions_of_one_target_survive_the_next() -> None:
    robot = load_robot("uzuner")
    first = robot.inverse([0.2, 0.0, 0.1])
    before = first.q.copy()
    robot.inverse([0.22, 0.03, 0.12])
    assert np.array_equal(first.q, before)
    first.q[:] = 0.0  # the caller's own: nothing inside leans on it
    assert np.array_equal(robot.inverse([0.2, 0.0, 0.1]).q, before)


def test_two_threads_share_a_spherical_shoulder() -> None:
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
