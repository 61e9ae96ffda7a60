"""What a Mega with StandardFirmata answers, to the byte: for the real image and for what stands in for it.

Each function of ``CONFORMANCE`` wants a freshly started board that has reported itself and whose report
has been read. The bytes expected here are the ones of StandardFirmata 2.3 as others built it.
"""

from __future__ import annotations

from tests.avr.conformance import Line, checks

VERSION = bytes.fromhex("F9 02 03")
FIRMWARE = b"\xf0\x79\x02\x03" + b"".join(bytes((code, 0)) for code in b"StandardFirmata.ino") + b"\xf7"
REPORT = VERSION + FIRMWARE
"""what the board sends unasked when it has started"""

PINS = 70
SERIAL_PINS = (0, 1)
SERVO_PINS = range(2, 50)
PWM_PINS = (*range(2, 14), 44, 45, 46)
ANALOG_PINS = range(54, 70)

_SETTLE_S = 0.05
_LONG_S = 0.5


def the_version_is_told(line: Line) -> None:
    assert line.exchange(b"\xf9", _SETTLE_S) == VERSION


def the_firmware_is_told(line: Line) -> None:
    assert line.exchange(bytes.fromhex("F0 79 F7"), _SETTLE_S) == FIRMWARE


def the_capabilities_are_told(line: Line) -> None:
    expected = bytearray(b"\xf0\x6c")
    for pin in range(PINS):
        expected += _modes(pin) + b"\x7f"
    assert line.exchange(bytes.fromhex("F0 6B F7"), _LONG_S) == bytes(expected + b"\xf7")


def the_analog_channels_are_told(line: Line) -> None:
    """Clients such as firmata-io are ready once they have this."""
    channels = bytes(pin - ANALOG_PINS.start if pin in ANALOG_PINS else 127 for pin in range(PINS))
    assert line.exchange(bytes.fromhex("F0 69 F7"), _LONG_S) == b"\xf0\x6a" + channels + b"\xf7"


def pins_start_as_outputs_or_analog_inputs(line: Line) -> None:
    for pin in range(PINS):
        mode = 0 if pin in SERIAL_PINS else 2 if pin in ANALOG_PINS else 1
        assert _state(line, pin) == bytes((pin, mode, 0))


def a_pin_beyond_the_board_has_no_state(line: Line) -> None:
    for pin in (PINS, 100, 127):
        assert _state(line, pin) == bytes((pin,))


def a_configured_servo_has_its_mode_and_then_its_width(line: Line) -> None:
    for pin in (2, 13, 14, 15, 16, 22, 49):
        assert line.exchange(_servo_config(pin, 544, 2400), _SETTLE_S) == b""
        assert _state(line, pin) == bytes((pin, 4, 0))
        for width in (544, 1500, 2047, 2048, 2400):
            assert line.exchange(_write(pin, width), _SETTLE_S) == b""
            assert _state(line, pin) == bytes((pin, 4, width & 0x7F, width >> 7))


def the_servo_mode_alone_attaches_too(line: Line) -> None:
    line.exchange(bytes((0xF4, 44, 4)), _SETTLE_S)
    line.exchange(_write(44, 1234), _SETTLE_S)
    assert _state(line, 44) == bytes((44, 4, 1234 & 0x7F, 1234 >> 7))


def a_config_keeps_no_earlier_width(line: Line) -> None:
    line.exchange(_servo_config(22, 544, 2400) + _write(22, 2000), _SETTLE_S)
    line.exchange(_servo_config(22, 544, 2400), _SETTLE_S)
    assert _state(line, 22) == bytes((22, 4, 0))


def the_output_mode_ends_a_servo(line: Line) -> None:
    line.exchange(_servo_config(5, 544, 2400) + _write(5, 2000), _SETTLE_S)
    assert line.exchange(bytes.fromhex("F4 05 01"), _SETTLE_S) == b""
    assert _state(line, 5) == bytes((5, 1, 0))


def a_write_to_a_pin_that_is_no_servo_is_ignored(line: Line) -> None:
    line.exchange(_write(22, 1500), _SETTLE_S)
    assert _state(line, 22) == bytes((22, 1, 0))


def a_pin_that_cannot_drive_a_servo_stays_as_it_is(line: Line) -> None:
    for pin in (0, 1, 50, 53):
        before = _state(line, pin)
        line.exchange(_servo_config(pin, 544, 2400) + _write(pin, 1500), _SETTLE_S)
        assert _state(line, pin) == before


def a_short_write_reaches_pins_up_to_15_only(line: Line) -> None:
    line.exchange(_servo_config(9, 544, 2400) + bytes((0xE9, 1700 & 0x7F, 1700 >> 7)), _SETTLE_S)
    assert _state(line, 9) == bytes((9, 4, 1700 & 0x7F, 1700 >> 7))


def a_reset_sets_every_pin_back(line: Line) -> None:
    line.exchange(_servo_config(2, 544, 2400) + _write(2, 2000), _SETTLE_S)
    line.exchange(_servo_config(44, 544, 2400) + _write(44, 2000), _SETTLE_S)
    assert line.exchange(b"\xff", _SETTLE_S) == b""
    assert _state(line, 2) == bytes((2, 1, 0))
    assert _state(line, 44) == bytes((44, 1, 0))
    assert line.exchange(b"\xf9", _SETTLE_S) == VERSION


