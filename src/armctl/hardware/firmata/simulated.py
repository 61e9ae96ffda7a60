"""A simulated Arduino Mega with StandardFirmata 2.3: the sketch's behaviour, byte for byte."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from armctl.errors import InputError
from armctl.hardware.firmata.codec import CAPABILITY_RESPONSE_PIN_END, Command, PinMode, Sysex, split_14_bits

# One servo of a simulated sketch: what the Arduino Servo library does with what it is given.

_MINIMUM_US = 544
_MAXIMUM_US = 2400
_DEFAULT_US = 1500
_LIMIT_STEP_US = 4
_LARGEST_DEGREES = 180


@dataclass(frozen=True, slots=True)
class Pulse:
    """One pulse on a pin: when it began, and how long it was."""

    time: float
    width_us: int


class SimulatedServo:
    """Limits, degrees and microseconds as in Servo.cpp.

    Attributes:
        width_us: the pulse width that the next frame sends.
    """

    def __init__(self) -> None:
        self.width_us = _DEFAULT_US
        self._minimum_us, self._maximum_us = _MINIMUM_US, _MAXIMUM_US

    def attach(self, minimum_us: int = _MINIMUM_US, maximum_us: int = _MAXIMUM_US) -> None:
        """Begin to send pulses, of the width that was there before."""
        self._minimum_us = _MINIMUM_US - _LIMIT_STEP_US * _stored(_MINIMUM_US - minimum_us)
        self._maximum_us = _MAXIMUM_US - _LIMIT_STEP_US * _stored(_MAXIMUM_US - maximum_us)

    def write(self, value: int) -> None:
        """Take degrees below 544, else µs."""
        if value < _MINIMUM_US:
            degrees = min(_LARGEST_DEGREES, max(0, value))
            span_us = self._maximum_us - self._minimum_us
            value = self._minimum_us + span_us * degrees // _LARGEST_DEGREES
        self.width_us = min(self._maximum_us, max(self._minimum_us, value))


def _stored(distance_us: int) -> int:
    """A limit's distance from the library's own, as kept in a signed byte: it wraps round."""
    steps = int(distance_us / _LIMIT_STEP_US)  # towards zero, as C divides
    return (steps + 128) % 256 - 128


# The pins of an Arduino Mega as StandardFirmata 2.3 sees them (Boards.h).

PINS = 70

_SERIAL_PINS = (0, 1)
_FIRST_ANALOG_PIN = 54
_PWM_PINS = (*range(2, 14), 44, 45, 46)
_LAST_SERVO_PIN = 49  # the Servo library has room for 48, and the sketch keeps one for each pin from 2 on
_I2C_PINS = (20, 21)


def mode_after_reset(pin: int) -> PinMode:
    """What a reset sets a pin to: the analog ones listen, the others are low; the serial ones it leaves."""
    if pin in _SERIAL_PINS:
        return PinMode.INPUT
    return PinMode.ANALOG if pin >= _FIRST_ANALOG_PIN else PinMode.OUTPUT


def capabilities(pin: int) -> dict[int, int]:
    """The modes that a pin knows, with their resolution in bits, in the sketch's order."""
    if pin in _SERIAL_PINS or not 0 <= pin < PINS:
        return {}
    modes: dict[int, int] = {PinMode.INPUT: 1, PinMode.OUTPUT: 1}
    if pin >= _FIRST_ANALOG_PIN:
        modes[PinMode.ANALOG] = 10
    if pin in _PWM_PINS:
        modes[PinMode.PWM] = 8
    if pin <= _LAST_SERVO_PIN:
        modes[PinMode.SERVO] = 14
    if pin in _I2C_PINS:
        modes[PinMode.I2C] = 1
    return modes


SERVO_PINS = tuple(pin for pin in range(PINS) if PinMode.SERVO in capabilities(pin))


SERVO_FRAME_S = 0.020
_TIME_SLACK_S = 1e-9
_VERSION = (2, 3)
_NAME = "StandardFirmata.ino"


