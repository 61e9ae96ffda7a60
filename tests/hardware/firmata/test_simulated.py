"""The fake sketch, byte for byte: what StandardFirmata 2.3 answers, and what its servos then send."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.avr.conformance import Check, ModelLine
from tests.avr.firmata_conformance import CONFORMANCE, REPORT

from armctl.errors import InputError
from armctl.hardware.firmata.codec import BoardText, I2cReply, ReplyParser
from armctl.hardware.firmata.simulated import SimulatedFirmata, SimulatedServo

NAME = "StandardFirmata.ino".encode("utf-16-le").hex(" ")
ON_AT_1500 = "f0 70 09 20 04 60 12 f7 f0 6f 09 5c 0b f7"


def running() -> SimulatedFirmata:
    board = SimulatedFirmata()
    board.advance(0.0)
    return board


def say(board: SimulatedFirmata, text: str) -> str:
    return board.feed(bytes.fromhex(text)).hex(" ")


def widths(board: SimulatedFirmata, pin: int) -> list[int]:
    return [pulse.width_us for pulse in board.pulses(pin)]


def test_it_reports_itself_when_it_has_started_and_is_deaf_before():
    board = SimulatedFirmata(boot_s=1.7)
    assert board.advance(10.0) == b""
    assert board.feed(b"\xf9") == b""
    assert board.advance(11.69) == b""
    assert board.advance(11.71).hex(" ") == f"f9 02 03 f0 79 02 03 {NAME} f7"
    assert board.advance(11.72) == b""
    assert say(board, "f9") == "f9 02 03"


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (f"{ON_AT_1500} f4 09 00 f0 6d 09 f7", "f0 6e 09 00 00 f7"),
        ("f0 70 09 20 04 60 f7 f0 6d 09 f7", "f0 6e 09 01 00 f7"),  # too short
        ("f0 6f 09 f7 f0 6d f7 f0 f7", ""),
        ("f0" + "01" * 64 + "f7 f9", "f9 02 03"),  # all that it can keep
        ("c3 01 f9", "f9 02 03"),  # the report of an analog pin switched on
        ("f4 09 f4 09 04 f0 6d 09 f7", "f0 6e 09 04 00 f7"),  # a command ends an unfinished one
        ("f4 09 f9 04 f0 6d 09 f7", "f9 02 03 f0 6e 09 04 00 f7"),  # the version in between does not
    ],
)
def test_answers(command: str, answer: str):
    assert say(running(), command) == answer


class OneChip:
    """An I²C chip at 0x40 that gives back its register's number, counted up."""

    def __init__(self) -> None:
        self.written: list[str] = []

    def __call__(self, address: int, data: bytes, count: int) -> bytes | None:
        if address != 0x40:
            return None
        self.written.append(data.hex(" "))
        start = data[0] if data else 0
        return bytes((start + k) % 256 for k in range(count))


def test_i2c():
    chip = OneChip()
    board = SimulatedFirmata(i2c=chip)
    board.advance(0.0)
    board.feed(b"")
    assert say(board, "f0 76 40 08 00 00 01 00 f7") == "", "not before its pins are given to I²C"
    assert say(board, "f0 78 00 00 f7 f0 6d 14 f7") == "f0 6e 14 06 00 f7"
    assert say(board, "f0 76 40 00 06 00 7f 01 f7") == ""
    assert say(board, "f0 76 40 08 7e 01 02 00 f7") == "f0 77 40 00 7e 01 7e 01 7f 01 f7"
    assert say(board, "f0 76 40 08 01 00 f7") == "f0 77 40 00 00 00 00 00 f7"
    assert chip.written == ["06 ff", "fe", ""]
    assert say(board, f"f0 76 40 00 {'06 00 ' * 15} f7 f9") == "f9 02 03"
    assert len(chip.written) == 3, "a sysex of 33 bytes is dropped"


def test_where_nobody_answers_it_says_so_and_sends_what_it_read_before():
    board = SimulatedFirmata(i2c=OneChip())
    board.advance(0.0)
    say(board, "f0 78 00 00 f7 f0 76 40 08 05 00 01 00 f7")
    text, reply = ReplyParser().feed(bytes.fromhex(say(board, "f0 76 41 08 09 00 01 00 f7")))
    assert text == BoardText("I2C Read Error: Too many bytes received")  # the sketch's own mistake
    assert reply == I2cReply(0x40, 5, b"\x05")
    assert say(board, "f0 76 41 00 00 00 f7") == ""


@pytest.mark.parametrize("check", CONFORMANCE, ids=lambda check: check.__name__)
def test_conformance(check: Check):
    line = ModelLine(SimulatedFirmata(), 0.001)
    assert line.exchange(b"", 2.0) == REPORT
    check(line)


def test_config_alone_sends_1500_with_the_next_frame():
    board = running()
    say(board, "f0 70 09 20 04 60 12 f7")
    board.advance(0.019)
    assert widths(board, 9) == []
    board.advance(0.021)
    assert widths(board, 9) == [1500]
    say(board, "f0 6f 09 68 07 f7")
    board.advance(0.05)
    assert widths(board, 9) == [1500, 1000]
    assert [pulse.time for pulse in board.pulses(9)] == pytest.approx([0.02, 0.04])


