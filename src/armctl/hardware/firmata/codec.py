"""Firmata messages, as bytes and back (Firmata protocol 2.x; StandardFirmata.ino).

Analog writes always use the extended form: the short one (``E0 | pin``) holds pins
up to 15 only, and a larger pin turns it into another command.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TypeAlias

from armctl.errors import InputError
from armctl.hardware.firmata import LARGEST_PULSE_US, SMALLEST_PULSE_US
from armctl.lazy_dataclass import dataclass

_MAX_14_BIT = 0x3FFF
_MAX_PIN = 0x7F
_MAX_I2C_ADDRESS = 0x7F


class MessageStart(IntEnum):
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

    ANALOG_MAPPING_QUERY = 0x69
    ANALOG_MAPPING_RESPONSE = 0x6A
    CAPABILITY_QUERY = 0x6B
    CAPABILITY_RESPONSE = 0x6C
    PIN_STATE_QUERY = 0x6D
    PIN_STATE_RESPONSE = 0x6E
    EXTENDED_ANALOG = 0x6F
    SERVO_CONFIG = 0x70
    STRING_DATA = 0x71
    I2C_REQUEST = 0x76
    I2C_REPLY = 0x77
    I2C_CONFIG = 0x78
    REPORT_FIRMWARE = 0x79
    SAMPLING_INTERVAL = 0x7A


class PinMode(IntEnum):
    """What a pin may be set to; some boards know more modes than these."""

    INPUT = 0
    OUTPUT = 1
    ANALOG = 2
    PWM = 3
    SERVO = 4
    I2C = 6
    INPUT_PULLUP = 11


END_OF_PIN = 0x7F
"""in the answer to a capability query"""


def sysex(kind: Sysex, *data: int) -> bytes:
    """A message of any length, of data bytes of 7 bits."""
    return bytes((MessageStart.START_SYSEX, kind, *data, MessageStart.END_SYSEX))


VERSION_QUERY = bytes((MessageStart.REPORT_VERSION,))
"""the only question that does no harm whatever the board has received before: inside an unfinished sysex it
is one more data byte, and it does not end that sysex"""
FIRMWARE_QUERY = sysex(Sysex.REPORT_FIRMWARE)
"""for the sketch's name and version"""
CAPABILITY_QUERY = sysex(Sysex.CAPABILITY_QUERY)
"""for the modes of every pin"""


def pin_state_query(pin: int) -> bytes:
    """Ask for a pin's mode and the value last written to it."""
    _check("pin", pin, 0, _MAX_PIN)
    return sysex(Sysex.PIN_STATE_QUERY, pin)


def pin_mode(pin: int, mode: PinMode) -> bytes:
    """Set a pin's mode; every mode but SERVO detaches a servo."""
    _check("pin", pin, 0, _MAX_PIN)
    return bytes((MessageStart.SET_PIN_MODE, pin, mode))


def pin_low(pin: int) -> bytes:
    """Set a pin low that is an output; sketches before protocol 2.5 ignore it."""
    _check("pin", pin, 0, _MAX_PIN)
    return bytes((MessageStart.SET_DIGITAL_PIN, pin, 0))


def servo_config(pin: int, minimum_us: int, maximum_us: int) -> bytes:
    """Attach a servo with pulses limited to a range [µs].

    The pulses begin with the next servo frame, at 1500 µs or at whatever the sketch last sent there:
    the wanted width has to follow in the same burst.
    """
    _check("pin", pin, 0, _MAX_PIN)
    _check("minimum", minimum_us, 0, _MAX_14_BIT)
    _check("maximum", maximum_us, 0, _MAX_14_BIT)
    return sysex(Sysex.SERVO_CONFIG, pin, *split_14_bits(minimum_us), *split_14_bits(maximum_us))


def servo_write(pin: int, pulse_us: int) -> bytes:
    """Set the pulse width of a servo pin [µs] with an extended analog write."""
    _check("pin", pin, 0, _MAX_PIN)
    _check("pulse width", pulse_us, SMALLEST_PULSE_US, LARGEST_PULSE_US)
    return sysex(Sysex.EXTENDED_ANALOG, pin, *split_14_bits(pulse_us))


