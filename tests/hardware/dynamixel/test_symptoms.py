"""What goes wrong for people with Dynamixel arms, each by its symptom, and what becomes of it here."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from tests.hardware.bus_kit import BusBench
from tests.hardware.dynamixel.kit import ELBOW, HOME, OMX, REST, Arm, memory
from tests.runtime.kit import TEST

import armctl
from armctl.errors import BoardTimeoutError, EnableError
from armctl.facts import State
from armctl.hardware.bus.packets import BusPacket, Instruction
from armctl.hardware.dynamixel.make import HEAT, OVERLOAD, VOLTAGE, WATCHDOG_MS
from armctl.hardware.dynamixel.simulated import SimulatedX
from armctl.protocol import ClearFault, Enable, Release
from armctl.robot import load_robot

ALL = (11, 12, 13, 14, 15)


def bench() -> BusBench:
    return BusBench(OMX)


def servo(arm: BusBench, number: int = ELBOW) -> SimulatedX:
    one = arm.bus.servo(number)
    assert isinstance(one, SimulatedX)
    return one


def reboots(arm: Arm) -> list[int]:
    return [packet.id for packet in arm.bus.heard if packet.code == Instruction.REBOOT]


def test_no_answer_though_the_servos_work_names_what_to_look_at():
    arm = bench()
    arm.bus.loose = 0
    with pytest.raises(BoardTimeoutError, match=r"no servo answers \(servos 11, 12, 13, 14, 15 were asked\)"):
        arm.driver.open()


def test_no_answer_of_some_names_the_plug_before_them():
    arm = bench()
    arm.bus.loose = 2
    assert "servos 13, 14, 15 of 5 did not answer" in arm.open().identity.earlier[0]


def test_every_fifth_read_is_incorrect_is_a_rate_and_never_a_jump():
    arm = bench().open()
    assert arm.enable() is None
    arm.bus.spoilt = 0.2
    stood = arm.joint(11).angle
    asked = lost = 0
    for _ in range(200):
        back = arm.ticks()
        asked, lost = asked + back.asked, lost + back.lost
        assert back.faults == {}
        assert all(position is not None for position in back.positions.values())
    assert 0.03 < lost / asked < 0.3
    assert arm.joint(11).angle == pytest.approx(stood, abs=0.001)
    assert all(one.driven for one in arm.bus.servos)


def test_sync_read_fails_with_two_because_of_the_status_return_level():
    arm = bench()
    for number, level in ((12, 0), (14, 1)):
        servo(arm, number).put("status_return_level", level)
    notes = arm.open().identity.earlier
    assert [words.split(":")[0] for words in notes] == ["servo 12", "servo 14"]
    assert all("register 68" in words for words in notes)
    assert None not in arm.ticks(3).positions.values()
    assert arm.enable() is None


def test_servos_that_reboot_on_a_large_step_are_told_and_stay_limp():
    arm = bench().open()
    assert arm.enable() is None
    one = servo(arm)
    one.restart(0.4)  # the supply drooped
    for _ in range(60):
        arm.driver.write({number: servo(arm, number).get("goal_position") for number in ALL})
        back = arm.ticks()
    assert "has switched its torque off" in back.faults[ELBOW]
    assert not one.driven
    assert back.voltage is not None and back.voltage[ELBOW] == pytest.approx(12, abs=0.3)
    arm.driver.clear_faults()
    assert arm.enable() is None
    assert one.driven


def test_one_motor_in_overload_is_named_the_others_hold_and_clear_fault_restarts_that_one():
    arm = Arm().connect().enable().go(HOME)
    arm.bench.until(State.HOLDING)
    arm.joint().blocked = True
    arm.go(REST)
    arm.bench.until(State.FAULT)
    assert f"servo {ELBOW} has switched its torque off (overload" in arm.told
    others = [one for one in ALL if one != ELBOW]
    arm.bench.run(1.0)
    assert all(arm.servo(one).driven for one in others)
    assert "came on though nobody asked" not in arm.told
    arm.joint().blocked = False
    stood = [arm.joint(one).angle for one in others]
    arm.bench.do(ClearFault())
    assert reboots(arm) == [ELBOW]
    arm.bench.run(0.1)
    assert "starts anew" in arm.told
    arm.bench.run(1.0)
    assert all(arm.servo(one).driven for one in others)  # no other was released
    assert [arm.joint(one).angle for one in others] == pytest.approx(stood, abs=math.radians(2.0))
    arm.enable().go(HOME)
    arm.bench.until(State.HOLDING)
    assert arm.bench.now.cause == "move finished"


@pytest.mark.parametrize("lost", ["the command", "the answer"])
def test_a_restart_of_which_a_packet_is_lost_is_done_all_the_same(lost: str, monkeypatch: pytest.MonkeyPatch):
    arm = bench().open()
    assert arm.enable() is None
    one = servo(arm)
    one.fail(OVERLOAD)
    assert "switched its torque off" in arm.ticks(20).faults[ELBOW]
    other, asked = one.other, list[int]()

    def bad_line(packet: BusPacket) -> BusPacket | None:
        asked.append(packet.code)
        heard = len(asked) > 1 or lost == "the answer"
        answer = other(packet) if heard else None
        return answer if len(asked) > 1 else None

    monkeypatch.setattr(one, "other", bad_line)
    arm.driver.clear_faults()
    back = arm.ticks(100)
    assert one.get("hardware_error_status") == 0 and ELBOW not in back.faults
    assert arm.enable() is None


@pytest.mark.parametrize(("error", "words"), [(OVERLOAD, "overload"), (HEAT, "too hot")])
def test_a_motor_that_an_earlier_program_left_latched_is_named_and_release_restarts_it(
    error: int, words: str
):
    arm = Arm()
    arm.servo().fail(error)
    arm.connect()
    assert words in arm.told
    ticket = arm.bench.controller.submit(Enable(), TEST)
    arm.bench.run(0.1)
    with pytest.raises(EnableError, match=f"Joint 3: servo {ELBOW}: .*Release restarts it"):
        ticket.accepted.result(0)
    arm.bench.do(Release())
    assert reboots(arm) == [ELBOW]
    arm.bench.run(1.5)
    arm.enable()
    assert arm.servo().driven


def test_a_hardware_error_that_keeps_the_torque_on_is_told_while_it_holds():
    arm = Arm().connect().enable()
    arm.servo().fail(VOLTAGE)  # the factory's shutdown leaves it on
    arm.bench.run(0.5)
    assert arm.servo().driven
    assert "its supply is outside the voltages" in arm.told


def test_two_motors_of_one_joint_fight_is_refused_with_the_joints_name(tmp_path: Path):
    text = (Path(armctl.__file__).parents[2] / "robots/open_manipulator_x.toml").read_text(encoding="utf-8")
    also = (
        "also = [{ channel = 22, zero_steps = 2048, steps_per_deg = -11.3778, range_steps = [1070, 3026] }]"
    )
    paired = text.replace("range_steps = [1070, 3026] }", f"range_steps = [1070, 3026], {also} }}")
    (tmp_path / "pair.toml").write_text(paired, encoding="utf-8")
    arm = Arm(robot=load_robot(tmp_path / "pair.toml"))
    memory(arm.servo(22), homing_offset=60)  # its horn sits 5.3° askew
    arm.connect()
    ticket = arm.bench.controller.submit(Enable(), TEST)
    arm.bench.run(0.1)
    with pytest.raises(EnableError, match="two motors of Joint 2 stand apart"):
        ticket.accepted.result(0)
    memory(arm.servo(22), homing_offset=0)
    arm.enable().go(HOME)
    arm.bench.until(State.HOLDING)
    assert arm.bench.now.cause == "move finished"


def test_the_arm_jumps_when_it_was_moved_between_reading_and_torque_on():
    arm = bench().open()
    joint = arm.joint(12)
    joint.lies_at, joint.blocked = None, True  # somebody put it elsewhere, and holds it there
    joint.angle += math.radians(20)
    refused = arm.enable()
    assert isinstance(refused, EnableError)
    assert refused.channel == 12
    assert "servo 12 has turned by 20.0°" in str(refused)
    assert not any(one.driven for one in arm.bus.servos)


def test_a_read_that_fails_does_not_switch_the_torque_off():
    arm = Arm().connect().enable()
    arm.bus.lost = 1.0
    arm.bench.run(1.5)
    assert all(arm.servo(one).driven for one in ALL)
    assert arm.bench.now.state is State.FAULT


def test_torque_that_a_crash_left_on_is_taken_over_as_it_is_found():
    arm = Arm()
    for number in ALL:
        one = arm.servo(number)
        one.written(64, b"\1")  # without a watchdog, as other programs leave it
    arm.connect().enable()
    assert [arm.servo(one).get("bus_watchdog") for one in ALL[:-1]] == [WATCHDOG_MS // 20] * 4
    arm.go(HOME)
    arm.bench.until(State.HOLDING)
    assert arm.bench.now.cause == "move finished"


def test_an_arm_that_is_taken_over_does_not_drop_because_one_servo_refuses():
    arm = bench()
    for number in ALL[:-1]:
        servo(arm, number).written(64, b"\1")
    arm.open()
    memory(servo(arm, 15), min_position_limit=4000)
    refused = arm.enable()
    assert isinstance(refused, EnableError) and refused.channel == 15
    assert all(servo(arm, number).driven for number in ALL[:-1])


def test_limits_of_a_servo_that_cut_off_a_part_of_the_robots_range_are_told():
    arm = bench()
    memory(servo(arm), max_position_limit=2500)
    warnings = arm.open().ticks(2).warnings
    assert list(warnings) == [ELBOW]
    assert "0 … 2500" in warnings[ELBOW]
