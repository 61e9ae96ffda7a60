"""The check-up: what it says of good and bad ports and boards, and that it moves and changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.hardware.lines import LoopTransport, holding_maestro

from armctl.errors import BoardTimeoutError, PortError
from armctl.hardware import ByteModel, ChannelSettings
from armctl.hardware.board_type import Finding, Verdict, round_trips
from armctl.hardware.doctor import Patient, examine, without_personal_data
from armctl.hardware.encoder.messages import seal
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard
from armctl.hardware.faults import Fault, FaultyModel
from armctl.hardware.firmata.codec import servo_config, servo_write
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.simulated import (
    MaestroSettings,
    SimulatedMaestro,
)
from armctl.hardware.ports import PortChecks
from armctl.hardware.transport import PortInfo
from armctl.protocol import ManualClock

MICRO = MaestroModel.MICRO_6.label
CHANNELS = [ChannelSettings(channel, 1000.0, 2000.0) for channel in range(4)]
FREE = PortChecks(lambda _device: True, lambda _device: None, lambda _device: (), tuple)


@pytest.fixture
def device(tmp_path: Path) -> str:
    """A file that stands for the device; what is said over it goes through a loop."""
    (tmp_path / "ttyACM0").touch()
    return str(tmp_path / "ttyACM0")


def listed(device: str, kind: str = MICRO, **changes) -> PortInfo:
    values = {"serial_number": "00046907", "usable": True, "why_not": None} | changes
    return PortInfo(device, kind, "what the system says", **values)


def opener(model: ByteModel, clock: ManualClock) -> Callable[[int], LoopTransport]:
    return lambda _baud: LoopTransport(model, clock.now, clock.advance, name="port")


def report(patient: Patient, model: ByteModel, clock: ManualClock) -> dict[str, Finding]:
    """Findings by check; where a check has several, the worst counts."""
    order = list(Verdict)
    order.sort(key=[Verdict.OK, Verdict.NOT_CHECKED, Verdict.WARNING, Verdict.FAILED].index)
    worst: dict[str, Finding] = {}
    for finding in examine(patient, opener(model, clock), clock.now):
        known = worst.get(finding.check)
        if known is None or order.index(finding.verdict) > order.index(known.verdict):
            worst[finding.check] = finding
    return worst


def failures(findings: dict[str, Finding]) -> list[str]:
    return [check for check, finding in findings.items() if finding.verdict is Verdict.FAILED]


def patient(device: str, **changes) -> Patient:
    values = {"info": listed(device), "expected": "maestro", "channels": CHANNELS, "checks": FREE}
    return Patient(device, **(values | changes))


@pytest.mark.parametrize(("crc", "words"), [(False, "off"), (True, "on; armctl sends it with every command")])
def test_a_healthy_maestro(clock: ManualClock, device: str, crc, words):
    board = holding_maestro(crc=crc)
    findings = report(patient(device), board, clock)
    assert failures(findings) == []
    assert findings["port"].seen == f"{MICRO}, USB serial number 00046907"
    assert findings["CRC"].seen == words
    assert findings["channels"].seen == "channels 0, 1, 2, 3: the board has them"
    assert findings["outputs"].seen == "on: 0 at 1500 µs"
    assert findings["error register"].seen == "empty"
    assert findings["round trips"].seen.startswith("50 questions answered, median")
    assert findings["watchdog"].verdict is Verdict.NOT_CHECKED
    assert findings["ranges"].verdict is Verdict.OK
    assert board.target_us(0) == 1500.0
    assert board.errors == 0
    assert {entry.opcode.name for entry in board.log} == {"SET_TARGET", "GET_POSITION", "GET_ERRORS"}


def test_a_channel_too_many_is_not_asked_for_and_wide_ranges_cannot_be_told(clock: ManualClock, device: str):
    channels = [*CHANNELS, ChannelSettings(7, 554.0, 2446.0)]
    board = holding_maestro()
    findings = report(patient(device, channels=channels), board, clock)
    assert failures(findings) == ["channels"]
    assert findings["channels"].seen == f"channel 7: a {MICRO} has 0 … 5"
    assert findings["ranges"].verdict is Verdict.NOT_CHECKED
    assert "channel 7 554 … 2446 µs" in findings["ranges"].seen
    assert "Channel Settings" in findings["ranges"].advice
    unlisted = report(patient(device, channels=channels, info=None), board, clock)["channels"]
    assert unlisted.verdict is Verdict.NOT_CHECKED
    assert "the model cannot be told" in unlisted.seen
    assert (board.errors, board.target_us(0)) == (0, 1500.0)


def test_what_the_maestro_had_reported_is_in_the_report_once(clock: ManualClock, device: str):
    board = holding_maestro(timeout_units=10)
    clock.advance(5.0)
    finding = report(patient(device), board, clock)["error register"]
    assert (finding.verdict, finding.seen.split(":")[0]) == (Verdict.WARNING, "serial timeout")
    assert report(patient(device), board, clock)["error register"].verdict is Verdict.OK


class Dying(SimulatedMaestro):
    """Falls silent in the middle."""

    def feed(self, data: bytes) -> bytes:
        return b"" if len(self.log) > 30 else super().feed(data)


class Leaving(FaultyModel):
    """Is unplugged at the first position that is asked for."""

    def feed(self, data: bytes) -> bytes:
        reply = super().feed(data)
        if len(data) == 3:
            self.unplug()
        return reply


@pytest.mark.parametrize(
    ("board", "check", "words"),
    [
        (Dying(), "round trips", "answered, then: port: the board answered 0 of 4 bytes"),
        (Leaving(SimulatedMaestro()), "opens", "unplugged"),
    ],
)
def test_a_board_or_a_line_that_fails_in_the_middle(clock: ManualClock, device: str, board, check, words):
    findings = report(patient(device), board, clock)
    assert failures(findings) == [check]
    assert words in findings[check].seen


FIRMATA_PINS = [ChannelSettings(2, 600.0, 2400.0), ChannelSettings(44, 600.0, 2400.0)]


def test_a_healthy_firmata(clock: ManualClock, device: str):
    board = SimulatedFirmata()
    board.advance(clock.now())
    board.feed(servo_config(44, 544, 2400) + servo_write(44, 1234))
    clock.advance(1.0)
    mega = patient(device, info=None, expected="firmata", channels=FIRMATA_PINS)
    findings = report(mega, board, clock)
    assert failures(findings) == []
    assert findings["firmware"].seen.startswith("StandardFirmata.ino 2.")
    assert findings["channels"].seen == "the board can drive servos on pins 2, 44"
    assert findings["outputs"].seen == "servo pulses on pin 44 at 1234"
    assert findings["watchdog"].verdict is Verdict.WARNING
    assert {pulse.width_us for pulse in board.pulses(44)} == {1234}
    assert board.pulses(2) == ()


def test_pins_and_ranges_that_firmata_cannot_do(clock: ManualClock, device: str):
    channels = [ChannelSettings(0, 600.0, 2400.0), ChannelSettings(3, 500.0, 2400.0)]
    findings = report(
        patient(device, info=None, expected="firmata", channels=channels), SimulatedFirmata(), clock
    )
    assert failures(findings) == ["channels"]
    assert "pin 0 cannot drive a servo" in findings["channels"].seen
    assert "pin 3: 500 … 2400 µs" in findings["channels"].seen


AXES = [ChannelSettings(axis, -1000.0, 1000.0, 500.0, 5000.0) for axis in range(6)]


def encoder_patient(device: str, channels=AXES) -> Patient:
    return patient(device, info=None, expected="encoder", channels=channels)


def test_a_healthy_encoder_board(clock: ManualClock, device: str):
    board = SimulatedEncoderBoard()
    findings = report(encoder_patient(device), board, clock)
    assert failures(findings) == []
    assert findings["firmware"].seen == "armctl-encoder 1.3.0, protocol 4"
    assert findings["channels"].seen == "axes 0, 1, 2, 3, 4, 5: the board has them"
    assert findings["outputs"].seen.startswith("motors off; homed axes: none")
    assert findings["watchdog"].verdict is Verdict.OK
    assert findings["supply"].seen == "last started by: power; the board does not measure it"
    assert {text.split(" ")[-1] for text in board.log} <= {"HELLO", "PING"}
    assert board.mode.powered is False
    assert findings["encoders"].verdict is Verdict.OK
    board.reset("brownout")
    board.axes[2].lose_edges(3)
    findings = report(encoder_patient(device, [ChannelSettings(6, -1000.0, 1000.0)]), board, clock)
    assert failures(findings) == ["channels"]
    assert findings["channels"].seen == "axis 6: the board has axes 0 … 5"
    assert findings["supply"].verdict is Verdict.WARNING
    assert "sagged" in findings["supply"].seen
    assert "brown-out" in findings["error register"].seen
    assert "axis 2: its encoder has lost 3 edges" in findings["encoders"].seen


class OldEncoderBoard:
    """Speaks protocol 0, and its state every 20 ms."""

    def __init__(self) -> None:
        self._next = 0.0

    def advance(self, now: float) -> bytes:
        if now < self._next:
            return b""
        self._next = now + 0.02
        return seal("@ 20 O 00 00 00 000000000000 0 0 0 0 0 0")

    def feed(self, data: bytes) -> bytes:
        if b"PING" in data:
            return seal(f"{data.split()[0].decode()} ok")
        return seal("1 ok armctl-encoder 0.9.0 proto=0 axes=6 reset=power") if b"HELLO" in data else b""

    def reset(self) -> None: ...


@pytest.mark.parametrize(
    ("board", "seen", "advice"),
    [
        (OldEncoderBoard(), "armctl-encoder 0.9.0, protocol 0; this", "flash the board again, with the"),
        (SimulatedEncoderBoard(protocol=5), "protocol 5; this armctl needs protocol 4", ": update armctl"),
    ],
)
def test_a_firmware_of_another_protocol(clock: ManualClock, device: str, board, seen, advice):
    firmware = report(encoder_patient(device), board, clock)["firmware"]
    assert firmware.verdict is Verdict.FAILED
    assert seen in firmware.seen
    assert advice in firmware.advice


def test_another_board_than_the_robot_needs_is_looked_at_all_the_same(clock: ManualClock, device: str):
    findings = report(encoder_patient(device), holding_maestro(), clock)
    assert failures(findings) == ["who answers"]
    expected = "an Arduino with armctl's encoder firmware is expected"
    assert findings["who answers"].seen == f"a Pololu Maestro answers, where {expected}"
    assert findings["error register"].verdict is Verdict.OK
    for check in ("channels", "ranges"):
        assert findings[check].verdict is Verdict.NOT_CHECKED
        assert findings[check].seen == "the robot file is for another kind of board"


def test_without_a_robot_the_channels_are_not_checked(clock: ManualClock, device: str):
    for board in (holding_maestro(), SimulatedFirmata(), SimulatedEncoderBoard()):
        findings = report(patient(device, info=None, expected=None, channels=()), board, clock)
        assert failures(findings) == []
        assert findings["channels"].seen == "no robot was named"
        assert findings["channels"].advice == "name one with --robot"


@pytest.mark.parametrize(
    ("expected", "advice"),
    [
        ("maestro", "USB Dual Port"),
        ("firmata", "StandardFirmata, Upload"),
        ("encoder", "flash armctl's encoder firmware"),
        (None, "if it should be an Arduino with StandardFirmata"),
    ],
)
def test_nobody_answers(clock: ManualClock, device: str, expected, advice):
    silent = SimulatedMaestro(settings=MaestroSettings(takes_usb=False))
    findings = report(patient(device, info=None, expected=expected), silent, clock)
    assert failures(findings) == ["who answers"]
    assert advice in findings["who answers"].advice
    skipped = Finding("round trips", "an earlier check failed", verdict=Verdict.NOT_CHECKED)
    assert findings["round trips"] == skipped


def refuse(baud: int) -> LoopTransport:
    raise PortError("port: cannot be opened")


@pytest.mark.parametrize(
    ("listing", "checks", "check", "words"),
    [
        ({}, PortChecks(lambda _: False, FREE.used_by, FREE.notes), "permission", "may not open"),
        (
            {},
            PortChecks(FREE.may_open, lambda _: "minicom (process 8)", FREE.notes),
            "other programs",
            "minicom (process 8) has it open",
        ),
        ({"why_not": "this is the Maestro's TTL port", "usable": False}, FREE, "right port", "TTL port"),
        ({}, FREE, "opens", "cannot be opened"),  # another user has it, say
    ],
)
def test_a_port_that_is_no_use(clock: ManualClock, device: str, listing, checks, check, words):
    findings = examine(patient(device, info=listed(device, **listing), checks=checks), refuse, clock.now)
    (failed,) = [finding for finding in findings if finding.verdict is Verdict.FAILED]
    assert failed.check == check
    assert words in failed.seen
    assert findings[-1].verdict is Verdict.NOT_CHECKED


@pytest.mark.parametrize("name", ["/dev/ttyACM99", "/dev/" + 300 * "a"])
def test_a_port_that_is_not_there(clock: ManualClock, name: str):
    port, *_ = examine(patient(name, info=None), refuse, clock.now)
    assert (port.seen, port.verdict) == (f"{name} does not exist", Verdict.FAILED)


def test_a_board_without_a_port_is_told_where_the_port_is_not_there(clock: ManualClock):
    taken = listed("USB 1-3", usable=False, why_not="brltty takes it", missing=True)
    port, other, *_ = examine(patient("/dev/ttyUSB99", info=None, missing=[taken]), refuse, clock.now)
    assert (port.check, other.check, other.verdict) == ("port", "other programs", Verdict.FAILED)
    assert other.seen == "USB 1-3: brltty takes it"


def test_a_socket_that_does_not_open(clock: ManualClock):
    port, opens, *_ = examine(Patient("socket://127.0.0.1:1", checks=FREE), refuse, clock.now)
    assert (port.verdict, opens.verdict) == (Verdict.OK, Verdict.FAILED)


def test_modem_manager_is_a_warning(clock: ManualClock, device: str):
    info = listed(device, notes=("ModemManager is running",))
    finding = report(patient(device, info=info), holding_maestro(), clock)["other programs"]
    assert (finding.verdict, finding.seen) == (Verdict.WARNING, "ModemManager is running")


@pytest.mark.parametrize("fault", [Fault.HALF_REPLY, Fault.GARBLE_REPLY])
def test_a_bad_line_moves_nothing(clock: ManualClock, device: str, fault):
    board = holding_maestro()
    faulty = FaultyModel(board)
    faulty.advance(clock.now())
    faulty.inject(fault, count=5)
    examine(patient(device), opener(faulty, clock), clock.now)
    assert board.target_us(0) == 1500.0


@pytest.mark.parametrize(
    ("times", "verdict", "seen"),
    [
        ([0.003] * 49 + [0.015], Verdict.OK, "50 questions answered, median 3.0 ms, worst 15.0 ms"),
        ([0.016] * 50, Verdict.WARNING, "median 16.0 ms"),
        ([0.002] * 47 + [0.03] * 3, Verdict.WARNING, "3 later than 20 ms"),
        ([0.002] * 2, Verdict.FAILED, "2 of 50 answered, then: no answer"),
    ],
)
def test_round_trips(clock: ManualClock, times: list[float], verdict: Verdict, seen: str):
    took = iter(times)

    def ask() -> None:
        if (time := next(took, None)) is None:
            raise BoardTimeoutError("no answer")
        clock.advance(time)

    finding = round_trips(ask, clock.now)
    assert finding.verdict is verdict
    assert seen in finding.seen
    assert ("latency timer" in finding.advice) == (verdict is Verdict.WARNING)


@pytest.mark.parametrize(
    ("text", "clean"),
    [
        ("link /home/ada/arm is gone", "link ~/arm is gone"),
        ("/home/ada", "~"),
        ("/home/adams/arm", "/home/adams/arm"),
        ("/media/ada/stick", "/media/<user>/stick"),
        ("socket://babbage.lan:5000", "socket://<host>:5000"),
        ("socket://babbage:5000", "socket://<host>:5000"),
        ("Pololu Micro Maestro, adapter", "Pololu Micro Maestro, adapter"),
    ],
)
def test_a_report_names_no_person_and_no_computer(text, clean):
    assert without_personal_data(text, "/home/ada", "babbage.lan", "ada") == clean


@pytest.mark.parametrize(("home", "host", "user"), [("/", "localhost", "root"), ("/root", "pi", "pi")])
def test_names_that_tell_nothing_or_are_parts_of_words_stay(home, host, user):
    text = "localhost: the supply of the pi is weak, /dev/ttyACM0, root"
    assert without_personal_data(text, home, host, user) == text
