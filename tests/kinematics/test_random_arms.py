"""Any spherical-shoulder arm: its pose leads back to it; its least rotation is never above a sweep."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.kinematics.kit import FloatArray, plain_forward, solver_of
from tests.kinematics.spherical_kit import random_arm

from armctl.kinematics import Chain, InverseKinematics, Target

STEP = math.radians(0.5)
ALWAYS_THE_SAME = settings(derandomize=True, max_examples=200, database=None)
"""a property that fails now and then would tell nobody which change broke it"""

shares = st.lists(st.one_of(st.sampled_from([0.0, 0.5, 1.0]), st.floats(0.0, 1.0)), min_size=5, max_size=5)
"""where each joint stands between its limits"""


spherical_arms = st.integers(0, 2**32 - 1).map(lambda seed: random_arm(np.random.default_rng(seed)))


def standing(limits: FloatArray, share: list[float]) -> FloatArray:
    low, high = limits.T
    return np.clip(low + np.array(share[: len(limits)]) * (high - low), low, high)


@pytest.mark.slow
@given(spherical_arms, shares)
@ALWAYS_THE_SAME
def test_a_spherical_arm_finds_its_pose_again(arm: tuple[Chain, FloatArray], share: list[float]) -> None:
    leads_back(*arm, standing(arm[1], share))


def leads_back(chain: Chain, limits: FloatArray, q: FloatArray) -> None:
    """Its own configuration is listed; where the pose does not determine it, one with the same pose is."""
    T = plain_forward(chain, q)
    solutions = solver_of(chain, limits).solve(Target.of(T[:3, 3], rotation=T[:3, :3]), STEP)
    assert solutions.success, solutions.reason
    assert solutions.complete
    assert (solutions.q >= limits[:, 0]).all() and (solutions.q <= limits[:, 1]).all()
    reached = np.array([plain_forward(chain, found) for found in solutions.q])
    assert np.abs(reached[:, :3, 3] - T[:3, 3]).max() < 1e-9
    smallest = np.linalg.svd(chain.jacobian(q), compute_uv=False)[-1]
    away = np.abs(solutions.q - q).max(axis=1).min()
    if away > (1e-6 if smallest > 1e-2 else 1e-4):
        assert smallest < 1e-4, "the configuration is lost"
        assert np.abs(reached - T).max(axis=(1, 2)).min() < 1e-6


@pytest.mark.slow
@given(spherical_arms, shares)
@ALWAYS_THE_SAME
def test_the_least_rotation_of_a_spherical_arm(arm: tuple[Chain, FloatArray], share: list[float]) -> None:
    never_above_the_sweep(*arm, standing(arm[1], share))


def never_above_the_sweep(chain: Chain, limits: FloatArray, q: FloatArray) -> None:
    target = chain.forward(q)[:3, 3]
    ik: InverseKinematics = solver_of(chain, limits)
    solutions = ik.solve(Target.of(target), STEP)
    best = solutions.best("least-rotation")
    assert np.abs(chain.forward(best)[:3, 3] - target).max() < 1e-9
    assert (best >= limits[:, 0]).all() and (best <= limits[:, 1]).all()
    assert np.abs(best).sum() <= np.abs(solutions.q).sum(axis=1).min() + 1e-9
