"""The driver on a Feetech bus: what goes wrong for people, each by its symptom, and a bad line."""

from __future__ import annotations

import random

import numpy as np
import pytest
from tests.hardware.bus_kit import BusBench, Moments

from armctl.errors import BoardError, BoardTimeoutError, EnableError
from armctl.hardware import Source
from armctl.hardware.bus.packets import Instruction
from armctl.hardware.faults import Fault
from armctl.hardware.feetech.make import OVERLOAD
from armctl.robot import load_robot

ROBOT = load_robot("so101")
STEPS_PER_DEG = 4096 / 360


def bench(**options) -> BusBench:
    return BusBench(ROBOT, options)


@pytest.fixture
def arm() -> BusBench:
    return bench().open()


def enabled(arm: BusBench) -> BusBench:
    refused = arm.enable()
    assert refused is None, refused
    return arm


def writes_to(arm: BusBench, first: int, last: int) -> list:
    """Instructions heard that write into these addresses."""
    return [
        one
        for one in arm.bus.heard
        if one.code in (Instruction.WRITE, Instruction.REG_WRITE, Instruction.SYNC_WRITE)
        and first <= one.data[0] <= last
    ]


def test_connecting_moves_nothing_and_writes_nothing(arm: BusBench):
    assert not arm.identity.earlier
    assert not writes_to(arm, 0, 255)
    assert arm.back.source is Source.MEASURED and arm.back.on == dict.fromkeys(arm.ids, False)
    assert arm.back.positions[4] == arm.bus.servo(4).get("present_position")


def test_each_quantity_is_that_of_its_servo(arm: BusBench):
    arm.bus.servo(3).heat = 48.0
    back = arm.ticks()
    assert back.temperature is not None and back.temperature[3] == 48.0 and back.temperature[2] == 25.0
    assert back.voltage is not None and back.voltage[1] == pytest.approx(12.0)


def test_it_follows_a_stream_and_goes_limp_on_release(arm: BusBench):
    enabled(arm)
    arm.move({1: 2448.0}, 1.5)
    back = arm.ticks(10)
    assert back.positions[1] == pytest.approx(2448, abs=1.5 * STEPS_PER_DEG)
    arm.driver.release()
    assert arm.ticks().on == dict.fromkeys(arm.ids, False)
    assert not any(one.driven for one in arm.bus.servos)


# Torque on.


def test_torque_on_without_a_goal_the_gripper_slams_open(arm: BusBench):
    # a servo that woke with goal 0 goes there as soon as its torque comes on
    arm.joint(6).angle = 0.4
    arm.ticks(2)
    moments, before = Moments(arm.bus), arm.bus.servo(6).shaft
    enabled(arm)
    arm.ticks(50)
    assert max(steps for _, steps in moments.jumps) <= 1.0
    assert arm.bus.servo(6).shaft == pytest.approx(before, abs=3)


def test_an_arm_that_was_moved_after_it_was_looked_at_stays_limp(arm: BusBench):
    arm.joint(2).angle += np.deg2rad(1.6)
    refused = arm.enable()
    assert isinstance(refused, EnableError) and refused.channel == 2
    assert "servo 2 has turned by 1.6°" in str(refused)
    assert not any(one.driven for one in arm.bus.servos)


def test_a_goal_outside_the_limits_of_the_eeprom_would_be_clamped_and_jump():
    arm = bench()
    arm.bus.servo(4).put("highest", arm.bus.servo(4).get("present_position") - 751)  # 66 degrees
    arm.open()
    refused = arm.enable()
    assert isinstance(refused, EnableError) and "it would jump by 66.0°" in str(refused)
    assert arm.back.warnings is not None and "cut off a part" in arm.back.warnings[4]
    assert not any(one.driven for one in arm.bus.servos)


def test_limp_servos_never_get_a_sync_write_of_goals(arm: BusBench):
    enabled(arm)
    arm.driver.release_channels([2])
    arm.bus.heard.clear()
    arm.move({1: 2300.0, 3: 2900.0}, 0.5)
    rows = [one for one in arm.bus.heard if one.code == Instruction.SYNC_WRITE]
    assert rows
    assert all(2 not in one.data[2::3] for one in rows)
    assert not arm.bus.servo(2).driven


