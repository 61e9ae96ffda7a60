from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.runtime.kit import ROBOT

from armctl.kinematics.chain import LinkFrames
from armctl.motion import Floor
from armctl.motion.clearance import SelfCollision
from armctl.robot import load_robot
from armctl.robot.parts import Obstacle
from armctl.runtime.joint_servo import KeepClear

HOME = ROBOT.pose("home")
CLEAR = KeepClear(ROBOT)


def test_a_way_through_the_air_is_clear() -> None:
    assert CLEAR.blocked(CLEAR.line(HOME, HOME + np.radians([40, 5, 5, 5, 20]))) is None


def test_the_first_row_below_the_floor_is_named() -> None:
    way = CLEAR.line(HOME, np.radians([0, 0, -80, -40, 0]))
    found = CLEAR.blocked(way)
    assert found is not None
    row, why = found
    assert why == "the floor is in the way"
    floor = Floor(ROBOT)
    assert floor.clearance(way[:row]).min() >= -1e-9
    assert floor.clearance(way[row]).min() < 0


def test_what_is_below_the_floor_may_come_up_but_not_sink_deeper() -> None:
    low = np.radians([-22, 0, -70, -47, -8])
    assert Floor(ROBOT).clearance(low).min() < 0
    assert CLEAR.blocked(CLEAR.line(low, low + np.radians([0, 20, 0, 0, 0]))) is None
    assert CLEAR.blocked(CLEAR.line(low, low - np.radians([0, 2, 0, 0, 0]))) == (1, "the floor is in the way")


def test_an_obstacle_is_in_the_way() -> None:
    wall = Obstacle("wall", np.array([0.0, 0.12, 0.0]), np.array([0.4, 0.2, 0.5]))
    robot = replace(ROBOT, obstacles=(wall,))
    clear = KeepClear(robot)
    found = clear.blocked(clear.line(HOME, HOME + np.radians([90, 0, 0, 0, 0])))
    assert found is not None
    assert found[1].startswith("an obstacle is in the way of ")


@pytest.mark.parametrize("seed", range(3))
def test_no_height_changes_by_more_than_5_mm_between_two_looks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, end = (rng.uniform(ROBOT.limits[:, 0], ROBOT.limits[:, 1]) for _ in range(2))
    way = CLEAR.line(start, end)
    assert np.array_equal(way[0], start)
    assert way[-1] == pytest.approx(end)
    assert np.abs(np.diff(Floor(ROBOT).clearance(way), axis=0)).max() <= 5e-3


def test_the_arm_may_not_run_into_itself() -> None:
    robot = load_robot("mico")
    clear, body = KeepClear(robot), SelfCollision(robot)
    way = clear.line(robot.pose("home"), np.radians([-18, 29, 37, 107]))
    found = clear.blocked(way)
    assert found is not None
    row, why = found
    assert why == "the arm itself is in the way of the gripper"
    assert body.gaps(LinkFrames.at(robot.chain, way[:row])).min() >= -1e-9
    assert body.gaps(LinkFrames.at(robot.chain, way[row : row + 1])).min() < 0
