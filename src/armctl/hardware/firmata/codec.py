"""Firmata messages from the host to the board, as bytes (Firmata protocol 2.x; StandardFirmata.ino).

Pure functions. Analog writes always use the extended form: the short one (``E0 | pin``) holds pins
up to 15 only, and a larger pin turns it into another command.
"""

from __future__ import annotations

from enum import IntEnum

from armctl.errors import InputError

BAUD = 57_600
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
