"""A simulated Arduino Mega with StandardFirmata 2.3: the sketch's behaviour, byte for byte."""

from __future__ import annotations

import math
from collections import deque

from armctl.errors import InputError
from armctl.hardware.firmata import sketch_reports
from armctl.hardware.firmata.codec import Command, PinMode, Sysex
from armctl.hardware.firmata.mega_pins import PINS, capabilities, mode_after_reset
from armctl.hardware.firmata.simulated_servo import Pulse, SimulatedServo
from armctl.hardware.firmata.sketch_parser import (
    Overflow,
    ShortMessage,
    SketchMessage,
    SketchParser,
    SysexMessage,
)

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
        return sketch_reports.version_report(*_VERSION) + _firmware_report()

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
                return sketch_reports.version_report(*_VERSION)
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
                return _firmware_report()
            case Sysex.CAPABILITY_QUERY:
                return sketch_reports.capability_response(map(capabilities, range(PINS)))
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
            return sketch_reports.text_message("Unknown pin mode")
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
            return sketch_reports.unknown_pin_state_response(pin)
        return sketch_reports.pin_state_response(pin, self._modes[pin], self._values[pin])


def _firmware_report() -> bytes:
    return sketch_reports.firmware_report(*_VERSION, _NAME)


def _checked(pin: int) -> int:
    if not 0 <= pin < PINS:
        raise InputError(f"pin {pin}: a Mega has pins 0 … {PINS - 1}")
    return pin
