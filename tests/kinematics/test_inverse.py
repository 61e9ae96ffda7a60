"""Round trips: the configuration that a pose comes from is among its solutions, and every solution is one."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator

import numpy as np
import pytest
from benchmarks.naive_sweep import PlanarArm
from tests.kinematics.kit import (
    FloatArray,
    chain_of,
    plain_forward,
    planar_arms,
    random_q,
    rotation_about,
    solver_of,
)

from armctl import load_robot
from armctl.errors import InputError
from armctl.kinematics import Chain, DHRow, InverseKinematics, Solutions, Target
from armctl.kinematics.families.yaw_pitch_roll import solver

STEP = math.radians(0.5)


def rows(table: list[tuple[float, float, float]], *fixed: int) -> list[DHRow]:
    """Standard rows from (a, alpha in degrees, d) in mm."""
    return [
        DHRow(a / 1000, math.radians(alpha), d / 1000, joint=i not in fixed)
        for i, (a, alpha, d) in enumerate(table)
    ]


ABAAS = Chain.from_dh(rows([(0, 90, 105), (105, 0, 0), (100, 0, 0), (0, 90, 0), (0, 0, 150)]), "standard")
SCORBOT = Chain.from_dh(
    rows([(25, -90, 325), (222, 0, 0), (222, 0, 0), (0, -90, 0), (0, 0, 135)]), "standard"
)
ABAAS_LIMITS = np.radians([[-90, 90], [0, 180], [-135, 0], [-45, 180], [-90, 90.0]])
SCORBOT_LIMITS = np.radians([[-155, 155], [-130, 35], [-130, 130], [-130, 130], [-180, 180.0]])


def configurations(limits: FloatArray, rng: np.random.Generator) -> Iterator[FloatArray]:
    """Random ones; some joints exactly on their limits; straight links where the limits allow them."""
    for _ in range(5):
        yield random_q(rng, limits)
    for _ in range(3):
        q = random_q(rng, limits)
        at = rng.random(len(q)) < 0.6
        yield np.where(at, limits[np.arange(len(q)), rng.integers(2, size=len(q))], q)
    for joints in ([2], [3], [2, 3]):
        q = random_q(rng, limits)
        q[joints] = np.clip(0.0, *limits[joints].T)
        yield q


def assert_true(solutions: Solutions, limits: FloatArray) -> None:
    """Every solution inside the limits and at the target, by plain products."""
    assert ((solutions.q >= limits[:, 0]) & (solutions.q <= limits[:, 1])).all()
    for q in solutions.q[:: max(1, len(solutions) // 20)]:
        T = plain_forward(solutions.arm.chain, q)
        assert np.abs(T[:3, 3] - solutions.target.position).max() < 1e-9


def miss(solutions: Solutions, q: FloatArray) -> float:
    assert solutions.success, solutions.reason
    return float(np.abs(solutions.q - q).max(axis=1).min())


def test_a_pose_or_its_position_on_the_grid_contains_the_configuration() -> None:
    rng = np.random.default_rng(24)
    asked, arms = 0, planar_arms(21, 90 if os.environ.get("ARMCTL_LONG") else 15)
    arms[1:3] = [(ABAAS, ABAAS_LIMITS), (SCORBOT, SCORBOT_LIMITS)]
    for chain, limits in arms:
        ik = solver_of(chain, limits)
        for q in configurations(limits, rng):
            T = chain.forward(q)
            pitch, roll = ik.pitch_and_roll(q)
            targets = [Target.of(T[:3, 3], rotation=T[:3, :3])]
            if pitch is not None:
                asked += 1
                assert math.sin(pitch) == pytest.approx(plain_forward(chain, q)[2, 2], abs=1e-12)
                targets.append(Target.of(T[:3, 3], pitch, roll))
            for target in targets:
                solutions = ik.solve(target, STEP)
                assert_true(solutions, limits)
                assert miss(solutions, q) < 1e-6
                assert target.rotation is None or solutions.residual_rad.min() < 1e-7
                for other in solutions.q if target.pitch is not None else ():
                    assert ik.pitch_and_roll(other)[0] == pytest.approx(pitch, abs=1e-6)
            q[1] = STEP * round(q[1] / STEP)
            if limits[1, 0] <= q[1] <= limits[1, 1]:
                solutions = ik.solve(Target.of(chain.forward(q)[:3, 3], roll=roll), STEP)
                assert_true(solutions, limits)
                turned = np.exp(1j * solutions.q) - np.exp(1j * q)  # a roll of half a turn is one of two
                assert np.abs(turned).max(axis=1).min() < 1e-6
    assert asked > 700 * len(arms) / 93


def test_the_written_out_closed_form_lists_what_the_general_one_lists(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Same postures, same branches, same order; upright and backward tools and the links in line too."""
    rng = np.random.default_rng(95)
    for chain, limits in planar_arms(93, 15):
        quick = solver_of(chain, limits)
        with monkeypatch.context() as patched:
            patched.setattr(solver, "pose_function", lambda *_: None)
            general = solver_of(chain, limits)
        for i in range(20):
            q = random_q(rng, limits)
            if i < 4:
                q[2] = np.clip(0.0, *limits[2])
            pitch, roll = quick.pitch_and_roll(q)
            if pitch is None:
                continue
            pitch = (pitch, pitch, math.pi / 2, -math.pi / 2, math.pi - pitch)[i % 5]
            target = Target.of(chain.forward(q)[:3, 3], pitch, (roll, None)[i % 2])
            one, other = quick.solve(target, STEP), general.solve(target, STEP)
            assert one.branch.tolist() == other.branch.tolist()
            assert one.reason == other.reason
            assert np.abs(one.q - other.q).max(initial=0.0) < 1e-9


