"""All solutions of a position against the straightforward full-grid sweep."""

from __future__ import annotations

import cmath
import math
import os

import numpy as np
import pytest
from benchmarks.naive_sweep import UZUNER, PlanarArm, naive_sweep
from tests.kinematics.kit import FloatArray, chain_of, random_planar_arm, random_q, solver_of

from armctl import load_robot
from armctl.errors import InputError
from armctl.kinematics import InverseKinematics, Target
from armctl.kinematics.samples import grid_values

STEP = math.radians(0.01)
COARSE, FINE = math.radians(0.5), math.radians(0.02)


def in_order(q: FloatArray) -> FloatArray:
    return q[np.lexsort(np.round(q, 7).T)]


def swept(ik: InverseKinematics, position: FloatArray, step: float) -> FloatArray:
    """The four joints of the grid solutions, checked for limits and residual by the way."""
    solutions = ik.solve(Target.of(position), step)
    if solutions.success:
        assert solutions.residual_m.max() < 1e-9
    if solutions.free_joint is None:  # none on the grid: a single one between two grid values, or none at all
        return np.empty((0, 4))
    return solutions.q[:, :4]


def assert_same(ik: InverseKinematics, arm: PlanarArm, position: FloatArray, step: float) -> int:
    ours, naive = swept(ik, position, step), naive_sweep(arm, position, step)
    assert len(ours) == len(naive)
    if len(ours):
        assert np.abs(in_order(ours) - in_order(naive)).max() < 1e-9
        assert (ours >= arm.limits[:, 0]).all()
        assert (ours <= arm.limits[:, 1]).all()
    return len(ours)


def special_configurations() -> list[FloatArray]:
    """Near limits, near the base axis, nearly stretched; the joints a little off the exact places."""
    rng = np.random.default_rng(12)
    low, high = UZUNER.limits.T
    out: list[FloatArray] = []
    for _ in range(25):
        near_limit = random_q(rng, UZUNER.limits)
        k = rng.integers(4, size=2)
        near_limit[k] = np.where(rng.random(2) < 0.5, low[k] + 1e-5, high[k] - 1e-5)
        stretched = random_q(rng, UZUNER.limits)
        stretched[2:] = rng.uniform(-1e-3, 1e-3, 2)
        near_axis = np.array([rng.uniform(-1.5, 1.5), math.radians(98), *rng.uniform(-0.1, 0.1, 2)])
        folded = np.array([rng.uniform(-1, 1), rng.uniform(0.5, 2), low[2] + 1e-4, low[3] + 1e-4])
        out += [near_limit, stretched, near_axis, folded]
    return out


def test_uzuner_lists_what_the_full_grid_lists() -> None:
    robot = load_robot("uzuner")
    count = 300 if os.environ.get("ARMCTL_LONG") else 40
    random = random_q(np.random.default_rng(11), UZUNER.limits, count)
    targets = UZUNER.tip(np.vstack([random, special_configurations()]))
    listed = sum(assert_same(robot.inverse_kinematics, UZUNER, target, STEP) for target in targets)
    assert listed > 10**6 * count / 300
    assert max(robot.inverse(target).residual_m.max() for target in targets[:150]) < 1e-12


@pytest.mark.parametrize(("step", "arms", "least"), [(COARSE, 50, 6 * 10**3), (FINE, 10, 3 * 10**4)])
def test_random_arms_list_what_the_full_grid_lists(step: float, arms: int, least: float) -> None:
    rng = np.random.default_rng(13)
    listed = 0
    for i in range(arms):
        arm = random_planar_arm(rng)
        chain = chain_of(arm, ("standard", "modified")[i % 2], roll=i % 3 == 0, rng=rng)
        ik = solver_of(chain, arm.limits if chain.n == 4 else np.vstack([arm.limits, [[-1.0, 1.0]]]))
        for target in (*arm.tip(random_q(rng, arm.limits, 4)), rng.uniform(-0.6, 0.6, 3)):
            listed += assert_same(ik, arm, target, step)
    assert listed > least


def test_a_target_between_two_grid_values_still_has_its_solution() -> None:
    robot = load_robot("uzuner")
    q = np.radians([10.0, 20.005, 0.0, 0.0, 0.0])  # stretched: one shoulder angle only, not on the grid
    solutions = robot.inverse(robot.forward(q)[:3, 3])
    assert len(solutions) == 1
    assert np.abs(solutions.q[0] - q).max() < 1e-6
    assert solutions.branch[0].startswith("front")


@pytest.mark.parametrize("step", [0.0, -1.0, math.nan, math.inf, 1e-12, "0.01", None, [0.1], np.zeros(5)])
def test_a_step_that_cannot_be_is_refused(step: object) -> None:
    with pytest.raises(InputError, match="step of the swept joint"):
        load_robot("uzuner").inverse([0.2, 0, 0.1], step=step)  # type: ignore[arg-type]


def test_a_step_wider_than_the_limits_leaves_what_there_is() -> None:
    robot = load_robot("uzuner")
    q = np.radians([20.0, 0.0, -30.0, -20.0, 0.0])
    solutions = robot.inverse(robot.forward(q)[:3, 3], step=100.0)
    assert np.all(solutions.q[:, 1] == 0.0)
    assert np.abs(solutions.q - q).max(axis=1).min() < 1e-9
    assert len(robot.inverse([0.2, 0, 0.1], step=100.0)) == 1  # not with the shoulder at 0


