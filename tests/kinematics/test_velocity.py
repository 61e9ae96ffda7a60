"""Velocity kinematics against differences of the plain products, and at singular poses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.kinematics.kit import FloatArray, plain_forward, random_q

from armctl.errors import InputError
from armctl.kinematics.velocity import (
    joint_rates,
    manipulability,
    tool_speeds,
    tool_velocity,
    twist_manipulability,
)
from armctl.robot import Robot, load_robot, shipped_robots

ROBOTS = tuple(load_robot(name) for name in shipped_robots())
UZUNER, SCORBOT, MICO, ABAAS = (load_robot(name) for name in ("uzuner", "scorbot", "mico", "abaas"))
_STEP_S = 1e-6


def moved(robot: Robot, q: FloatArray, rates: FloatArray) -> FloatArray:
    """(6,) velocity of the tool by central differences of the plain 4 x 4 products."""
    ahead, behind = (plain_forward(robot.chain, q + way * _STEP_S * rates) for way in (1, -1))
    D = (ahead - behind) / (2 * _STEP_S)
    spin = D[:3, :3] @ plain_forward(robot.chain, q)[:3, :3].T
    return np.array([*D[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]])


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_tool_velocity_is_what_differences_say(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    q = random_q(rng, robot.limits, 20)
    rates = rng.uniform(-1, 1, q.shape)
    velocity = tool_velocity(robot.jacobian(q), rates)
    for one, at, turning in zip(velocity, q, rates, strict=True):
        np.testing.assert_allclose(one, moved(robot, at, turning), atol=1e-8)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_joint_rates_move_the_tool_as_asked(robot: Robot) -> None:
    rng = np.random.default_rng(2)
    q = random_q(rng, robot.limits, 60)
    J = robot.jacobian(q)
    q, J = q[manipulability(J).condition < 30], J[manipulability(J).condition < 30]
    wanted = rng.uniform(-0.01, 0.01, (len(q), 3))
    found = joint_rates(J, wanted, None, np.full(robot.n, 1e3))
    assert len(q) > 10
    assert found.missed_linear.max() < 1e-12 and (found.scale == 1.0).all()
    for at, turning, asked in zip(q, found.rates, wanted, strict=True):
        np.testing.assert_allclose(moved(robot, at, turning)[:3], asked, atol=1e-9)


def test_rates_are_the_least_of_all_that_serve() -> None:
    J = UZUNER.jacobian(UZUNER.pose("home"))
    found = joint_rates(J, [0.02, -0.01, 0.03], None, UZUNER.speed_limits)
    free = np.linalg.svd(J[:3])[2][3:]
    np.testing.assert_allclose(free @ found.rates, 0.0, atol=1e-12)  # nothing in what moves no tool point


def test_what_the_arm_can_do_comes_back() -> None:
    """Rates → velocity → rates: with as many joints as independent motions there is only one way."""
    rates = np.array([0.1, -0.2, 0.05, 0.1, -0.3])
    J = SCORBOT.jacobian(SCORBOT.pose("home"))
    velocity = tool_velocity(J, rates)
    found = joint_rates(J, velocity[:3], velocity[3:], np.full(5, 1e3))
    np.testing.assert_allclose(found.rates, rates, atol=1e-12)
    assert found.missed_linear < 1e-12 and found.missed_angular < 1e-12


def test_the_tool_point_comes_before_the_orientation() -> None:
    J = SCORBOT.jacobian(SCORBOT.pose("home"))
    found = joint_rates(J, [0.0, 0.05, 0.0], [0.0, 0.0, 0.0], np.full(5, 1e3))
    np.testing.assert_allclose(found.velocity[:3], [0.0, 0.05, 0.0], atol=1e-12)
    assert found.missed_angular > 0.05  # sideways five joints cannot keep the orientation
    # and no other rates with the same tool point turn it less
    free = np.linalg.svd(J[:3])[2][3:]
    for k in range(len(free)):
        for way in (1e-3, -1e-3):
            other = found.rates + way * free[k]
            assert np.linalg.norm(J[3:] @ other) >= found.missed_angular - 1e-12


def test_speed_limits_scale_and_keep_the_direction() -> None:
    J = SCORBOT.jacobian(SCORBOT.pose("home"))
    slow, fast = (joint_rates(J, [0.0, way, 0.0], None, SCORBOT.speed_limits) for way in (0.01, 5.0))
    assert slow.scale == 1.0
    assert 0.0 < fast.scale < 0.1
    assert (np.abs(fast.rates) / SCORBOT.speed_limits).max() == pytest.approx(1.0)
    np.testing.assert_allclose(fast.velocity[:3], [0.0, 5.0 * fast.scale, 0.0], atol=1e-12)
    assert fast.missed_linear < 1e-12


def test_a_joint_that_cannot_turn_is_left_out() -> None:
    J = UZUNER.jacobian(UZUNER.pose("home"))
    limits = UZUNER.speed_limits * [1, 1, 0, 1, 1]
    found = joint_rates(J, [0.01, 0.0, 0.02], None, limits)
    assert found.rates[2] == 0.0
    np.testing.assert_allclose((J @ found.rates)[:3], [0.01, 0.0, 0.02], atol=1e-12)


def test_a_straight_arm_cannot_go_on_outwards() -> None:
    q = np.zeros(5)  # uzuner: stretched along x
    J = UZUNER.jacobian(q)
    figure = manipulability(J)
    assert figure.measure == pytest.approx(0.0, abs=1e-15)
    assert figure.smallest == pytest.approx(0.0, abs=1e-15) and figure.condition == np.inf
    # the tip passes the base axis 3.62 mm aside: lost is the direction from the shoulder axis to the tip
    np.testing.assert_allclose(np.abs(figure.weakest), [1.0, 0.0, 0.0], atol=0.02)
    for rates in np.eye(5):
        assert abs(figure.weakest @ moved(UZUNER, q, rates)[:3]) < 1e-9
    outward = joint_rates(J, 0.05 * figure.weakest, None, UZUNER.speed_limits)
    assert outward.missed_linear == pytest.approx(0.05)
    np.testing.assert_allclose(outward.rates, 0.0, atol=1e-9)


def test_a_tip_above_the_base_axis_cannot_go_sideways() -> None:
    q = MICO.inverse([0.0, 0.0, 0.7]).q[0]
    figure = manipulability(MICO.jacobian(q))
    sideways = np.array([-math.sin(q[0]), math.cos(q[0]), 0.0])
    assert figure.smallest == pytest.approx(0.0, abs=1e-12)
    assert abs(figure.weakest @ sideways) == pytest.approx(1.0)
    found = joint_rates(MICO.jacobian(q), 0.1 * sideways + [0, 0, 0.01], None, MICO.speed_limits)
    assert found.missed_linear == pytest.approx(0.1)
    assert found.velocity[2] == pytest.approx(0.01)


def test_damping_bounds_the_rates_on_the_way_into_a_singularity() -> None:
    """Undamped, the rates grow without end; damped, they stay bounded, change steadily, and fade."""
    bends = np.radians(np.geomspace(20.0, 1e-7, 400))
    q = np.zeros((len(bends), 5))
    q[:, 1], q[:, 2], q[:, 3] = 0.4, -bends, bends / 2
    J = UZUNER.jacobian(q)
    figure = manipulability(J)
    # the speed that the outward direction is asked at, whichever sign the decomposition gives it
    found = joint_rates(J, 0.05 * figure.weakest, None, np.full(5, 1e9))
    sizes = np.linalg.norm(found.rates, axis=1)
    limit = 0.05 / (0.02 * figure.singular_values[:, 0])
    assert (sizes <= limit + 1e-9).all()
    assert (np.abs(np.diff(sizes)) < 0.2 * limit[0]).all()
    assert sizes[-1] < 1e-3 and found.missed_linear[-1] == pytest.approx(0.05)
    assert found.missed_linear[0] < 1e-12
    assert (np.diff(found.missed_linear) >= -1e-12).all()


def test_the_smallest_singular_value_is_the_distance_to_a_singular_jacobian() -> None:
    J = UZUNER.jacobian(UZUNER.pose("home"))
    figure = manipulability(J)
    np.testing.assert_allclose(figure.measure, np.sqrt(np.linalg.det(J[:3] @ J[:3].T)), rtol=1e-12)
    rows = J.copy()
    rows[:3] -= np.outer(figure.weakest, figure.weakest @ J[:3])
    assert np.linalg.norm(rows - J) == pytest.approx(float(figure.smallest))
    assert np.linalg.matrix_rank(rows[:3], tol=1e-12) == 2
    assert figure.condition == pytest.approx(np.linalg.cond(J[:3]))


def test_many_poses_at_once_are_the_same_as_one_by_one() -> None:
    rng = np.random.default_rng(5)
    q = random_q(rng, UZUNER.limits, 4, 3)
    J = UZUNER.jacobian(q)
    linear, angular = rng.normal(size=(4, 3, 3)), rng.normal(size=(4, 3, 3))
    found = joint_rates(J, linear, angular, UZUNER.speed_limits)
    figure = manipulability(J)
    assert figure.measure.shape == figure.condition.shape == (4, 3) and figure.weakest.shape == (4, 3, 3)
    for i in np.ndindex(4, 3):
        one = joint_rates(J[i], linear[i], angular[i], UZUNER.speed_limits)
        np.testing.assert_allclose(found.rates[i], one.rates, atol=1e-12)
        np.testing.assert_allclose(found.missed_angular[i], one.missed_angular, atol=1e-12)
        np.testing.assert_allclose(figure.smallest[i], manipulability(J[i]).smallest, atol=1e-15)


def test_tool_speed_of_each_joint_alone() -> None:
    """The abaas arm's base at 60 °/s: its tip runs on a circle about the base axis."""
    q = ABAAS.pose("home")
    x, y, _ = ABAAS.forward(q)[:3, 3]
    speeds = tool_speeds(ABAAS.jacobian(q), ABAAS.speed_limits)
    assert speeds[0] == pytest.approx(math.radians(60) * math.hypot(x, y))
    assert speeds[4] == pytest.approx(0.0, abs=1e-15)  # the roll joint's axis passes through the tip
    for j, limit in enumerate(ABAAS.speed_limits):
        assert speeds[j] == pytest.approx(np.linalg.norm(moved(ABAAS, q, limit * np.eye(5)[j])[:3]), abs=1e-9)