def test_a_tip_over_the_base_axis_keeps_its_rotation() -> None:
    """There the position says nothing about the base; the rotation does."""
    ik = solver_of(ABAAS, ABAAS_LIMITS)
    for yaw, roll in ((37.0, 20.0), (-80.0, -60.0), (0.0, 0.0)):
        # 105 c2 + 100 c23 = 0 with the tool level: over the axis but for the tool's own length
        q = np.radians([yaw, 120.0, -60.0, 0.0, roll])
        q[3] = math.pi / 2 + math.acos((0.105 * 0.5 - 0.1 * 0.5) / 0.15) - q[1] - q[2]
        T = ABAAS.forward(q)
        assert np.hypot(*T[:2, 3]) < 1e-12
        assert miss(ik.solve(Target.of(T[:3, 3], rotation=T[:3, :3]), STEP), q) < 1e-6


def test_a_tip_straight_above_the_base_axis_is_solved_whatever_the_base_limits() -> None:
    limits = ABAAS_LIMITS.copy()
    limits[0] = np.radians([30, 60])
    q = np.radians([40, 90, 0, 90, 10.0])  # upright: base and roll turn about the same axis
    T = ABAAS.forward(q)
    ik = solver_of(ABAAS, limits)
    for target in (
        Target.of(T[:3, 3]),
        Target.of(T[:3, 3], pitch=math.pi / 2, roll=0.2),
        Target.of(T[:3, 3], rotation=T[:3, :3]),
    ):
        solutions = ik.solve(target, STEP)
        assert_true(solutions, limits)
        assert solutions.success
        assert solutions.residual_rad.max() < 1e-7


def test_an_arm_folded_onto_its_shoulder_points_where_the_limits_let_it() -> None:
    """Equal links folded up: the shoulder is free, and what the wrist allows decides."""
    limits = np.radians([[-150, 150], [40, 130], [-180, 180], [-10, 10], [-90, 90.0]])
    ik = solver_of(SCORBOT, limits)
    q = np.radians([20, 100, 180, 5, 30.0])
    pitch, roll = ik.pitch_and_roll(q)
    solutions = ik.solve(Target.of(SCORBOT.forward(q)[:3, 3], pitch, roll), STEP)
    assert solutions.success
    assert_true(solutions, limits)


def test_a_pitch_is_met_outward_and_inward() -> None:
    robot = load_robot("uzuner")
    outward = robot.inverse([0.15, 0.0, 0.15], pitch=math.radians(60))
    inward = robot.inverse([0.15, 0.0, 0.15], pitch=math.radians(120))
    assert all(
        robot.inverse_kinematics.pitch_and_roll(q)[0] == pytest.approx(math.radians(60)) for q in outward.q
    )
    for q in inward.q:
        approach = robot.forward(q)[:3, 2]
        assert math.degrees(math.asin(approach[2])) == pytest.approx(60)
        assert approach[0] < 0
    assert len({tuple(q) for q in outward.q.tolist()}) == len(outward)


@pytest.mark.parametrize("off", [0.5, 20.0])
def test_a_rotation_that_cannot_be_gets_the_nearest_that_can(off: float) -> None:
    """Off what five joints can do, also at limits: the position is exact, no grid solution is nearer."""
    robot = load_robot("uzuner")
    rng = np.random.default_rng(25)
    for _ in range(60):
        T = robot.forward(random_q(rng, robot.limits))
        wanted = T[:3, :3] @ rotation_about(rng.normal(size=3), math.radians(off))
        solutions = robot.inverse(T[:3, 3], rotation=wanted)
        assert_true(solutions, robot.limits)
        chords = np.linalg.norm(robot.forward(solutions.q)[:, :3, :3] - wanted, axis=(1, 2))
        best = 2 * math.asin(min(1.0, chords.min() / math.sqrt(8)))
        assert best <= math.radians(off) + 1e-6
        assert best == pytest.approx(solutions.residual_rad.min(), abs=1e-7)
        swept = robot.inverse(T[:3, 3], step=math.radians(0.1)).q.copy()
        for roll in np.linspace(*robot.limits[4], 25):
            swept[:, 4] = roll
            traces = np.einsum("kij,ij->k", robot.forward(swept)[:, :3, :3], wanted)
            assert best <= np.arccos(np.clip((traces - 1) / 2, -1, 1)).min() + 1e-6


