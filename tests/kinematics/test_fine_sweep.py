"""Sweeps in fine steps, and joints that only touch their limits."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from benchmarks.naive_sweep import UZUNER, PlanarArm
from tests.kinematics.kit import chain_of, random_planar_arm, random_q, solver_of
from tests.kinematics.test_sweep import STEP, assert_same, in_order, swept, wide_arm

from armctl import load_robot

FINE = math.radians(0.02)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_random_arms_list_what_the_full_fine_grid_lists(convention: str) -> None:
    rng = np.random.default_rng(3 if convention == "standard" else 4)
    counts: list[int] = []
    for _ in range(25):
        arm = random_planar_arm(rng)
        ik = solver_of(chain_of(arm, convention, rng=rng), arm.limits)
        counts += [assert_same(ik, arm, arm.tip(random_q(rng, arm.limits)), FINE) for _ in range(2)]
    assert sum(counts) > 10**5


def test_joints_that_turn_round_list_on_a_fine_grid_what_they_list_on_a_coarse_one() -> None:
    """Every 25th value is on both; there the directions pass every angle, and equal links fold."""
    rng = np.random.default_rng(5)
    listed = 0
    for i in range(24):
        lengths = (0.15, 0.1, 0.1) if i % 3 == 0 else tuple(rng.uniform(0.03, 0.3, 3).tolist())
        arm, ik, limits = wide_arm(rng, lengths)
        position = arm.tip(random_q(rng, limits))
        fine, coarse = swept(ik, position, FINE), swept(ik, position, 25 * FINE)
        on_both = np.abs(fine[:, 1] / (25 * FINE) - np.rint(fine[:, 1] / (25 * FINE))) < 1e-6
        assert on_both.sum() == len(coarse)
        assert np.abs(in_order(fine[on_both]) - in_order(coarse)).max() < 1e-9
        assert (fine >= limits[:, 0]).all()
        assert (fine <= limits[:, 1]).all()
        listed += len(fine)
    assert listed > 10**5


def test_a_joint_that_only_touches_its_limit_stays_inside() -> None:
    """The first link points at the target, so the last joint turns back at its limit, between grid values."""
    ik = load_robot("uzuner").inverse_kinematics
    assert ik.plane is not None
    l2, l3, l4 = ik.plane.lengths
    shoulder = ik.plane.shoulder
    rng = np.random.default_rng(6)
    listed = 0
    for _ in range(40):
        limit = float(rng.choice(UZUNER.limits[3]))
        beyond = abs(l3 + l4 * cmath.exp(1j * limit))
        target = shoulder + (l2 + beyond) * cmath.exp(1j * rng.uniform(0.6, 2.0))
        azimuth = float(rng.uniform(-0.5, 0.5))
        position = np.array([target.real * math.cos(azimuth), target.real * math.sin(azimuth), target.imag])
        listed += assert_same(ik, UZUNER, position, STEP)
    assert listed > 10**4


def test_a_joint_that_stays_on_its_limit_stays_inside() -> None:
    """The target on the first pitch axis: the last joint keeps one angle all the way, here its limit."""
    rng = np.random.default_rng(7)
    for _ in range(10):
        l2, l3, l4 = 0.12, 0.1, float(rng.uniform(0.06, 0.1))
        bend = math.acos((l2 * l2 - l3 * l3 - l4 * l4) / (2 * l3 * l4))
        limits = np.array([[-2.0, 2.0], [-0.5, 2.0], [-3.0, 3.0], [-bend, bend]])
        arm = PlanarArm(0.0, 0.05, 0.1, (l2, l3, l4), limits)
        ik = solver_of(chain_of(arm, "standard"), limits)
        azimuth = float(rng.uniform(-1.0, 1.0))
        position = np.array([0.05 * math.cos(azimuth), 0.05 * math.sin(azimuth), 0.1])
        listed = swept(ik, position, FINE)
        assert len(listed) > 10**4
        assert np.abs(np.abs(listed[:, 3]) - bend).max() < 1e-9
        assert (np.abs(listed[:, 3]) <= bend).all()