def test_a_take_over_throws_no_servo_that_was_on_its_way():
    arm = bench()
    servo = arm.bus.servo(1)
    servo.put("goal_speed", 60)
    servo.written(42, servo.table.encode("goal_position", 3000))
    arm.clock.advance(0.5)
    arm.open()
    before = servo.shaft
    enabled(arm)
    arm.ticks(50)
    assert servo.shaft == pytest.approx(before, abs=30)
    assert 0 < servo.get("goal_speed") < 3000


@pytest.mark.parametrize("lost", range(1, 60, 3))
@pytest.mark.parametrize("fault", [Fault.DROP_REPLY, Fault.DROP_COMMAND])
def test_whatever_is_lost_a_refusal_leaves_nothing_on_or_says_so(lost: int, fault: Fault):
    arm = bench().open()
    arm.faulty.inject(fault, lost)
    refused = arm.enable()
    on = [one.id for one in arm.bus.servos if one.driven]
    if refused is not None:
        assert not on or "cut the power" in str(refused), (lost, str(refused))
    else:
        assert on == arm.ids


def test_a_release_that_was_not_heard_is_never_taken_for_done():
    for seed in range(20):
        arm = enabled(bench().open())
        rng = random.Random(seed)
        for _ in range(6):
            arm.faulty.inject(rng.choice([Fault.DROP_REPLY, Fault.DROP_COMMAND, Fault.DELAY_REPLY]), 1, 0.01)
        try:
            arm.driver.release()
        except BoardTimeoutError as error:
            assert "did not confirm" in str(error)
            continue
        assert not any(one.driven for one in arm.bus.servos), seed


def test_a_servo_that_was_silent_does_not_catch_up_by_itself():
    arm = enabled(bench().open())
    arm.bus.servo(1).silent_s = 1.0
    for k in range(15):
        arm.driver.write({1: 2048.0 + 20 * k})
        arm.ticks()
    place = arm.bus.servo(1).shaft
    arm.ticks(60)  # the runtime writes nothing more
    assert arm.bus.servo(1).shaft == pytest.approx(place, abs=60)


def test_a_servo_that_started_anew_within_a_tick_is_switched_off_again():
    arm = enabled(bench().open())
    arm.driver.limit_torque({1: 0.3})
    arm.ticks()
    arm.bus.servo(1).restart(0.0)
    arm.driver.write({1: 2070.0})
    arm.ticks(2)
    assert not arm.bus.servo(1).driven and "switched its torque off" in arm.back.faults[1]


def test_a_servo_that_started_anew_stays_limp_until_release():
    arm = enabled(bench().open())
    servo = arm.bus.servo(5)
    servo.restart(1.0)
    arm.move({1: 2200.0}, 3.0)
    assert not servo.driven
    assert arm.back.on is not None and not arm.back.on[5]
    assert "switched its torque off" in arm.back.faults[5]
    arm.driver.release()
    arm.ticks(2)
    assert not arm.back.faults
    enabled(arm)
    assert servo.driven


def test_the_torque_limit_of_a_servo_is_set_before_its_torque(arm: BusBench):
    arm.driver.limit_torque({6: 0.3})
    enabled(arm)
    assert arm.bus.servo(6).get("torque_limit") == 150  # of half: a gripper may hold a finger
    assert arm.bus.servo(1).get("torque_limit") == 1000


def test_torque_left_on_after_a_crash_is_taken_over_as_found():
    arm = bench()
    for one in arm.bus.servos:
        one.put("goal_position", one.get("present_position"))
        one.written(40, b"\1")
    arm.open()
    assert arm.back.on == dict.fromkeys(arm.ids, True)
    before = [one.shaft for one in arm.bus.servos]
    enabled(arm)
    arm.ticks(25)
    assert [one.shaft for one in arm.bus.servos] == pytest.approx(before, abs=2)


