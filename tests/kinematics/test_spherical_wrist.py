"""Six-joint arms with a spherical wrist at one end: every posture, none twice, none outside the limits."""

from __future__ import annotations

import math
import os
import re
from itertools import combinations

import numpy as np
import pytest
from tests.kinematics.kit import rotation_about, solver_of
from tests.kinematics.wrist_kit import (
    KNOWN,
    REGIONAL,
    known_arm,
    newton,
    product,
    random_arms,
    random_chain,
    random_limits,
)

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics import Chain, InverseKinematics, Solutions, Target
from armctl.kinematics.angles import TWO_PI, distinct
from armctl.kinematics.families.spherical_wrist.geometry import recognise_wrist
from armctl.kinematics.samples import DEFAULT_STEP

LONG = "ARMCTL_LONG" in os.environ
ARMS, POSES, STARTS = (300, 100, 600) if LONG else (300, 1, 60)
KNOWN_POSES = 100_000 if LONG else 1000


def solved(solver: InverseKinematics, pose: FloatArray, start: FloatArray | None = None) -> Solutions:
    return solver.solve(Target.of(pose[:3, 3], rotation=pose[:3, :3]), DEFAULT_STEP, start)


def pose_of(chain: Chain, q: FloatArray) -> FloatArray:
    return product(chain, q[None])[-1][0]


def check_list(chain: Chain, limits: FloatArray, pose: FloatArray, found: Solutions) -> None:
    """Every listed posture has the pose and keeps the limits; none is listed twice."""
    off = np.abs(product(chain, found.q)[-1] - pose)
    assert off.max(initial=0.0) <= 1e-9
    assert found.residual_m.max(initial=0.0) <= 1e-9 and found.residual_rad.max(initial=0.0) <= 1e-9
    assert (found.q >= limits[:, 0]).all() and (found.q <= limits[:, 1]).all()
    assert all(np.abs(one - other).max() >= 1e-6 for one, other in combinations(found.q, 2))


def is_listed(chain: Chain, found: Solutions, q: FloatArray) -> bool:
    """To 1e-6 rad, or what near a singular pose moves the tool by a tenth of what may be missed."""
    apart = found.q - q
    near = np.abs(apart).max(axis=1) < 1e-3
    felt = np.abs(apart @ chain.jacobian(q).T).max(axis=1) < 1e-10
    return bool((np.abs(apart).max(axis=1) < 1e-6).any() or (near & felt).any())


def test_random_arms_list_the_posture_that_the_pose_comes_from() -> None:
    rng = np.random.default_rng(1)
    for chain, limits in random_arms(20, ARMS):
        solver = solver_of(chain, limits)
        assert solver.family == "spherical wrist"
        for q in rng.uniform(*limits.T, (POSES, 6)):
            found = solved(solver, pose_of(chain, q))
            check_list(chain, limits, pose_of(chain, q), found)
            assert is_listed(chain, found, q)


@pytest.mark.parametrize("name", KNOWN)
def test_known_arms_list_the_posture_that_the_pose_comes_from(name: str) -> None:
    chain, limits = known_arm(name)
    solver = solver_of(chain, limits)
    q = np.random.default_rng(2).uniform(*limits.T, (KNOWN_POSES, 6))
    poses = product(chain, q)[-1]
    answers = [solved(solver, pose) for pose in poses]
    assert all(answer.complete for answer in answers[:30])
    of = np.repeat(np.arange(len(q)), [len(answer) for answer in answers])
    found = np.concatenate([answer.q for answer in answers])
    assert np.abs(product(chain, found)[-1] - poses[of]).max() <= 1e-9
    assert (found >= limits[:, 0]).all() and (found <= limits[:, 1]).all()
    near = np.abs(found - q[of]).max(axis=1) < 1e-6
    missing = np.setdiff1d(np.arange(len(q)), of[near])
    assert all(is_listed(chain, answers[k], q[k]) for k in missing.tolist())
    twice = np.unique(np.column_stack([of, np.round(found, 6)]), axis=0)
    assert len(twice) == len(found)


