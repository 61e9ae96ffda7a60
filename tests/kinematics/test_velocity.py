"""Velocity kinematics against differences of the plain products, and at singular poses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.arms import FIVE
from tests.kinematics.kit import chain_of, plain_jacobian, random_planar_arm, random_q

from armctl.errors import InputError
from armctl.kinematics import Chain, DHRow
from armctl.kinematics.velocity import (
    NEAR,
    joint_rates,
    manipulability,
    pose_freedom,
    position_freedom,
    position_leaves_pitch,
    speeds_alone,
    tool_velocity,
    turning_speeds,
)
from armctl.robot import Robot, load_robot

ROBOTS = tuple(load_robot(name) for name in FIVE)
UZUNER, SCORBOT, MICO, ABAAS, HUMANOID = (
    load_robot(name) for name in ("uzuner", "scorbot", "mico", "abaas", "humanoid")
)
_UNLIMITED = np.full(5, 1e3)


def test_what_five_joints_cannot_do_is_told() -> None:
    """Sideways without turning: the residual is what is missed, and no other rates miss less."""
    J = SCORBOT.jacobian(SCORBOT.pose("home"))
    wanted = np.array([0.0, 0.05, 0.0, 0.0, 0.0, 0.0])
    found = joint_rates(J, _UNLIMITED, wanted[:3], wanted[3:])
    np.testing.assert_allclose(found.residual, wanted - J @ found.rates, atol=1e-15)
    weights = np.repeat([1.0, np.linalg.norm(J[:3], axis=0).max()], 3)
    least = np.linalg.norm(weights * found.residual)
    assert least > 1e-3
    for k in range(5):
        for way in (1e-4, -1e-4):
            other = found.rates + way * np.eye(5)[k]
            assert np.linalg.norm(weights * (wanted - J @ other)) >= least - 1e-12


def test_speed_limits_scale_and_keep_the_direction() -> None:
    J = SCORBOT.jacobian(SCORBOT.pose("home"))
    slow, fast = (joint_rates(J, SCORBOT.speed_limits, [0.0, way, 0.0]) for way in (0.01, 5.0))
    assert slow.scale == 1.0
    assert 0.0 < fast.scale < 0.1 and fast.limiting == 0
    assert (np.abs(fast.rates) / SCORBOT.speed_limits).max() == pytest.approx(1.0)
    np.testing.assert_allclose((J @ fast.rates)[:3], [0.0, 5.0 * fast.scale, 0.0], atol=1e-12)
    np.testing.assert_allclose(fast.residual, 0.0, atol=1e-12)


def test_a_joint_that_cannot_turn_is_left_out() -> None:
    J = UZUNER.jacobian(UZUNER.pose("home"))
    found = joint_rates(J, UZUNER.speed_limits * [1, 1, 0, 1, 1], [0.01, 0.0, 0.02])
    assert found.rates[2] == 0.0
    np.testing.assert_allclose((J @ found.rates)[:3], [0.01, 0.0, 0.02], atol=1e-12)
    speeds = turning_speeds(HUMANOID.limits, HUMANOID.speed_limits)
    assert speeds[4] == 0.0 and (speeds[:4] == HUMANOID.speed_limits[:4]).all()
    assert (joint_rates(np.zeros((6, 5)), np.zeros(5), [0.1, 0, 0]).rates == 0.0).all()


def test_a_straight_arm_cannot_go_on_outwards() -> None:
    q = np.zeros(5)  # uzuner: stretched along x
    J = UZUNER.jacobian(q)
    freedom = position_freedom(J)
    assert freedom.verdict == "singular"
    assert freedom.measure == pytest.approx(0.0, abs=1e-15)
    assert freedom.smallest == pytest.approx(0.0, abs=1e-15) and freedom.condition > 1e12
    np.testing.assert_allclose(np.abs(freedom.hardest), [1.0, 0.0, 0.0], atol=0.02)
    assert np.abs(freedom.hardest @ plain_jacobian(UZUNER.chain, q)[:3]).max() < 1e-9
    outward = joint_rates(J, UZUNER.speed_limits, 0.05 * freedom.hardest)
    np.testing.assert_allclose(outward.residual, 0.05 * freedom.hardest, atol=1e-12)
    np.testing.assert_allclose(outward.rates, 0.0, atol=1e-9)


def test_a_tip_above_the_base_axis_cannot_go_sideways() -> None:
    q = MICO.inverse([0.0, 0.0, 0.7]).q[0]
    J = MICO.jacobian(q)
    freedom = position_freedom(J)
    sideways = np.array([-math.sin(q[0]), math.cos(q[0]), 0.0])
    assert freedom.smallest == pytest.approx(0.0, abs=1e-12)
    assert abs(freedom.hardest @ sideways) == pytest.approx(1.0)
    found = joint_rates(J, MICO.speed_limits, 0.1 * sideways + [0, 0, 0.01])
    np.testing.assert_allclose(found.residual, 0.1 * sideways, atol=1e-12)
    assert (J @ found.rates)[2] == pytest.approx(0.01)


def test_damping_bounds_the_rates_on_the_way_into_a_singularity() -> None:
    """Undamped, the rates grow without end; damped, they stay bounded, change steadily, and fade."""
    sizes: list[float] = []
    missed: list[float] = []
    for bend in np.radians(np.geomspace(40.0, 1e-7, 400)):
        J = UZUNER.jacobian(np.array([0.0, 0.4, -bend, bend / 2, 0.0]))
        freedom = position_freedom(J)
        found = joint_rates(J, np.full(5, 1e9), 0.05 * freedom.hardest)
        sizes.append(float(np.linalg.norm(found.rates)))
        missed.append(float(np.linalg.norm(found.residual)))
        assert sizes[-1] <= 0.05 / (NEAR * freedom.singular_values[0]) * (1 + 1e-9)
    assert np.abs(np.diff(sizes)).max() < 0.1 * max(sizes)
    assert sizes[-1] < 1e-3 and missed[-1] == pytest.approx(0.05)
    assert missed[0] < 1e-12 and (np.diff(missed) >= -1e-12).all()


def test_the_smallest_singular_value_is_the_distance_to_a_singular_jacobian() -> None:
    J = UZUNER.jacobian(UZUNER.pose("home"))
    freedom = position_freedom(J)
    np.testing.assert_allclose(freedom.measure, np.sqrt(np.linalg.det(J[:3] @ J[:3].T)), rtol=1e-12)
    assert freedom.verdict == "well away from singularities"
    nearest = J[:3] - np.outer(freedom.hardest, freedom.hardest @ J[:3])
    assert np.linalg.norm(nearest - J[:3]) == pytest.approx(freedom.smallest)
    assert np.linalg.matrix_rank(nearest, tol=1e-12) == 2
    assert freedom.condition == pytest.approx(np.linalg.cond(J[:3]))


def test_tool_speed_of_each_joint_alone() -> None:
    """The abaas arm's base at 60 °/s: its tip runs on a circle about the base axis."""
    q = ABAAS.pose("home")
    x, y, _ = ABAAS.forward(q)[:3, 3]
    speeds = speeds_alone(ABAAS.jacobian(q), ABAAS.speed_limits)
    assert speeds[0] == pytest.approx(math.radians(60) * math.hypot(x, y))
    assert speeds[4] == pytest.approx(0.0, abs=1e-15)  # the roll joint's axis passes through the tip
    plain = np.linalg.norm(plain_jacobian(ABAAS.chain, q)[:3], axis=0) * ABAAS.speed_limits
    assert speeds == pytest.approx(plain, abs=1e-9)


