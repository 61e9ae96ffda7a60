"""Many poses at once get what one at a time gets."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from benchmarks.naive_sweep import PlanarArm
from hypothesis import given
from hypothesis import strategies as st
from tests.kinematics.kit import (
    FloatArray,
    chain_of,
    planar_arms,
    random_planar_arm,
    random_q,
    solver_of,
)

from armctl import Robot, load_robot
from armctl.errors import InputError
from armctl.kinematics import DEFAULT_STEP, BatchSolutions, Chain, DHRow, Target
from armctl.kinematics import chain as chain_kernel
from armctl.kinematics.families.yaw_pitch_roll import closed_form
from armctl.kinematics.families.yaw_pitch_roll.closed_form import cosines_within


def assert_true(chain: Chain, limits: FloatArray, batch: BatchSolutions, position: FloatArray) -> None:
    rows, _ = np.nonzero(batch.found)
    q = batch.q[batch.found]
    assert np.isnan(batch.q[~batch.found]).all()
    assert ((q >= limits[:, 0]) & (q <= limits[:, 1])).all()
    assert np.abs(chain.forward(q)[:, :3, 3] - position[rows]).max() < 1e-9


@pytest.mark.parametrize("name", ["ar4", "scorbot", "humanoid", "so101"])
def test_whether_a_target_is_met_is_what_solve_lists(name: str) -> None:
    robot, rng, met = load_robot(name), np.random.default_rng(6), list[bool]()
    solver = robot.inverse_kinematics
    for _ in range(8):
        pose = robot.forward(random_q(rng, robot.limits))
        place = pose[:3, 3] + rng.normal(size=3) * rng.choice([0.0, 0.15])
        pitch, rotation = (None, pose[:3, :3]) if robot.orients_tool else (math.asin(pose[2, 2]), None)
        target = Target.of(place, pitch, rotation=rotation)
        met.append(solver.meets(target))
        listed = solver.solve(target, DEFAULT_STEP)
        assert met[-1] == listed.met == bool((listed.residual_rad < 1e-6).any())
    assert any(met) and not all(met)


def test_every_branch_of_a_batch_is_what_solve_lists() -> None:
    rng = np.random.default_rng(102)
    for chain, limits in planar_arms(101, 30):
        ik = solver_of(chain, limits)
        q = random_q(rng, limits, 60)
        q[:10] = np.where(rng.random((10, chain.n)) < 0.5, limits[:, rng.integers(2)], q[:10])  # on limits
        q[10:20, 2] = np.clip(0.0, *limits[2])  # links in line
        position = chain.forward(q)[:, :3, 3]
        asked = [ik.pitch_and_roll(one) for one in q]
        if asked[0][0] is None:
            continue
        pitch = np.array([p for p, _ in asked], dtype=np.float64)
        roll = None if chain.n == 4 else q[:, 4]
        batch = ik.solve_batch(position, pitch, roll)
        assert batch.q.shape == (60, 8, chain.n)
        assert len(batch) == 60
        assert_true(chain, limits, batch, position)
        assert np.array_equal(batch.count, batch.found.sum(axis=1))
        for i in range(60):
            assert np.nanmin(np.abs(batch.q[i] - q[i]).max(axis=1)) < 1e-6
            listed = ik.solve(Target.of(position[i], pitch[i], None if roll is None else roll[i]), 1.0)
            for branch, one in zip(listed.branch.tolist(), listed.q, strict=True):
                column = batch.branch_names.index(branch)
                if 10 <= i < 20 and not batch.found[i, column]:
                    continue  # links in line: rounding decides whether the two bends are one
                miss = batch.q[i, column] - one  # one image of each; a limit may be met from both sides
                assert np.abs(miss - 2 * math.pi * np.rint(miss / (2 * math.pi))).max() < 1e-6


def test_a_pitch_straight_up_and_beyond_the_vertical() -> None:
    robot = load_robot("abaas")
    for pitch in (math.pi / 2, -math.pi / 2, math.radians(120), -3.0, 2 * math.pi - 0.3, 0.0):
        position = np.array([[0.02, -0.2, 0.25], [-0.1, -0.1, 0.1], [0.0, -0.25, 0.05], [0.05, -0.15, 0.3]])
        batch = robot.inverse_batch(position, pitch, 1.0)
        for i, one in enumerate(position):
            listed = robot.inverse(one, pitch, 1.0)
            assert len(listed) == batch.count[i]
            for branch, q in zip(listed.branch.tolist(), listed.q, strict=True):
                assert np.abs(batch.q[i, batch.branch_names.index(branch)] - q).max() < 1e-9


def test_a_point_on_the_base_axis_and_points_out_of_reach() -> None:
    robot = load_robot("abaas")
    upright = robot.forward(np.radians([0, 90, 0, 180, 30.0]))[:3, 3]
    position = np.stack([upright, [5.0, 0.0, 0.0], [0.0, 0.0, 0.1]])
    batch = robot.inverse_batch(position, math.pi / 2, 0.5)
    assert bool(batch.found[0].any()) == robot.inverse(upright, math.pi / 2, 0.5).success
    assert not batch.found[1:].any()
    assert np.isnan(robot.least_rotation(position)[1]).all()


def test_two_pitch_joints_need_no_pitch() -> None:
    robot = load_robot("mico")
    q = random_q(np.random.default_rng(103), robot.limits, 80)
    position = robot.forward(q)[:, :3, 3]
    batch = robot.inverse_batch(position, roll=q[:, 3])
    assert_true(robot.chain, robot.limits, batch, position)
    least = robot.least_rotation(position)
    assert np.abs(robot.forward(least)[:, :3, 3] - position).max() < 1e-9
    for i, one in enumerate(position):
        listed = robot.inverse(one, roll=float(q[i, 3]))
        distances = np.abs(listed.q[:, None] - batch.q[i][batch.found[i]]).max(axis=2)
        assert distances.min(axis=0).max() < 1e-9
        assert np.abs(least[i]).sum() == pytest.approx(np.abs(robot.inverse(one).best()).sum(), abs=1e-9)
    with pytest.raises(InputError, match="position alone decides the pitch"):
        robot.inverse_batch(position, pitch=0.1)


def test_least_rotation_of_random_arms_is_the_exact_one_and_never_above_the_sweep() -> None:
    rng = np.random.default_rng(105)
    with_curves = 0
    for i in range(120):
        arm = random_planar_arm(rng, offsets=i % 3 != 0)
        ik = solver_of(chain_of(arm, "standard"), arm.limits)
        position = arm.tip(random_q(rng, arm.limits, 25))
        position[-1] = [3.0, 0.0, 0.0]
        q = ik.least_rotation(position)
        assert np.isnan(q[-1]).all()
        q, position = q[:-1], position[:-1]
        assert np.abs(arm.tip(q) - position).max() < 1e-9
        assert ((q >= arm.limits[:, 0]) & (q <= arm.limits[:, 1])).all()
        for point, one in zip(position[:3], q[:3], strict=True):
            solutions = ik.solve(Target.of(point), math.radians(0.02))
            assert np.abs(one).sum() == pytest.approx(np.abs(solutions.best()).sum(), abs=1e-9)
            assert np.abs(one).sum() <= solutions.energies().min() + 1e-9
        resting = np.minimum(np.abs(q[:, 1:]), np.abs(q[:, 1:, None] - arm.limits[1:]).min(axis=2))
        with_curves += int((resting.min(axis=1) > 1e-3).sum())
    assert with_curves > 5  # stationary curves are needed, and were


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"position_m": [[0.1, 0.0, math.nan], [0.1, 0.0, 0.1]]}, r"got \[0.1, 0.0, nan\] in row 0"),
        (
            {"position_m": [[0.1, 0.0, 0.1], [200.0, 0.0, 20000.0]]},
            r"row 1 is 20001 m from the base.*a wrong unit",
        ),
        ({"position_m": [0.1, 0.0, 0.1]}, r"shape \(k, 3\), got \(3,\)"),
        ({"position_m": [["a", "b", "c"]]}, "must be numbers"),
        ({"pitch": [0.1, math.inf]}, r"the pitch must be finite numbers, got inf in row 1"),
        ({"pitch": [0.1, 0.2, 0.3]}, "the pitch needs one number, or one for each of 2 poses"),
        ({"pitch": None}, "this arm has a free joint"),
        ({"roll": math.nan}, "the roll must be finite numbers, got nan"),
    ],
)
def test_what_is_no_batch_is_refused(asked: dict[str, object], says: str) -> None:
    values: dict[str, object] = {"position_m": [[0.1, 0.0, 0.1], [0.2, 0.0, 0.1]], "pitch": 0.1, "roll": 0.0}
    with pytest.raises(InputError, match=says):
        load_robot("uzuner").inverse_batch(**(values | asked))  # type: ignore[arg-type]


def test_a_family_without_a_batch_says_so() -> None:
    robot = load_robot("humanoid")
    for ask in (robot.inverse_batch, robot.least_rotation):
        with pytest.raises(InputError, match=r"'spherical shoulder, elbow, roll'.*call inverse for each"):
            ask([[0.1, 0.1, -0.3]])


@pytest.mark.parametrize("name", ["mico", "abaas", "scorbot"])
def test_points_at_the_end_of_reach_with_the_straight_arm_outside_its_limits(name: str) -> None:
    """All columns in line, none of them inside: an answer like any other, not a crash."""
    robot = load_robot(name)
    rng = np.random.default_rng(111)
    q = random_q(rng, np.tile([-math.pi, math.pi], (robot.n, 1)), 200)
    plane = robot.inverse_kinematics.plane
    assert plane is not None
    q[:, 2] = plane.joint_angle(1, 0.0)
    position = robot.forward(q)[:, :3, 3]
    pitch = None if name == "mico" else robot_pitch(robot, q)
    batch = robot.inverse_batch(position, pitch, 0.0)
    for i in range(200):
        alone = robot.inverse_batch(position[i : i + 1], None if pitch is None else pitch[i], 0.0)
        assert (alone.found[0] == batch.found[i]).all()
    assert not batch.found.any(axis=1).all()


def robot_pitch(robot: Robot, q: FloatArray) -> FloatArray:
    return np.arcsin(np.clip(robot.forward(q)[:, 2, 2], -1.0, 1.0))


def test_a_batch_of_several_parts_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot("scorbot")
    rng = np.random.default_rng(112)
    q = random_q(rng, robot.limits, 1000)
    position, pitch = robot.forward(q)[:, :3, 3], robot_pitch(robot, q)
    pitch[::7] = math.pi / 2
    pitch[300:400] = -math.pi / 2
    whole = robot.inverse_batch(position, pitch, q[:, 4]), robot.forward(q)
    monkeypatch.setattr(closed_form, "_CHUNK", 64)
    monkeypatch.setattr(chain_kernel, "_CHUNK", 96)
    parts = robot.inverse_batch(position, pitch, q[:, 4]), robot.forward(q)
    assert (whole[0].found == parts[0].found).all()
    assert np.array_equal(whole[0].q, parts[0].q, equal_nan=True)
    assert np.array_equal(whole[1], parts[1])
    q[300, 1], q[900, 2] = math.nan, math.inf
    with pytest.raises(InputError, match="in row 300"):
        robot.forward(q)


def test_a_pitch_in_degrees_is_refused() -> None:
    robot = load_robot("scorbot")
    with pytest.raises(InputError, match=r"got -30 rad, which is -1718\.87°"):
        robot.inverse([0.3, 0.0, 0.3], pitch=-30.0)
    with pytest.raises(InputError, match=r"got 7 rad in row 1, which is 401\.07°"):
        robot.inverse_batch([[0.3, 0.0, 0.3]] * 2, [0.0, 7.0])
    there = robot.inverse([0.4, 0.1, 0.2], pitch=-1.0)
    turned = robot.inverse([0.4, 0.1, 0.2], pitch=2 * math.pi - 1.0)
    assert there.branch.tolist() == turned.branch.tolist()
    assert np.abs(there.q - turned.q).max() < 1e-12


def test_an_empty_batch_is_an_empty_answer() -> None:
    robot = load_robot("uzuner")
    assert robot.inverse_batch(np.empty((0, 3)), 0.0).q.shape == (0, 8, 5)
    assert robot.least_rotation(np.empty((0, 3))).shape == (0, 5)


def test_two_threads_get_what_they_get_alone() -> None:
    robot = load_robot("scorbot")
    jobs = [random_q(np.random.default_rng(seed), robot.limits, 9000) for seed in range(12)]

    def work(q: FloatArray) -> list[FloatArray]:
        T = robot.forward(q)
        batch = robot.inverse_batch(T[:, :3, 3], robot_pitch(robot, q), q[:, 4])
        return [T, robot.jacobian(q), batch.q, robot.least_rotation(T[:300, :3, 3])]

    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(work, jobs))
    for q, found in zip(jobs, together, strict=True):
        for one, other in zip(work(q), found, strict=True):
            assert np.array_equal(one, other, equal_nan=True)


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 1e-8, 1e-7, 1e-6])
def test_links_folded_onto_their_joint_are_solved_in_a_batch_too(off: float) -> None:
    """Equal links: the direction is free, and limits that leave a little of it must be found."""
    rng = np.random.default_rng(107)
    for _ in range(30):
        first = rng.uniform(-2.5, 2.5)
        limits = np.array([[-3, 3], [first, first + 0.3], [-math.pi, math.pi], [-0.4, 0.5], [-1, 1]])
        arm = PlanarArm(0.0, 0.0, 0.1, (0.15, 0.15, 0.1), limits[:4])
        ik = solver_of(chain_of(arm, "standard", roll=True), limits)
        q = random_q(rng, limits, 4)
        q[:, 2] = rng.choice([1, -1], 4) * (math.pi - off)
        position = arm.tip(q)
        pitch = np.array([ik.pitch_and_roll(one)[0] for one in q], dtype=np.float64)
        batch = ik.solve_batch(position, pitch, q[:, 4])
        assert batch.found.any(axis=1).all()
        assert_true(ik.chain, limits, batch, position)
        for i in range(4):
            listed = ik.solve(Target.of(position[i], pitch[i], q[i, 4]), 1.0)
            names = {batch.branch_names[k] for k in np.flatnonzero(batch.found[i])}
            assert names == {*listed.branch.tolist()}


@pytest.mark.parametrize("radius", [0.02, 0.0])
def test_the_tip_on_the_shoulder_of_two_equal_links(radius: float) -> None:
    """With the shoulder on the base axis the base is free, too."""
    rng = np.random.default_rng(108)
    for _ in range(30):
        first = rng.uniform(-2.5, 2.5)
        limits = np.array([[-3, 3], [first, first + 0.3], [-math.pi, math.pi], [-1, 1]])
        chain = Chain.from_dh([
            DHRow(radius, math.pi / 2, 0.1), DHRow(0.15, 0.0, 0.0),
            DHRow(0.0, math.pi / 2, 0.0, math.pi / 2), DHRow(0.0, 0.0, 0.15),
        ])  # fmt: skip
        ik = solver_of(chain, limits)
        assert ik.plane is not None
        assert ik.plane.lengths == pytest.approx((0.15, 0.15), abs=1e-15)
        q = random_q(rng, limits)
        elbow = ik.plane.joint_angle(1, math.pi)
        q[2] = math.remainder(elbow, 2 * math.pi)
        T = chain.forward(q)
        position = T[:3, 3]
        assert np.isfinite(ik.least_rotation(position[None])).all()
        assert_true(chain, limits, ik.solve_batch(position[None], None, None), position[None])
        for asked in ({}, {"pitch": ik.pitch_and_roll(q)[0], "roll": float(q[3])}, {"rotation": T[:3, :3]}):
            solutions = ik.solve(Target.of(position, **asked), 1.0)  # type: ignore[arg-type]
            assert solutions.success, asked
            assert solutions.residual_m.max() < 1e-9
            if "rotation" in asked:
                assert solutions.residual_rad.max() < 1e-7
            if "rotation" in asked or (asked and radius > 0.0):
                assert np.abs(solutions.q - q).max(axis=1).min() < 1e-6


@given(low=st.floats(-9.0, 9.0), wide=st.floats(0.0, 7.0), share=st.floats(0.0, 1.0))
def test_the_cosines_of_every_bend_inside_its_limits_are_let_through(
    low: float, wide: float, share: float
) -> None:
    least, most = cosines_within(low, low + wide)
    assert least < math.cos(low + share * wide) < most
    cosines = np.cos(np.linspace(low, low + wide, 2001))
    assert cosines.min() - least < 1e-5 and most - cosines.max() < 1e-5
