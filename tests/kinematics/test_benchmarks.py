"""The benchmarks run and measure the same work; how fast is for ``make bench`` to say."""

from __future__ import annotations

import numpy as np
from benchmarks.__main__ import table
from benchmarks.forward import forward_ratios
from benchmarks.naive_forward import naive_forward
from benchmarks.sweep import sweep_ratios
from tests.kinematics.kit import plain_forward, random_q

from armctl import load_robot


def test_the_naive_products_are_right() -> None:
    robot = load_robot("uzuner")
    q = random_q(np.random.default_rng(81), robot.limits, 5)
    for one, T in zip(q, naive_forward(robot.chain, q), strict=True):
        assert np.abs(T - plain_forward(robot.chain, one)).max() < 1e-12


def test_every_benchmark_gives_a_ratio() -> None:
    robot = load_robot("uzuner")
    ratios = [*sweep_ratios(robot, 20), *forward_ratios(robot, 2000)]
    assert all(ratio.ratio > 0 for ratio in ratios)
    assert {"work", "plain_us", "armctl_us", "ratio", "goal"} == set(ratios[0].as_json())
    assert all(ratio.work in table(ratios) for ratio in ratios)
