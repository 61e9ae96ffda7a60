"""The torque-on rite, what is read of the EEPROM, and what the answers mean."""

from __future__ import annotations

import pytest
from tests.hardware.dynamixel.kit import Rig, memory, one_servo

from armctl.errors import EnableError
from armctl.hardware.bus.make import Block, Limits, bring_on
from armctl.hardware.dynamixel.make import (
    DYNAMIXEL,
    ENCODER,
    FULL_PWM,
    HEAT,
    OVERLOAD,
    SHOCK,
    VOLTAGE,
    WATCHDOG_MS,
)
from armctl.hardware.dynamixel.simulated import factory_memory
from armctl.protocol import ManualClock


def switched_on(rig: Rig, expected: float = 2048, torque: float = 1.0) -> int:
    settings = DYNAMIXEL.settings(rig.line, 1)
    return bring_on(DYNAMIXEL, rig.line, 1, settings, expected, Limits(torque))[0]


def taken_over(rig: Rig) -> tuple[int, bool]:
    settings = DYNAMIXEL.settings(rig.line, 1)
    return bring_on(DYNAMIXEL, rig.line, 1, settings, 2048, Limits())


def test_it_holds_where_it_stands_with_its_watchdog_set(clock: ManualClock):
    rig = one_servo(clock)
    assert switched_on(rig) == 2048
    assert rig.reads("torque", "goal_position", "bus_watchdog") == [
        1,
        2048,
        WATCHDOG_MS // 20,
    ]
    assert DYNAMIXEL.off(rig.line, 1)
    assert rig.reads("torque", "bus_watchdog") == [0, 0]


def test_an_old_goal_is_no_jump(clock: ManualClock):
    rig = one_servo(clock)
    rig.write("goal_position", 3000)
    assert switched_on(rig) == 2048
    rig.let(0.3)
    assert rig.read("present_position") == 2048


@pytest.mark.parametrize("drive_mode", [0, 4])
def test_an_old_profile_is_taken_away_be_it_a_speed_or_a_time(clock: ManualClock, drive_mode: int):
    rig = one_servo(clock, drive_mode=drive_mode)
    rig.write("profile_velocity", 20)
    rig.write("profile_acceleration", 10)
    switched_on(rig)
    assert rig.reads("profile_velocity", "profile_acceleration") == [0, 0]


def test_a_joint_that_was_moved_since_is_refused_with_its_angle(clock: ManualClock):
    rig = one_servo(clock)
    rig.servo().joint.angle = 0.1
    with pytest.raises(EnableError, match=r"servo 1 has turned by 5\.7°"):
        switched_on(rig)
    assert rig.read("torque") == 0


def test_a_joint_that_turns_meanwhile_is_off_again(clock: ManualClock):
    rig = one_servo(clock)
    settings = DYNAMIXEL.settings(rig.line, 1)
    rig.servo().joint.angle = 0.05
    with pytest.raises(EnableError, match="turns while its torque is switched on"):
        DYNAMIXEL.on_at(rig.line, 1, 2048)
    assert settings.unfit is None
    assert rig.read("torque") == 0


def test_outside_its_own_limits_it_is_refused_with_both(clock: ManualClock):
    rig = one_servo(clock, min_position_limit=2100)
    with pytest.raises(EnableError, match=r"stands at 2048 steps, outside the limits 2100 … 4095"):
        switched_on(rig)
    assert rig.read("torque") == 0


def test_a_refused_goal_ends_it_with_torque_off(clock: ManualClock):
    rig = one_servo(clock, max_position_limit=2000)
    rig.write("goal_position", 100)
    with pytest.raises(EnableError, match=r"refuses 2048 as its goal position \(error 6"):
        DYNAMIXEL.on_at(rig.line, 1, 2048)
    assert rig.reads("torque", "goal_position") == [0, 100]


def test_an_error_that_comes_in_the_middle_ends_it_with_torque_off(clock: ManualClock):
    rig = one_servo(clock)
    rig.servo().put("shutdown", 0)  # so that its torque would stay on
    settings = DYNAMIXEL.settings(rig.line, 1)
    write = rig.line.write

    def failing(servo: int, address: int, data: bytes):
        if address == DYNAMIXEL.table["torque"].address and data == b"\1":
            rig.servo().fail(ENCODER)
        return write(servo, address, data)

    rig.line.write = failing  # type: ignore[method-assign]
    with pytest.raises(EnableError, match="hardware error"):
        bring_on(DYNAMIXEL, rig.line, 1, settings, 2048, Limits())
    assert rig.read("torque") == 0