class SimulatedFirmata:
    """StandardFirmata on a Mega, with servos; inputs, I²C and serial pins do nothing.

    Bytes are taken as soon as they are fed: the line's own speed is not modelled. All servos share
    one frame of 20 ms. A sysex that is longer than the sketch's buffer crashes it, as it does in old
    builds: nothing answers any more until ``reset``.

    Args:
        boot_s: how long it is deaf and dumb after power-on; a real Mega 1.7 s and its bootloader's time.
        log_length: how many pulses are kept for each pin.
    """

    def __init__(self, boot_s: float = 0.0, log_length: int = 10_000) -> None:
        self._boot_s = boot_s
        self._log_length = log_length
        self._now: float | None = None
        self._pulses: dict[int, deque[Pulse]] = {}
        self.reset()

    def reset(self) -> None:
        """Start anew, as after the reset button: no pulses; the sketch reports itself when it runs."""
        self._parser = SketchParser()
        self._crashed = False
        self._modes: dict[int, int] = {pin: mode_after_reset(pin) for pin in range(PINS)}
        self._values = dict.fromkeys(range(PINS), 0)
        self._servos = {pin: SimulatedServo() for pin in range(PINS) if PinMode.SERVO in capabilities(pin)}
        self._on: set[int] = set()
        self._runs_at = None if self._now is None else self._now + self._boot_s
        self._reported = False
        self._frames = 0

    def advance(self, now: float) -> bytes:
        """Let servo frames go by up to ``now`` [s]; the sketch reports itself once it has started."""
        self._now = now
        if self._runs_at is None:
            self._runs_at = now + self._boot_s
        if now < self._runs_at:
            return b""
        self._run_frames(now, self._runs_at)
        if self._reported:
            return b""
        self._reported = True
        return version_report(*_VERSION) + _name_report()

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the host and return what the sketch answers."""
        if not self._reported:
            return b""
        reply = b""
        for byte in data:
            if not self._crashed and (message := self._parser.push(byte)) is not None:
                reply += self._obey(message)
        return reply

    def mode(self, pin: int) -> int:
        """What a pin is set to."""
        return self._modes[_checked(pin)]

    def pulses(self, pin: int) -> tuple[Pulse, ...]:
        """Every pulse that a pin has sent, oldest first."""
        return tuple(self._pulses.get(_checked(pin), ()))

    def _run_frames(self, now: float, started: float) -> None:
        due = math.floor((now - started + _TIME_SLACK_S) / SERVO_FRAME_S)
        for frame in range(max(self._frames, due - self._log_length) + 1, due + 1):
            for pin in self._on:
                log = self._pulses.setdefault(pin, deque(maxlen=self._log_length))
                log.append(Pulse(started + frame * SERVO_FRAME_S, self._servos[pin].width_us))
        self._frames = due

    def _obey(self, message: SketchMessage) -> bytes:
        match message:
            case Overflow():
                self._crashed = True
                return b""
            case SysexMessage(body):
                return self._obey_sysex(body[0], body[1:]) if body else b""
            case ShortMessage(Command.REPORT_VERSION):
                return version_report(*_VERSION)
            case ShortMessage(Command.SYSTEM_RESET):
                self._system_reset()
            case ShortMessage(Command.SET_PIN_MODE, _, data):
                return self._set_mode(data[0], data[1])
            case ShortMessage(Command.ANALOG_MESSAGE, channel, data):
                self._analog_write(channel, data[0] | data[1] << 7)
            case _:
                pass  # digital pins and reports: nothing here depends on them
        return b""

    def _obey_sysex(self, kind: int, data: bytes) -> bytes:
        match kind:
            case Sysex.REPORT_FIRMWARE:
                return _name_report()
            case Sysex.CAPABILITY_QUERY:
                return capability_response(map(capabilities, range(PINS)))
            case Sysex.PIN_STATE_QUERY if data:
                return self._pin_state(data[0])
            case Sysex.EXTENDED_ANALOG if len(data) > 1:
                value = 0
                for place, byte in enumerate(data[1:4]):
                    value |= byte << 7 * place
                self._analog_write(data[0], (value + 0x8000) % 0x10000 - 0x8000)  # an int of 16 bits
            case Sysex.SERVO_CONFIG if len(data) > 4:
                self._configure_servo(data[0], data[1] + (data[2] << 7), data[3] + (data[4] << 7))
            case _:
                pass  # other sysexes have no handler, and short ones are ignored
        return b""

    def _system_reset(self) -> None:
        for pin in range(PINS):
            self._set_mode(pin, mode_after_reset(pin))

    def _set_mode(self, pin: int, mode: int) -> bytes:
        if not capabilities(pin):
            return b""
        if mode != PinMode.SERVO:
            self._on.discard(pin)
        self._values[pin] = 0
        if mode not in tuple(PinMode):
            return text_message("Unknown pin mode")
        if mode not in capabilities(pin):
            return b""
        self._modes[pin] = mode
        if mode == PinMode.SERVO and pin not in self._on:
            self._servos[pin].attach()
            self._on.add(pin)
        return b""

    def _configure_servo(self, pin: int, minimum_us: int, maximum_us: int) -> None:
        if pin in self._servos:
            self._servos[pin].attach(minimum_us, maximum_us)
            self._on.add(pin)
            self._set_mode(pin, PinMode.SERVO)

    def _analog_write(self, pin: int, value: int) -> None:
        if pin < PINS and self._modes[pin] in (PinMode.SERVO, PinMode.PWM):
            if pin in self._on:
                self._servos[pin].write(value)
            self._values[pin] = value

    def _pin_state(self, pin: int) -> bytes:
        if pin >= PINS:
            return unknown_pin_state_response(pin)
        return pin_state_response(pin, self._modes[pin], self._values[pin])


def _name_report() -> bytes:
    return firmware_report(*_VERSION, _NAME)


def _checked(pin: int) -> int:
    if not 0 <= pin < PINS:
        raise InputError(f"pin {pin}: a Mega has pins 0 … {PINS - 1}")
    return pin


# The receiving side of the sketch: single bytes to commands (FirmataParser.cpp).

SYSEX_BUFFER = 64
"""data bytes that the sketch can keep"""

_COMMAND_BIT = 0x80
_CHANNEL_BITS = 0x0F
_TWO_DATA_BYTES = (
    Command.ANALOG_MESSAGE,
    Command.DIGITAL_MESSAGE,
    Command.SET_PIN_MODE,
    Command.SET_DIGITAL_PIN,
)
_ONE_DATA_BYTE = (Command.REPORT_ANALOG, Command.REPORT_DIGITAL)


@dataclass(frozen=True, slots=True)
class ShortMessage:
    """A command of up to three bytes. Those from F0 on have no channel (0)."""

    command: Command
    channel: int
    data: bytes


@dataclass(frozen=True, slots=True)
class SysexMessage:
    """What stood between F0 and F7: any bytes at all, for the sketch does not look at them."""

    body: bytes


@dataclass(frozen=True, slots=True)
class Overflow:
    """A sysex longer than the buffer: old builds for the Mega crash here."""


SketchMessage: TypeAlias = ShortMessage | SysexMessage | Overflow


class SketchParser:
    """Takes bytes one at a time, with the sketch's own weaknesses.

    Inside a sysex every byte but F7 is data, the beginning of the next message too: a sysex that has
    lost its end swallows whatever follows, up to the next F7, and is then executed.
    """

    def __init__(self) -> None:
        self._sysex: bytearray | None = None
        self._command: Command | None = None
        self._channel = 0
        self._data = bytearray()

    def push(self, byte: int) -> SketchMessage | None:
        """What this byte completes."""
        if self._sysex is not None:
            return self._push_sysex(self._sysex, byte)
        if not byte & _COMMAND_BIT:
            return self._push_data(byte)
        channel = byte & _CHANNEL_BITS if byte < Command.START_SYSEX else 0
        try:
            command = Command(byte - channel)
        except ValueError:  # a command that the sketch does not know is passed over
            return None
        if command is Command.START_SYSEX:
            self._sysex = bytearray()
        elif command in _TWO_DATA_BYTES or command in _ONE_DATA_BYTE:
            self._command, self._channel, self._data = command, channel, bytearray()
        elif command in (Command.REPORT_VERSION, Command.SYSTEM_RESET):
            return ShortMessage(command, 0, b"")
        return None

    def _push_sysex(self, sysex: bytearray, byte: int) -> SketchMessage | None:
        if byte == Command.END_SYSEX:
            self._sysex = None
            return SysexMessage(bytes(sysex))
        sysex.append(byte)
        return Overflow() if len(sysex) > SYSEX_BUFFER else None

    def _push_data(self, byte: int) -> SketchMessage | None:
        # A command that comes in between does not end the wait for data: the sketch counts on.
        if self._command is None:
            return None
        self._data.append(byte)
        if len(self._data) < (1 if self._command in _ONE_DATA_BYTE else 2):
            return None
        message = ShortMessage(self._command, self._channel, bytes(self._data))
        self._command = None
        return message


# What the StandardFirmata sketch sends, as bytes.


def version_report(major: int, minor: int) -> bytes:
    """The protocol version."""
    return bytes((Command.REPORT_VERSION, major, minor))


def firmware_report(major: int, minor: int, name: str) -> bytes:
    """The sketch's version and name."""
    return _sysex(Sysex.REPORT_FIRMWARE, bytes((major, minor)) + _characters(name))