PORT, PWM_FULL, ANALOG_FULL = 8, 255, 1023
"""pins that are written and reported together; the largest value of a PWM pin, and of an analog one"""


def digital_write(port: int, bits: int) -> bytes:
    """Set the pins of a port that are outputs; one that is an input is pulled up where its bit is set."""
    return _of_port(MessageStart.DIGITAL_MESSAGE, port, *split_14_bits(bits))


def report_digital(port: int) -> bytes:
    """Have every change of a port's inputs reported."""
    return _of_port(MessageStart.REPORT_DIGITAL, port, 1)


def report_analog(channel: int) -> bytes:
    """Have an analog channel reported in each round of sampling."""
    return _of_port(MessageStart.REPORT_ANALOG, channel, 1)


def sampling_interval(milliseconds: int) -> bytes:
    """How often analog channels are reported [ms]."""
    return sysex(Sysex.SAMPLING_INTERVAL, *split_14_bits(milliseconds))


def pwm_write(pin: int, value: int) -> bytes:
    """Set the share of a PWM pin, 0 ... 255."""
    _check("pin", pin, 0, _MAX_PIN)
    _check("PWM value", value, 0, PWM_FULL)
    return sysex(Sysex.EXTENDED_ANALOG, pin, *split_14_bits(value))


def _of_port(start: MessageStart, number: int, *data: int) -> bytes:
    """A message whose first byte has a number 0 ... 15 in it."""
    _check("port or channel", number, 0, 15)
    return bytes((start | number, *data))


_DEFAULT_MINIMUM_US, _DEFAULT_MAXIMUM_US = 544, 2400
_LIMIT_STEP_US, _LIMIT_STEPS = 4, 127


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


I2C_START = sysex(Sysex.I2C_CONFIG, 0, 0)
"""give the sketch its I²C pins; no pause between the register of a question and its answer"""
I2C_READ = 0b0000_1000


def i2c_write(address: int, data: bytes) -> bytes:
    """One I²C transfer: a register, and what goes there and behind. Whether anybody took it is not told."""
    _check("I²C address", address, 0, _MAX_I2C_ADDRESS)
    return sysex(Sysex.I2C_REQUEST, address, 0, *(half for byte in data for half in split_14_bits(byte)))


def i2c_read(address: int, register: int | None, count: int) -> bytes:
    """Ask for ``count`` bytes from a register on; None: from wherever the chip has its pointer."""
    _check("I²C address", address, 0, _MAX_I2C_ADDRESS)
    start = () if register is None else split_14_bits(register)
    return sysex(Sysex.I2C_REQUEST, address, I2C_READ, *start, *split_14_bits(count))


def split_14_bits(value: int) -> tuple[int, int]:
    """Two data bytes of 7 bits, low one first."""
    return value & 0x7F, value >> 7


def _check(what: str, value: int, lowest: int, highest: int) -> None:
    if not lowest <= value <= highest:
        raise InputError(f"{what} {value} is outside {lowest} … {highest} and cannot be sent")


# What a Firmata board sends: single bytes to whole messages.


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
class I2cReply:
    """What was read from an I²C chip.

    Sketches before 2.4 send what they had read before where nobody answers; a ``BoardText`` goes ahead of it.
    """

    address: int
    register: int  # 0 where none was given
    data: bytes


@dataclass(frozen=True, slots=True)
class DigitalReport:
    """The inputs of a port: bit 0 is its lowest pin."""

    port: int
    bits: int


@dataclass(frozen=True, slots=True)
class AnalogReport:
    """What an analog channel reads, 0 ... 1023."""

    channel: int
    value: int


@dataclass(frozen=True, slots=True)
class Malformed:
    """A message that breaks off or makes no sense."""

    raw: bytes


Reply: TypeAlias = (
    VersionReport
    | FirmwareReport
    | CapabilityReport
    | PinState
    | BoardText
    | I2cReply
    | DigitalReport
    | AnalogReport
    | Malformed
)

