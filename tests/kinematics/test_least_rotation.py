"""The exact least rotation is never above a sweep, and is a true solution."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from benchmarks.naive_sweep import UZUNER
from tests.kinematics.kit import random_q
from tests.kinematics.spherical_kit import (
    HUMANOID,
    HUMANOID_LIMITS,
    assert_reached,
    random_arm,
    spherical_solver,
)

from armctl import load_robot
from armctl.kinematics import Target

FINE = math.radians(0.02)


@pytest.mark.slow
def test_uzuner_is_never_above_the_sweep() -> None:
    robot = load_robot("uzuner")
    positions = UZUNER.tip(random_q(np.random.default_rng(31), UZUNER.limits, 600))
    gains: list[float] = []
    for position, least in zip(positions, robot.least_rotation(positions), strict=True):
        solutions = robot.inverse(position)
        best = solutions.best("least-rotation")
        assert np.abs(least).sum() == pytest.approx(np.abs(best).sum(), abs=1e-9)
        for q in (best, least):
            assert np.abs(UZUNER.tip(q[:4]) - position).max() < 1e-9
            assert robot.check_limits(q).tolist() == q.tolist()
        gains.append(float(solutions.energies().min() - np.abs(best).sum()))
    assert min(gains) > -1e-9
    assert max(gains) < math.radians(2)  # nor far below: where links stretch, a step of 0.01° is a degree


def test_the_printed_example_of_the_text() -> None:
    """The uzuner paper's text: min sum |theta| over all branches for (220, -196, 85)."""
    best = np.degrees(load_robot("uzuner").inverse([0.22, -0.196, 0.085]).best())
    assert best[:4] == pytest.approx([-42.402, 0.0, -0.678, -48.795], abs=1e-3)


@pytest.mark.slow
def test_random_spherical_arms_are_never_above_a_fine_sweep() -> None:
    rng, count = np.random.default_rng(91), 100 if os.environ.get("ARMCTL_LONG") else 15
    stationary = swept = 0
    for _ in range(count):
        chain, limits = random_arm(rng)
        ik = spherical_solver(chain, limits)
        for _ in range(2):
            position = chain.forward(random_q(rng, limits))[:3, 3]
            solutions = ik.solve(Target.of(position), FINE)
            assert_reached(solutions, limits)
            assert solutions.least_rotation is not None
            best = solutions.best()
            assert np.linalg.norm(chain.forward(best)[:3, 3] - position) < 1e-9
            assert ((best >= limits[:, 0]) & (best <= limits[:, 1])).all()
            assert np.abs(best).sum() <= solutions.energies().min() + 1e-9
            swept += solutions.free_joint == 0
            resting = np.minimum(np.abs(best[:3]), np.abs(best[:3, None] - limits[:3]).min(axis=1))
            stationary += resting.min() > 1e-3
    assert swept > 1.25 * count
    assert stationary > count / 10  # the stationary postures are needed, and were found


def test_the_humanoid_is_never_above_a_fine_sweep_nor_far_below() -> None:
    ik = spherical_solver(HUMANOID, HUMANOID_LIMITS)
    rng = np.random.default_rng(92)
    gains: list[float] = []
    for _ in range(40):
        position = HUMANOID.forward(random_q(rng, HUMANOID_LIMITS))[:3, 3]
        solutions = ik.solve(Target.of(position), FINE)
        assert_reached(solutions, HUMANOID_LIMITS)
        gains.append(float(solutions.energies().min() - np.abs(solutions.best()).sum()))
    assert min(gains) > -1e-9
    assert np.median(gains) < math.radians(0.1)


def test_the_least_of_the_printed_position() -> None:
    """With θ1 held at zero: the paper prints (0, -9.62, 0, 31), which lands beside the target."""
    ik = spherical_solver(HUMANOID, HUMANOID_LIMITS)
    best = np.degrees(ik.solve(Target.of([0.15, -0.10, -0.59]), FINE).best())
    assert best == pytest.approx([0.0, -9.62, 0.06, 31.0027, 0.0], abs=1e-2)
