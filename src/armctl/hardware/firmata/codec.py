"""Firmata messages, as bytes and back (Firmata protocol 2.x; StandardFirmata.ino).

Analog writes always use the extended form: the short one (``E0 | pin``) holds pins
up to 15 only, and a larger pin turns it into another command.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TypeAlias

from armctl.errors import InputError
from armctl.hardware.driver import ChannelScale

BAUD = 57_600
SCALE = ChannelScale("pin", "µs")
HOW_TO_LOAD = (
    "load the sketch: Arduino IDE, File > Examples > Firmata > StandardFirmata, Upload; then connect again"
)
SMALLEST_PULSE_US = 544
"""anything below is taken as degrees (the Servo library's MIN_PULSE_WIDTH)"""
LARGEST_PULSE_US = 2912
"""the longest limit that the Servo library can hold"""

_MAX_14_BIT = 0x3FFF
_MAX_PIN = 0x7F

_DEFAULT_MINIMUM_US = 544
_DEFAULT_MAXIMUM_US = 2400
_LIMIT_STEP_US = 4
_LIMIT_STEPS = 127


class Command(IntEnum):
    """Bytes that begin a message, in both directions."""

    DIGITAL_MESSAGE = 0x90
    REPORT_ANALOG = 0xC0
    REPORT_DIGITAL = 0xD0
    ANALOG_MESSAGE = 0xE0
    START_SYSEX = 0xF0
    SET_PIN_MODE = 0xF4
    SET_DIGITAL_PIN = 0xF5
    END_SYSEX = 0xF7
    REPORT_VERSION = 0xF9
    SYSTEM_RESET = 0xFF


class Sysex(IntEnum):
    """The byte after ``START_SYSEX``, in both directions."""

    CAPABILITY_QUERY = 0x6B
    CAPABILITY_RESPONSE = 0x6C
    PIN_STATE_QUERY = 0x6D
    PIN_STATE_RESPONSE = 0x6E
    EXTENDED_ANALOG = 0x6F
    SERVO_CONFIG = 0x70
    STRING_DATA = 0x71
    REPORT_FIRMWARE = 0x79


class PinMode(IntEnum):
    """What a pin may be set to; some boards know more modes than these."""

    INPUT = 0
    OUTPUT = 1
    ANALOG = 2
    PWM = 3
    SERVO = 4
    I2C = 6


CAPABILITY_RESPONSE_PIN_END = 0x7F


def version_query() -> bytes:
    """Ask for the protocol version.

    The only question that does no harm whatever the board has received before: inside an unfinished
    sysex it is one more data byte, and it does not end that sysex.
    """
    return bytes((Command.REPORT_VERSION,))


def firmware_query() -> bytes:
    """Ask for the sketch's name and version."""
    return _sysex(Sysex.REPORT_FIRMWARE)


def capability_query() -> bytes:
    """Ask for the modes of every pin."""
    return _sysex(Sysex.CAPABILITY_QUERY)


def pin_state_query(pin: int) -> bytes:
    """Ask for a pin's mode and the value last written to it."""
    _check("pin", pin, 0, _MAX_PIN)
    return _sysex(Sysex.PIN_STATE_QUERY, pin)


def pin_mode(pin: int, mode: PinMode) -> bytes:
    """Set a pin's mode; every mode but SERVO detaches a servo."""
    _check("pin", pin, 0, _MAX_PIN)
    return bytes((Command.SET_PIN_MODE, pin, mode))


def servo_config(pin: int, minimum_us: int, maximum_us: int) -> bytes:
    """Attach a servo with pulses limited to a range [µs].

    The pulses begin with the next servo frame, at 1500 µs or at whatever the sketch last sent there:
    the wanted width has to follow in the same burst.
    """
    _check("pin", pin, 0, _MAX_PIN)
    _check("minimum", minimum_us, 0, _MAX_14_BIT)
    _check("maximum", maximum_us, 0, _MAX_14_BIT)
    return _sysex(Sysex.SERVO_CONFIG, pin, *split_14_bits(minimum_us), *split_14_bits(maximum_us))


def servo_write(pin: int, pulse_us: int) -> bytes:
    """Set the pulse width of a servo pin [µs] with an extended analog write."""
    _check("pin", pin, 0, _MAX_PIN)
    _check("pulse width", pulse_us, SMALLEST_PULSE_US, LARGEST_PULSE_US)
    return _sysex(Sysex.EXTENDED_ANALOG, pin, *split_14_bits(pulse_us))


def servo_limits(minimum_us: int, maximum_us: int) -> tuple[int, int]:
    """The narrowest limits around a range [µs] that the board's Servo library can hold.

    It keeps their distances from 544 and 2400 µs in steps of 4 µs in a signed byte each and cuts
    towards zero; what does not fit wraps round to somewhere else.
    """
    lowest = max(_DEFAULT_MINIMUM_US, minimum_us)
    lowest = min(lowest, _DEFAULT_MINIMUM_US + _LIMIT_STEP_US * _LIMIT_STEPS)
    # Cutting towards zero would move a limit above 2400 inwards, so the next step up is taken.
    beyond = -(-(maximum_us - _DEFAULT_MAXIMUM_US) // _LIMIT_STEP_US)
    highest = _DEFAULT_MAXIMUM_US + _LIMIT_STEP_US * max(-_LIMIT_STEPS, beyond)
    return lowest, highest


def split_14_bits(value: int) -> tuple[int, int]:
    """Two data bytes of 7 bits, low one first."""
    return value & 0x7F, value >> 7


def _sysex(kind: Sysex, *data: int) -> bytes:
    return bytes((Command.START_SYSEX, kind, *data, Command.END_SYSEX))


def _check(what: str, value: int, lowest: int, highest: int) -> None:
    if not lowest <= value <= highest:
        raise InputError(f"{what} {value} is outside {lowest} … {highest} and cannot be sent")


# What a Firmata board sends: single bytes to whole messages.

_LONGEST_SYSEX = 8192
"""the capabilities of a Mega are about 700 bytes; anything this long is no Firmata"""
_SHORT_LENGTH = 3
_COMMAND_BIT = 0x80
_COMMAND_OF_CHANNEL = 0xF0


@dataclass(frozen=True, slots=True)
class VersionReport:
    """The protocol version: at boot unasked, later when asked."""

    major: int
    minor: int


@dataclass(frozen=True, slots=True)
class FirmwareReport:
    """The sketch's name and version: at boot unasked, later when asked."""

    major: int
    minor: int
    name: str


@dataclass(frozen=True, slots=True)
class CapabilityReport:
    """The modes that each pin knows, with their resolutions in bits, by pin number."""

    pins: tuple[dict[int, int], ...]

    def pins_with(self, mode: int) -> tuple[int, ...]:
        """The pins that know ``mode``, lowest first."""
        return tuple(pin for pin, modes in enumerate(self.pins) if mode in modes)


@dataclass(frozen=True, slots=True)
class PinState:
    """A pin's mode and the value last written to it."""

    pin: int
    mode: int
    value: int


@dataclass(frozen=True, slots=True)
class BoardText:
    """What the sketch says in words, mostly that it could not do something."""

    text: str


@dataclass(frozen=True, slots=True)
class Malformed:
    """A message that breaks off or makes no sense."""

    raw: bytes


Reply: TypeAlias = VersionReport | FirmwareReport | CapabilityReport | PinState | BoardText | Malformed


class ReplyParser:
    """Takes bytes as they come, in any pieces, and returns the messages that they complete.

    Reports of pins that nobody asked for (analog, digital) and sysexes of other sketches are left
    out. A message that is broken off by another one is ``Malformed``; the other one counts. Data
    bytes that belong to nothing are skipped and counted (``skipped``).
    """

    def __init__(self) -> None:
        self.skipped = 0
        """bytes so far that belonged to no message"""
        self._raw = bytearray()

    def feed(self, data: bytes) -> list[Reply]:
        """The messages that ``data`` completes, in order."""
        replies: list[Reply] = []
        for byte in data:
            if byte & _COMMAND_BIT:
                replies += self._push_command(byte)
            else:
                replies += self._push_data(byte)
        return replies

    def _push_command(self, byte: int) -> list[Reply]:
        raw = self._raw
        if byte == Command.END_SYSEX and raw and raw[0] == Command.START_SYSEX:
            self._raw = bytearray()
            return _decode(bytes(raw[1:]))
        broken: list[Reply] = [Malformed(bytes(raw))] if raw else []
        if byte == Command.START_SYSEX or _length(byte) is not None:
            self._raw = bytearray((byte,))
        else:
            self._raw = bytearray()
            self.skipped += 1
        return broken

    def _push_data(self, byte: int) -> list[Reply]:
        raw = self._raw
        if not raw:
            self.skipped += 1
            return []
        raw.append(byte)
        if raw[0] == Command.START_SYSEX:
            if len(raw) < _LONGEST_SYSEX:
                return []
            self._raw = bytearray()
            return [Malformed(bytes(raw))]
        if len(raw) != _length(raw[0]):
            return []
        self._raw = bytearray()
        return [VersionReport(raw[1], raw[2])] if raw[0] == Command.REPORT_VERSION else []


def _length(command: int) -> int | None:
    """Bytes of a message that is no sysex; None for a byte that begins none."""
    reported = command & _COMMAND_OF_CHANNEL in (Command.ANALOG_MESSAGE, Command.DIGITAL_MESSAGE)
    return _SHORT_LENGTH if reported or command == Command.REPORT_VERSION else None


def _decode(body: bytes) -> list[Reply]:
    """The message of a sysex without its frame; none for one that is of no use here."""
    if not body:
        return [Malformed(body)]
    data = body[1:]
    match body[0]:
        case Sysex.REPORT_FIRMWARE:
            decoded = _firmware(data)
        case Sysex.CAPABILITY_RESPONSE:
            decoded = _capabilities(data)
        case Sysex.PIN_STATE_RESPONSE:
            decoded = _pin_state(data)
        case Sysex.STRING_DATA:
            decoded = BoardText(_text(data)) if len(data) % 2 == 0 else None
        case _:
            return []
    return [decoded if decoded is not None else Malformed(body)]


def _firmware(data: bytes) -> FirmwareReport | None:
    if len(data) < 2 or len(data) % 2:
        return None
    return FirmwareReport(data[0], data[1], _text(data[2:]))


def _capabilities(data: bytes) -> CapabilityReport | None:
    if not data or data[-1] != CAPABILITY_RESPONSE_PIN_END:
        return None
    pins: list[dict[int, int]] = []
    for modes in data[:-1].split(bytes((CAPABILITY_RESPONSE_PIN_END,))):
        if len(modes) % 2:
            return None
        pins.append(dict(zip(modes[::2], modes[1::2], strict=True)))
    return CapabilityReport(tuple(pins))


def _pin_state(data: bytes) -> PinState | None:
    # Pin, mode, and the value in as many 7-bit bytes as it needs, low one first.
    if len(data) < 3:
        return None
    return PinState(data[0], data[1], sum(byte << 7 * place for place, byte in enumerate(data[2:])))


def _text(data: bytes) -> str:
    """Characters sent as two 7-bit bytes each."""
    codes = bytes((low | high << 7) & 0xFF for low, high in zip(data[::2], data[1::2], strict=True))
    return codes.decode("latin-1")