_LONGEST_SYSEX = 8192
"""the capabilities of a Mega are about 700 bytes; anything this long is no Firmata"""
_COMMAND_BIT = 0x80
_START, _PIN_ENDS = bytes((MessageStart.START_SYSEX,)), bytes((END_OF_PIN,))
_DECODED = (
    Sysex.REPORT_FIRMWARE,
    Sysex.CAPABILITY_RESPONSE,
    Sysex.PIN_STATE_RESPONSE,
    Sysex.STRING_DATA,
    Sysex.I2C_REPLY,
)


class ReplyParser:
    """Takes bytes as they come, in any pieces, and returns the messages that they complete.

    Sysexes of other sketches and stray data bytes are left out. A message that is broken off by another one
    is ``Malformed``; the other one counts.
    """

    def __init__(self) -> None:
        self._raw = bytearray()

    def feed(self, data: bytes) -> list[Reply]:
        """The messages that ``data`` completes, in order."""
        replies: list[Reply] = []
        for byte in data:
            raw = self._raw
            if byte == MessageStart.END_SYSEX and raw.startswith(_START):
                self._raw = bytearray()
                replies += _decode(bytes(raw[1:]))
            elif byte & _COMMAND_BIT:
                replies += [Malformed(bytes(raw))] if raw else []
                name_report = (
                    bytes(raw) == _START and byte == MessageStart.REPORT_VERSION
                )  # with one bit wrong
                self._raw = bytearray((byte,) if _length(byte) and not name_report else ())
            elif raw:
                raw.append(byte)
                if len(raw) == _length(raw[0]):
                    self._raw = bytearray()
                    replies.append(_short(raw))
        return replies


def _short(raw: bytearray) -> Reply:
    """A whole message that is no sysex, or a sysex without an end."""
    number, value = raw[0] & 0x0F, raw[1] | raw[2] << 7
    match raw[0] & 0xF0:
        case MessageStart.DIGITAL_MESSAGE:
            return DigitalReport(number, value)
        case MessageStart.ANALOG_MESSAGE:
            return AnalogReport(number, value)
        case _ if raw[0] == MessageStart.REPORT_VERSION:
            return VersionReport(raw[1], raw[2])
        case _:
            return Malformed(bytes(raw))


def _length(command: int) -> int:
    """Bytes of a message that begins so, of a sysex the most; 0 where none does."""
    if command == MessageStart.START_SYSEX:
        return _LONGEST_SYSEX
    reported = command & 0xF0 in (MessageStart.ANALOG_MESSAGE, MessageStart.DIGITAL_MESSAGE)
    return 3 if reported or command == MessageStart.REPORT_VERSION else 0


def _decode(body: bytes) -> list[Reply]:
    """The message of a sysex without its frame; none for one that is of no use here."""
    kind, data = body[0] if body else None, body[1:]
    even = len(data) % 2 == 0
    if kind == Sysex.REPORT_FIRMWARE and data and even:
        return [FirmwareReport(data[0], data[1], _text(data[2:]))]
    if kind == Sysex.CAPABILITY_RESPONSE and data[-1:] == _PIN_ENDS:
        pins = data[:-1].split(_PIN_ENDS)
        if all(len(modes) % 2 == 0 for modes in pins):
            return [CapabilityReport(tuple(dict(zip(pin[::2], pin[1::2], strict=True)) for pin in pins))]
    if kind == Sysex.PIN_STATE_RESPONSE and len(data) >= 3:
        # Pin, mode, and the value in as many 7-bit bytes as it needs, low one first.
        value = sum(byte << 7 * place for place, byte in enumerate(data[2:]))
        return [PinState(data[0], data[1], value)]
    if kind == Sysex.STRING_DATA and even and (text := _text(data)).isprintable():
        return [BoardText(text)]
    if kind == Sysex.I2C_REPLY and even and len(data) >= 4:
        address, register, *rest = _whole_bytes(data)
        return [I2cReply(address, register, bytes(rest))]
    return [Malformed(body)] if kind is None or kind in _DECODED else []


def _text(data: bytes) -> str:
    return _whole_bytes(data).decode("latin-1")


def _whole_bytes(data: bytes) -> bytes:
    """Bytes that were sent as two of 7 bits each."""
    return bytes((low | high << 7) & 0xFF for low, high in zip(data[::2], data[1::2], strict=True))
