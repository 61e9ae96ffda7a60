"""The bus watchdog: a killed host, a slow one, and how the arm goes on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.hardware.bus_kit import LEAD_S
from tests.hardware.dynamixel.kit import ELBOW, HOME, OMX, STEPS_PER_RAD, Arm

from armctl.facts import State
from armctl.hardware.boards import board_type
from armctl.hardware.dynamixel.make import WATCHDOG_MS
from armctl.protocol import ClearFault, Enable, MoveJoints, Release, SetSpeed

BASE = 11
TRIP_S = WATCHDOG_MS / 1000
SAG_DEG = board_type("dynamixel").sag_deg


def fast_arm(share: float = 1.0) -> Arm:
    """Its base turns at a share of its full 120°/s, less what friction takes."""
    arm = Arm().connect().enable().go(HOME)
    arm.bench.until(State.HOLDING)
    arm.bench.do(SetSpeed(share))
    arm.bench.do(MoveJoints(HOME + np.radians([175, 0, 0, 0])))
    arm.bench.run(1.2 / share)
    assert arm.joint(BASE).speed > 0.8 * share * float(OMX.speed_limits[0])
    return arm


def turned_deg(arm: Arm, before: list[float]) -> float:
    """How far any joint has turned since, in degrees."""
    turned = np.subtract([joint.angle for joint in arm.bus.plant.joints], before)
    return float(np.degrees(np.abs(turned).max()))


@pytest.mark.parametrize(("share", "most_deg"), [(1.0, 7.0), (0.7, 5.0), (0.25, 2.0)])
def test_an_arm_whose_host_is_killed_stands_100_ms_after_the_trip_and_a_few_degrees_on(
    share: float, most_deg: float
):
    arm = fast_arm(share)
    began, speed = arm.joint(BASE).angle, arm.joint(BASE).speed
    told = (arm.servo(BASE).get("goal_position") - 2048) / STEPS_PER_RAD
    arm.silence(TRIP_S + 0.1)
    assert all(arm.servo(one).watchdog_tripped for one in (11, 12, 13, 14, 15))
    stood = arm.joint(BASE).angle
    assert arm.joint(BASE).speed == 0.0
    assert 0.0 < stood - began < speed * LEAD_S
    assert math.degrees(stood - began) < most_deg
    assert told - math.radians(1.5) < stood <= told  # no farther than it was told: on its path
    arm.silence(5.0)
    assert arm.joint(BASE).angle == stood
    assert all(arm.servo(one).get("torque") == 1 for one in (11, 12, 13, 14, 15))  # it holds


def test_an_arm_that_still_turns_is_stopped_by_the_trip():
    arm = fast_arm()
    servo = arm.servo(BASE)
    servo.put("goal_position", servo.get("goal_position") + 1000)  # as a program sends that looks far ahead
    servo.put("bus_watchdog", 5)
    arm.silence(0.12)
    assert servo.watchdog_tripped
    tripped_at = arm.joint(BASE).angle
    arm.silence(0.1)
    assert arm.joint(BASE).speed == 0.0
    assert math.degrees(abs(arm.joint(BASE).angle - tripped_at)) < 10.0


@pytest.mark.parametrize("late_s", [0.06, 0.2, 0.4])
def test_a_host_that_is_slow_for_a_moment_trips_nothing(late_s: float):
    arm = fast_arm()
    for _ in range(2):
        arm.silence(late_s)
        arm.bench.run(0.1)
    assert not arm.servo(BASE).watchdog_tripped
    arm.bench.until(State.HOLDING)
    assert arm.bench.now.cause == "move finished"


def test_after_a_trip_it_is_a_fault_that_names_it_and_enable_goes_on_from_there():
    arm = fast_arm()
    arm.silence(TRIP_S + 0.2)
    arm.bench.run(0.3)
    assert arm.bench.now.state is State.FAULT
    assert f"bus watchdog stopped it after {WATCHDOG_MS} ms" in arm.told
    stood = [joint.angle for joint in arm.bus.plant.joints]
    arm.bench.do(ClearFault())
    arm.bench.run(0.3)
    assert [joint.angle for joint in arm.bus.plant.joints] == stood  # nothing drops
    arm.bench.do(Enable())
    arm.bench.run(0.5)
    assert arm.bench.now.state is State.HOLDING
    assert turned_deg(arm, stood) < SAG_DEG  # its load leans on it anew, nothing more
    assert abs(arm.joint(BASE).angle - stood[0]) < math.radians(0.5)
    assert not any(arm.servo(one).watchdog_tripped for one in (11, 12, 13, 14, 15))
    arm.go(HOME)
    arm.bench.until(State.HOLDING)
    assert arm.bench.now.cause == "move finished"


def test_release_clears_it_and_the_next_enable_begins_anew():
    arm = fast_arm()
    arm.silence(TRIP_S + 0.2)
    arm.bench.run(0.3)
    arm.bench.do(Release())
    assert [arm.servo(one).get("bus_watchdog") for one in (11, 12, 13, 14, 15)] == [0] * 5
    arm.bench.run(1.0)
    arm.enable()
    assert arm.servo(ELBOW).get("bus_watchdog") == WATCHDOG_MS // 20


def test_while_it_is_off_silence_is_nothing():
    arm = Arm().connect()
    arm.silence(3.0)
    arm.enable()
    assert arm.bench.now.warnings == ()


def test_an_arm_that_an_earlier_program_left_holding_is_taken_over_without_a_drop():
    first = fast_arm()
    first.bench.until(State.HOLDING)
    first.silence(2.0)
    stood = [joint.angle for joint in first.bus.plant.joints]
    first.bench.controller.close()
    again = Arm(first.bus)
    again.bench.clock.advance(first.bench.clock.now() - again.bench.clock.now())
    again.connect().enable()
    assert turned_deg(again, stood) < SAG_DEG
    again.go(HOME)
    again.bench.until(State.HOLDING)
    assert again.bench.now.cause == "move finished"