# What is in the EEPROM.


def test_positions_below_zero_or_above_4095_of_a_servo_that_counts_turns():
    arm = bench()
    arm.bus.servo(1).put("phase", 12 | 16)
    arm.open()
    assert any("counts over several turns" in words for words in arm.identity.earlier)
    assert isinstance(arm.enable(), EnableError)


def test_a_servo_in_wheel_mode_gets_no_torque():
    arm = bench()
    arm.bus.servo(6).put("mode", 1)
    arm.open()
    refused = arm.enable()
    assert refused is not None and "mode 1" in str(refused)
    assert not writes_to(arm, 0, 39)


def test_an_eeprom_is_never_written_unasked(arm: BusBench):
    enabled(arm)
    arm.move({1: 2300.0, 2: 1200.0}, 1.0)
    arm.driver.limit_torque({1: 0.5})
    arm.driver.release()
    assert not writes_to(arm, 0, 39) and not writes_to(arm, 55, 55)


# Who answers.


def test_no_servo_answers_says_what_to_look_at():
    arm = bench(loose=1)
    with pytest.raises(BoardTimeoutError, match=r"no servo answers .* powered"):
        arm.open()


def test_an_adapter_that_echoes_is_no_servo():
    arm = bench(loose=1, echo=True)
    with pytest.raises(BoardTimeoutError, match="answers with what it was sent"):
        arm.open()


def test_behind_an_adapter_that_echoes_all_works_the_same():
    arm = enabled(bench(echo=True).open())
    arm.move({1: 2448.0}, 1.5)
    assert arm.ticks(10).positions[1] == pytest.approx(2448, abs=20)
    assert arm.back.lost == 0


def test_an_echoed_ping_is_not_taken_for_a_servo_in_trouble():
    arm = bench(echo=True)
    arm.bus.servo(6).silent_s = np.inf
    arm.open()
    assert any("servo 6" in words for words in arm.identity.earlier)


def test_a_loose_plug_cuts_what_is_behind_it():
    arm = bench(loose=4).open()
    assert any("servos 4, 5, 6 of 6 did not answer" in words for words in arm.identity.earlier)
    refused = arm.enable()
    assert isinstance(refused, EnableError) and refused.channel in (4, 5, 6)
    assert not any(one.driven for one in arm.bus.servos)


def test_a_plug_that_comes_loose_is_named_while_the_others_hold():
    arm = enabled(bench().open())
    arm.bus.loose = 3
    arm.ticks(40)
    assert {4, 5, 6} == set(arm.back.faults)
    assert "does not answer" in arm.back.faults[4]
    assert arm.bus.servo(1).driven and arm.back.positions[1] is not None


def test_two_servos_of_one_id_garble_each_other():
    arm = bench(twin=2).open()
    refused = arm.enable()
    assert isinstance(refused, EnableError) and refused.channel == 2
    assert not any(one.driven for one in arm.bus.servos)


# Load, heat, supply.


def jammed(servo: int, goal: float) -> BusBench:
    """Something holds a servo until it gives way."""
    arm = enabled(bench().open())
    arm.joint(servo).blocked = True
    arm.move({servo: goal}, 1.0)
    arm.ticks(150)
    arm.joint(servo).blocked = False
    return arm


def test_full_torque_against_an_obstacle_ends_where_the_joint_stands():
    arm = jammed(1, 3000.0)
    assert "overload" in arm.back.faults[1] and arm.back.on is not None and not arm.back.on[1]
    before = arm.bus.servo(1).shaft
    arm.driver.write({1: 3000.0})  # nobody has enabled it again
    arm.ticks(50)
    assert arm.bus.servo(1).shaft == pytest.approx(before, abs=15)
    assert arm.bus.servo(1).driven and not arm.bus.servo(1).errors()
    arm.driver.clear_faults()
    arm.driver.configure(arm.setup.channels)
    enabled(arm)
    arm.move({1: 2300.0}, 1.0)
    assert not arm.ticks(20).faults
    assert arm.bus.servo(1).shaft == pytest.approx(2300, abs=15)


