from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.runtime.kit import (
    ROBOT,
    TEST,
    TICK,
    Rig,
    assert_accelerations_keep_limits,
    assert_keeps_limits,
    make_rig,
)

from armctl.errors import InputError
from armctl.motion import Floor
from armctl.runtime import Jog, MoveGripper, MoveJoints, Pause, SetSpeed, State

HOME = ROBOT.pose("home")


@pytest.fixture
def rig() -> Rig:
    rig = make_rig().enable(HOME)
    rig.history.clear()
    return rig


def rates(joint: int, rate: float = 1.0) -> np.ndarray:
    values = np.zeros(5)
    values[joint] = rate
    return values


def hold(rig: Rig, rate: np.ndarray, seconds: float) -> None:
    for _ in range(round(seconds / TICK)):
        rig.do(Jog(rate)).accepted.result(0)


def test_it_speeds_up_to_its_share_of_the_limit_and_expires_100_ms_after_the_last_command(rig: Rig) -> None:
    hold(rig, rates(0, 0.5), 1.0)
    assert rig.now.velocity_command == pytest.approx([np.radians(30), 0, 0, 0, 0])
    assert rig.now.state is State.MOVING
    assert rig.now.cause == "jog (test)"
    last = rig.now.stamp
    rig.until(lambda s: s.velocity_command[0] < np.radians(30) - 1e-9, seconds=1)
    assert rig.now.stamp - last == pytest.approx(0.1, abs=1.01 * TICK)
    rig.rests(1)
    # 30 °/s at 360 °/s²: 83 ms to rest
    assert rig.now.stamp - last < 0.1 + 0.0834 + 3 * TICK
    assert rig.now.cause == "jog finished"
    assert_keeps_limits(rig)


def test_the_override_slows_it_down(rig: Rig) -> None:
    rig.do(SetSpeed(0.2))
    hold(rig, rates(3), 0.5)
    assert rig.now.velocity_command[3] == pytest.approx(np.radians(120 * 0.2))


@pytest.mark.parametrize("joint", range(5))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_it_ends_exactly_at_the_joint_limit(joint: int, sign: float) -> None:
    # High up, so that the floor is nowhere near.
    rig = make_rig().enable(np.radians([0, 90, 0, 0, 0]))
    rig.history.clear()
    if joint == 1:  # the straight arm would sweep the floor
        rig = make_rig().enable(np.radians([0, 90, 40, 40, 0]))
        rig.history.clear()
    hold(rig, rates(joint, sign), 3.5)
    limit = ROBOT.limits[joint, 1 if sign > 0 else 0]
    assert rig.now.q_command[joint] == pytest.approx(limit, abs=1e-9)
    assert not rig.now.velocity_command.any()
    assert rig.now.warnings == (f"jog: {ROBOT.joints[joint].title} at the limit",)
    assert_keeps_limits(rig)
    rig.run(1)
    assert rig.now.warnings == ()
    assert rig.now.state is State.HOLDING


def test_it_brakes_late_but_in_time(rig: Rig) -> None:
    hold(rig, rates(0), 3.0)
    q = np.array([snapshot.q_command[0] for snapshot in rig.history])
    arrived = int(np.argmax(q >= ROBOT.limits[0, 1] - 1e-9))
    # 107.26° at 60 °/s with two ramps of 0.167 s: 1.95 s at the least
    assert arrived * TICK < 1.955 + 5 * TICK


def test_it_stops_above_the_floor_and_comes_up_again() -> None:
    rig = make_rig().enable(np.radians([0, 60, -80, -20, 0]))
    rig.history.clear()
    floor = Floor(ROBOT)
    hold(rig, rates(1, -1.0), 3.0)
    lowest = floor.clearance(rig.now.q_command).min()
    assert 0 <= lowest < 2e-3
    assert rig.now.warnings == ("jog: the floor is in the way",)
    assert all(floor.clearance(s.q_command).min() >= -1e-9 for s in rig.history)
    assert_accelerations_keep_limits(rig)
    hold(rig, rates(1, 1.0), 0.5)
    assert floor.clearance(rig.now.q_command).min() > 0.02


def test_letting_go_near_the_floor_does_not_carry_it_through() -> None:
    floor = Floor(ROBOT)
    for ticks in range(20, 75, 3):
        rig = make_rig().enable(np.radians([0, 60, -80, -20, 0]))
        hold(rig, np.array([0.3, -1, 0.2, -1, 0]), ticks * TICK)
        rig.run(0.5)
        assert all(floor.clearance(s.q_command).min() >= -1e-9 for s in rig.history)


def test_a_change_of_direction_keeps_the_acceleration(rig: Rig) -> None:
    hold(rig, rates(2), 0.5)
    hold(rig, rates(2, -1.0), 0.5)
    assert rig.now.velocity_command[2] == pytest.approx(-np.radians(90))
    assert_accelerations_keep_limits(rig)


def test_it_needs_the_arm_holding(rig: Rig) -> None:
    rig.do(MoveJoints(ROBOT.pose("rest")))
    rig.refuses(Jog(rates(0)), "a jog needs the arm holding, it is moving")


def test_no_motion_begins_while_it_is_held(rig: Rig) -> None:
    hold(rig, rates(0), 0.2)
    rig.refuses(MoveJoints(HOME), "stop first")
    rig.refuses(Pause(), "jog cannot be paused")


def test_zero_does_not_begin_a_jog(rig: Rig) -> None:
    rig.do(Jog(np.zeros(5))).finished.result(0)
    assert rig.now.state is State.HOLDING


@pytest.mark.parametrize("rate", [np.full(5, 1.1), np.full(5, np.nan), np.zeros(3)])
def test_rates_that_cannot_be(rig: Rig, rate: np.ndarray) -> None:
    rig.refuses(Jog(rate), "5 rates between -1 and 1", InputError)


def test_a_command_that_came_too_late_moves_nothing(rig: Rig) -> None:
    rig.controller.submit(Jog(rates(0)), TEST)
    rig.tick(0.5)
    rig.run(0.5)
    assert np.array_equal(rig.now.q_command, HOME)
    assert rig.now.state is State.HOLDING


def test_the_gripper_may_move_at_the_same_time(rig: Rig) -> None:
    rig.do(MoveGripper(0.0))
    ticket = rig.do(MoveGripper(1.0))
    hold(rig, rates(0), 1.0)
    ticket.result(0)
    assert rig.now.gripper == 1.0
    assert all(len(values) in (1, 5, 6) for _, values in rig.driver.writes)
    assert any(len(values) == 6 for _, values in rig.driver.writes)


def test_a_held_joint_is_not_jogged() -> None:
    held = replace(ROBOT.joints[4], lower=0.0, upper=0.0)
    rig = make_rig(robot=replace(ROBOT, joints=(*ROBOT.joints[:4], held))).enable(HOME)
    rig.refuses(Jog(rates(4)), r"Wrist roll is held at 0\.00°: .* cannot be jogged", InputError)
    assert rig.now.state is State.HOLDING
    hold(rig, rates(0), 0.2)
    assert rig.now.q_command[0] > HOME[0]
    assert rig.now.q_command[4] == 0.0
    assert rig.now.warnings == ()


def test_what_its_sender_writes_afterwards_changes_nothing(rig: Rig) -> None:
    wanted = rates(0, 0.1)
    rig.do(Jog(wanted)).accepted.result(0)
    wanted[:] = 1e6
    rig.run(0.08)
    assert np.degrees(rig.now.velocity_command[0]) == pytest.approx(6)
    assert not rig.now.velocity_command[1:].any()
