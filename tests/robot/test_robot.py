"""The robot: limits, poses, servo map."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from armctl import Robot, load_robot, shipped_robots
from armctl.errors import InputError, MotionRefusedError


def test_limits_are_kept_and_named() -> None:
    robot = load_robot("uzuner")
    inside = robot.limits.mean(axis=1)
    assert robot.check_limits(inside).tolist() == inside.tolist()
    grazing = robot.limits[:, 1] + 5e-10
    assert robot.check_limits(grazing).tolist() == robot.limits[:, 1].tolist()
    with pytest.raises(
        MotionRefusedError, match=r"Elbow: -91\.20° is outside -84\.36° … 95\.07°; Wrist roll: 50"
    ):
        robot.check_limits(np.radians([0, 0, -91.2, 0, 50]))
    with pytest.raises(InputError, match="finite"):
        robot.check_limits([0, 0, 0, 0, math.nan])


def test_pulses_there_and_back() -> None:
    robot = load_robot("uzuner")
    servos = robot.output_map
    assert servos is not None
    for q in (robot.limits[:, 0], robot.limits[:, 1], robot.pose("home")):
        pulses = servos.outputs(q)
        assert servos.angles(pulses) == pytest.approx(q, abs=1e-12)
        for k, channel in enumerate(servos.channels):
            assert servos.low[k] - 0.125 <= pulses[channel] <= servos.high[k] + 0.125
    assert servos.outputs(robot.pose("zero"))[0] == pytest.approx(1479.93)
    assert servos.outputs(np.radians([1, 0, 0, 0, 0]))[0] == pytest.approx(1479.93 + 9)
    assert np.isnan(servos.angles({0: None, 1: 1500.0})).tolist() == [True, False, True, True, True]


def test_the_gripper_there_and_back() -> None:
    servos = load_robot("uzuner").output_map
    assert servos is not None
    for opening in (0.0, 0.25, 1.0):
        assert servos.opening(servos.gripper_output(opening)) == pytest.approx(opening)
    assert servos.gripper_output(1.0) == {5: 2000.0}
    assert servos.opening({5: None}) is None
    assert servos.opening({}) is None


def test_the_solver_is_made_once() -> None:
    robot = load_robot("uzuner")
    assert robot.inverse_kinematics is robot.inverse_kinematics
    assert robot.inverse_kinematics.family.startswith("yaw")


def test_one_configuration_is_needed_where_one_is_asked_for() -> None:
    robot = load_robot("uzuner")
    several = np.zeros((2, 5))
    solutions = robot.inverse([0.2, 0.0, 0.1])
    for ask in (robot.check_limits, solutions.index_of, solutions.branch_of):
        with pytest.raises(InputError, match=r"5 joint angles are needed, got an array of shape \(2, 5\)"):
            ask(several)


def test_least_rotation_says_what_is_wrong_with_a_point() -> None:
    robot = load_robot("uzuner")
    for wrong in (None, "0.2", ["a", "b", "c"], [[1, 2], [1, 2, 3]], [True, False, True]):
        with pytest.raises(InputError, match="the target position must be numbers"):
            robot.least_rotation(wrong)  # type: ignore[arg-type]
    for wrong in ([], [0.2, 0.1], 0.2, np.zeros((2, 2, 3))):
        with pytest.raises(InputError, match="shape"):
            robot.least_rotation(wrong)


def test_what_a_robot_hands_out_is_read_only() -> None:
    robot = load_robot("mico")
    robot.pose("home")[0] = 1.0  # a copy
    assert robot.pose("home")[0] == 0.0
    with pytest.raises(InputError, match="mico has no pose 'bed'; it has home, "):
        robot.pose("bed")
    arrays = (
        robot.limits, robot.speed_limits, robot.acceleration_limits, robot.jerk_limits,
        *robot.poses.values(), *robot.points.values(), *robot.chain.segments, robot.chain.tail,
    )  # fmt: skip
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0
    with pytest.raises(TypeError, match="item assignment"):
        robot.poses["home"] = np.zeros(robot.n)  # type: ignore[index]


COPIES: dict[str, Callable[[Robot], Robot]] = {
    "pickle": lambda robot: pickle.loads(pickle.dumps(robot)),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
}


@pytest.mark.parametrize("copied", COPIES.values(), ids=COPIES)
@pytest.mark.parametrize("name", shipped_robots())
def test_a_robot_is_pickled_copied_and_compared(name: str, copied: Callable[[Robot], Robot]) -> None:
    robot = load_robot(name)
    assert robot.inverse([0.2, 0.0, 0.1]).q.shape[1] == robot.n  # what it has worked out does not travel
    other, middle = copied(robot), robot.limits.mean(axis=1)
    assert (other, hash(other)) == (robot, hash(robot)) == (load_robot(name), hash(load_robot(name)))
    assert (other.chain, hash(other.chain)) == (robot.chain, hash(robot.chain))
    assert (other.gravity, other.energy) == (robot.gravity, robot.energy)
    assert np.array_equal(other.forward(middle), robot.forward(middle))
    assert {*robot.poses} == {*other.poses}
    assert {robot: 1}[other] == 1
    for array in (other.limits, other.jerk_limits, other.poses["home"], *other.chain.segments):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    with pytest.raises(TypeError):
        other.poses["home"] = middle  # pyright: ignore[reportIndexIssue]


def test_robots_that_say_something_else_are_not_equal() -> None:
    robot = load_robot("uzuner")
    servos = robot.output_map
    assert servos is not None
    assert replace(robot, output_map=replace(servos, zero=servos.zero + 0.25)) != robot
    assert replace(robot, poses={**robot.poses, "home": robot.pose("rest")}) != robot
    assert replace(robot, output_map=replace(servos)) == robot
    assert robot not in ("uzuner", load_robot("abaas"), None)
    assert robot.chain != load_robot("abaas").chain != "uzuner"