def capability_response(pins: Iterable[Mapping[int, int]]) -> bytes:
    """The modes that each pin knows, with their resolutions in bits."""
    data = bytearray()
    for modes in pins:
        for mode, resolution in modes.items():
            data += bytes((mode, resolution))
        data.append(CAPABILITY_RESPONSE_PIN_END)
    return _sysex(Sysex.CAPABILITY_RESPONSE, data)


def pin_state_response(pin: int, mode: int, value: int) -> bytes:
    """A pin's mode and value (16 bits with sign), in as many bytes of 7 bits as it needs."""
    data = bytearray((pin, mode, value & 0x7F))
    if value & 0xFF80:
        data.append(value >> 7 & 0x7F)
    if value & 0xC000:
        data.append(value >> 14 & 0x7F)
    return _sysex(Sysex.PIN_STATE_RESPONSE, data)


def unknown_pin_state_response(pin: int) -> bytes:
    """The answer for a pin that the board has not: nothing but its number."""
    return _sysex(Sysex.PIN_STATE_RESPONSE, bytes((pin,)))


def text_message(text: str) -> bytes:
    """A text for people."""
    return _sysex(Sysex.STRING_DATA, _characters(text))


def _sysex(kind: Sysex, data: bytes | bytearray) -> bytes:
    return bytes((Command.START_SYSEX, kind, *data, Command.END_SYSEX))


def _characters(text: str) -> bytes:
    return bytes(half for code in text.encode("ascii") for half in split_14_bits(code))