def test_fewer_than_six_joints_still_have_a_measure_of_all_rows() -> None:
    many = UZUNER.jacobian(random_q(np.random.default_rng(5), UZUNER.limits, 4, 3))[..., :3, :]
    plain = np.sqrt(np.linalg.det(many @ np.swapaxes(many, -1, -2)))
    np.testing.assert_allclose(manipulability(many), plain, atol=1e-12)
    J = SCORBOT.jacobian(SCORBOT.pose("home"))
    assert manipulability(J) == pytest.approx(math.sqrt(np.linalg.det(J.T @ J)))
    assert np.linalg.det(J @ J.T) == pytest.approx(0.0, abs=1e-12)
    assert manipulability(np.diag([1.0, 1, 1, 2, 2, 2])) == pytest.approx(8.0)
    six = pose_freedom(np.diag([1.0, 1, 1, 2, 2, 2]))
    assert six.measure == pytest.approx(8.0) and six.isotropy == pytest.approx(0.5)


def test_two_joints_leave_a_direction_without_motion() -> None:
    freedom = position_freedom(UZUNER.jacobian(UZUNER.pose("home"))[:, :2])
    assert freedom.measure == 0.0 and freedom.verdict == "singular"
    assert position_freedom(np.zeros((6, 3))).condition == np.inf


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_with_two_pitch_joints_the_position_decides_the_pitch(robot: Robot) -> None:
    assert position_leaves_pitch(robot.chain, robot.limits) == (robot.name != "mico")
    limits = robot.limits.copy()
    limits[3] = -1.0  # a held wrist leaves two
    assert not position_leaves_pitch(robot.chain, limits)