@pytest.mark.parametrize("off", ["f4 09 00", "f4 09 01", "ff"])
def test_pulses_go_on_until_it_is_off(off: str):
    board = running()
    say(board, ON_AT_1500)
    board.advance(60.0)
    assert len(board.pulses(9)) == 3000
    say(board, off)
    board.advance(61.0)
    assert len(board.pulses(9)) == 3000


def test_only_the_last_pulses_are_kept_however_long_it_was_not_looked_at():
    board = SimulatedFirmata(log_length=10)
    board.advance(0.0)
    say(board, ON_AT_1500)
    board.advance(3600.0)
    assert len(board.pulses(9)) == 10
    assert board.pulses(9)[-1].time == pytest.approx(3600.0)


@pytest.mark.parametrize(
    ("command", "width_us"),
    [
        ("f0 70 09 20 04 60 12 f7 f0 6f 09 5a 00 f7", 1472),  # below 544: degrees
        (f"{ON_AT_1500} e9 68 07", 1000),  # a short analog write, to a pin up to 15
        (f"{ON_AT_1500} f0 6f 09 68 07 f7 f4 09 01 f0 70 09 20 04 60 12 f7", 1000),  # what it sent last
    ],
)
def test_the_width_that_a_servo_begins_with(command: str, width_us: int):
    board = running()
    say(board, command)
    board.advance(0.02)
    assert widths(board, 9) == [width_us]


def test_a_sysex_without_its_end_executes_a_wrong_value():
    board = running()
    say(board, f"{ON_AT_1500} f0 6f 09 5c f0 6f 0a 5c 0b f7")
    board.advance(0.02)
    # 5c + (f0 << 7) + (6f << 14) in 16 bits is negative, and anything below 0 is 0 degrees.
    assert widths(board, 9) == [544]
    assert say(board, "f0 6d 09 f7") == "f0 6e 09 04 5c 70 7f f7"


def test_a_restart_forgets_everything():
    board = running()
    say(board, ON_AT_1500)
    board.advance(0.1)
    board.reset()
    assert board.advance(1.0).hex(" ").startswith("f9 02 03 f0 79")
    assert say(board, "f0 6d 09 f7") == "f0 6e 09 01 00 f7"
    assert len(board.pulses(9)) == 5


def test_a_sysex_too_long_crashes_it_until_the_reset_button():
    board = running()
    assert say(board, "f0" + "01" * 65 + "f7 f9") == ""
    assert say(board, "f9") == ""
    board.reset()
    board.advance(1.0)
    assert say(board, "f9") == "f9 02 03"


@pytest.mark.parametrize("pin", [-1, 70])
def test_a_pin_that_a_mega_has_not(pin: int):
    board = running()
    for look in (board.pulses, board.mode):
        with pytest.raises(InputError, match=f"pin {pin}: a Mega has pins 0 … 69"):
            look(pin)


@given(st.lists(st.binary(max_size=60), max_size=20))
def test_any_bytes_are_taken_and_every_pulse_stays_what_a_servo_can_send(bursts: list[bytes]):
    board = running()
    say(board, ON_AT_1500)
    for step, burst in enumerate(bursts):
        ReplyParser().feed(board.feed(burst))
        board.advance(0.02 * step)
    for pin in range(70):
        assert all(0 < pulse.width_us <= 2912 for pulse in board.pulses(pin))


# Figures worked out from Servo.cpp: limits in steps of 4 µs in a signed byte, degrees below 544.


@pytest.mark.parametrize(
    ("value", "width_us"),
    [
        (-5, 544),
        (0, 544),
        (90, 1472),
        (180, 2400),
        (200, 2400),
        (543, 2400),
        (544, 544),
        (1234, 1234),
        (9999, 2400),
    ],
)
def test_degrees_below_544_and_microseconds_from_there(value: int, width_us: int):
    servo = SimulatedServo()
    servo.attach()
    assert servo.width_us == 1500
    servo.write(value)
    assert servo.width_us == width_us
    servo.attach(1000, 2000)  # attached again, it keeps the width
    assert servo.width_us == width_us


@pytest.mark.parametrize(
    ("limits", "shortest", "longest"),
    [
        ((1000, 2000), 1000, 2000),
        ((1002, 2001), 1000, 2004),  # cut towards 544 and 2400
        ((1000, 1800), 1000, 2824),  # 600 µs below 2400 do not fit: wrapped round
        ((1100, 2000), 76, 2000),
    ],
)
def test_limits(limits: tuple[int, int], shortest: int, longest: int):
    servo = SimulatedServo()
    servo.attach(*limits)
    servo.write(544)
    assert servo.width_us == max(shortest, 544)
    servo.write(3000)
    assert servo.width_us == longest
    servo.write(0)
    assert servo.width_us == shortest
