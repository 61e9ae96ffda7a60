"""Each criterion against its formula, written out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.arms import FIVE
from tests.kinematics.kit import FloatArray, plain_frames, random_q

from armctl import load_robot
from armctl.errors import InputError, UnreachableError
from armctl.kinematics import (
    CRITERIA,
    CRITERION_TEXT,
    Body,
    Chain,
    DHRow,
    EnergyModel,
    GravityModel,
    Solutions,
    Target,
)
from armctl.kinematics.families.numeric.solver import NumericSolver
from armctl.motion import plan_joints

START = np.radians([10, 100, -60, -20, 5.0])
HALF = 0.5 * math.pi
UR5 = (
    (0.0, HALF, 0.089159), (-0.425, 0.0, 0.0), (-0.39225, 0.0, 0.0),
    (0.0, HALF, 0.10915), (0.0, -HALF, 0.09465), (0.0, 0.0, 0.0823),
)  # fmt: skip
"""a [m], alpha [rad], d [m] (Universal Robots)"""


def solutions() -> Solutions:
    robot = load_robot("uzuner")
    return robot.inverse(robot.forward(np.radians([15, 60, -70, 20, 0]))[:3, 3], roll=math.radians(12))


def potential(model: GravityModel, q: FloatArray) -> float:
    """Potential energy [J] by plain products."""
    chain = model.chain
    frames = plain_frames(chain.rows, chain.convention, q)
    heights: list[float] = []
    for body in model.bodies:
        T = frames[chain.joint_rows[body.joint] + 1]
        heights.append(body.mass_kg * float((T @ [*body.com_m, 1.0])[2]))
    return 9.80665 * (sum(heights) + model.payload_kg * frames[-1][2, 3])


def test_least_rotation_travel_and_torque_by_their_formulas() -> None:
    found, robot = solutions(), load_robot("uzuner")
    assert found.energies("least-rotation") == pytest.approx(np.abs(found.q).sum(axis=1), rel=1e-14)
    times = (np.abs(found.q - START) / np.radians([60, 60, 90, 120, 120.0])).sum(axis=1)
    assert found.energies("least-travel", START) == pytest.approx(times, rel=1e-12)
    best = found.best("least-travel", START)
    exact = (np.abs(best - START) / np.radians([60, 60, 90, 120, 120.0])).sum()
    assert times.min() - 0.01 < exact < times.min()  # not only the best of the list
    stall = np.array([2.941995, 2.941995, 3.9, 1.2552512, 0.4903325])
    loads = ((robot.gravity.torque(found.q) / stall) ** 2).sum(axis=1)
    assert found.energies("least-torque") == pytest.approx(loads, rel=1e-12)
    assert found.best("least-torque").tolist() == found.q[loads.argmin()].tolist()


def test_shortest_time_is_the_duration_of_the_planned_motion() -> None:
    found, robot = solutions(), load_robot("uzuner")
    times = found.energies("shortest-time", START)
    for i in range(0, len(found), len(found) // 40):
        assert times[i] == plan_joints(robot, START, found[i], checked=False).duration
    best = found.best("shortest-time", START)
    assert plan_joints(robot, START, best, checked=False).duration <= times.min()
    far = START + np.radians(
        [150, 0, 0, 0, 0]
    )  # the base sets the time: of many equals the one that moves least
    equal = found.energies("shortest-time", far) <= found.energies("shortest-time", far).min() + 1e-10
    assert equal.sum() > 100
    least = found.energies("least-travel", far)[equal].min()
    best = found.best("shortest-time", far)
    assert (np.abs(best - far) / robot.speed_limits).sum() <= least + 1e-12
    order = found.order("shortest-time", far)
    assert sorted(order.tolist()) == list(range(len(found)))
    assert found.energies("least-travel", far)[order[0]] == least


@pytest.mark.parametrize("name", FIVE)
def test_the_least_way_from_a_start_keeps_what_need_not_move(name: str) -> None:
    """Asked for the position it is at, the arm stays; from elsewhere nothing that is listed beats it."""
    robot = load_robot(name)
    rng = np.random.default_rng(29)
    poses = random_q(rng, robot.limits, 12)
    if name == "scorbot":
        poses = np.vstack([poses, np.radians([30, -50, 80, -60, 170])])
    for q, start in zip(poses, np.roll(poses, 1, axis=0), strict=True):
        T = robot.forward(q)
        pitch, _ = robot.inverse_kinematics.pitch_and_roll(q)
        here = robot.inverse(T[:3, 3], step=math.radians(1), start=q)
        for criterion in ("least-travel", "shortest-time"):
            assert here.best(criterion, q) == pytest.approx(q, abs=1e-6)
        if robot.inverse_kinematics.free_joint is not None and pitch is not None:
            assert robot.inverse(T[:3, 3], pitch, start=q).best("least-travel", q) == pytest.approx(
                q, abs=1e-6
            )
        best = here.best("least-travel", start)
        assert np.linalg.norm(robot.forward(best)[:3, 3] - T[:3, 3]) < 1e-9
        travel = (np.abs(best - start) / robot.speed_limits).sum()
        fine = robot.inverse(T[:3, 3], step=math.radians(0.02))
        swept = fine.q.copy()
        roll = robot.inverse_kinematics.roll_joint
        if roll is not None:
            swept[:, roll] = np.clip(start[roll], *robot.limits[roll])
        listed = (np.abs(swept - start) / robot.speed_limits).sum(axis=1).min()
        assert listed - 2e-3 < travel <= listed + 1e-9


def test_a_searched_arm_asked_for_its_own_pose_stays_there() -> None:
    """UR5, whose joints turn twice each way: every image is listed, and the search begins at the start."""
    chain = Chain.from_dh([DHRow(*row) for row in UR5])
    limits = np.array([[-math.tau, math.tau]] * 6)
    solver = NumericSolver(
        chain, limits, EnergyModel(np.ones(6), np.ones(6), GravityModel(chain, ())), "abcdef"
    )
    rng = np.random.default_rng(2)
    for q in rng.uniform(-math.tau, math.tau, (4, 6)):
        T = chain.forward(q)
        for target in (Target.of(T[:3, 3], rotation=T[:3, :3]), Target.of(T[:3, 3])):
            found = solver.solve(target, 0.1, q)
            for criterion in ("least-travel", "shortest-time"):
                assert found.best(criterion, q) == pytest.approx(q, abs=1e-9)
            assert found.incomplete_reason is not None
            assert found.incomplete_reason.startswith("found by search, there may be others")


def test_published_is_the_magnitude_of_the_sum_with_the_last_pitch_joint_not_positive() -> None:
    found = solutions()
    energy = found.energies("published")
    allowed = found.q[:, 3] <= 0
    assert 0 < allowed.sum() < len(found)
    assert energy[allowed] == pytest.approx(np.abs(found.q[allowed, :4].sum(axis=1)), abs=1e-14)
    assert np.isinf(energy[~allowed]).all()
    best = found.best("published")
    assert abs(best[:4].sum()) == energy.min()


@pytest.mark.parametrize("name", FIVE)
def test_gravity_torque_is_the_gradient_of_the_potential_energy(name: str) -> None:
    robot = load_robot(name)
    rng = np.random.default_rng(51)
    bodies = tuple(Body(int(rng.integers(robot.n)), 0.3, tuple(rng.uniform(-0.1, 0.1, 3))) for _ in range(6))
    for model in (robot.gravity, GravityModel(robot.chain, bodies, 0.25)):
        q = random_q(rng, robot.limits, 2, 4)
        batched = model.torque(q).reshape(8, robot.n)
        for one, torque in zip(q.reshape(8, robot.n), batched, strict=True):
            steps = 1e-5 * np.eye(robot.n)
            numeric = [(potential(model, one + h) - potential(model, one - h)) / 2e-5 for h in steps]
            assert torque == pytest.approx(numeric, abs=1e-8)
            assert model.torque(one) == pytest.approx(torque, abs=1e-14)


def test_a_payload_put_in_later_counts() -> None:
    robot = load_robot("uzuner")
    q = np.radians([0, 10, 5, 5, 0])
    heavier = replace(robot.gravity, payload_kg=robot.gravity.payload_kg + 1.0)
    more = heavier.torque(q)[1] - robot.gravity.torque(q)[1]
    assert abs(robot.gravity.torque(q)[0]) < 1e-15  # the base of an upright arm carries nothing
    assert more == pytest.approx(9.80665 * robot.forward(q)[0, 3], rel=1e-9)


def test_of_two_that_tie_the_first_is_taken() -> None:
    found = load_robot("uzuner").inverse([0.2, 0.05, 0.085], pitch=math.radians(-90))
    twice = Solutions(
        found.arm, found.target, np.repeat(found.q, 2, axis=0), np.repeat(found.branch_index, 2)
    )
    assert twice.index_of(twice.best()) == 0
    assert twice.best().tolist() == found.q[0].tolist()


def test_all_excluded_says_so() -> None:
    robot = load_robot("uzuner")
    q = np.radians([10, 20, -20, 50, 0.0])
    found = robot.inverse(robot.forward(q)[:3, 3], pitch=math.radians(50))
    assert (found.q[:, 3] > 0).all()
    with pytest.raises(UnreachableError, match=r"'published' excludes all \d+ solutions"):
        found.best("published")


@pytest.mark.parametrize(
    ("criterion", "start", "says"),
    [
        ("least-travel", None, "needs the pose that the arm starts from"),
        ("shortest-time", None, "shortest-time needs the pose that the arm starts from"),
        ("least-travel", [0, 0, 0], "5 joint angles are needed"),
        ("least-travel", [0, 0, 0, 0, math.nan], "finite"),
        ("least-travel", "home", "must be numbers"),
        ("least-travel", np.zeros((2, 5)), "5 joint angles are needed, got an array of shape"),
        ("least-rotation", [0, 0, 0, 0, math.nan], "finite"),
        ("published", "home", "must be numbers"),
        ("least-torque", [0, 0, 0], "5 joint angles are needed"),
        (
            "least-effort",
            None,
            "no criterion 'least-effort'; choose one of least-rotation, published",
        ),
        ("", None, "there is no criterion"),
    ],
)
def test_what_cannot_choose_is_refused(criterion: str, start: object, says: str) -> None:
    with pytest.raises(InputError, match=says):
        solutions().best(criterion, start)  # type: ignore[arg-type]


def test_least_torque_is_refused_where_no_mass_of_a_link_is_known() -> None:
    al5d = load_robot("al5d")
    bare = replace(al5d, gravity=replace(al5d.gravity, bodies=()))  # a payload alone says little
    assert "least-torque" in al5d.energy.criteria and "least-torque" not in bare.energy.criteria
    found = bare.inverse(bare.forward(bare.pose("home"))[:3, 3])
    with pytest.raises(InputError, match="least-torque cannot choose: the robot file gives no masses"):
        found.best("least-torque")
    assert len(found.best("least-rotation")) == bare.n


def test_a_criterion_of_your_own_chooses_among_the_solutions() -> None:
    uzuner = load_robot("uzuner")
    start = uzuner.pose("home")
    found = uzuner.inverse([0.2, 0.0, 0.1], roll=0.0)

    def elbow(q: FloatArray, begin: FloatArray | None) -> FloatArray:
        assert begin is not None
        with pytest.raises(ValueError, match="read-only"):
            q[0] = 0.0
        return np.where(q[:, 1] < 0.7, np.abs(q[:, 2] - begin[2]), np.inf)

    best, admitted = found.best(elbow, start), found.q[found.q[:, 1] < 0.7]
    assert len(admitted) < len(found)
    assert best.tolist() == admitted[np.abs(admitted[:, 2] - start[2]).argmin()].tolist()
    assert found.best(lambda q, _: range(len(q))).tolist() == found[0].tolist()
    last = len(found) - 1  # minus infinity is the least energy of all
    least = found.best(lambda q, _: np.where(np.arange(len(q)) == last, -np.inf, 0.0))
    assert least.tolist() == found[last].tolist()
    with pytest.raises(UnreachableError, match=r"the criterion given excludes all \d+ solutions"):
        found.best(lambda q, _: np.full(len(q), np.inf))
    for wrong in (lambda q, _: 3, lambda q, _: np.zeros((len(q), 2)), lambda q, _: np.full(len(q), np.nan)):
        with pytest.raises(InputError, match="one energy for each of"):
            found.best(wrong)


def test_solutions_are_a_read_only_list_of_configurations() -> None:
    uzuner = load_robot("uzuner")
    found = uzuner.inverse([0.2, 0.0, 0.1], roll=0.0)
    assert len(found) == len(list(found)) == len(found[:]) > 1
    assert all(np.array_equal(q, found[i]) for i, q in enumerate(found))
    nearest = uzuner.inverse([0.3, 0.0, 0.6])
    assert nearest.nearest_q is not None
    assert nearest.nearest_m is not None
    assert (len(nearest), list(nearest)) == (0, [])
    batch = uzuner.inverse_batch([[0.2, 0.0, 0.1]], -1.0)
    for array in (found.q, found[0], found.branch, found.branch_index, found.residual_m, found.residual_rad):
        assert not array.flags.writeable
    for array in (nearest.nearest_q, nearest.nearest_m, batch.q, batch.found):
        assert not array.flags.writeable


def test_without_a_solution_there_is_no_best() -> None:
    none = load_robot("uzuner").inverse([0.3, 0, 0.6])
    for criterion in CRITERIA:
        with pytest.raises(UnreachableError, match=r"too far by 200\.0 mm"):
            none.best(criterion, START)
    with pytest.raises(UnreachableError, match="too far"):
        none.branch_of(START)


def test_every_criterion_is_described() -> None:
    assert set(CRITERION_TEXT) == set(CRITERIA)


@pytest.mark.parametrize("name", ["ur5", "ar4"])
def test_of_solutions_that_hold_the_same_torque_the_one_of_least_rotation_is_taken(name: str) -> None:
    """Whole turns and a roll about the vertical weigh nothing."""
    robot = load_robot(name)
    in_the_axis = Body(joint=5, mass_kg=1.0, com_m=(0.0, 0.0, 0.0))
    robot = replace(robot, gravity=replace(robot.gravity, bodies=(in_the_axis,)))
    home = robot.pose("home")
    T = robot.forward(home)
    found = robot.inverse(T[:3, 3], rotation=T[:3, :3])
    torque = found.energies("least-torque")
    same = np.flatnonzero(np.isclose(torque, torque.min(), rtol=1e-10))
    assert len(same) > 1
    best = found.best("least-torque")
    assert np.abs(best).sum() == pytest.approx(np.abs(found.q[same]).sum(axis=1).min())
    assert found.q[found.order("least-torque")[0]] == pytest.approx(best)