@pytest.mark.parametrize("error", [VOLTAGE, HEAT, ENCODER, SHOCK, OVERLOAD])
def test_a_latched_error_is_named_and_a_restart_ends_it(clock: ManualClock, error: int):
    rig = one_servo(clock)
    rig.servo().fail(error)
    with pytest.raises(EnableError, match="Release restarts it"):
        switched_on(rig)
    seen = DYNAMIXEL.understood(rig.line.read(1, 64, 7), Block(64, 7))
    assert seen.on is False and seen.latched is not None and len(seen.latched) == 1
    assert DYNAMIXEL.clear(rig.line, 1)
    assert rig.line.ping(1, attempts=1) is None
    rig.let(0.5)
    assert switched_on(rig) == 2048


def test_the_torque_is_a_share_of_what_the_eeprom_allows(clock: ManualClock):
    rig = one_servo(clock, pwm_limit=600)
    switched_on(rig, torque=0.5)
    assert rig.read("goal_pwm") == 300
    assert DYNAMIXEL.limit_torque(rig.line, 1, 1.0)
    assert rig.read("goal_pwm") == 600


def test_one_that_holds_is_taken_over_with_its_goal(clock: ManualClock):
    rig = one_servo(clock)
    rig.write("goal_position", 2060)
    rig.write("torque", 1)
    rig.let(0.3)
    assert taken_over(rig) == (2060, False)
    assert rig.reads("torque", "bus_watchdog") == [1, WATCHDOG_MS // 20]


def test_one_that_its_watchdog_stopped_is_taken_over_where_it_stands(clock: ManualClock):
    rig = one_servo(clock)
    switched_on(rig)
    rig.servo().joint.blocked = True
    rig.write("goal_position", 2100)
    rig.let(0.6)
    seen = DYNAMIXEL.understood(rig.line.read(1, 98, 49), DYNAMIXEL.telemetry)
    assert seen.refuses and seen.faults
    rig.servo().joint.blocked = False
    assert taken_over(rig) == (2048, False)
    rig.let(0.3)
    assert rig.reads("torque", "goal_position", "present_position") == [1, 2048, 2048]


def test_what_it_measures(clock: ManualClock):
    rig = one_servo(clock)
    switched_on(rig)
    rig.servo().joint.blocked = True
    rig.write("goal_position", 1998)
    rig.let(0.1)
    seen = DYNAMIXEL.understood(rig.line.read(1, 98, 49), DYNAMIXEL.telemetry)
    assert (seen.position, seen.goal, seen.refuses, seen.faults) == (2048, 1998, False, ())
    assert seen.load == pytest.approx(-50 * 800 / 128 / FULL_PWM, abs=0.002)
    assert seen.voltage == pytest.approx(12.0, abs=0.2)
    assert seen.temperature == pytest.approx(25, abs=2)


@pytest.mark.parametrize(
    ("changes", "unfit"),
    [
        ({"operating_mode": 1}, "mode 1"),
        ({"operating_mode": 4}, "mode 4"),
        ({"operating_mode": 16}, "mode 16"),
        ({"drive_mode": 8}, "bit 3 of register 10"),
        ({"max_position_limit": 10, "min_position_limit": 10}, "10 … 10"),
    ],
)
def test_what_makes_it_unfit(clock: ManualClock, changes: dict[str, int], unfit: str):
    rig = one_servo(clock, **changes)
    assert unfit in (DYNAMIXEL.settings(rig.line, 1).unfit or "")
    with pytest.raises(EnableError, match="servo 1"):
        switched_on(rig)


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"operating_mode": 5}, "mode 5"),
        ({"drive_mode": 1}, "bit 0 of register 10"),
        ({"drive_mode": 4}, "bit 2 of register 10"),
        ({"homing_offset": -100}, "-100 steps"),
        ({"shutdown": 16}, "heat or overload"),
        ({"model": 9999}, "9999"),
    ],
)
def test_what_is_unusual_is_told_and_enabled(clock: ManualClock, changes: dict[str, int], found: str):
    rig = one_servo(clock, **changes)
    [words] = DYNAMIXEL.settings(rig.line, 1).findings
    assert found in words
    place = rig.read("present_position")
    assert switched_on(rig, place) == place


def test_a_servo_as_it_comes_has_no_findings(clock: ManualClock):
    settings = DYNAMIXEL.settings(one_servo(clock).line, 1)
    assert (settings.findings, settings.unfit, settings.lowest, settings.highest) == ((), None, 0, 4095)
    assert DYNAMIXEL.models[settings.model] == "XM430-W350"


def test_what_the_eeprom_keeps_survives_a_power_cut_and_a_goal_does_not(clock: ManualClock):
    rig = Rig.of(clock, factory_memory(id=1))
    memory(rig.servo(), homing_offset=50)
    rig.write("goal_position", 3000)
    rig.bus.reset()
    assert rig.reads("homing_offset", "goal_position", "present_position") == [
        50,
        2098,
        2098,
    ]
