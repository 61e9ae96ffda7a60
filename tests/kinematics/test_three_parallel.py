"""Arms with three parallel axes in a row: every solution of a whole pose, in closed form."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from tests.kinematics.kit import random_q
from tests.kinematics.six_joints import (
    STEP,
    THREE_PARALLEL,
    UR5,
    SixJoints,
    apart,
    assert_all_listed,
    assert_sound,
    dh,
    multi_start,
    plain_pose,
    random_three_parallel,
    rotation,
    solver_of,
    target_of,
    with_links,
)

from armctl.kinematics import Chain, Target
from armctl.kinematics.families.numeric.solver import NumericSolver

LONG = bool(os.environ.get("ARMCTL_LONG"))
FAMILY = "three parallel axes"


def test_random_arms_list_the_configuration_behind_a_pose_and_all_others() -> None:
    rng = np.random.default_rng(31)
    for i in range(300 if LONG else 40):
        arm = random_three_parallel(rng, i % 4)
        q = random_q(rng, arm.limits)
        pose = plain_pose(arm.chain, q)
        solutions = solver_of(arm, FAMILY).solve(target_of(pose), STEP)
        assert_sound(arm, solutions, pose, q)
        assert solutions.complete or "whole turns" in str(solutions.incomplete_reason)
        if LONG or i % 30 == 0:
            assert_all_listed(arm, solutions, multi_start(arm, pose, rng, 600 if LONG else 60))


@pytest.mark.parametrize("name", THREE_PARALLEL)
def test_named_arms(name: str) -> None:
    arm = THREE_PARALLEL[name]
    rng = np.random.default_rng(32)
    q = random_q(rng, np.clip(arm.limits, -math.pi, math.pi), 100_000 if LONG else 1000)
    poses = plain_pose(arm.chain, q)
    solver = solver_of(arm, FAMILY)
    for at in range(0, len(q), 10_000):
        part = slice(at, at + 10_000)
        batch = solver.solve_poses(poses[part])
        off = plain_pose(arm.chain, np.nan_to_num(batch.q)) - poses[part, None]
        assert np.abs(off[batch.found]).max() < 1e-9
        assert np.nanmin(np.where(batch.found, apart(batch.q, q[part, None]), np.inf), axis=1).max() < 1e-6
        assert set(batch.count.tolist()) <= {2, 4, 6, 8}
    for one, pose in zip(q[:20], poses[:20], strict=True):
        solutions = solver.solve(target_of(pose), STEP)
        assert_sound(arm, solutions, pose, one)
        assert solutions.complete
        assert len(solutions) % 64 == 0  # two images of each angle


@pytest.mark.parametrize(("degrees", "whole"), [(360, True), (450, True), (540, False), (7000, False)])
def test_as_many_are_listed_as_are_counted(degrees: float, whole: bool) -> None:
    """Where the limits give some angles more images than others; what is left out is told."""
    arm = SixJoints(UR5.chain, np.tile(np.radians([-degrees, degrees]), (6, 1)))
    q = np.array([0.096, -2.305, 0.741, 1.66, 0.678, 2.504])
    solutions = solver_of(arm, FAMILY).solve(target_of(plain_pose(arm.chain, q)), STEP)
    assert len(solutions) == len(solutions.q) == len(solutions.branch) == len(np.unique(solutions.q, axis=0))
    assert 0 < len(solutions) <= 4096
    assert solutions.complete == whole == ("whole turns" not in str(solutions.incomplete_reason))
    assert (degrees, len(solutions)) in {(360, 512), (450, 2241), (540, 4096)} or not whole


@pytest.mark.parametrize("name", [*THREE_PARALLEL, "random"])
def test_one_pose_in_plain_floats_and_many_as_arrays_agree(name: str) -> None:
    """A branch has the same name in both."""
    rng = np.random.default_rng(35)
    arm = THREE_PARALLEL.get(name) or random_three_parallel(np.random.default_rng(3), 1)
    arm = SixJoints(arm.chain, np.tile([-math.pi, math.pi], (6, 1)))
    solver = solver_of(arm, FAMILY)
    q = random_q(rng, arm.limits, 60)
    q[::6, 2] = 0.0  # singular, where plain floats leave it to the arrays
    poses = plain_pose(arm.chain, q)
    batch = solver.solve_poses(poses)
    for pose, ways, found in zip(poses, batch.q, batch.found, strict=True):
        solutions = solver.solve(target_of(pose), STEP)
        assert len(solutions) == found.sum()
        for one, branch in zip(solutions, solutions.branch_index, strict=True):
            assert found[branch]
            assert apart(ways[branch], one) < 1e-6


def test_the_eight_ways_have_names() -> None:
    half = SixJoints(UR5.chain, np.tile([-math.pi, math.pi], (6, 1)))
    pose = plain_pose(UR5.chain, np.array([0.4, -1.1, 1.3, -0.7, 0.9, 0.2]))
    solutions = solver_of(half, FAMILY).solve(target_of(pose), STEP)
    assert len(set(solutions.branch.tolist())) == 8
    for q, name in zip(solutions.q, solutions.branch.tolist(), strict=True):
        points, axes = UR5.chain.axes(q)
        shoulder, elbow, wrist = points[1], points[2], points[3]
        ahead = -np.cross(axes[0], axes[1])  # where the arm reaches to at zero
        line = wrist - shoulder - axes[1] * (axes[1] @ (wrist - shoulder))
        assert name.startswith("front" if line @ ahead > 0 else "back")
        aside = elbow - shoulder - line * ((elbow - shoulder) @ line / (line @ line))
        assert ("elbow-up" in name) == (aside @ axes[0] > 0)
    flipped = [
        math.sin(q[4]) for q, name in zip(solutions.q, solutions.branch, strict=True) if "flipped" in name
    ]
    assert len(flipped) == 4
    assert len({math.copysign(1.0, s) for s in flipped}) == 1


@pytest.mark.parametrize(
    "q_deg",
    [
        (23.0, -63.0, 74.0, -40.0, 0.0, 11.0),
        (236.0, 313.0, 332.0, -360.0, -360.0, 102.0),  # the links do not reach with the last joint at 0
        (360.0, 97.0, 0.0, -360.0, 180.0, -354.0),
    ],
)
def test_a_wrist_in_line_with_the_parallel_axes_is_a_continuum(q_deg: tuple[float, ...]) -> None:
    q = np.radians(q_deg)
    pose = plain_pose(UR5.chain, q)
    solver = solver_of(UR5, FAMILY)
    solutions = solver.solve(target_of(pose), STEP, q)
    assert_sound(UR5, solutions, pose, q)
    assert not solutions.complete
    assert "Joint 6 and Joint 2 can turn against each other" in (solutions.incomplete_reason or "")
    assert solutions.best("least-travel", q) == pytest.approx(q, abs=1e-9)
    assert np.ptp(solutions.q[:, 5]) > 6.0
    batch = solver.solve_poses(pose[None])
    assert batch.found.sum() >= 1
    assert np.abs(plain_pose(UR5.chain, batch.q[batch.found]) - pose).max() < 1e-9


def test_links_that_fold_onto_the_shoulder_are_a_continuum() -> None:
    arm = with_links(0.3, 0.1)
    q = np.array([0.3, 0.4, math.pi, 0.5, 0.7, -0.3])
    pose = plain_pose(arm.chain, q)
    solutions = solver_of(arm, FAMILY).solve(target_of(pose), STEP, q)
    assert_sound(arm, solutions, pose, q)
    assert "Joint 2 and Joint 4 can turn against each other" in (solutions.incomplete_reason or "")


def test_a_wrist_on_the_first_axis_is_a_continuum() -> None:
    arm = with_links(0.25, 0.0)
    q = np.array([0.3, 0.7, 1.2, 0.0, 0.7, -0.3])
    points = arm.chain.axes(q)[0]
    wrist = points[5] - points[1]  # where the last two axes meet: turned onto the first axis
    level = math.copysign(np.hypot(*wrist[:2]), wrist[:2] @ [math.cos(q[0]), math.sin(q[0])])
    q[1] += math.pi / 2 - math.atan2(wrist[2], level)
    pose = plain_pose(arm.chain, q)
    solutions = solver_of(arm, FAMILY).solve(target_of(pose), STEP, q)
    assert_sound(arm, solutions, pose, q)
    assert "Joint 5 and Joint 1 can turn against each other" in (solutions.incomplete_reason or "")


@pytest.mark.parametrize(
    "q",
    [
        [0.4, -1.1, 0.0, -0.7, 0.9, 0.2],  # elbow stretched
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [2 * math.pi, -2 * math.pi, 1.0, 2 * math.pi, -1.0, -2 * math.pi],  # at limits
        [0.4, -1.1, 1e-4, -0.7, 1e-4, 0.2],
        [0.4, -1.1, 1.3, -0.7, 1e-8, 0.2],
        [0.4, -1.1, 1.3, -0.7, math.pi, 0.2],
    ],
)
def test_singular_poses_and_limits(q: list[float]) -> None:
    pose = plain_pose(UR5.chain, np.array(q))
    solutions = solver_of(UR5, FAMILY).solve(target_of(pose), STEP, np.array(q))
    assert_sound(UR5, solutions, pose, np.array(q))


@pytest.mark.parametrize("straight_down", [False, True])
def test_an_elbow_almost_straight_with_a_joint_on_its_limit(straight_down: bool) -> None:
    """The tool points straight down; a joint on its limit may come out of rounding beyond it."""
    rng, limit = np.random.default_rng(13), math.radians(170)
    for _ in range(60):
        q = rng.uniform(-2.0, 2.0, 6)
        q[2], q[4] = rng.choice([-1, 1]) * 10.0 ** rng.uniform(-9, -5), -math.pi / 2
        q[3] = -math.pi / 2 - q[1] - q[2]
        limits = np.tile([-limit, limit], (6, 1))
        joint = rng.integers(1, 4)
        limits[joint] = sorted((q[joint], q[joint] - rng.choice([-1, 1]) * 2.0))
        arm = SixJoints(UR5.chain, limits)
        if ((q < limits[:, 0]) | (q > limits[:, 1])).any():
            continue
        solver, pose = solver_of(arm, FAMILY), plain_pose(arm.chain, q)
        target = target_of(pose)
        if straight_down:
            assert abs(pose[2, 2] + 1.0) < 1e-12
            target = Target.of(pose[:3, 3], -math.pi / 2, q[5])
        solutions = solver.solve(target, STEP)
        away = np.abs(solutions.q - q).max(axis=1).min(initial=math.inf)
        assert away < 1e-6 or not solutions.complete, q.tolist()


def test_images_that_are_left_out_are_told_of_moved_ways_too() -> None:
    limits = np.radians(np.tile([-170.0, 170.0], (6, 1)))
    limits[[0, 4, 5]] = np.radians([-9000.0, 9000.0])
    q = np.array([0.3, -1.1, 3e-8, 0.4, 0.9, 0.2])  # solved as a straight elbow, which is outside
    limits[2] = [q[2], 2.0]
    limits[[1, 3]] = q[[1, 3], None] + [-0.3, 0.3]  # no other way is inside
    solutions = solver_of(SixJoints(UR5.chain, limits), FAMILY).solve(
        target_of(plain_pose(UR5.chain, q)), STEP
    )
    assert "more differ by whole turns" in (solutions.incomplete_reason or "")


def test_an_arm_beside_the_family_by_its_printed_digits_is_exact_all_the_same() -> None:
    rng = np.random.default_rng(33)
    rows = [(r.a_m, r.alpha_rad + 4e-10 * rng.normal(), r.d_m) for r in UR5.chain.rows]
    arm = dh(rows, 180)
    for q in random_q(rng, arm.limits, 20):
        pose = plain_pose(arm.chain, q)
        solver = solver_of(arm, FAMILY)
        assert_sound(arm, solver.solve(target_of(pose), STEP), pose, q)
        batch = solver.solve_poses(pose[None])
        assert np.abs(plain_pose(arm.chain, batch.q[batch.found]) - pose).max() < 1e-11


def test_parts_of_a_pose_and_poses_out_of_reach_are_answered_as_by_search() -> None:
    solver = solver_of(UR5, FAMILY)
    numeric = NumericSolver(UR5.chain, UR5.limits, solver.energy, solver.titles)
    rng = np.random.default_rng(34)
    for target in (Target.of([0.4, 0.1, 0.3]), Target.of([0.4, 0.1, 0.3], pitch=-1.0), Target.of([2, 0, 0])):
        ours, theirs = solver.solve(target, STEP), numeric.solve(target, STEP)
        assert np.array_equal(ours.q, theirs.q)
        assert (ours.reason, ours.complete) == (theirs.reason, False)
    pose = plain_pose(UR5.chain, np.array([0.3, 0.02, -0.05, 0.1, 1.0, 0.2]))
    pose[:3, :3] = rotation(rng)
    near = solver.solve(target_of(pose), STEP)  # the point, with the orientation as near as it can be
    assert near.success and near.residual_m.max() < 1e-9 and not near.complete
    assert near.residual_rad.min() == pytest.approx(numeric.solve(target_of(pose), STEP).residual_rad.min())
    assert solver.pitch_and_roll(np.zeros(6))[1] == 0.0


def test_four_parallel_axes_or_two_on_one_line_are_not_of_the_family() -> None:
    q = math.pi / 2
    for rows in (
        [(0, q, 0.1), (0.3, 0, 0), (0.3, 0, 0), (0.2, 0, 0), (0, q, 0.1), (0, 0, 0.1)],
        [(0, q, 0.1), (0.3, 0, 0), (0, 0, 0.1), (0, q, 0.1), (0, q, 0.1), (0, 0, 0.1)],
    ):
        arm = dh(rows, 180)
        assert solver_of(arm, "numeric").family == "numeric"
    chain = Chain(UR5.chain.segments[:5], UR5.chain.tail)
    assert chain.n == 5
