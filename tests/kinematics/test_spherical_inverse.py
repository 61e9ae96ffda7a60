"""Spherical shoulder and elbow: the position is exact, the swivel goes where the orientation wants it."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from tests.kinematics.kit import FloatArray, plain_forward, random_q, rotation_about
from tests.kinematics.spherical_kit import (
    HUMANOID,
    HUMANOID_LIMITS,
    STEP,
    TITLES,
    assert_reached,
    configurations,
    miss,
    random_arm,
    singular_configuration,
    spherical_solver,
)

from armctl.errors import InputError
from armctl.kinematics import Target
from armctl.kinematics.families.spherical_shoulder.solver import SphericalShoulderSolver

LONG = bool(os.environ.get("ARMCTL_LONG"))
PRINTED = np.array([0.15, -0.10, -0.59])
PRINTED_ROTATION = np.array([[-0.8572, 0, 0.5150], [-0.0894, 0.9848, -0.1488], [-0.5072, -0.1736, -0.8441]])


def test_the_printed_position_is_reached_exactly() -> None:
    """The humanoid paper's angles miss it by 0.07 cm."""
    ik = spherical_solver(HUMANOID, HUMANOID_LIMITS)
    solutions = ik.solve(Target.of(PRINTED), STEP)
    assert_reached(solutions, HUMANOID_LIMITS)
    assert solutions.free_joint == 0
    steps = np.degrees(solutions.q[:, 0]) / 0.5
    assert np.abs(steps - np.rint(steps)).max() < 1e-9
    for q in (*solutions.q, solutions.best()):
        assert np.linalg.norm(plain_forward(HUMANOID, q)[:3, 3] - PRINTED) < 1e-9


def test_the_printed_orientation_is_met_as_nearly_as_can_be() -> None:
    """The humanoid paper's target: exact near (0.14, -9.66, 0.04, 31.0)° with a residual of about 0.009."""
    ik = spherical_solver(HUMANOID, HUMANOID_LIMITS)
    solutions = ik.solve(Target.of(PRINTED, rotation=PRINTED_ROTATION), STEP)
    assert_reached(solutions, HUMANOID_LIMITS)
    assert np.degrees(solutions.q[0]) == pytest.approx([0.14, -9.66, 0.04, 31.0, 0.0], abs=0.06)
    residual = np.linalg.norm(plain_forward(HUMANOID, solutions.q[0])[:3, :3] - PRINTED_ROTATION)
    assert residual == pytest.approx(0.009, abs=5e-4)


def assert_contains(ik: SphericalShoulderSolver, limits: FloatArray, q: FloatArray, pose: bool) -> None:
    """``q`` among the solutions of its own pose; or, where a singular pose leaves more, that pose."""
    T = ik.chain.forward(q)
    solutions = ik.solve(Target.of(T[:3, 3], rotation=T[:3, :3]), STEP)
    assert_reached(solutions, limits)
    assert solutions.residual_rad.max() < 1e-6
    assert pose or miss(solutions, q) < 1e-6


@pytest.mark.slow
def test_poses_of_the_humanoid_contain_their_configurations() -> None:
    ik = spherical_solver(HUMANOID, HUMANOID_LIMITS)
    rng = np.random.default_rng(81)
    for i in range(100_000 if LONG else 300):
        if i % 4 == 3:
            assert_contains(ik, HUMANOID_LIMITS, singular_configuration(ik, HUMANOID_LIMITS, rng), pose=True)
        else:
            assert_contains(ik, HUMANOID_LIMITS, random_q(rng, HUMANOID_LIMITS), pose=False)


