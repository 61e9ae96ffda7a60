"""Numeric inverse kinematics of arms that no closed form fits."""

from __future__ import annotations

import math
import os
import re

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from tests.kinematics.kit import plain_forward, random_q, rotation_about

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics import Chain, DHRow, EnergyModel, GravityModel, Target, rotation_from_rpy
from armctl.kinematics.angles import rotation_angle
from armctl.kinematics.families.numeric.descent import (
    Goal,
    PitchGoal,
    PositionGoal,
    RotationGoal,
    Turns,
    UprightGoal,
    rotation_vectors,
    tool_motion,
)
from armctl.kinematics.families.numeric.solver import LinkBound, NumericSolver
from armctl.kinematics.solutions import Solutions
from armctl.robot import Robot

Arm = tuple[Chain, FloatArray]
LONG = bool(os.environ.get("ARMCTL_LONG"))
POSES = 20 if LONG else 2
STEP = math.radians(0.01)
HALF, QUARTER = math.pi, math.pi / 2


def chain_of(rows: list[tuple[float, float, float]], convention: str = "standard") -> Chain:
    """Rows of a, alpha, d."""
    return Chain.from_dh([DHRow(a, alpha, d) for a, alpha, d in rows], convention)  # type: ignore[arg-type]


def degrees(*pairs: tuple[float, float]) -> FloatArray:
    return np.radians(np.array(pairs))


PUMA: Arm = (  # spherical wrist
    chain_of([
        (0, QUARTER, 0.67), (0.4318, 0, 0), (0.0203, -QUARTER, 0.15005),
        (0, QUARTER, 0.4318), (0, -QUARTER, 0), (0, 0, 0.1),
    ]),
    degrees((-160, 160), (-225, 45), (-45, 225), (-110, 170), (-100, 100), (-266, 266)),
)  # fmt: skip
UR5: Arm = (  # no spherical wrist, two turns a joint
    chain_of([
        (0, QUARTER, 0.089159), (-0.425, 0, 0), (-0.39225, 0, 0),
        (0, QUARTER, 0.10915), (0, -QUARTER, 0.09465), (0, 0, 0.0823),
    ]),
    degrees(*[(-360, 360)] * 6),
)  # fmt: skip
PANDA: Arm = (
    chain_of([
        (0, 0, 0.333), (0, -QUARTER, 0), (0, QUARTER, 0.316), (0.0825, QUARTER, 0),
        (-0.0825, -QUARTER, 0.384), (0, QUARTER, 0), (0.088, QUARTER, 0.107),
    ], "modified"),
    np.array([
        (-2.8973, 2.8973), (-1.7628, 1.7628), (-2.8973, 2.8973), (-3.0718, -0.0698),
        (-2.8973, 2.8973), (-0.0175, 3.7525), (-2.8973, 2.8973),
    ]),
)  # fmt: skip
IIWA: Arm = (
    chain_of([
        (0, -QUARTER, 0.34), (0, QUARTER, 0), (0, QUARTER, 0.4), (0, -QUARTER, 0),
        (0, -QUARTER, 0.4), (0, QUARTER, 0), (0, 0, 0.126),
    ]),
    degrees((-170, 170), (-120, 120), (-170, 170), (-120, 120), (-170, 170), (-120, 120), (-175, 175)),
)  # fmt: skip


def random_arm(n: int, seed: int) -> Arm:
    rng = np.random.default_rng(seed)
    rows = [DHRow(*rng.uniform((-0.2, -HALF, -0.2, -HALF), (0.3, HALF, 0.3, HALF))) for _ in range(n)]
    low = rng.uniform(-2.8, -0.2, n)
    return Chain.from_dh(rows), np.stack([low, low + rng.uniform(0.5, 5.0, n)], axis=1)


ODD4 = random_arm(4, 1)
ARMS = {"puma": PUMA, "ur5": UR5, "panda": PANDA, "iiwa": IIWA, "odd4": ODD4} | {
    f"random{n}": random_arm(n, 10 + n) for n in (1, 2, 3, 5, 6, 7, 9)
}


def solver_of(arm: Arm) -> NumericSolver:
    chain, limits = arm
    energy = EnergyModel(np.ones(chain.n), np.ones(chain.n), GravityModel(chain, ()))
    return NumericSolver(chain, limits, energy, [f"Joint {k + 1}" for k in range(chain.n)])