def test_a_search_from_many_starts_finds_no_other_posture() -> None:
    rng = np.random.default_rng(3)
    half = np.array([-math.pi, math.pi])
    for k in range(60 if LONG else 6):
        chain = random_chain(rng, REGIONAL[k % 6], backward=k % 2 == 1)
        solver = solver_of(chain, np.tile(half, (6, 1)))
        pose = pose_of(chain, rng.uniform(-3, 3, 6))
        answer = solved(solver, pose)
        check_list(chain, solver.limits, pose, answer)
        listed = np.exp(1j * answer.q)
        found = newton(chain, pose, rng.uniform(-math.pi, math.pi, (STARTS, 6)))
        assert len(found) > 0
        apart = np.abs(np.exp(1j * found)[:, None] - listed[None]).max(axis=2)
        assert apart.min(axis=1).max() < 1e-6


def singular(chain: Chain, kind: str, rng: np.random.Generator, off: float) -> FloatArray:
    """(6,) a posture whose wrist or arm is singular but for an angle [rad], the others at random."""
    geometry = recognise_wrist(chain)
    assert geometry is not None
    q = rng.uniform(-2.5, 2.5, 6)
    joint, offset = (4, geometry.offsets[2]) if kind == "wrist" else (2, geometry.offsets[1])
    q[joint] = math.remainder(off + math.pi * rng.integers(2) - offset, math.tau)
    return geometry.order(q)