def test_stretched_links_on_a_grid_value_are_listed_once_and_exactly() -> None:
    robot = load_robot("uzuner")
    q = np.radians([20.0, 33.0, 25.0, 0.0, 0.0])
    solutions = robot.inverse(robot.forward(q)[:3, 3])
    same = np.abs(solutions.q - q).max(axis=1) < 1e-6
    assert same.sum() == 1
    assert np.abs(solutions.q[same] - q).max() < 1e-12
    assert solutions.residual_m.max() < 1e-12


def wide_arm(
    rng: np.random.Generator, lengths: tuple[float, float, float]
) -> tuple[PlanarArm, InverseKinematics, FloatArray]:
    """Elbow and wrist turn once or more, from and to whole quarter turns."""
    ranges = [(-180, 180), (-90, 270), (-360, 360), (-135, 405), (-170, 500)]
    wide = [ranges[i] for i in rng.integers(len(ranges), size=2)]
    limits = np.radians([(-180.0, 180.0), (-100.0, 130.0), *wide])
    senses, offsets = rng.choice([1, -1], 3), rng.choice([0.0, math.pi / 2, -1.0], 3)
    arm = PlanarArm(0.02, 0.0, 0.1, lengths, limits, 1, tuple(map(int, senses)), tuple(map(float, offsets)))
    return arm, solver_of(chain_of(arm, "modified", rng=rng), limits), limits


def test_a_joint_that_turns_round_is_listed_once_at_each_of_its_angles() -> None:
    """Its limits, the ends of a whole turn and the places where the links are in line among them."""
    rng = np.random.default_rng(16)
    for _ in range(60):
        arm, ik, limits = wide_arm(rng, tuple(rng.uniform(0.03, 0.3, 3).tolist()))
        for _ in range(4):
            q = random_q(rng, limits)
            q[1] = COARSE * round(q[1] / COARSE)
            for k in (2, 3):
                special = [*limits[k], limits[k].mean(), 0.0, math.pi, -math.pi, limits[k, 0] + 2 * math.pi]
                q[k] = np.clip(rng.choice([q[k], *special]), *limits[k])
            listed = swept(ik, arm.tip(q), COARSE)
            assert np.abs(listed - q).max(axis=1).min() < 1e-6
            same = np.abs(listed[:, 1] - q[1]) < 1e-9
            apart = np.abs(listed[same][:, None] - listed[same]).max(axis=2) + np.eye(same.sum())
            assert apart.min() > 1e-8


def test_links_folded_onto_their_joint_are_listed_once_and_reach_the_target() -> None:
    """Equal last links: any angle of the second joint serves then, and next to it digits are lost."""
    rng = np.random.default_rng(17)
    for bend in (math.pi, math.pi - 1e-7, math.pi - 1e-8, math.pi - 1e-9):
        for _ in range(20):
            arm, ik, limits = wide_arm(rng, (0.15, 0.1, 0.1))
            q = random_q(rng, limits)
            q[1] = COARSE * round(q[1] / COARSE)
            wrist = arm.signs[2] * (bend - arm.offsets[2])
            q[3] = wrist + 2 * math.pi * math.ceil((limits[3, 0] - wrist) / (2 * math.pi))
            if q[3] > limits[3, 1]:
                continue
            listed = swept(ik, arm.tip(q), COARSE)
            here = listed[np.abs(listed[:, 1] - q[1]) < 1e-9]
            assert len(here)
            assert np.abs(arm.tip(here) - arm.tip(q)).max() < 5e-10
            if bend == math.pi:
                turns = here[:, 2:] / (2 * math.pi)
                apart = np.abs(turns[:, None] - turns).max(axis=2) + np.eye(len(here))
                assert apart.min() > 0.1


def test_a_held_joint_is_listed_where_it_is_held() -> None:
    """Not on a multiple of the step; no joint is free then, and every branch is listed."""
    rng = np.random.default_rng(18)
    for _ in range(60):
        arm = random_planar_arm(rng)
        q = random_q(rng, arm.limits)
        limits = arm.limits.copy()
        limits[1] = q[1]
        ik = solver_of(chain_of(arm, "standard"), limits)
        assert ik.free_joint is None
        solutions = ik.solve(Target.of(arm.tip(q)), STEP)
        assert solutions.free_joint is None
        assert np.all(solutions.q[:, 1] == q[1])
        assert np.abs(solutions.q - q).max(axis=1).min() < 1e-6
        assert solutions.residual_m.max() < 1e-9


def test_limits_between_two_multiples_of_the_step_have_the_angle_nearest_to_zero() -> None:
    assert grid_values(0.3, 0.7, 1.0).tolist() == [0.3]
    assert grid_values(-0.7, -0.3, 1.0).tolist() == [-0.3]
    assert grid_values(-0.3, 0.7, 1.0).tolist() == [0.0]
    assert grid_values(0.5, 2.2, 1.0).tolist() == [1.0, 2.0]


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