def an_analog_channel_is_reported_until_it_is_switched_off(line: Line) -> None:
    assert line.exchange(b"", _LONG_S) == b""  # unasked it reports nothing
    assert _reports(line.exchange(bytes.fromhex("C3 01"), _LONG_S)) == {3: (26, 26)}
    assert _reports(line.exchange(bytes.fromhex("CF 01"), _LONG_S)) == {3: (26, 27), 15: (26, 27)}
    assert _reports(line.exchange(bytes.fromhex("C3 00"), _LONG_S)) == {15: (26, 27)}
    line.exchange(b"\xff", _SETTLE_S)
    assert line.exchange(b"", _LONG_S) == b""


def the_sampling_interval_is_10_ms_or_more(line: Line) -> None:
    line.exchange(bytes.fromhex("C0 01 F0 7A 64 00 F7"), _LONG_S)
    assert _reports(line.exchange(b"", 1.0)) == {0: (9, 11)}
    line.exchange(bytes.fromhex("F0 7A 01 00 F7"), _LONG_S)
    assert _reports(line.exchange(b"", 1.0)) == {0: (99, 101)}


def the_analog_mode_switches_its_report_on_and_another_one_off(line: Line) -> None:
    assert _reports(line.exchange(bytes.fromhex("F4 36 02"), _LONG_S)) == {0: (26, 26)}
    assert line.exchange(bytes.fromhex("F4 36 01"), _SETTLE_S)[3:] == b""
    assert line.exchange(b"", _LONG_S) == b""


def an_unknown_mode_is_answered_in_words(line: Line) -> None:
    words = b"".join(bytes((code, 0)) for code in b"Unknown pin mode")
    for mode in (5, 11, 126):
        assert line.exchange(bytes((0xF4, 2, mode)), _SETTLE_S) == b"\xf0\x71" + words + b"\xf7"
        assert _state(line, 2) == bytes((2, 1, 0))


def an_unknown_sysex_is_ignored(line: Line) -> None:
    assert line.exchange(bytes.fromhex("F0 01 02 F7"), _SETTLE_S) == b""
    assert line.exchange(b"\xf9", _SETTLE_S) == VERSION


def data_bytes_that_belong_to_nothing_are_ignored(line: Line) -> None:
    assert line.exchange(bytes(range(0x20, 0x60)), _SETTLE_S) == b""
    assert line.exchange(b"\xf9", _SETTLE_S) == VERSION


def commands_inside_a_sysex_are_its_data(line: Line) -> None:
    line.exchange(_servo_config(2, 544, 2400) + _write(2, 2000), _SETTLE_S)
    assert line.exchange(b"\xf0\x01\xf9\xff\xf9\xf7", _SETTLE_S) == b""
    assert _state(line, 2) == bytes((2, 4, 2000 & 0x7F, 2000 >> 7))


def a_question_a_byte_at_a_time_is_the_same_question(line: Line) -> None:
    got = b"".join(line.exchange(bytes((byte,)), 0.01) for byte in bytes.fromhex("F0 6D 02 F7"))
    assert got + line.exchange(b"", _SETTLE_S) == bytes.fromhex("F0 6E 02 01 00 F7")


def questions_in_one_burst_are_answered_in_order(line: Line) -> None:
    pins = (2, 54, 22, 13, 0)
    question = b"".join(bytes((0xF0, 0x6D, pin, 0xF7)) for pin in pins)
    answers = b"".join(b"\xf0\x6e" + _state(line, pin) + b"\xf7" for pin in pins)
    assert line.exchange(question, _LONG_S) == answers


class _Count:
    """A number of reports that is one of two next to each other, or between."""

    def __init__(self, count: int) -> None:
        self.count = count

    def __eq__(self, other: object) -> bool:
        assert isinstance(other, tuple)
        low, high = other
        return low <= self.count <= high

    def __repr__(self) -> str:
        return f"{self.count} reports"


def _reports(said: bytes) -> dict[int, _Count]:
    """How many reports of each analog channel these bytes are, and they are nothing else."""
    counts: dict[int, int] = {}
    assert len(said) % 3 == 0
    for command, low, high in zip(said[::3], said[1::3], said[2::3], strict=True):
        assert command & 0xF0 == 0xE0 and low < 128 and high < 8
        counts[command & 0x0F] = counts.get(command & 0x0F, 0) + 1
    return {channel: _Count(count) for channel, count in counts.items()}


def _modes(pin: int) -> bytes:
    """A pin's modes with their resolutions in bits, as the capabilities tell them."""
    if pin in SERIAL_PINS:
        return b""
    modes = bytes((0, 1, 1, 1))
    if pin in ANALOG_PINS:
        modes += bytes((2, 10))
    if pin in PWM_PINS:
        modes += bytes((3, 8))
    if pin in SERVO_PINS:
        modes += bytes((4, 14))
    return modes + bytes((6, 1)) if pin in (20, 21) else modes


def _state(line: Line, pin: int) -> bytes:
    """The body of the answer to a question for a pin's state."""
    answer = line.exchange(bytes((0xF0, 0x6D, pin, 0xF7)), _SETTLE_S)
    assert answer[:2] == b"\xf0\x6e"
    assert answer[-1:] == b"\xf7"
    return answer[2:-1]


def _servo_config(pin: int, lowest: int, highest: int) -> bytes:
    return bytes((0xF0, 0x70, pin, lowest & 0x7F, lowest >> 7, highest & 0x7F, highest >> 7, 0xF7))


def _write(pin: int, width: int) -> bytes:
    return bytes((0xF0, 0x6F, pin, width & 0x7F, width >> 7, 0xF7))


CONFORMANCE = checks(globals())