def test_poses_of_random_arms_contain_their_configurations() -> None:
    """Singular ones are met, maybe by others."""
    rng = np.random.default_rng(83)
    for _ in range(140 if LONG else 20):
        chain, limits = random_arm(rng)
        ik = spherical_solver(chain, limits)
        for q in configurations(limits, rng, 6):
            assert_contains(ik, limits, q, pose=False)
        for _ in range(4):
            assert_contains(ik, limits, singular_configuration(ik, limits, rng), pose=True)
    for i in range(
        100 if LONG else 30
    ):  # the elbow of the humanoid at its limits, of which one is the straight arm
        q = random_q(rng, HUMANOID_LIMITS)
        q[3] = HUMANOID_LIMITS[3, i % 2]
        assert_contains(spherical_solver(HUMANOID, HUMANOID_LIMITS), HUMANOID_LIMITS, q, pose=False)


@pytest.mark.parametrize("held", [True, False])
def test_a_position_contains_the_configuration(held: bool) -> None:
    """On the grid of the first joint; or, where that is held, off it: both ways of shoulder and elbow."""
    rng = np.random.default_rng(87)
    asked = 0
    for _ in range(50):
        chain, limits = random_arm(rng)
        q = random_q(rng, limits)
        if held:
            limits[0] = q[0]
        else:
            q[0] = STEP * round(q[0] / STEP)
        if not limits[0, 0] <= q[0] <= limits[0, 1]:
            continue
        ik = spherical_solver(chain, limits)
        roll = None if chain.n == 4 else float(q[4])
        solutions = ik.solve(Target.of(chain.forward(q)[:3, 3], roll=roll), STEP)
        assert_reached(solutions, limits)
        assert not held or ik.free_joint is solutions.free_joint is None
        assert miss(solutions, np.append(q[:4], solutions.q[0, 4:])) < 1e-6
        asked += 1
    assert asked > 35


def test_pitch_and_roll_of_random_arms_contain_their_configurations_and_positions_are_reached() -> None:
    """Also with the first joint held, and where all that is reachable lies between two values of the grid."""
    rng = np.random.default_rng(85)
    for _ in range(120 if LONG else 20):
        chain, limits = random_arm(rng)
        ik = spherical_solver(chain, limits)
        for i, q in enumerate(configurations(limits, rng, 6)):
            singular = i == 5
            if singular:
                q = singular_configuration(ik, limits, rng)
            pitch, roll = ik.pitch_and_roll(q)
            assert pitch is not None
            T = plain_forward(chain, q)
            held = limits.copy()
            held[0] = q[0]
            for one, inside in ((ik, limits), (spherical_solver(chain, held), held)):
                assert_reached(one.solve(Target.of(T[:3, 3]), STEP), inside)
            assert math.sin(pitch) == pytest.approx(T[2, 2], abs=1e-12)
            solutions = ik.solve(Target.of(T[:3, 3], pitch, roll), STEP)
            assert_reached(solutions, limits)
            for other in solutions.q:
                assert ik.pitch_and_roll(other)[0] == pytest.approx(pitch, abs=1e-6)
            wrapped = solutions.q - q
            wrapped[:, 4:] = np.remainder(wrapped[:, 4:] + 1.0, 2 * math.pi) - 1.0  # a whole turn of the roll
            assert singular or np.abs(wrapped).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("off", [0.01, 0.4, 3.0])
def test_a_rotation_that_cannot_be_gets_the_nearest_that_can(off: float) -> None:
    """No posture of the sweep at any roll comes nearer, limits or not."""
    rng = np.random.default_rng(88)
    for _ in range(40):
        chain, limits = random_arm(rng)
        ik = spherical_solver(chain, limits)
        T = chain.forward(random_q(rng, limits))
        wanted = T[:3, :3] @ rotation_about(rng.normal(size=3), off)
        solutions = ik.solve(Target.of(T[:3, 3], rotation=wanted), STEP)
        assert_reached(solutions, limits)
        best = solutions.residual_rad.max()
        assert best - solutions.residual_rad.min() < 1e-6
        assert best <= off + 1e-6
        swept = ik.solve(Target.of(T[:3, 3]), STEP).q.copy()
        for roll in np.linspace(*limits[4], 25) if chain.n == 5 else [0.0]:
            swept[:, 4:] = roll
            traces = np.einsum("kij,ij->k", chain.forward(swept)[:, :3, :3], wanted)
            assert best <= np.arccos(np.clip((traces - 1) / 2, -1, 1)).min() + 1e-6