@pytest.mark.parametrize(
    ("linear", "angular", "says"),
    [
        ([0, 0], None, "linear velocity must have the shape"),
        ([0, 0, 0], [0.0], "angular velocity must have the shape"),
        ([0, 0, np.inf], None, "finite"),
        ([0, 0, "fast"], None, "numbers"),
    ],
)
def test_bad_input_is_refused(linear: list[float], angular: list[float] | None, says: str) -> None:
    with pytest.raises(InputError, match=says):
        joint_rates(np.zeros((6, 5)), np.ones(5), linear, angular)
    with pytest.raises(InputError, match="joint rates must have the shape"):
        tool_velocity(np.zeros((6, 5)), [0.0])


@pytest.mark.parametrize("seed", range(20))
def test_velocities_of_random_arms_come_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arm = random_planar_arm(rng)
    chain = chain_of(arm, str(rng.choice(["standard", "modified"])), roll=True, rng=rng)
    tried = 0
    for q in random_q(rng, np.vstack([arm.limits, [-1.0, 1.0]]), 30):
        J = chain.jacobian(q)
        if position_freedom(J).isotropy < 1.01 * NEAR:
            continue
        wanted = rng.uniform(-0.1, 0.1, 3)
        found = joint_rates(J, _UNLIMITED, wanted)
        assert found.scale == 1.0 and found.limiting is None
        np.testing.assert_allclose(found.residual, 0.0, atol=1e-12)
        np.testing.assert_allclose((plain_jacobian(chain, q) @ found.rates)[:3], wanted, atol=1e-7)
        np.testing.assert_allclose(found.rates, np.linalg.lstsq(J[:3], wanted, rcond=None)[0], atol=1e-9)
        tried += 1
    assert tried > 5


def six_axes() -> Chain:
    """Base, two parallel joints, and a wrist of three axes that meet."""
    turn = math.pi / 2
    rows = ((0.0, turn, 0.4), (0.3, 0.0, 0.0), (0.05, turn, 0.0), (0.0, -turn, 0.3), (0.0, turn, 0.0))
    return Chain.from_dh([*(DHRow(a, alpha, d) for a, alpha, d in rows), DHRow(0.0, 0.0, 0.1)])


def test_six_joints_give_every_velocity_of_the_tool() -> None:
    chain, q = six_axes(), np.array([0.3, 0.8, -1.1, 0.4, 0.9, -0.2])
    J = chain.jacobian(q)
    assert pose_freedom(J).verdict == "well away from singularities"
    assert pose_freedom(J).measure == pytest.approx(abs(np.linalg.det(J)))
    wanted = np.array([0.1, -0.05, 0.2, 0.3, -0.1, 0.15])
    found = joint_rates(J, np.full(6, 1e3), wanted[:3], wanted[3:])
    np.testing.assert_allclose(plain_jacobian(chain, q) @ found.rates, wanted, atol=1e-8)
    back = tool_velocity(J, found.rates)
    np.testing.assert_allclose([*back.linear, *back.angular], wanted, atol=1e-12)
    assert position_leaves_pitch(chain, np.tile([-2.0, 2.0], (6, 1)))


def test_a_wrist_in_line_is_seen_by_all_rows_only() -> None:
    J = six_axes().jacobian(np.array([0.3, 0.8, -1.1, 0.4, 0.0, -0.2]))
    assert position_freedom(J).verdict == "well away from singularities"
    assert pose_freedom(J).verdict == "singular"
    assert pose_freedom(J).measure == pytest.approx(0.0, abs=1e-12)
