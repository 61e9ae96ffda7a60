from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from tests.runtime.homing_kit import AXES, SCORBOT, home, make_homing_rig
from tests.runtime.kit import TEST, Rig, make_rig

from armctl.errors import BoardError, StateError
from armctl.hardware import Readback, Source
from armctl.robot import Robot
from armctl.runtime import ClearFault, Enable, HomeAxes, MoveGripper, MoveJoints, Release, State


@pytest.fixture
def rig() -> Rig:
    return make_homing_rig()


def test_an_arm_that_was_not_homed_cannot_be_enabled(rig: Rig) -> None:
    assert [axis.homed for axis in rig.now.homing] == [False] * 6
    rig.refuses(Enable(), "does not know where it is yet; press Homing")
    assert rig.now.state is State.OFF
    rig.refuses(MoveJoints(SCORBOT.pose("rest")), "a motion needs the arm holding, it is off; press Homing")
    assert rig.driver.writes == []


def test_homing_tells_how_far_it_is_and_ends_holding_where_it_ended(rig: Rig) -> None:
    ticket = rig.do(HomeAxes())
    assert rig.now.state is State.MOVING
    rig.run(0.4)
    assert any("Gripper looks for its zero (1 of 6)" in text for text in rig.now.warnings)
    rig.driver.find(5, 1, then=2)
    rig.run(0.1)
    assert any("Elbow looks for its zero (3 of 6)" in text for text in rig.now.warnings)
    assert [axis.title for axis in rig.now.homing if axis.homed] == ["Shoulder", "Gripper"]
    assert [axis.title for axis in rig.now.homing if axis.running] == ["Elbow"]
    assert rig.now.progress == pytest.approx(2 / 6)
    rig.driver.find(*AXES, then=None)
    rig.run(0.1)
    ticket.finished.result(0)
    assert rig.now.state is State.HOLDING
    assert rig.now.q_command == pytest.approx(SCORBOT.pose("home"), abs=1e-9)
    assert rig.now.gripper == 0.0
    assert rig.now.warnings == ()
    told = [event.text for event in rig.now.events if "looks for its zero" in event.text]
    assert [text.split()[1] for text in told] == ["Gripper", "Elbow"]  # each once, as it begins
    assert rig.driver.writes == []  # the board holds by itself


def coarse_at_its_limit() -> Robot:
    """A Scorbot whose waist has two counts a degree, and its home at its lower limit."""
    outputs, low = SCORBOT.output_map, SCORBOT.limits[0]
    assert outputs is not None
    per_rad, zero = outputs.per_rad.copy(), outputs.zero.copy()
    least, most = outputs.low.copy(), outputs.high.copy()
    per_rad[0] = np.degrees(2.0)
    zero[0], least[0], most[0] = -per_rad[0] * low[0], 0.0, per_rad[0] * (low[1] - low[0])
    return replace(SCORBOT, output_map=replace(outputs, per_rad=per_rad, zero=zero, low=least, high=most))


@pytest.mark.parametrize("noise", [-1.0, 0.0, 1.0])
def test_a_home_at_a_limit_may_waver_by_a_count(noise: float) -> None:
    robot = coarse_at_its_limit()
    rig = make_homing_rig(robot)
    rig.driver.counts[0] = noise  # half a degree
    home(rig)
    assert rig.now.state is State.HOLDING
    q = rig.controller.snapshot.q_command
    assert q[0] == pytest.approx(robot.limits[0, 0] + max(noise, 0.0) / np.degrees(2.0))


def test_two_counts_between_two_readings_are_no_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = make_homing_rig(coarse_at_its_limit())
    home(rig)
    rig.do(Release()).finished.result(0)
    read, counts = rig.driver.read, itertools.cycle([-1.0, 1.0])

    def wavering() -> Readback:
        rig.driver.counts[0] = next(counts)
        return read()

    monkeypatch.setattr(rig.driver, "read", wavering)
    rig.refuses(Enable(), "the board says two things of where it is")


def test_after_homing_the_arm_moves(rig: Rig) -> None:
    home(rig)
    goal = SCORBOT.pose("home") + np.radians([10, 5, -5, 5, 20])
    ticket = rig.do(MoveJoints(goal))
    rig.until(lambda now: now.state is State.HOLDING)
    ticket.finished.result(0)
    assert rig.now.q == pytest.approx(goal, abs=1e-6)
    assert rig.now.source is Source.MEASURED


