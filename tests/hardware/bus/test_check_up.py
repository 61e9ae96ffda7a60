"""What the check-up says of servo buses, good and bad; it reads only."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.hardware.bus_kit import BusBench
from tests.hardware.lines import LoopTransport

from armctl.hardware.access import latency_timer_ms
from armctl.hardware.board_type import ChannelsToCheck, CheckUp, Finding, Verdict
from armctl.hardware.boards import board_type
from armctl.hardware.bus import check_up
from armctl.hardware.bus.packets import Instruction


def examined(bench: BusBench) -> dict[str, Finding]:
    """Findings by check; where a check has several, the last that is not well."""
    line = LoopTransport(bench.bus, bench.clock.now, bench.clock.advance)
    needs = ChannelsToCheck(bench.setup.channels)
    told: dict[str, Finding] = {}
    for one in board_type(bench.robot.board).examine(CheckUp(line, bench.clock.now, needs)):
        if one.check not in told or one.verdict is not Verdict.OK:
            told[one.check] = one
    return told


@pytest.mark.parametrize("robot", ["so101", "open_manipulator_x"])
def test_a_healthy_bus_is_well_in_each_check_and_nothing_is_written(robot: str):
    bench = BusBench(robot)
    for servo in bench.bus.servos:
        if "return_delay_time" in servo.table:
            servo.put("return_delay_time", 0)
    told = examined(bench)
    unwell = [one.check for one in told.values() if one.verdict is not Verdict.OK]
    assert unwell == (["watchdog"] if robot == "so101" else [])
    assert "channels" in told and told["round trips"].seen.startswith("50 questions answered")
    asked = {one.code for one in bench.bus.heard}
    assert asked <= {Instruction.PING, Instruction.READ, Instruction.SYNC_READ}


def test_no_servo_answers_says_what_to_look_at():
    bench = BusBench()
    bench.bus.loose = 0
    told = examined(bench)["channels"]
    assert told.verdict is Verdict.FAILED and "Are they powered" in told.seen


def test_a_loose_plug_an_open_eeprom_and_a_servo_in_wheel_mode_are_each_named():
    bench = BusBench()
    bench.bus.loose = 4
    bench.bus.servo(2).put("lock", 0)
    bench.bus.servo(3).put("mode", 1)
    bench.bus.servo(1).put("lowest", 2000)
    told = examined(bench)
    assert told["channels"].verdict is Verdict.FAILED and "the one of servo 5" in told["channels"].seen
    assert "servo 2 is open" in told["EEPROM lock"].seen
    assert told["settings"].verdict is Verdict.FAILED and "servo 3: it is in mode 1" in told["settings"].seen


def test_an_error_that_a_servo_has_is_told():
    bench = BusBench("open_manipulator_x")
    bench.bus.servo(12).put("hardware_error_status", 1 << 5)
    told = examined(bench)["error register"]
    assert told.verdict is Verdict.WARNING and "servo 12: overload" in told.seen


def test_servos_that_wait_before_each_answer_are_named_with_the_command_that_ends_it():
    bench = BusBench("open_manipulator_x")  # as they come from the factory
    told = examined(bench)["return delay"]
    assert told.verdict is Verdict.WARNING
    assert told.seen.startswith("servos wait 2.5 ms in all")
    assert "write 11 return_delay_time 0" in told.advice


@pytest.mark.parametrize(("held", "verdict"), [("16\n", Verdict.WARNING), ("1\n", Verdict.OK)])
def test_an_adapter_that_holds_answers_back_is_told(
    held: str, verdict: Verdict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    timer = tmp_path / "bus/usb-serial/devices/ttyUSB3/latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text(held)
    assert latency_timer_ms("/dev/ttyACM0", tmp_path) is None
    monkeypatch.setattr(check_up, "latency_timer_ms", lambda _: latency_timer_ms("/dev/ttyUSB3", tmp_path))
    told = examined(BusBench())["latency timer"]
    assert told.verdict is verdict
    assert ("latency_timer" in told.advice) == (verdict is Verdict.WARNING)


def test_an_adapter_that_echoes_is_no_trouble():
    told = examined(BusBench("so101", {"echo": True}))
    assert told["echo"].verdict is Verdict.OK and told["channels"].verdict is Verdict.OK