def test_a_tool_that_swings_out_of_its_plane_has_no_pitch_but_its_rotation_is_solved() -> None:
    """A fixed bend behind the roll joint: the approach axis turns about the roll axis."""
    bent = [*load_robot("uzuner").chain.rows, DHRow(0.0, math.radians(30), 0.0, joint=False)]
    chain, limits = Chain.from_dh(bent, "modified"), load_robot("uzuner").limits
    ik = solver_of(chain, limits)
    q = np.radians([20, 60, -40, -20, 30.0])
    assert ik.pitch_and_roll(q) == (None, q[4])
    T = chain.forward(q)
    refused = ik.solve(Target.of(T[:3, 3], pitch=0.3), STEP)
    assert "has no pitch" in str(refused.reason)
    assert miss(ik.solve(Target.of(T[:3, 3], rotation=T[:3, :3]), STEP), q) < 1e-6


def two_pitch_arm(roll: bool) -> tuple[InverseKinematics, Chain, FloatArray]:
    """The build of the MICO as a teaching arm: two pitch joints, and a roll along the forearm."""
    chain = Chain.from_dh(
        rows([(0, -90, 275.5), (290, 0, 0), (0, -90, 0), (0, 0, 283.3)], *(() if roll else (3,)))
    )
    limits = np.radians([[-180, 180], [-220, 40], [-230, 50], [-180, 180.0]])[: chain.n]
    return solver_of(chain, limits), chain, limits


@pytest.mark.parametrize("roll", [True, False])
def test_arms_with_two_pitch_joints(roll: bool) -> None:
    ik, chain, limits = two_pitch_arm(roll)
    assert ik.free_joint is None
    assert ik.pitch_joints == (1, 2)
    rng = np.random.default_rng(26)
    for _ in range(100):
        q = random_q(rng, limits)
        T = chain.forward(q)
        asked = float(q[3]) if roll else None
        for target in (
            Target.of(T[:3, 3], roll=asked),
            Target.of(T[:3, 3], pitch=ik.pitch_and_roll(q)[0], roll=asked),
            Target.of(T[:3, 3], rotation=T[:3, :3]),
        ):
            solutions = ik.solve(target, STEP)
            assert_true(solutions, limits)
            assert miss(solutions, q) < 1e-6


def test_two_pitch_joints_refuse_a_pitch_that_the_position_does_not_give() -> None:
    ik, chain, _ = two_pitch_arm(True)
    q = np.radians([10, -60, -40, 0.0])
    solutions = ik.solve(Target.of(chain.forward(q)[:3, 3], pitch=0.1234), STEP)
    assert not solutions.success
    pitch = math.degrees(ik.pitch_and_roll(q)[0] or 0.0)
    assert "that pitch is impossible here" in str(solutions.reason)
    assert f"{pitch:.2f}°" in str(solutions.reason)


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"position_m": [0.2, 0.0]}, "shape"),
        ({"position_m": [0.2, math.nan, 0.1]}, "finite"),
        ({"position_m": [0.2, 0, math.inf]}, "finite"),
        ({"position_m": ["0.2", "0", "0.1"]}, "must be numbers"),
        ({"position_m": None}, "must be numbers"),
        ({"position_m": [200, 0, 100_000]}, r"100000 m from the base, farther than 1000 m; a wrong unit"),
        ({"position_m": [1e308, 1e308, 0]}, "farther than 1000 m"),
        ({"pitch": math.nan}, "pitch must be a finite number"),
        ({"pitch": "0.5"}, "pitch must be numbers"),
        ({"pitch": [0.5]}, "pitch must be one number"),
        ({"roll": math.inf}, "roll must be a finite number"),
        ({"rotation": np.zeros((3, 3))}, "orthonormal"),
        ({"rotation": np.diag([1.0, 1.0, -1.0])}, "right-handed"),
        ({"rotation": np.eye(4)}, "shape"),
        ({"rotation": np.full((3, 3), math.nan)}, "finite"),
        ({"rotation": np.eye(3), "pitch": 0.1}, "not both"),
    ],
)
def test_what_is_no_target_is_refused(asked: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        load_robot("uzuner").inverse(**({"position_m": [0.2, 0.0, 0.1]} | asked))  # type: ignore[arg-type]


def test_a_base_on_its_limits_with_the_tip_as_near_to_the_axis_as_it_comes() -> None:
    """The tool plane passes the axis at 50 mm; straight up the tip is there, give or take a rounding."""
    rng = np.random.default_rng(27)
    for yaw in rng.uniform(0.2, 3.0, 60):
        limits = np.array([[yaw, yaw], [0.0, 3.0], [-2.0, 2.0], [-2.0, 2.0]])
        arm = PlanarArm(0.05, 0.0, 0.1, (0.2, 0.15, 0.1), limits)
        ik = solver_of(chain_of(arm, "standard"), limits)
        q = np.array([yaw, math.pi / 2, 0.0, 0.0])
        T = ik.chain.forward(q)
        for target in (Target.of(T[:3, 3]), Target.of(T[:3, 3], rotation=T[:3, :3])):
            solutions = ik.solve(target, STEP)
            assert solutions.success, solutions.reason
            assert_true(solutions, limits)
        points = np.tile(T[:3, 3], (20, 1))
        assert np.isfinite(ik.least_rotation(points)).all()