@pytest.mark.parametrize("kind", ["wrist", "arm"])
def test_at_and_near_singular_poses_on_joint_limits(kind: str) -> None:
    rng = np.random.default_rng(4)
    for k in range(60 * (20 if LONG else 1)):
        chain = random_chain(rng, REGIONAL[k % 6], backward=k % 4 == 3)
        q = singular(chain, kind, rng, (0.0, 1e-11, 1e-9, 1e-8, 1e-7, 1e-5)[k // 6 % 6])
        limits = np.stack([q - rng.uniform(0.1, 3.5, 6), q + rng.uniform(0.1, 3.5, 6)], axis=1)
        for joint in range(6):  # some of the joints stand on a limit
            if rng.random() < 0.4:
                limits[joint, rng.integers(2)] = q[joint]
        found = solved(solver_of(chain, limits), pose_of(chain, q))
        check_list(chain, limits, pose_of(chain, q), found)
        assert len(found) > 0
        if found.complete:
            assert is_listed(chain, found, q)
        else:
            assert re.search("listed|rounding decides", str(found.incomplete_reason))


def test_an_aligned_wrist_is_told_and_stays_where_it_is() -> None:
    chain, limits = known_arm("PUMA 560")
    solver = solver_of(chain, limits)
    q = np.array([0.3, -0.8, 0.9, 0.7, 0.0, -1.1])
    rest = solved(solver, pose_of(chain, q))
    assert not rest.complete
    assert "Joint 4 and Joint 6 are one line" in str(rest.incomplete_reason)
    aligned = rest.q[np.abs(rest.q[:, 4]) < 1e-6]
    assert aligned[:, 3] + aligned[:, 5] == pytest.approx(-0.4, abs=1e-9)
    assert aligned[:, 3] - aligned[:, 5] == pytest.approx(0.0, abs=1e-9)  # nearest to rest: both take half
    stays = solved(solver, pose_of(chain, q), start=q)
    assert np.abs(stays.q - q).max(axis=1).min() < 1e-9


def test_a_wrist_above_the_first_axis_is_told() -> None:
    """IRB 140: one posture of a turn about the first axis, the one nearest to where the arm stands."""
    chain, limits = known_arm("IRB 140")
    solver = solver_of(chain, limits)
    geometry = recognise_wrist(chain)
    assert geometry is not None
    q = np.array([0.4, -0.5, 0.0, 0.3, 0.8, 0.2])
    # bends θ2 until the wrist is over the first axis
    for _ in range(20):
        wrist = product(chain, q[None])[4][0, :3, 3]
        reach = wrist[0] * math.cos(q[0]) + wrist[1] * math.sin(q[0])
        lower = product(chain, (q + 1e-7 * np.eye(6)[1])[None])[4][0, :3, 3]
        q[1] -= reach * 1e-7 / (lower[0] * math.cos(q[0]) + lower[1] * math.sin(q[0]) - reach)
    found = solved(solver, pose_of(chain, q), start=q)
    check_list(chain, limits, pose_of(chain, q), found)
    assert "axis of Joint 1, which may be at any angle" in str(found.incomplete_reason)
    assert np.abs(found.q - q).max(axis=1).min() < 1e-6


def test_branches_are_named_once_each() -> None:
    chain, _ = known_arm("KUKA KR 6")
    solver = solver_of(chain, np.radians([[-179.9, 180]] * 6))
    found = solved(solver, pose_of(chain, np.array([0.2, -1.2, 1.0, 0.5, 0.8, 0.3])))
    assert sorted(found.branch.tolist()) == sorted(
        f"{shoulder} elbow-{elbow} {flip}"
        for shoulder in ("front", "back")
        for elbow in ("up", "down")
        for flip in ("flip", "no-flip")
    )
    elbow = product(chain, found.q)[2][:, 2, 3]  # the third joint's height
    for shoulder in ("front", "back"):
        up, down = (
            elbow[np.char.startswith(found.branch, f"{shoulder} elbow-{which}")] for which in ("up", "down")
        )
        assert up.min() > down.max()


@pytest.mark.parametrize("regional", REGIONAL)
@pytest.mark.parametrize("backward", [False, True])
def test_a_batch_lists_what_single_poses_do(regional: str, backward: bool) -> None:
    rng = np.random.default_rng(6)
    chain = random_chain(rng, regional, backward=backward)
    limits = random_limits(rng)
    solver = solver_of(chain, limits)
    q = rng.uniform(*limits.T, (20, 6))
    poses = product(chain, q)[-1]
    far = np.array([[5.0, 0.0, 0.0]])
    positions, rotations = np.vstack([poses[:, :3, 3], far]), np.vstack([poses[:, :3, :3], np.eye(3)[None]])
    batch = solver.solve_batch(positions, None, None, rotations)
    assert batch.count[-1] == 0
    for k, pose in enumerate(poses):
        single = solved(solver, pose)
        mine = batch.q[k][batch.found[k]]
        assert len(mine) == len(set(single.branch_index.tolist()))
        assert np.abs(chain.forward(mine) - pose).max() < 1e-9
        apart = np.abs(mine[:, None] - single.q[None]).max(axis=2)
        assert apart.min(axis=1).max() < 1e-6
    whatever = solver.solve_poses(poses)
    assert whatever is not None and (whatever.count >= batch.count[:-1]).all()


def test_a_batch_takes_rounded_rotations_as_the_true_ones_and_names_what_is_none() -> None:
    chain, limits = known_arm("AR4")
    solver = solver_of(chain, limits)
    poses = product(chain, np.random.default_rng(8).uniform(*(0.9 * limits).T, (6, 6)))[-1]
    printed = poses[:, :3, :3].copy()
    printed[1::2] = printed[1::2].round(6)
    batch = solver.solve_batch(poses[:, :3, 3], None, None, printed)
    for k, pose in enumerate(poses):
        R = chain.forward(batch.q[k][batch.found[k]])[:, :3, :3]
        assert len(R) and np.abs(R - pose[:3, :3]).max() < (2e-6 if k % 2 else 1e-9)
    for wrong in (-printed[4], 0.999 * printed[4], np.ones((3, 3))):
        printed[4] = wrong
        with pytest.raises(InputError, match="row 4"):
            solver.solve_batch(poses[:, :3, 3], None, None, printed)


def test_batches_of_anything_else_are_refused() -> None:
    solver = solver_of(*known_arm("AR4"))
    with pytest.raises(InputError, match="spherical wrist"):
        solver.solve_batch([[0.2, 0.0, 0.3]], None, None)
    with pytest.raises(InputError, match="row 1"):
        solver.solve_batch(np.zeros((2, 3)), None, None, np.stack([np.eye(3), 2.0 * np.eye(3)]))


def test_what_cannot_be_had_is_approached() -> None:
    solver = solver_of(*known_arm("AR4"))
    far = solver.solve(Target.of([2.0, 0.0, 0.3], rotation=np.eye(3)), DEFAULT_STEP)
    assert not far.success and far.nearest_m is not None
    assert "too far" in str(far.reason)
    chain, limits = known_arm("AR4")
    pose = pose_of(chain, np.array([0.1, 0.4, 0.2, 0.3, 0.5, 0.2]))
    turned = solver.solve(
        Target.of(pose[:3, 3], rotation=pose[:3, :3] @ np.diag([-1.0, 1.0, -1.0])), DEFAULT_STEP
    )
    assert turned.success and not turned.complete
    assert turned.residual_m.max() < 1e-9 and turned.residual_rad.min() > 0.01
    position = solver.solve(Target.of(pose[:3, 3]), DEFAULT_STEP)
    assert position.success and not position.complete
    assert (position.q >= limits[:, 0]).all() and (position.q <= limits[:, 1]).all()


def test_arms_that_are_not_of_the_family() -> None:
    rng = np.random.default_rng(8)
    chain = random_chain(rng, "usual")
    moved = [segment.copy() for segment in chain.segments]
    moved[5][:3, 3] += [1e-6, 0.0, 0.0]
    assert recognise_wrist(chain) is not None
    assert recognise_wrist(Chain(moved, chain.tail)) is None
    assert recognise_wrist(Chain(chain.segments[1:], chain.tail)) is None
    # three parallel axes ahead of the wrist move it in a plane only
    flat = [segment.copy() for segment in known_arm("PUMA 560")[0].segments]
    flat[1] = np.eye(4)
    assert recognise_wrist(Chain(flat, chain.tail)) is None


def test_axes_that_miss_each_other_by_a_hair_are_made_up_for() -> None:
    rng = np.random.default_rng(9)
    chain = random_chain(rng, "usual")
    moved = [segment.copy() for segment in chain.segments]
    moved[5][:3, 3] += [4e-10, 0.0, 0.0]
    chain = Chain(moved, chain.tail)
    limits = random_limits(rng)
    q = rng.uniform(*limits.T, 6)
    found = solved(solver_of(chain, limits), pose_of(chain, q))
    assert found.residual_m.max() < 1e-13 and is_listed(chain, found, q)


@pytest.mark.parametrize("off", [1e-11, 1e-8, 1e-5, 1e-3])
def test_axes_that_are_nearly_parallel_or_nearly_meet(off: float) -> None:
    """No posture is lost, and none is less exact, beside an arm whose axes are or do."""
    rng = np.random.default_rng(10)
    for regional in REGIONAL[1:]:
        chain = random_chain(rng, regional)
        moved = [segment.copy() for segment in chain.segments]
        for k in (1, 2):
            moved[k][:3, 3] += off * rng.normal(size=3)
            moved[k][:3, :3] = moved[k][:3, :3] @ rotation_about(rng.normal(size=3), off)
        near = Chain(moved, chain.tail)
        q = rng.uniform(-3, 3, 6)
        limits = np.tile([-math.pi, math.pi], (6, 1))
        there = solved(solver_of(chain, limits), pose_of(chain, q))
        found = solved(solver_of(near, limits), pose_of(near, q))
        check_list(near, limits, pose_of(near, q), found)
        assert len(found) == len(there)
        assert is_listed(near, found, q)


@pytest.mark.parametrize("turned", [0.0, 1e-7, 0.6])
def test_many_whole_turns_are_listed_or_told_beside_a_singular_pose(turned: float) -> None:
    chain, _ = known_arm("PUMA 560")
    q = np.array([0.3, -0.5, 0.7, 0.2, turned, 0.4])
    once, twice, more = (
        solved(solver_of(chain, np.tile(np.radians([-most, most]), (6, 1))), pose_of(chain, q), q)
        for most in (180.0, 450.0, 720.0)
    )
    assert is_listed(chain, once, q) and is_listed(chain, twice, q) and is_listed(chain, more, q)
    turns = TWO_PI * np.array([[-1.0], [0.0], [1.0]])
    each = [np.abs(one - turns) <= math.radians(450) for one in once.q[distinct(once.q)]]
    assert len(twice) == sum(int(inside.sum(axis=0).prod()) for inside in each)
    off = np.abs(product(chain, twice.q)[-1] - pose_of(chain, q))
    assert off.max() < 1e-9
    assert len(more) <= 4096 and "more differ by whole turns" in str(more.incomplete_reason)
