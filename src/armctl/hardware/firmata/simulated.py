"""A simulated Arduino Mega with StandardFirmata 2.3: the sketch's behaviour, byte for byte."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import TypeAlias

from armctl.errors import InputError
from armctl.hardware.board_type import SimulatedPins
from armctl.hardware.firmata.codec import (
    ANALOG_FULL,
    END_OF_PIN,
    I2C_READ,
    PORT,
    CapabilityReport,
    MessageStart,
    PinMode,
    Sysex,
    split_14_bits,
    sysex,
)
from armctl.hardware.firmata.sketch_parser import SYSEX_BUFFER, SYSEX_OBEYED, SketchMessage, SketchParser
from armctl.lazy_dataclass import dataclass

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
    """Limits, degrees and microseconds as in Servo.cpp; ``width_us`` is what the next frame sends."""

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
_NO_CHANNEL = 0x7F


def _mode_after_reset(pin: int) -> PinMode:
    """The analog pins listen, the others are low; the serial ones are left as they are."""
    if pin in _SERIAL_PINS:
        return PinMode.INPUT
    return PinMode.ANALOG if pin >= _FIRST_ANALOG_PIN else PinMode.OUTPUT


def _capabilities(pin: int) -> dict[int, int]:
    """The modes that a pin knows, with their resolution in bits, in the sketch's order."""
    if pin in _SERIAL_PINS or not 0 <= pin < PINS:
        return {}
    modes = (
        (PinMode.INPUT, 1, True),
        (PinMode.OUTPUT, 1, True),
        (PinMode.ANALOG, 10, pin >= _FIRST_ANALOG_PIN),
        (PinMode.PWM, 8, pin in _PWM_PINS),
        (PinMode.SERVO, 14, pin <= _LAST_SERVO_PIN),
        (PinMode.I2C, 1, pin in _I2C_PINS),
    )
    return {mode: bits for mode, bits, known in modes if known}


_MODES = tuple(mode for mode in PinMode if mode is not PinMode.INPUT_PULLUP)
"""of this version: an input is pulled up by writing to it"""


def _analog_channel(pin: int) -> int:
    """The number of an analog pin among its kind; 127 for the others."""
    return pin - _FIRST_ANALOG_PIN if pin >= _FIRST_ANALOG_PIN else _NO_CHANNEL


SERVO_PINS = tuple(pin for pin in range(PINS) if PinMode.SERVO in _capabilities(pin))
CAPABILITIES = CapabilityReport(tuple(map(_capabilities, range(PINS))))


# The sketch, and what it sends.

SERVO_FRAME_S = 0.020
_SAMPLING_MS, _SHORTEST_SAMPLING_MS = 19, 10
_MOST_MISSED = 50
"""rounds of analog reports that are made up for after nobody has looked at the board for a while"""
_TIME_SLACK_S = 1e-9
_VERSION = (2, 3)
_VERSION_REPORT = bytes((MessageStart.REPORT_VERSION, *_VERSION))


def _with_text(kind: Sysex, text: str, *data: int) -> bytes:
    return sysex(kind, *data, *(half for code in text.encode("ascii") for half in split_14_bits(code)))


_NAME_REPORT = _with_text(Sysex.REPORT_FIRMWARE, "StandardFirmata.ino", *_VERSION)


I2cTransfer: TypeAlias = Callable[[int, bytes, int], "bytes | None"]
"""An I²C bus: address, what is written, how many bytes are read then. None: nobody acknowledges."""
_WIRE_BUFFER = 32
_NOTHING_READ = bytes(_WIRE_BUFFER)
_I2C_ERROR = "I2C Read Error: Too many bytes received"


def _no_chips(address: int, data: bytes, count: int) -> bytes | None:
    return None