def test_a_tip_in_the_shoulder_itself() -> None:
    """Equal links folded up: the target gives no direction, and all three shoulder joints are free."""
    rows = list(HUMANOID.rows)
    rows[4] = type(rows[4])(0.0, 0.0, 0.35)
    chain = HUMANOID.from_dh(rows, "standard")
    limits = np.array([[-2, 2], [-1, 2], [-3, 3], [-3.2, 3.2], [-1, 1.0]])
    ik = spherical_solver(chain, limits)
    rng = np.random.default_rng(89)
    for elbow in (math.pi, -math.pi, math.pi - 1e-8, math.pi - 1e-5):
        for _ in range(10 if LONG else 4):
            q = random_q(rng, limits)
            q[3] = elbow
            T = chain.forward(q)
            pitch, roll = ik.pitch_and_roll(q)
            assert_reached(ik.solve(Target.of(T[:3, 3]), STEP), limits)
            assert_contains(ik, limits, q, pose=True)
            held = ik.solve(Target.of(T[:3, 3], pitch, roll), STEP)
            assert_reached(held, limits)
            for other in held.q:
                assert ik.pitch_and_roll(other)[0] == pytest.approx(pitch, abs=1e-6)


def test_branches_are_named_by_the_configuration() -> None:
    """Both ways of the shoulder take up the same rotation, with the elbow bent to either side."""
    limits = np.array([[-3.1, 3.1]] * 5)
    ik = spherical_solver(HUMANOID, limits, TITLES)
    q = np.array([0.3, -0.5, 0.4, 0.8, 0.2])
    T = HUMANOID.forward(q)
    solutions = ik.solve(Target.of(T[:3, 3], rotation=T[:3, :3]), STEP)
    assert sorted(solutions.branch.tolist()) == sorted(solutions.branch_names)
    assert solutions.residual_rad.max() < 1e-9
    assert solutions.branch_of(q) == "shoulder-direct elbow-plus"
    swept = ik.solve(Target.of(T[:3, 3]), STEP)
    assert {*swept.branch.tolist()} == {*swept.branch_names}
    elbow_plus = np.char.endswith(swept.branch, "elbow-plus")
    assert (elbow_plus == (swept.q[:, 3] > 0)).all()


def test_a_step_that_is_none_is_refused() -> None:
    ik = spherical_solver(HUMANOID, HUMANOID_LIMITS)
    for step in (0.0, -0.1, math.nan):
        with pytest.raises(InputError, match="step"):
            ik.solve(Target.of(PRINTED), step)
    with pytest.raises(InputError, match="at least"):
        ik.solve(Target.of(PRINTED), 1e-9)


def test_a_pitch_is_met_with_every_equal_angle_of_the_roll() -> None:
    rng = np.random.default_rng(90)
    limits = HUMANOID_LIMITS.copy()
    limits[4] = np.radians([-400.0, 400.0])
    ik = spherical_solver(HUMANOID, limits)
    for _ in range(40):
        q = random_q(rng, limits)
        pitch, _ = ik.pitch_and_roll(q)
        solutions = ik.solve(Target.of(HUMANOID.forward(q)[:3, 3], pitch, float(q[4])), STEP)
        assert_reached(solutions, limits)
        assert miss(solutions, q) < 1e-6
        images = {round(float(roll), 6) for roll in solutions.q[:, 4]}
        inside = [q[4] + 2 * math.pi * k for k in range(-3, 4) if abs(q[4] + 2 * math.pi * k) <= limits[4, 1]]
        assert images == {round(float(roll), 6) for roll in inside}
