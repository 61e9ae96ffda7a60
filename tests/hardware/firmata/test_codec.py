"""Golden bytes, written out by hand from the Firmata protocol 2.5."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import InputError
from armctl.hardware.firmata import codec
from armctl.hardware.firmata.codec import (
    AnalogReport,
    BoardText,
    CapabilityReport,
    DigitalReport,
    FirmwareReport,
    I2cReply,
    Malformed,
    PinMode,
    PinState,
    ReplyParser,
    VersionReport,
)
from armctl.hardware.firmata.simulated import SimulatedServo


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (codec.VERSION_QUERY, "f9"),
        (codec.FIRMWARE_QUERY, "f0 79 f7"),
        (codec.CAPABILITY_QUERY, "f0 6b f7"),
        (codec.pin_state_query(9), "f0 6d 09 f7"),
        (codec.pin_mode(9, PinMode.SERVO), "f4 09 04"),
        (codec.pin_mode(22, PinMode.OUTPUT), "f4 16 01"),
        (codec.servo_config(9, 544, 2400), "f0 70 09 20 04 60 12 f7"),  # 544 = 4·128 + 32, 2400 = 18·128 + 96
        (codec.servo_write(9, 1500), "f0 6f 09 5c 0b f7"),  # 1500 = 11·128 + 92
        (codec.servo_write(22, 544), "f0 6f 16 20 04 f7"),
        (codec.servo_write(127, 2912), "f0 6f 7f 60 16 f7"),
        (codec.I2C_START, "f0 78 00 00 f7"),
        (codec.i2c_write(0x40, b"\xfe\x79"), "f0 76 40 00 7e 01 79 00 f7"),
        (codec.i2c_read(0x40, 0xFE, 1), "f0 76 40 08 7e 01 01 00 f7"),
        (codec.i2c_read(0x41, None, 1), "f0 76 41 08 01 00 f7"),
    ],
)
def test_bytes(message: bytes, expected: str):
    assert message.hex(" ") == expected


@pytest.mark.parametrize(
    ("message", "says"),
    [
        *(
            (lambda pulse_us=pulse_us: codec.servo_write(9, pulse_us), f"{pulse_us} is outside 544 … 2912")
            for pulse_us in (0, 90, 180, 543, 2913, -1)  # degrees to the sketch, or cut by it
        ),
        (lambda: codec.servo_write(128, 1500), "pin 128 is outside 0 … 127"),
        (lambda: codec.servo_config(-1, 544, 2400), "pin -1 is outside 0 … 127"),
        (lambda: codec.pin_state_query(128), "pin 128 is outside 0 … 127"),
        (lambda: codec.i2c_write(128, b""), "I²C address 128 is outside 0 … 127"),
        (lambda: codec.i2c_read(-1, 0, 1), "I²C address -1 is outside 0 … 127"),
        (lambda: codec.pin_mode(128, PinMode.OUTPUT), "pin 128 is outside 0 … 127"),
    ],
)
def test_what_does_not_fit_is_refused(message, says: str):
    with pytest.raises(InputError, match=says):
        message()


@given(st.integers(544, 2912), st.integers(544, 2912), st.integers(544, 2912))
def test_the_boards_own_limits_never_cut_a_pulse_inside_the_range(low: int, middle: int, high: int):
    low, middle, high = sorted((low, middle, high))
    servo = SimulatedServo()
    servo.attach(*codec.servo_limits(low, high))
    servo.write(middle)
    assert servo.width_us == middle


@given(st.integers(544, 1052), st.integers(1892, 2900))
def test_the_boards_own_limits_are_within_3_us_of_a_range_that_it_can_hold(low: int, high: int):
    servo = SimulatedServo()
    servo.attach(*codec.servo_limits(low, high))
    servo.write(544)
    assert low - 3 <= servo.width_us <= low
    servo.write(3000)
    assert high <= servo.width_us <= high + 3


VERSION = "f9 02 05"
FIRMWARE = "f0 79 02 05 41 00 2e 00 69 00 6e 00 6f 00 f7"
CAPABILITIES = "f0 6c 7f 7f 00 01 0b 01 01 01 03 08 04 0e 7f 00 01 02 0a 7f f7"
STATE = "f0 6e 16 04 5c 0b f7"
TEXT = "f0 71 48 00 69 01 f7"

GOLDEN = [
    (VERSION, VersionReport(2, 5)),
    (FIRMWARE, FirmwareReport(2, 5, "A.ino")),
    ("f0 79 02 03 f7", FirmwareReport(2, 3, "")),
    (CAPABILITIES, CapabilityReport(({}, {}, {0: 1, 11: 1, 1: 1, 3: 8, 4: 14}, {0: 1, 2: 10}))),
    (STATE, PinState(22, 4, 1500)),
    ("f0 6e 09 01 00 f7", PinState(9, 1, 0)),
    ("f0 6e 0c 04 55 70 7f f7", PinState(12, 4, 0x55 + 0x70 * 128 + 0x7F * 16384)),
    (TEXT, BoardText("Hé")),
    ("f0 77 40 00 7e 01 79 00 f7", I2cReply(0x40, 0xFE, b"\x79")),
    ("f0 77 40 00 00 00 f7", I2cReply(0x40, 0, b"")),
]


@pytest.mark.parametrize(("raw", "expected"), GOLDEN)
def test_golden_messages(raw: str, expected):
    assert ReplyParser().feed(bytes.fromhex(raw)) == [expected]


@pytest.mark.parametrize(
    "raw",
    [
        "f0 7a 01 f7",  # a sysex that is of no use here
        b"hello\xf7\xff".hex(),  # stray bytes
    ],
)
def test_what_is_of_no_use_is_left_out(raw: str):
    assert ReplyParser().feed(bytes.fromhex(f"{raw} {STATE}")) == [PinState(22, 4, 1500)]


def test_reports_of_pins_are_read() -> None:
    said = bytes.fromhex("E3 12 01 91 55 01 EF 7F 07")
    assert ReplyParser().feed(said) == [AnalogReport(3, 146), DigitalReport(1, 0xD5), AnalogReport(15, 1023)]


def test_pins_are_set_and_reported_with_the_bytes_of_the_protocol() -> None:
    assert codec.digital_write(2, 0b1000_0001).hex(" ") == "92 01 01"
    assert codec.report_digital(2).hex(" ") == "d2 01"
    assert codec.report_analog(15).hex(" ") == "cf 01"
    assert codec.sampling_interval(10).hex(" ") == "f0 7a 0a 00 f7"
    assert codec.pwm_write(44, 200).hex(" ") == "f0 6f 2c 48 01 f7"
    assert codec.pin_mode(22, PinMode.INPUT_PULLUP).hex(" ") == "f4 16 0b"
    with pytest.raises(InputError, match="port or channel 16 is outside 0 … 15"):
        codec.report_digital(16)


def test_a_message_broken_off_by_another_costs_only_itself():
    assert ReplyParser().feed(bytes.fromhex(f"f0 6e 16 04 {VERSION} f9 02 {STATE}")) == [
        Malformed(bytes.fromhex("f0 6e 16 04")),
        VersionReport(2, 5),
        Malformed(bytes.fromhex("f9 02")),
        PinState(22, 4, 1500),
    ]


@pytest.mark.parametrize(
    "body",
    [
        "",
        *("79 02", "79 02 05 41"),
        *("6c", "6c 7f 00", "6c 7f 00 7f"),
        *("6e 09", "6e 09 04", "6e"),
        *("71 48", "71 02 03 48 00"),
        *("77 40 00", "77 40 00 00 00 01"),
    ],
)
def test_a_message_that_makes_no_sense(body: str):
    raw = bytes.fromhex(body)
    assert ReplyParser().feed(b"\xf0" + raw + b"\xf7") == [Malformed(raw)]


def test_a_name_with_a_wrong_bit_is_no_version():
    name = "02 03 53 00 f7"
    assert ReplyParser().feed(bytes.fromhex(f"f0 f9 {name} {VERSION}")) == [
        Malformed(b"\xf0"),
        VersionReport(2, 5),
    ]


def test_a_sysex_without_an_end_is_given_up():
    (reply,) = ReplyParser().feed(b"\xf0" + b"\x00" * 10_000)
    assert isinstance(reply, Malformed)


@given(st.lists(st.sampled_from(GOLDEN), max_size=8), st.data())
def test_any_split_gives_the_same_messages(messages, data):
    raw = b"".join(bytes.fromhex(text) for text, _ in messages)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(raw)), max_size=10)))
    parser, replies = ReplyParser(), []
    for start, end in zip([0, *cuts], [*cuts, len(raw)], strict=True):
        replies += parser.feed(raw[start:end])
    assert replies == [expected for _, expected in messages]


GARBAGE = st.binary(max_size=12).filter(lambda data: not data.endswith(b"\xf0"))
"""a version right after that byte would be a name with a wrong bit"""


@given(st.lists(st.tuples(st.sampled_from(GOLDEN), GARBAGE), max_size=6))
def test_after_any_garbage_the_next_message_is_understood(parts):
    parser = ReplyParser()
    for (raw, expected), garbage in parts:
        parser.feed(garbage)
        # An unfinished message may swallow the first bytes of one that begins with data; these begin with
        # a command byte, which ends it.
        replies = parser.feed(bytes.fromhex(raw))
        assert replies[-1] == expected