class SimulatedFirmata(SimulatedPins):
    """StandardFirmata on a Mega, with servos, reports of its pins and I²C (``i2c``: what is on its bus).

    An input that nothing is connected to is low, or high where it is pulled up; an analog channel reads then
    what ``analog`` says, 0 … 1023.

    Bytes are taken as soon as they are fed: the line's own speed is not modelled. All servos share
    one frame of 20 ms. A sysex that is longer than the sketch's buffer crashes it, as it does in old
    builds: nothing answers any more until ``reset``. After power-on it is deaf and dumb for ``boot_s`` (a
    real Mega 1.7 s and its bootloader's time). The last ``log_length`` pulses of each pin are kept.
    """

    def __init__(self, boot_s: float = 0.0, log_length: int = 10_000, i2c: I2cTransfer = _no_chips) -> None:
        super().__init__()
        self._boot_s = boot_s
        self._i2c = i2c
        self._log_length = log_length
        self._now: float | None = None
        self._pulses: dict[int, deque[Pulse]] = {}
        self.analog = dict.fromkeys(range(PINS - _FIRST_ANALOG_PIN), 0)
        """by channel, what it reads"""
        self.reset()

    def reset(self) -> None:
        """Start anew, as after the reset button: no pulses; the sketch reports itself when it runs."""
        self._parser = SketchParser()
        self._crashed = False
        self._modes: dict[int, int] = {pin: _mode_after_reset(pin) for pin in range(PINS)}
        self._values = dict.fromkeys(range(PINS), 0)
        self._servos = {pin: SimulatedServo() for pin in SERVO_PINS}
        self._on: set[int] = set()
        self._runs_at = None if self._now is None else self._now + self._boot_s
        self._reported = False
        self._frames = 0
        self._channels: set[int] = set()
        """the analog channels that are reported"""
        self._ports: set[int] = set()
        """the ports whose inputs are reported"""
        self._hidden: set[int] = set()
        """inputs that were told of another mode, which they do not know: not reported"""
        self._told_bits: dict[int, int] = {}
        self._sampling_ms, self._sampled_ms = _SAMPLING_MS, 0
        self._i2c_enabled = False
        self._i2c_read = _NOTHING_READ
        """address, register and data of the last reading that somebody answered"""

    def advance(self, now: float) -> bytes:
        """Let servo frames go by up to ``now`` [s]; the sketch reports itself once it has started."""
        self._now = now
        if self._runs_at is None:
            self._runs_at = now + self._boot_s
        if now < self._runs_at:
            return b""
        self._run_frames(now, self._runs_at)
        reports = self._analog_reports(now - self._runs_at) + self._digital_reports()
        if self._reported:
            return reports
        self._reported = True
        return _VERSION_REPORT + _NAME_REPORT

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the host and return what the sketch answers."""
        reply = b""
        for byte in data if self._reported else b"":
            if not self._crashed and (message := self._parser.push(byte)) is not None:
                reply += self._obey(message)
        return reply

    def mode(self, pin: int) -> int:
        """What a pin is set to."""
        return self._modes[_checked(pin)]

    def value(self, pin: int) -> int:
        """What was last written to a pin."""
        return self._values[_checked(pin)]

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

    def _analog_reports(self, ran_s: float) -> bytes:
        """What the sketch's rounds of sampling send, up to so long after its start."""
        now_ms = math.floor(1000 * ran_s + _TIME_SLACK_S)
        rounds = max(0, math.ceil((now_ms - self._sampled_ms) / self._sampling_ms) - 1)
        self._sampled_ms += rounds * self._sampling_ms
        if self._crashed:
            return b""
        values = [(channel, self._analog_value(channel)) for channel in sorted(self._channels)]
        one = b"".join(
            bytes((MessageStart.ANALOG_MESSAGE | channel, *split_14_bits(value)))
            for channel, value in values
            if self._modes[_FIRST_ANALOG_PIN + channel] == PinMode.ANALOG
        )
        return one * min(rounds, _MOST_MISSED)

    def _analog_value(self, channel: int) -> int:
        level = self.levels.get(_FIRST_ANALOG_PIN + channel)
        return self.analog[channel] if level is None else round(ANALOG_FULL * level)

    def _digital_reports(self) -> bytes:
        """The ports whose inputs have changed; the sketch takes all for low when it starts."""
        reports = b""
        for port in () if self._crashed else sorted(self._ports):
            pins = [pin for pin in range(PORT * port, min(PINS, PORT * port + PORT)) if self._is_high(pin)]
            bits = sum(1 << pin % PORT for pin in pins)
            if bits != self._told_bits.get(port, 0):
                self._told_bits[port] = bits
                reports += bytes((MessageStart.DIGITAL_MESSAGE | port, *split_14_bits(bits)))
        return reports

    def _is_high(self, pin: int) -> bool:
        """Whether an input is; what was written to it pulls it up."""
        listens = self._modes[pin] == PinMode.INPUT and pin not in self._hidden
        return listens and self.levels.get(pin, float(self._values[pin])) > 0.5

    def _obey(self, message: SketchMessage) -> bytes:
        data = message.data
        match message.command:
            case MessageStart.START_SYSEX if len(data) > SYSEX_BUFFER:
                self._crashed = True
            case MessageStart.START_SYSEX if len(data) > SYSEX_OBEYED:
                pass
            case MessageStart.START_SYSEX if data:
                return self._obey_sysex(data[0], data[1:])
            case MessageStart.REPORT_VERSION:
                return _VERSION_REPORT
            case MessageStart.SYSTEM_RESET:
                for pin in range(PINS):
                    self._set_mode(pin, _mode_after_reset(pin))
                self._channels.clear()
                self._ports.clear()
            case MessageStart.REPORT_ANALOG:
                self._report_analog(message.channel, data[0] != 0)
            case MessageStart.SET_PIN_MODE:
                return self._set_mode(data[0], data[1])
            case MessageStart.ANALOG_MESSAGE:
                self._analog_write(message.channel, data[0] | data[1] << 7)
            case MessageStart.REPORT_DIGITAL:
                (self._ports.add if data[0] else self._ports.discard)(message.channel)
            case MessageStart.DIGITAL_MESSAGE:
                for pin in range(PORT * message.channel, min(PINS, PORT * message.channel + PORT)):
                    if _capabilities(pin) and self._modes[pin] in (PinMode.INPUT, PinMode.OUTPUT):
                        self._values[pin] = (data[0] | data[1] << 7) >> pin % PORT & 1
            case _:
                pass  # single digital pins: of later versions
        return b""

    def _obey_sysex(self, kind: int, data: bytes) -> bytes:
        match kind:
            case Sysex.REPORT_FIRMWARE:
                return _NAME_REPORT
            case Sysex.CAPABILITY_QUERY:
                pins = [sum(_capabilities(pin).items(), ()) for pin in range(PINS)]
                return sysex(
                    Sysex.CAPABILITY_RESPONSE, *(byte for pin in pins for byte in (*pin, END_OF_PIN))
                )
            case Sysex.ANALOG_MAPPING_QUERY:
                return sysex(Sysex.ANALOG_MAPPING_RESPONSE, *map(_analog_channel, range(PINS)))
            case Sysex.PIN_STATE_QUERY if data:
                return self._pin_state(data[0])
            case Sysex.EXTENDED_ANALOG if len(data) > 1:
                value = 0
                for place, byte in enumerate(data[1:4]):
                    value |= byte << 7 * place
                self._analog_write(data[0], (value + 0x8000) % 0x10000 - 0x8000)  # an int of 16 bits
            case Sysex.SAMPLING_INTERVAL if len(data) > 1:
                self._sampling_ms = max(_SHORTEST_SAMPLING_MS, data[0] + (data[1] << 7))
            case Sysex.SERVO_CONFIG if len(data) > 4 and data[0] in self._servos:
                self._servos[data[0]].attach(data[1] + (data[2] << 7), data[3] + (data[4] << 7))
                self._on.add(data[0])
                self._set_mode(data[0], PinMode.SERVO)
            case Sysex.I2C_CONFIG:
                self._i2c_enabled = True
                for pin in _I2C_PINS:
                    self._set_mode(pin, PinMode.I2C)
            case Sysex.I2C_REQUEST if len(data) > 2 and self._i2c_enabled:
                return self._obey_i2c(data[0], data[1], data[2:])
            case _:
                pass  # other sysexes have no handler, and short ones are ignored
        return b""

    def _obey_i2c(self, address: int, mode: int, pairs: bytes) -> bytes:
        """A write is not answered; a reading that fails is, with a text and what was read before."""
        data = bytes((low | high << 7) & 0xFF for low, high in zip(pairs[::2], pairs[1::2], strict=False))
        if not mode & I2C_READ:
            self._i2c(address, data[:_WIRE_BUFFER], 0)
            return b""
        register, count = data[:-1], min(data[-1], _WIRE_BUFFER - 2)
        found = self._i2c(address, register, count)
        if found is not None:
            self._i2c_read = bytes((address, *(register or b"\0"), *found)).ljust(_WIRE_BUFFER, b"\0")
        halves = (half for byte in self._i2c_read[: 2 + count] for half in split_14_bits(byte))
        reply = sysex(Sysex.I2C_REPLY, *halves)
        # The sketch mixes up "few" and "many".
        return reply if found is not None else _with_text(Sysex.STRING_DATA, _I2C_ERROR) + reply

    def _set_mode(self, pin: int, mode: int) -> bytes:
        if not _capabilities(pin):
            return b""
        if mode != PinMode.SERVO:
            self._on.discard(pin)
        if pin >= _FIRST_ANALOG_PIN:
            self._report_analog(pin - _FIRST_ANALOG_PIN, mode == PinMode.ANALOG)
        self._values[pin] = 0
        (self._hidden.discard if mode == PinMode.INPUT else self._hidden.add)(pin)
        if mode not in _MODES:
            return _with_text(Sysex.STRING_DATA, "Unknown pin mode")
        if mode in _capabilities(pin):
            self._modes[pin] = mode
            if mode == PinMode.SERVO and pin not in self._on:
                self._servos[pin].attach()
                self._on.add(pin)
        return b""

    def _report_analog(self, channel: int, on: bool) -> None:
        (self._channels.add if on else self._channels.discard)(channel)

    def _analog_write(self, pin: int, value: int) -> None:
        if pin < PINS and self._modes[pin] in (PinMode.SERVO, PinMode.PWM):
            if pin in self._on:
                self._servos[pin].write(value)
            self._values[pin] = value

    def _pin_state(self, pin: int) -> bytes:
        """A pin's mode and value (16 bits with sign), in as many bytes of 7 bits as it needs."""
        if pin >= PINS:
            return sysex(Sysex.PIN_STATE_RESPONSE, pin)
        value = self._values[pin]
        data = [pin, self._modes[pin], value & 0x7F]
        if value & 0xFF80:
            data.append(value >> 7 & 0x7F)
        if value & 0xC000:
            data.append(value >> 14 & 0x7F)
        return sysex(Sysex.PIN_STATE_RESPONSE, *data)


def _checked(pin: int) -> int:
    if not 0 <= pin < PINS:
        raise InputError(f"pin {pin}: a Mega has pins 0 … {PINS - 1}")
    return pin