def test_a_gripper_that_holds_a_part_lets_the_arm_go_on():
    arm = enabled(bench().open())
    arm.driver.limit_torque({6: 1.0})
    servo = arm.bus.servo(6)
    servo.put("overload_torque", 40)
    arm.joint(6).blocked = True
    arm.move({6: 2400.0}, 1.0)
    arm.ticks(110)
    assert not arm.back.faults and arm.back.on is not None and arm.back.on[6]
    assert "stopped by something" in arm.back.warnings[6]
    assert servo.get("goal_position") == pytest.approx(servo.shaft, abs=3)
    arm.move({1: 2200.0}, 1.0)
    assert not arm.ticks(20).faults
    assert arm.bus.servo(1).shaft == pytest.approx(2200, abs=15)


def test_release_of_a_servo_in_overload_is_no_failure():
    arm = enabled(bench().open())
    arm.joint(1).blocked = True
    arm.move({1: 3000.0}, 1.0)
    arm.ticks(10)
    vars(arm.bus.servo(1))["_latched"] = OVERLOAD
    arm.driver.release()
    assert not any(one.driven for one in arm.bus.servos)


def test_who_does_not_release_is_named_and_the_others_are_released():
    arm = enabled(bench().open())
    arm.bus.servo(3).silent_s = np.inf
    with pytest.raises(BoardTimeoutError, match="servo 3 did not confirm"):
        arm.driver.release()
    assert not any(one.driven for one in arm.bus.servos if one.id != 3)


def test_a_supply_outside_the_limits_is_told_by_every_servo():
    arm = bench(volts=16.0).open()
    assert "outside the voltages" in arm.back.faults[1]


def test_an_arm_that_let_go_for_want_of_voltage_does_not_rise_by_itself_when_that_is_back():
    arm = enabled(bench().open())
    arm.move({2: 1700.0, 3: 2300.0}, 1.0)
    up = arm.bus.servo(2).shaft
    for one in arm.bus.servos:
        one.put("unloading", 45)  # as some set it: want of voltage, heat, current, overload
    arm.bus.supply.open_v = 3.5
    back = arm.ticks(60)
    assert abs(arm.bus.servo(2).shaft - up) > 100
    assert "servo 2: it has let go: support the arm (its supply is outside" in back.faults[2]
    stood = [one.shaft for one in arm.bus.servos]
    arm.bus.supply.open_v = 12.0
    back = arm.ticks(60)
    assert [one.shaft for one in arm.bus.servos] == pytest.approx(stood, abs=15)
    assert 2 in back.faults


def test_a_setpoint_outside_the_robot_file_is_refused(arm: BusBench):
    enabled(arm)
    with pytest.raises(BoardError, match="nothing was sent"):
        arm.driver.write({1: 4000.0})


def test_homing_is_refused(arm: BusBench):
    with pytest.raises(BoardError, match="no homing"):
        arm.driver.home()


# A bad line.


@pytest.mark.parametrize("kind", ["lost", "spoilt", "doubled"])
def test_an_arm_moves_as_told_on_a_line_that_loses_packets(kind: str):
    arm = enabled(bench().open())
    setattr(arm.bus, kind, 0.05)
    asked = lost = 0
    for k in range(100):
        arm.driver.write({1: 2048.0 + 4 * k, 5: 2048.0 - 3 * k})
        back = arm.ticks()
        asked, lost = asked + back.asked, lost + back.lost
        assert not back.faults
    setattr(arm.bus, kind, 0.0)
    back = arm.ticks(20)
    assert back.positions[1] == pytest.approx(2444, abs=15) and back.positions[5] == pytest.approx(
        1751, abs=15
    )
    assert (lost > 0) == (kind != "doubled") and lost / asked < 0.1


def test_a_lost_goal_is_sent_again(arm: BusBench):
    enabled(arm)
    arm.bus.lost = 0.999
    arm.driver.write({1: 2060.0})
    arm.bus.lost = 0.0
    arm.ticks(3)
    assert arm.bus.servo(1).get("goal_position") == 2060