def test_fewer_than_six_joints_still_have_a_measure_of_all_rows() -> None:
    J = SCORBOT.jacobian(SCORBOT.pose("home"))
    assert twist_manipulability(J) == pytest.approx(math.sqrt(np.linalg.det(J.T @ J)))
    assert np.linalg.det(J @ J.T) == pytest.approx(0.0, abs=1e-12)
    diagonal = np.diag([1.0, 1, 1, 2, 2, 2])
    assert twist_manipulability(diagonal) == pytest.approx(8.0)
    assert twist_manipulability(diagonal, length_m=0.5) == pytest.approx(64.0)


def test_two_joints_leave_a_direction_without_motion() -> None:
    figure = manipulability(UZUNER.jacobian(UZUNER.pose("home"))[:, :2])
    assert figure.measure == 0.0 and figure.condition == np.inf
    assert manipulability(np.zeros((6, 3))).condition == np.inf


@pytest.mark.parametrize(
    ("jacobian", "linear", "angular", "limits", "says"),
    [
        (np.zeros((3, 5)), [0, 0, 0], None, np.ones(5), r"shape \(\.\.\., 6, n\)"),
        (np.full((6, 5), np.nan), [0, 0, 0], None, np.ones(5), "finite"),
        (np.zeros((6, 5)), [0, 0], None, np.ones(5), "velocity of the tool point must be 3 numbers"),
        (np.zeros((6, 5)), [0, 0, 0], [0.0], np.ones(5), "angular velocity must be 3 numbers"),
        (np.zeros((6, 5)), [0, 0, np.inf], None, np.ones(5), "finite"),
        (np.zeros((6, 5)), [0, 0, 0], None, np.ones(4), "speed limits must be 5 numbers"),
        (np.zeros((6, 5)), [0, 0, 0], None, -np.ones(5), "not negative"),
    ],
)
def test_bad_input_is_refused(
    jacobian: FloatArray, linear: list[float], angular: list[float] | None, limits: FloatArray, says: str
) -> None:
    with pytest.raises(InputError, match=says):
        joint_rates(jacobian, linear, angular, limits)
