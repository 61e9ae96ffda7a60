from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples
from tests.runtime.kit import ROBOT, TICK
from tests.sticks import of_sticks

from armctl.kinematics.frames import LinkFrames
from armctl.motion import Floor
from armctl.motion.clearance import SelfCollision
from armctl.robot.parts import Obstacle
from armctl.runtime.joint_servo import JointServo, KeepClear

LOW, HIGH = ROBOT.limits[:, 0], ROBOT.limits[:, 1]
ANY = np.zeros(ROBOT.n)
A, V = ROBOT.acceleration_limits, ROBOT.speed_limits
POSES = st.lists(st.floats(0, 1), min_size=ROBOT.n, max_size=ROBOT.n).map(
    lambda s: LOW + np.array(s) * (HIGH - LOW)
)
TICKS = st.lists(st.sampled_from([0.0005, 0.006, 0.013, 0.02, 0.021, 0.035, 0.04]), min_size=1, max_size=40)


def taken(servo: JointServo, goal: np.ndarray, dt: float, speed: float = 1.0) -> None:
    """One step, with everything that must hold of it."""
    q, v = servo.toward(goal, speed, dt)
    assert (np.abs(v - servo.v) <= A * dt * (1 + 1e-9) + 1e-12).all()
    assert (np.abs(v) <= np.maximum(V, np.abs(servo.v)) * (1 + 1e-9)).all()
    assert (np.abs(q - servo.q) <= V * dt * (1 + 1e-9) + 1e-12).all()
    assert (q >= LOW).all()
    assert (q <= HIGH).all()
    assert (v * v <= 2 * A * np.where(v > 0, HIGH - q, q - LOW) * (1 + 1e-6) + 1e-9).all()  # can still brake
    servo.take(q, v)


def until_there(servo: JointServo, goal: np.ndarray, ticks: Iterator[float], side: np.ndarray = ANY) -> float:
    """Seconds until all joints rest exactly at their goal, which is not passed on the side it lies on."""
    total = 0.0
    while not (servo.standing and np.array_equal(servo.q, goal)):
        dt = next(ticks)
        taken(servo, goal, dt)
        assert (side * (servo.q - goal) <= 1e-12).all()
        total += dt
        assert total < 30, (servo.q - goal, servo.v)
    return total


def ever(ticks: list[float]) -> Iterator[float]:
    while True:
        yield from ticks


def least_time(way: np.ndarray) -> float:
    """What the slowest joint needs from rest to rest, whatever the ticks."""
    peak = np.minimum(V, np.sqrt(A * way))
    return float((way / np.maximum(peak, 1e-12) + peak / A).max())


@given(POSES, POSES, TICKS)
@settings(max_examples=30 if os.environ.get("ARMCTL_LONG") else 10)
def test_a_goal_that_rests_is_met_exactly_soon_and_never_overshot(
    start: np.ndarray, goal: np.ndarray, ticks: list[float]
) -> None:
    servo = JointServo(ROBOT, start)
    side = np.where(goal < start, -1.0, 1.0)
    total = until_there(servo, goal, ever(ticks), side)
    assert total <= least_time(np.abs(goal - start)) + 8 * max(ticks)


@given(st.lists(st.tuples(POSES, st.floats(0.05, 1.0), TICKS), min_size=1, max_size=8))
@settings(max_examples=examples(60))
def test_a_goal_that_jumps_about_breaks_no_limit_and_the_last_one_is_met(
    script: list[tuple[np.ndarray, float, list[float]]],
) -> None:
    servo = JointServo(ROBOT, ROBOT.pose("home"))
    for goal, speed, ticks in script:
        for dt in ticks:
            taken(servo, goal, dt, speed)
    until_there(servo, script[-1][0], ever([TICK]))


def test_the_joints_arrive_together_and_the_way_is_straight_in_between() -> None:
    start, goal = ROBOT.pose("home"), ROBOT.pose("home") + np.radians([60, -10, 20, 5, 30])
    servo = JointServo(ROBOT, start)
    arrived = np.zeros(5)
    for tick in range(100):
        arrived = np.where((arrived == 0) & (np.abs(servo.q - goal) < 1e-6), tick, arrived)
        taken(servo, goal, TICK)
    assert np.ptp(arrived) <= 8
    share = []
    servo = JointServo(ROBOT, start)
    while not servo.standing or not share:
        taken(servo, goal, TICK)
        share.append(np.ptp((servo.q - start) / (goal - start)))
    assert max(share) < 0.06


def test_a_goal_behind_a_moving_joint_is_overshot_no_more_than_it_must() -> None:
    servo = JointServo(ROBOT, ROBOT.pose("home"))
    for _ in range(40):
        taken(servo, ROBOT.pose("home") + np.radians([90, 0, 0, 0, 0]), TICK)
    here, speed = servo.q[0], servo.v[0]
    assert speed == pytest.approx(V[0])
    goal = ROBOT.pose("home")
    goal[0] = here + np.radians(1)
    farthest = here
    while not (servo.standing and np.array_equal(servo.q, goal)):
        taken(servo, goal, TICK)
        farthest = max(farthest, servo.q[0])
    assert farthest == pytest.approx(here + 0.5 * speed**2 / A[0], abs=np.radians(0.2))


def test_a_goal_outside_the_limits_ends_at_the_limit() -> None:
    servo = JointServo(ROBOT, ROBOT.pose("home"))
    goal = ROBOT.pose("home")
    goal[2] = -3.0
    for _ in range(100):
        taken(servo, goal, TICK)
    assert servo.q[2] == LOW[2]
    assert servo.standing


HOME = ROBOT.pose("home")
CLEAR = KeepClear(ROBOT)


def test_a_way_through_the_air_is_clear() -> None:
    assert CLEAR.blocked(CLEAR.line(HOME, HOME + np.radians([40, 5, 5, 5, 20]))) is None


def test_the_first_row_below_the_floor_is_named() -> None:
    way = CLEAR.line(HOME, np.radians([0, 0, -80, -40, 0]))
    found = CLEAR.blocked(way)
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
    robot = of_sticks("mico")
    clear, body = KeepClear(robot), SelfCollision(robot)
    way = clear.line(robot.pose("home"), np.radians([-18, 29, 37, 107]))
    found = clear.blocked(way)
    row, why = found
    assert why == "the arm itself is in the way of the gripper"
    assert body.gaps(LinkFrames.at(robot.chain, way[:row])).min() >= -1e-9
    assert body.gaps(LinkFrames.at(robot.chain, way[row : row + 1])).min() < 0
