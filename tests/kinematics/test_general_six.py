"""Six joints in any position to each other: every solution of a whole pose, by eigenvalues."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from tests.kinematics.kit import random_q
from tests.kinematics.six_joints import (
    GENERAL,
    QUARTER,
    STEP,
    SixJoints,
    apart,
    assert_all_listed,
    assert_sound,
    beside_a_wrist,
    dh,
    multi_start,
    plain_pose,
    random_general,
    rotation,
    solver_of,
    target_of,
)

from armctl.kinematics import Chain, Target
from armctl.kinematics.families.general_six.pencil import (
    ArmPencil,
    Beside,
    dual_quaternions,
    followed,
    product,
)
from armctl.kinematics.families.numeric.solver import NumericSolver

LONG = bool(os.environ.get("ARMCTL_LONG"))
FAMILY = "six joints in general"
DOWN = np.diag([1.0, -1.0, -1.0])


def test_random_arms_list_the_configuration_behind_a_pose_and_all_others() -> None:
    rng = np.random.default_rng(41)
    ran = 0
    for i in range(420 if LONG else 25):
        arm = random_general(rng)
        solver = solver_of(arm, None)
        if solver.family != FAMILY:
            continue  # the tidy ones may be of another family, or have two joints on one line
        ran += 1
        q = random_q(rng, arm.limits)
        pose = plain_pose(arm.chain, q)
        solutions = solver.solve(target_of(pose), STEP)
        assert_sound(arm, solutions, pose, q)
        if LONG or i % 10 == 0:
            assert_all_listed(arm, solutions, multi_start(arm, pose, rng, 600 if LONG else 60))
    assert ran > (300 if LONG else 15)


@pytest.mark.parametrize("name", GENERAL)
def test_named_arms(name: str) -> None:
    arm = GENERAL[name]
    rng = np.random.default_rng(42)
    solver = solver_of(arm, FAMILY)
    count = 20_000 if LONG else 15
    unsure = 0
    for i, q in enumerate(random_q(rng, np.clip(arm.limits, -math.pi, math.pi), count)):
        pose = plain_pose(arm.chain, q)
        solutions = solver.solve(target_of(pose), STEP)
        assert_sound(arm, solutions, pose, q)
        unsure += not solutions.complete
        if i < (count // 100 if LONG else 2):
            assert_all_listed(arm, solutions, multi_start(arm, pose, rng, 600 if LONG else 100))
    assert unsure <= max(1, 0.02 * count)


@pytest.mark.parametrize("name", GENERAL)
def test_the_last_axis_parallel_to_the_first(name: str) -> None:
    """A tool that points straight down: there the equations of the arm itself say nothing."""
    arm = GENERAL[name]
    rng = np.random.default_rng(43)
    solver = solver_of(arm, FAMILY)
    for q in random_q(rng, np.clip(arm.limits, -math.pi, math.pi), 200 if LONG else 5):
        pose = plain_pose(arm.chain, q)
        pose[:3, :3] = DOWN
        others = multi_start(arm, pose, rng, 600 if LONG else 100)
        if len(others) == 0:
            continue
        solutions = solver.solve(target_of(pose), STEP)
        assert_all_listed(arm, solutions, others)
        for one in others[:3]:
            if ((one >= arm.limits[:, 0]) & (one <= arm.limits[:, 1])).all():
                assert_sound(arm, solutions, pose, one)


def test_a_nearly_singular_pose_has_every_way() -> None:
    """Where the 4th and 6th axis are nearly in line, the fourth joint turns far for half a millimetre."""
    arm = GENERAL["mechArm 270"]
    q = np.radians([-27.818, 90.0, -90.0, 55.815, 0.0, -77.499])
    pose = plain_pose(arm.chain, q)
    solutions = solver_of(arm, FAMILY).solve(target_of(pose), STEP)
    assert_sound(arm, solutions, pose, q)
    assert_all_listed(arm, solutions, multi_start(arm, pose, np.random.default_rng(54), 600))


def random_beside_a_wrist(rng: np.random.Generator) -> SixJoints:
    """Right angles as people build arms, the last axis 0.1 to 2 mm beside the wrist, as in a mechArm."""
    shoulder, upper, d1, fore, hand = rng.uniform((0.0, 0.08, 0.05, 0.08, 0.02), (0.06, 0.3, 0.3, 0.3, 0.1))
    rows = [
        (rng.choice([0.0, shoulder]), -QUARTER, d1), (upper, 0, 0), (rng.choice([0.0, 0.01]), -QUARTER, 0),
        (0, QUARTER, fore), (rng.uniform(1e-4, 2e-3), -QUARTER, 0), (0, 0, hand),
    ]  # fmt: skip
    return dh(rows, rng.uniform(100, 180))


def test_every_way_of_singular_poses_beside_a_wrist() -> None:
    rng = np.random.default_rng(52)
    count, told = (3000 if LONG else 20), 0
    for i in range(count):
        if i % 10 == 0:
            arm = random_beside_a_wrist(rng)
            solver = solver_of(arm, FAMILY)
        q = random_q(rng, arm.limits)
        quarters = np.clip(np.rint(q / QUARTER) * QUARTER, *arm.limits.T)
        q = np.where(rng.random(6) < 0.6, quarters, q)
        q[4] = 0.0
        pose = plain_pose(arm.chain, q)
        solutions = solver.solve(target_of(pose), STEP)
        assert_sound(arm, solutions, pose)
        if np.abs(solutions.q - q).max(axis=1).min() > 1e-6:
            assert not solutions.complete, (i, q)
            told += 1
    assert told <= 0.05 * count  # three axes in line, or a continuum


def test_an_odd_number_of_ways_is_not_all() -> None:
    """The IRB 140 of a published file, the last axis parallel to the first: the tenth way was lost."""
    points = [(0, 0, 0), (0.28, 0, 1.38), (0.28, 0, 2.8), (0.28, 0, 2.8), (1.77, 0, 2.8), (1.77, 0, 2.82)]
    axes = np.eye(3)[[2, 1, 1, 0, 1, 0]]
    origins = np.tile(np.eye(4), (6, 1, 1))
    origins[:, :3, 3] = np.diff(points, axis=0, prepend=0.0)
    tool = np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]])
    limits = np.radians([[-181, 181], [-100, 110], [-60, 65], [-200, 200], [-120, 120], [-400, 400]])
    arm = SixJoints(Chain.from_joints(list(origins), list(axes), tool), limits)
    q = np.radians([180.000420918, -84.821260257, 31.460331353, -180.0, 2.290391601, 98.806149287])
    pose = plain_pose(arm.chain, q)
    assert_sound(arm, solver_of(arm, FAMILY).solve(target_of(pose), STEP), pose, q)


def test_an_arm_half_a_millimetre_beside_a_wrist_in_one_point_has_the_eight_ways_and_no_more() -> None:
    rng = np.random.default_rng(44)
    arm = beside_a_wrist(5e-4)
    arm = SixJoints(arm.chain, np.tile([-math.pi, math.pi], (6, 1)))
    solver = solver_of(arm, FAMILY)
    counts = [
        len(solver.solve(target_of(plain_pose(arm.chain, q)), STEP)) for q in random_q(rng, arm.limits, 20)
    ]
    assert max(counts) == 8


def test_an_arm_with_twists_of_a_degree_has_many_ways() -> None:
    """Neighbours that are nearly parallel: the equations are close to those of fewer ways."""
    arm = dh(
        [
            (0.3, QUARTER, 0.0), (1.0, math.radians(1), 0.0), (0.0, QUARTER, 0.2),
            (1.5, math.radians(1), 0.0), (0.0, QUARTER, 0.0), (0.0, 0.0, 0.0),
        ],
        180,
    )  # fmt: skip
    rng = np.random.default_rng(45)
    solver = solver_of(arm, FAMILY)
    most = 0
    for q in random_q(rng, arm.limits, 30):
        pose = plain_pose(arm.chain, q)
        solutions = solver.solve(target_of(pose), STEP)
        assert_sound(arm, solutions, pose, q)
        most = max(most, len(solutions))
    assert most >= 8


@pytest.mark.parametrize("name", ["j2s6s200", "mechArm 270", "CRX"])
def test_singular_poses_and_limits(name: str) -> None:
    arm = GENERAL[name]
    rng = np.random.default_rng(46)
    solver = solver_of(arm, FAMILY)
    for _ in range(30 if LONG else 4):
        q = singular(arm, rng)
        pose = plain_pose(arm.chain, q)
        solutions = solver.solve(target_of(pose), STEP)
        assert_sound(arm, solutions, pose)
        assert np.abs(solutions.q - q).max(axis=1).min() < 3e-5 or not solutions.complete
    q = random_q(rng, np.clip(arm.limits, -3.0, 3.0))
    q[[1, 4]] = arm.limits[[1, 4], [0, 1]]
    pose = plain_pose(arm.chain, q)
    assert_sound(arm, solver.solve(target_of(pose), STEP), pose, q)


def singular(arm: SixJoints, rng: np.random.Generator) -> np.ndarray:
    """A configuration between two where the determinant of the Jacobian has another sign."""

    def sign(q: np.ndarray) -> float:
        return float(np.linalg.det(arm.chain.jacobian(q)))

    low, high = np.clip(arm.limits, -2.8, 2.8).T
    one, other = rng.uniform(low, high), rng.uniform(low, high)
    while sign(one) * sign(other) > 0:
        other = rng.uniform(low, high)
    for _ in range(60):
        middle = 0.5 * (one + other)
        one, other = (middle, other) if sign(middle) * sign(one) > 0 else (one, middle)
    return one


def test_a_continuum_is_told() -> None:
    """An arm whose last axis comes to lie on the first: both turn, and the tool stands still."""
    rng = np.random.default_rng(50)
    segments = random_general(rng).chain.segments
    q = np.array([0.3, -0.4, 0.5, 0.6, 0.4, -0.7])
    last = segments[0].copy()
    last[:3, 3] += 0.3 * last[:3, 2]
    held = plain_pose(Chain(segments[:5], np.eye(4)), q[:5])
    tail = np.eye(4)
    tail[:3, 3] = 0.1, 0.05, 0.2
    chain = Chain([*segments[:5], np.linalg.inv(held) @ last], tail)
    arm = SixJoints(chain, np.tile([-math.pi, math.pi], (6, 1)))
    pose = plain_pose(chain, q)
    solutions = solver_of(arm, FAMILY).solve(target_of(pose), STEP)
    assert_sound(arm, solutions, pose)
    assert not solutions.complete
    assert "without moving the tool" in (solutions.incomplete_reason or "")
    assert np.ptp(solutions.q[:, 0]) > 5.0
    assert apart(solutions.q, q).min() < 0.1


def test_parts_of_a_pose_and_poses_out_of_reach_are_answered_as_by_search() -> None:
    arm = GENERAL["j2s6s200"]
    solver = solver_of(arm, FAMILY)
    numeric = NumericSolver(arm.chain, arm.limits, solver.energy, solver.titles)
    for target in (Target.of([0.4, 0.1, 0.3]), Target.of([0.4, 0.1, 0.3], pitch=-1.0), Target.of([2, 0, 0])):
        ours, theirs = solver.solve(target, STEP), numeric.solve(target, STEP)
        assert np.array_equal(ours.q, theirs.q)
        assert (ours.reason, ours.complete) == (theirs.reason, False)
    far = solver.solve(Target.of([2, 0, 0], rotation=DOWN), STEP)
    assert "too far by" in (far.reason or "")
    assert far.nearest_q is not None


def test_batches_are_the_single_answers() -> None:
    arm = GENERAL["CRX"]
    solver = solver_of(arm, FAMILY)
    q = random_q(np.random.default_rng(47), np.clip(arm.limits, -3.0, 3.0), 6)
    poses = plain_pose(arm.chain, q)
    batch = solver.solve_poses(poses)
    wide = solver_of(SixJoints(arm.chain, np.tile([-math.pi, math.pi], (6, 1))), FAMILY)
    for i, pose in enumerate(poses):
        assert batch.count[i] == len(wide.solve(target_of(pose), STEP))
        assert np.abs(plain_pose(arm.chain, batch.q[i, batch.found[i]]) - pose).max() < 1e-9


def test_two_joints_on_one_line_are_left_to_the_search() -> None:
    arm = dh([(0, QUARTER, 0.1), (0, 0, 0), (0.3, 0, 0), (0, QUARTER, 0), (0, 0, 0.2), (0, 0, 0.1)], 150)
    assert solver_of(arm, "numeric").family == "numeric"


def test_dual_quaternions_multiply_as_poses_do() -> None:
    rng = np.random.default_rng(48)
    poses = np.tile(np.eye(4), (40, 1, 1))
    for pose in poses:
        pose[:3, :3], pose[:3, 3] = rotation(rng), rng.normal(size=3)
    poses[:3, :3, :3] = [DOWN, np.diag([-1.0, 1.0, -1.0]), np.eye(3)]
    one, other = poses[:20], poses[20:]
    found = product(dual_quaternions(one, 2.0), dual_quaternions(other, 2.0))
    expected = dual_quaternions(one @ other, 2.0)
    assert found * np.sign((found * expected).sum(axis=1))[:, None] == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize("name", GENERAL)
def test_paths_from_a_complex_pose_end_at_all_ways(name: str) -> None:
    """Those that the eigenvalues of the pose itself say, complex ones too."""
    arm = GENERAL[name]
    loop = ArmPencil(arm.chain)
    rng = np.random.default_rng(53)
    q = random_q(rng, np.clip(arm.limits, -3.0, 3.0), 3)
    for pose in plain_pose(arm.chain, q):
        here = loop.candidates(pose[None], 0, 2.0)
        for _ in range(4):  # rounding, which depends on the processor, may lose a path: then another way
            beside = Beside.of(rng, 0.05, loop.unit)
            there = loop.candidates(beside.poses(pose, np.ones(1)), 0, 2.0)
            ends = followed(arm.chain, pose, beside, there.q[there.isotropy > 1e-6], loop.unit)
            if ends.all:
                break
        assert ends.all and len(ends.q) == 16 and not ends.singular.any()
        direct = here.q[here.isotropy > 1e-6]
        direct = direct[np.abs(direct.imag).max(axis=1) < 5.0]  # rounding grows with the imaginary part
        away = np.abs(np.exp(1j * ends.q) - np.exp(1j * direct[:, None])) / np.abs(
            np.exp(1j * direct[:, None])
        )
        assert away.max(axis=2).min(axis=1).max() < 1e-4


def test_sixteen_complex_ways_and_eight_that_are_no_turns() -> None:
    arm = GENERAL["j2s6s200"]
    q = random_q(np.random.default_rng(49), np.clip(arm.limits, -3.0, 3.0), 20)
    found = ArmPencil(arm.chain).candidates(plain_pose(arm.chain, q), 0, 2.0)
    assert ((found.isotropy < 1e-6).sum(axis=1) == 8).all()
    real = np.abs(found.q.imag).max(axis=2) < 1e-6
    away = np.abs(np.exp(1j * found.q.real) - np.exp(1j * q[:, None])).max(axis=2)
    assert np.where(real, away, np.inf).min(axis=1).max() < 1e-6