def test_a_doubtful_zero_from_before_does_not_end_homing(rig: Rig) -> None:
    home(rig)
    rig.do(HomeAxes())
    rig.driver.find(*AXES, then=None)  # what a late status line of before would say
    rig.run(0.1)
    assert rig.now.state is State.MOVING


def test_stop_ends_homing_and_leaves_an_arm_that_knows_nothing(rig: Rig) -> None:
    ticket = rig.do(HomeAxes())
    rig.run(0.4)
    stopped = rig.controller.stop(TEST)
    rig.run(0.5)
    stopped.finished.result(0)
    assert "stop" in rig.driver.calls
    with pytest.raises(StateError, match="homing was stopped by test"):
        ticket.finished.result(0)
    assert rig.now.state is State.OFF
    rig.refuses(Enable(), "press Homing")
    home(rig)
    assert rig.now.state is State.HOLDING


def test_an_axis_that_finds_no_switch_is_named(rig: Rig) -> None:
    ticket = rig.do(HomeAxes())
    rig.run(0.4)
    rig.driver.trip(1, "the home switch was not found")
    rig.run(0.1)
    with pytest.raises(BoardError, match="before every axis had its zero: Shoulder: the home switch"):
        ticket.finished.result(0)
    assert rig.now.state is State.OFF


def test_a_trip_while_holding_is_a_fault_in_words_and_nothing_goes_on_by_itself(rig: Rig) -> None:
    home(rig)
    rig.do(MoveJoints(SCORBOT.pose("rest")))
    rig.run(0.3)
    rig.driver.trip(2, "it stalled: full drive without movement")
    rig.run(0.1)
    assert rig.now.state is State.FAULT
    assert "Elbow: it stalled" in rig.now.cause
    written = len(rig.driver.writes)
    rig.run(1.0)
    assert len(rig.driver.writes) == written
    rig.do(ClearFault()).finished.result(0)
    assert "release" in rig.driver.calls
    assert rig.now.state is State.OFF
    rig.do(Enable()).finished.result(0)
    assert rig.now.state is State.HOLDING


def test_enable_keeps_the_arm_where_the_encoders_say_it_is(rig: Rig) -> None:
    home(rig)
    rig.do(Release()).finished.result(0)
    rig.driver.counts[0] = 141.8888 * 7
    rig.run(0.1)
    rig.do(Enable()).finished.result(0)
    assert np.degrees(rig.now.q_command[0]) == pytest.approx(7.0)
    assert "encoders say where the arm is" in rig.now.cause


def test_an_arm_outside_its_limits_is_not_taken_over(rig: Rig) -> None:
    home(rig)
    rig.do(Release()).finished.result(0)
    rig.driver.counts[0] = 141.8888 * 160
    rig.run(0.1)
    rig.refuses(Enable(), r"Waist stands at 160\.0°, outside .* or press Homing")


def test_servos_have_nothing_to_home() -> None:
    rig = make_rig().enable()
    assert rig.now.homing == ()
    rig.refuses(HomeAxes(), "nothing to home")
    assert rig.now.state is State.HOLDING


def test_homing_is_refused_while_the_arm_moves(rig: Rig) -> None:
    home(rig)
    rig.do(MoveJoints(SCORBOT.pose("rest")))
    rig.run(0.2)
    rig.refuses(HomeAxes(), "homing needs the arm off or holding, it is moving")


def test_a_board_that_does_not_begin_to_home_leaves_the_arm_as_it_was(rig: Rig) -> None:
    home(rig)
    q = rig.now.q_command
    rig.driver.fail["home"] = StateError("the board is busy")
    rig.refuses(HomeAxes(), "busy")
    assert rig.now.state is State.HOLDING
    assert np.array_equal(rig.now.q_command, q)
    del rig.driver.fail["home"]


def test_an_arm_that_stands_away_from_its_setpoint_is_told(rig: Rig) -> None:
    home(rig)
    rig.driver.counts[1] += 2 * 113.5555
    rig.run(1.0)
    assert any("does not stand where it was told (Shoulder by 2.0°)" in text for text in rig.now.warnings)


def test_the_gripper_waits_for_homing_too(rig: Rig) -> None:
    rig.refuses(MoveGripper(0.5), "the gripper needs the arm enabled")
    home(rig)
    rig.do(MoveGripper(0.5))
    rig.run(1.0)
    assert rig.driver.counts[5] == pytest.approx((50 + 1650) / 2)
