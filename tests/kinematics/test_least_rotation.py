"""The exact least rotation is never above a sweep, and is a true solution."""

from __future__ import annotations

import math

import numpy as np
import pytest
from benchmarks.naive_sweep import UZUNER
from tests.kinematics.kit import chain_of, random_planar_arm, random_q, solver_of

from armctl import load_robot
from armctl.kinematics import Target


@pytest.mark.slow
def test_uzuner_is_never_above_the_sweep() -> None:
    robot = load_robot("uzuner")
    rng = np.random.default_rng(31)
    gains = []
    for _ in range(2000):
        solutions = robot.inverse(UZUNER.tip(random_q(rng, UZUNER.limits)))
        best = solutions.best("least-rotation")
        assert np.abs(UZUNER.tip(best[:4]) - solutions.target.position).max() < 1e-9
        assert robot.check_limits(best).tolist() == best.tolist()
        gains.append(solutions.energies().min() - np.abs(best).sum())
    assert min(gains) > -1e-9
    assert max(gains) < math.radians(2)  # nor far below: where links stretch, a step of 0.01° is a degree


def test_random_arms_are_never_above_a_fine_sweep() -> None:
    rng = np.random.default_rng(32)
    with_curves = 0
    for i in range(320):
        arm = random_planar_arm(rng, offsets=i % 3 != 0)
        ik = solver_of(chain_of(arm, "standard"), arm.limits)
        for _ in range(3):
            position = arm.tip(random_q(rng, arm.limits))
            solutions = ik.solve(Target.of(position), math.radians(0.02))
            best = solutions.best("least-rotation")
            assert np.abs(arm.tip(best) - position).max() < 1e-9
            assert ((best >= arm.limits[:, 0]) & (best <= arm.limits[:, 1])).all()
            assert np.abs(best).sum() <= solutions.energies().min() + 1e-9
            # on a stationary curve no joint is at a limit or at zero
            resting = np.minimum(np.abs(best[1:]), np.abs(best[1:, None] - arm.limits[1:]).min(axis=1))
            with_curves += resting.min() > 1e-3
    assert with_curves > 5  # the stationary curves are needed, and were


def test_the_printed_example_of_the_text() -> None:
    """The uzuner paper's text: min sum |theta| over all branches for (220, -196, 85)."""
    best = np.degrees(load_robot("uzuner").inverse([0.22, -0.196, 0.085]).best())
    assert best[:4] == pytest.approx([-42.402, 0.0, -0.678, -48.795], abs=1e-3)