def assert_sound(solutions: Solutions, arm: Arm) -> None:
    """Inside the limits, on the point by the plain product, each once, and no claim to be complete."""
    chain, limits = arm
    q = solutions.q
    assert solutions.success, solutions.reason
    assert ((q >= limits[:, 0]) & (q <= limits[:, 1])).all()
    for one in q[:: max(1, len(q) // 4)]:
        assert np.linalg.norm(plain_forward(chain, one)[:3, 3] - solutions.target.position) < 1e-9
    assert solutions.residual_m.max() < 1e-9
    assert not cKDTree(q).query_pairs(1e-6, p=math.inf)
    assert not solutions.complete
    assert set(solutions.branch.tolist()) == {"numeric"}


@pytest.mark.parametrize("name", ARMS)
def test_every_pose_that_the_arm_takes_is_solved(name: str) -> None:
    """Position, pitch and rotation of random configurations, on twelve arms."""
    arm = ARMS[name]
    chain, limits = arm
    solver = solver_of(arm)
    for q in random_q(np.random.default_rng(3), limits, POSES):
        T = chain.forward(q)
        pitch, _ = solver.pitch_and_roll(q)
        assert_sound(solver.solve(Target.of(T[:3, 3]), STEP), arm)
        pitched = solver.solve(Target.of(T[:3, 3], pitch), STEP)
        assert_sound(pitched, arm)
        for one in pitched.q:
            assert solver.pitch_and_roll(one)[0] == pytest.approx(pitch, abs=2e-8)
        turned = solver.solve(Target.of(T[:3, 3], rotation=T[:3, :3]), STEP)
        assert_sound(turned, arm)
        assert turned.residual_rad.max() < 1e-7


def test_the_eight_ways_of_a_six_joint_arm_are_found() -> None:
    chain, _ = UR5
    found = solver_of(UR5).solve(pose_of(chain, np.array([0.4, -1.1, 1.3, -0.7, 0.9, 0.2])), STEP)
    assert len(found) == 8 * 2**6  # two turns are allowed: each joint has two equal angles
    assert len(np.unique(np.round(np.exp(1j * found.q), 6), axis=0)) == 8
    assert (np.abs(found.q[0]) <= HALF + 1e-9).all()  # the smallest angles come first
    rotation = np.abs(found.q).sum(axis=1)
    assert (np.diff(rotation) >= -1e-9).all()
    assert found.best("least-rotation") == pytest.approx(found.q[0])


def pose_of(chain: Chain, q: FloatArray) -> Target:
    T = chain.forward(q)
    return Target.of(T[:3, 3], rotation=T[:3, :3])


@pytest.mark.parametrize(
    ("name", "q"),
    [
        ("puma", [0.3, 0.5, -0.4, 0.0, 0.0, 0.7]),  # wrist singular
        ("puma", [0.3, -0.2, HALF - math.atan2(0.4318, 0.0203), 0.3, 0.4, 0.2]),  # elbow folded
        ("puma", [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ("puma", [*np.radians([160, 45, 225]), 0.2, math.radians(100), 0.1]),  # at limits
        ("iiwa", [0.0] * 7),  # fully stretched
    ],
)
def test_singular_poses_and_limits(name: str, q: list[float]) -> None:
    arm = ARMS[name]
    solutions = solver_of(arm).solve(pose_of(arm[0], np.array(q)), STEP)
    assert_sound(solutions, arm)
    assert solutions.residual_rad.max() < 1e-7


def test_joints_on_one_line() -> None:
    """Two joints about the same axis make every Jacobian singular."""
    chain = chain_of([(0, QUARTER, 0.1), (0, 0, 0), (0.3, 0, 0), (0, QUARTER, 0), (0, 0, 0.2), (0, 0, 0.1)])
    arm = chain, degrees(*[(-150, 150)] * 6)
    for q in random_q(np.random.default_rng(11), arm[1], 10):
        assert_sound(solver_of(arm).solve(pose_of(chain, q), STEP), arm)
    answer = solver_of(arm).solve(Target.of([0.3, 0, 0.3], rotation=rotation_from_rpy(1, 1, 1)), STEP)
    assert_sound(answer, arm)
    assert answer.residual_rad.max() > 0.01


def test_a_redundant_arm_lists_a_spread_and_a_held_joint_stays() -> None:
    solutions = solver_of(PANDA).solve(Target.of([0.4, 0.1, 0.5]), STEP)
    assert len(solutions) > 20
    assert np.ptp(solutions.q, axis=0).max() > 2.0
    chain, limits = PANDA[0], PANDA[1].copy()
    limits[2] = 0.25
    for q in random_q(np.random.default_rng(4), limits, 10):
        solutions = solver_of((chain, limits)).solve(pose_of(chain, q), STEP)
        assert_sound(solutions, (chain, limits))
        assert (solutions.q[:, 2] == 0.25).all()


def test_nothing_is_listed_twice_for_a_start() -> None:
    """Images near zero and near the start that are the same are so to the last digit."""
    chain, limits = PANDA
    q = np.array([0.3, -0.4, 0.2, -1.9, 0.4, 1.6, 0.7])
    found = solver_of(PANDA).solve(Target.of(chain.forward(q)[:3, 3]), STEP, q)
    assert_sound(found, PANDA)
    wide = chain, np.stack([limits[:, 0] - math.tau, limits[:, 1] + math.tau], axis=1)
    assert_sound(solver_of(wide).solve(Target.of(chain.forward(q)[:3, 3]), STEP, q + 2.0), wide)


@pytest.mark.parametrize("pitch", [90.0, -90.0, 89.999, -89.9999])
def test_pitch_at_and_near_the_vertical(pitch: float) -> None:
    solver = solver_of(PANDA)
    solutions = solver.solve(Target.of([0.45, -0.1, 0.3], math.radians(pitch)), STEP)
    assert_sound(solutions, PANDA)
    for q in solutions.q:
        assert solver.pitch_and_roll(q)[0] == pytest.approx(math.radians(pitch), abs=2e-8)


def test_roll_is_the_last_joints_own_angle_where_it_rolls_the_tool() -> None:
    solver = solver_of(PUMA)
    solutions = solver.solve(Target.of([0.4, 0.2, 0.5], pitch=-0.5, roll=0.7), STEP)
    assert_sound(solutions, PUMA)
    assert (solutions.q[:, 5] == 0.7).all()
    assert (solver.solve(Target.of([0.4, 0.2, 0.5]), STEP).q[:, 5] == 0.0).all()
    shifted = solver.solve(Target.of([0.4, 0.2, 0.5], roll=math.radians(280)), STEP)
    assert shifted.q[0, 5] == pytest.approx(math.radians(-80))


def test_a_roll_that_cannot_be_is_refused() -> None:
    no_roll = solver_of(ODD4).solve(Target.of([0.1, 0.1, 0.3], roll=0.2), STEP)
    assert no_roll.reason is not None
    assert no_roll.reason.startswith("this arm has no joint that rolls the tool; besides, too far by")
    beyond = solver_of(IIWA).solve(Target.of([0.4, 0.1, 0.5], roll=math.radians(178)), STEP)
    assert beyond.reason == "Joint 7 needs 178.00°, its limits are -175.00° … 175.00°"
    assert beyond.nearest_m == pytest.approx([0.4, 0.1, 0.5], abs=1e-9)
    limits = IIWA[1].copy()
    limits[-1] = np.radians([-90.0, 90.0])
    narrow = solver_of((IIWA[0], limits))
    for roll, nearest in ((200.0, -90.0), (160.0, 90.0), (-200.0, 90.0)):  # 200° is -160°
        refused = narrow.solve(Target.of([0.4, 0.1, 0.5], roll=math.radians(roll)), STEP)
        assert refused.nearest_q is not None
        assert math.degrees(refused.nearest_q[-1]) == pytest.approx(nearest)


def constrained_best(arm: Arm, point: FloatArray, R: FloatArray, starts: FloatArray) -> float:
    """Smallest angle to a rotation at a point, by another method (sequential quadratic programming)."""
    chain, limits = arm
    best = math.inf
    for start in starts:
        found = minimize(
            lambda q: 3.0 - np.trace(R.T @ chain.forward(q)[:3, :3]),
            start,
            bounds=limits,
            constraints={
                "type": "eq",
                "fun": lambda q: 10 * (chain.forward(q)[:3, 3] - point),
                "jac": lambda q: 10 * chain.jacobian(q)[:3],
            },
            method="SLSQP",
            options={"maxiter": 200, "ftol": 1e-13},
        )
        T = chain.forward(np.clip(found.x, limits[:, 0], limits[:, 1]))
        if np.linalg.norm(T[:3, 3] - point) < 1e-7:
            best = min(best, rotation_angle(R.T @ T[:3, :3]))
    return best


@pytest.mark.parametrize("name", ["odd4", "random5", "random6", "random7", "puma"])
def test_the_position_is_an_order_and_the_rotation_a_wish(name: str) -> None:
    arm = ARMS[name]
    chain, limits = arm
    rng = np.random.default_rng(5)
    solver = solver_of(arm)
    for q in random_q(rng, limits, 3 if LONG else 1):
        point, R = chain.forward(q)[:3, 3], rotation_from_rpy(*rng.uniform(-2, 2, 3))
        solutions = solver.solve(Target.of(point, rotation=R), STEP)
        assert_sound(solutions, arm)
        starts = np.vstack([q, random_q(rng, limits, 7)])
        assert solutions.residual_rad.max() < constrained_best(arm, point, R, starts) + 1e-6


def squared_distance(q: FloatArray, chain: Chain, point: FloatArray) -> tuple[float, FloatArray]:
    """From the tool to a point [m²], and its gradient."""
    away = chain.forward(q)[:3, 3] - point
    return float(away @ away), 2.0 * away @ chain.jacobian(q)[:3]


@pytest.mark.parametrize("name", ARMS)
def test_the_nearest_point_is_no_farther_than_another_method_finds(name: str) -> None:
    arm = ARMS[name]
    chain, limits = arm
    solver, rng = solver_of(arm), np.random.default_rng(6)
    refused = 0
    for _ in range(6 if LONG else 2):
        point = rng.normal(size=3)
        point *= rng.uniform(0.9, 1.5) * LinkBound(chain).outer / np.linalg.norm(point)
        answer = solver.solve(Target.of(point), STEP)
        if answer.success:
            continue
        refused += 1
        assert answer.nearest_q is not None and answer.nearest_m is not None
        assert ((answer.nearest_q >= limits[:, 0]) & (answer.nearest_q <= limits[:, 1])).all()
        away = float(np.linalg.norm(answer.nearest_m - point))
        for start in random_q(rng, limits, 6 if LONG else 3):
            other = minimize(
                squared_distance, start, (chain, point), bounds=limits, jac=True, method="L-BFGS-B"
            )
            assert away < math.sqrt(other.fun) + 1e-7
    assert refused > 0


def test_what_cannot_be_is_told_without_a_search() -> None:
    chain = chain_of([(0.4, 0, 0), (0.1, 0, 0)])
    hole = solver_of((chain, degrees((-170, 170), (-170, 170)))).solve(Target.of([0.1, 0, 0]), STEP)
    assert "inside the dead zone, too near by 200.0 mm" in (hole.reason or "")
    beyond = solver_of(PUMA).solve(Target.of([0.4, 0.2, 0.5], pitch=2.0), STEP)
    assert "between -90° and 90°" in (beyond.reason or "")
    with pytest.raises(InputError, match="must be a positive angle"):
        solver_of(PUMA).solve(Target.of([0.4, 0.2, 0.5]), 0.0)
    answer = solver_of(UR5).solve(Target.of([3.0, 0.0, 0.089159]), STEP)
    outer = LinkBound(UR5[0]).outer
    assert f"too far by {1000 * (3.0 - outer):.1f} mm" in (answer.reason or "")
    assert "on the axis of Joint 1" in answer.explanation
    assert answer.nearest_q is not None


@pytest.mark.parametrize("name", ARMS)
def test_no_pose_leaves_the_shell_of_the_links(name: str) -> None:
    chain, _ = ARMS[name]
    bound = LinkBound(chain)
    q = np.random.default_rng(7).uniform(-HALF, HALF, (4000, chain.n))
    away = np.linalg.norm(chain.forward(q)[:, :3, 3] - bound.centre, axis=1)
    assert away.max() <= bound.outer + 1e-9
    assert away.min() >= bound.inner - 1e-9
    if name == "iiwa":  # a wrist in one point: tight
        assert bound.centre == pytest.approx([0, 0, 0.34], abs=1e-6)
        assert bound.outer == pytest.approx(0.926, abs=1e-6)
    if chain.n > 1:
        assert away.max() > 0.6 * bound.outer  # a bound that is never come near would be worth little


def test_a_point_that_the_links_do_not_reach() -> None:
    answer = solver_of(PUMA).solve(Target.of([0.02, 0.0, 0.67]), STEP)
    assert answer.nearest_m is not None
    away = 1000 * np.linalg.norm(answer.nearest_m - [0.02, 0.0, 0.67])
    found = f"no solution was found: none of 256 starts came nearer than {away:.1f} mm"
    assert answer.reason == f"{found}; even without joint limits, none of 64 led there"


def test_the_joints_that_would_have_to_leave_their_limits_are_named() -> None:
    """Joint 1 cannot turn there, and no other joint makes up for it."""
    chain, limits = PUMA[0], PUMA[1].copy()
    limits[0] = [-1.0, 1.0]
    T = chain.forward(np.array([2.0, 0.3, 0.4, 0.2, 0.5, 0.1]))
    answer = solver_of((chain, limits)).solve(Target.of(T[:3, 3]), STEP)
    said = re.fullmatch(
        r"no solution was found: none of 256 starts came nearer than ([\d.]+) mm; at "
        r"the least, Joint 1 needs ([\d.]+)°, its limits are -57.30° … 57.30°",
        answer.reason or "",
    )
    assert said is not None, answer.reason
    assert answer.nearest_away_m == pytest.approx(float(said[1]) / 1000, abs=6e-5)
    q = [math.radians(float(said[2])), *answer.nearest_q[1:]] if answer.nearest_q is not None else []
    wide = limits.copy()
    wide[0, 1] = q[0] + 2e-4
    assert solver_of((chain, wide)).solve(Target.of(T[:3, 3]), STEP).success
    wide[0, 1] = q[0] - 2e-2
    assert not solver_of((chain, wide)).solve(Target.of(T[:3, 3]), STEP).success


def test_a_point_that_is_reached_but_not_with_that_pitch() -> None:
    solver = solver_of(PUMA)
    point = [0.85, 0.15005, 0.67]
    answer = solver.solve(Target.of(point, math.radians(-80)), STEP)
    assert solver.solve(Target.of(point), STEP).success
    assert "the arm reaches that point, but none of 256 starts found a pitch of -80.00° there" in (
        answer.reason or ""
    )
    nearest = float(re.findall(r"the nearest is (-?[\d.]+)°", answer.reason or "")[0])
    assert solver.solve(Target.of(point, math.radians(nearest + 0.01)), STEP).success
    assert not solver.solve(Target.of(point, math.radians(nearest - 0.02)), STEP).success
    assert answer.nearest_q is not None
    assert solver.pitch_and_roll(answer.nearest_q)[0] == pytest.approx(math.radians(-80), abs=1e-7)


@pytest.mark.parametrize(
    "goal",
    [
        PositionGoal(np.array([0.3, -0.2, 0.4]), 0.9),
        PitchGoal(0.4),
        UprightGoal(-1.0),
        RotationGoal(rotation_from_rpy(0.3, -0.8, 1.1)),
        Turns(np.linspace(-1.0, 1.0, 7), np.linspace(0.2, 1.0, 7), 0.1),
    ],
)
def test_the_derivatives_of_a_goal_are_those_of_finite_differences(goal: Goal | Turns) -> None:
    chain, limits = PANDA
    h = 1e-6
    for q in random_q(np.random.default_rng(9), limits, 10):
        moved = q + h * np.vstack([np.eye(chain.n), -np.eye(chain.n)])
        f, gradient, _ = goal.cost(tool_motion(chain, moved))
        _, g, H = goal.cost(tool_motion(chain, q[None]))
        assert g[0] == pytest.approx((f[: chain.n] - f[chain.n :]) / (2 * h), abs=1e-8)
        assert H[0] == pytest.approx((gradient[: chain.n] - gradient[chain.n :]) / (2 * h), abs=1e-6)
        if isinstance(goal, Turns):  # they are not about the tool
            continue
        half = 0.5 * (goal.rows(tool_motion(chain, moved))[0] ** 2).sum(axis=1)
        r, J = goal.rows(tool_motion(chain, q[None]))
        assert (r @ J[0])[0] == pytest.approx((half[: chain.n] - half[chain.n :]) / (2 * h), abs=1e-7)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 2.0, 3.14, HALF - 1e-7, HALF])
def test_rotation_vectors_of_any_angle(angle: float) -> None:
    axis = np.array([0.36, -0.48, 0.8])
    vector = rotation_vectors(rotation_about(axis, angle)[None])[0]
    if angle == HALF:  # both ways round are the same turn
        vector = vector * math.copysign(1.0, vector @ axis)
    assert vector == pytest.approx(angle * axis, abs=1e-8)


@pytest.mark.parametrize(
    ("name", "point_mm", "least_deg"),
    [("ar4", (300, 0, 250), 54.985), ("ur5", (400, 100, 300), 267.223), ("parol6", (200, 50, 300), None)],
)
def test_of_a_continuum_the_least_rotation_is_found(
    name: str, point_mm: tuple[float, ...], least_deg: float | None
) -> None:
    """Nothing on the continuum around it has less, and where another optimiser has the least, it agrees."""
    robot, point, rng = load_robot(name), np.array(point_mm) / 1000, np.random.default_rng(7)
    best = robot.inverse(point).best("least-rotation")
    least = np.abs(best).sum()
    assert least_deg is None or np.degrees(least) == pytest.approx(least_deg, abs=6e-4)
    others = 0
    for size in np.repeat([0.003, 0.03, 0.3], 60):
        q = np.clip(best + size * rng.normal(size=robot.n), *robot.limits.T)
        for _ in range(8):
            q = q - np.linalg.pinv(robot.jacobian(q)[:3]) @ (robot.forward(q)[:3, 3] - point)
        if (q >= robot.limits[:, 0]).all() and (q <= robot.limits[:, 1]).all():
            others += np.abs(robot.forward(q)[:3, 3] - point).max() < 1e-9
            assert np.abs(q).sum() > least - 1e-9
    assert others > 20


def least_by_slsqp(robot: Robot, point: FloatArray, starts: FloatArray) -> float:
    """The least sum of |q| that scipy finds from starts (k, n): each angle is a difference of two sizes."""
    n, (low, high) = robot.n, robot.limits.T
    bounds = [(max(b, 0.0), max(a, 0.0)) for a, b in zip((*high, *-low), (*low, *-high), strict=True)]

    def off(z: FloatArray) -> FloatArray:
        return 10 * (robot.forward(z[:n] - z[n:])[:3, 3] - point)

    def slope(z: FloatArray) -> FloatArray:
        J = 10 * robot.jacobian(z[:n] - z[n:])[:3]
        return np.hstack([J, -J])

    least = math.inf
    for q in starts:
        begin = np.concatenate([np.maximum(q, 0.0), np.maximum(-q, 0.0)])
        found = minimize(
            np.sum, begin, jac=np.ones_like, bounds=bounds, method="SLSQP",
            constraints={"type": "eq", "fun": off, "jac": slope}, options={"maxiter": 200, "ftol": 1e-10},
        )  # fmt: skip
        if np.abs(off(found.x)).max() < 1e-6:
            least = min(least, float(np.abs(found.x[:n] - found.x[n:]).sum()))
    return least


@pytest.mark.parametrize("name", ["ur5", "parol6"])
def test_least_rotation_and_another_optimiser(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(11)
    others = np.random.default_rng(5).uniform(*robot.limits.T, (15, robot.n)) / 2
    for q in rng.uniform(*robot.limits.T, (20 if LONG else 6, robot.n)):
        point = robot.forward(q)[:3, 3]
        best = robot.inverse(point).best("least-rotation")
        assert np.abs(best).sum() <= 1.005 * least_by_slsqp(robot, point, np.vstack([best, others]))


def test_a_joint_that_holds_the_tool_off_has_its_title() -> None:
    found = load_robot("ar4").inverse([0.64330544, 0.02385538, 0.12549655])
    assert found.explanation.endswith("where Joint 2 is at its limit of 90.00°")
