"""Pins of a Firmata board that are inputs or outputs beside its servos."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from armctl.errors import BoardError
from armctl.hardware.firmata import codec, pin_ranges
from armctl.hardware.firmata.codec import (
    AnalogReport,
    CapabilityReport,
    DigitalReport,
    PinMode,
    PinState,
    Reply,
)
from armctl.robot.signals import ON, Input, Output, Signals

_SAMPLING_MS = 10
"""from one report of the analog pins to the next: the shortest that sketches know"""
_REMIND_S = 1.0
"""Reports are asked for again and again: sketches from 2.5 on answer at once, which makes good a lost one."""
_ASK_S = 0.02
_ATTEMPTS = 25
"""so often an output may be written until the sketch says that it has the value"""
_MODES = {"digital": PinMode.INPUT, "pull-up": PinMode.INPUT, "analog": PinMode.ANALOG, "pwm": PinMode.PWM}


class FirmataSignals:
    """What was last told of the pins of ``signals``, and what is still to be sent to them.

    A digital pin is written with all eight of its port. The sketch leaves pins of other modes alone.
    """

    def __init__(self, signals: Signals, capabilities: CapabilityReport, servos: Sequence[int] = ()) -> None:
        """``servos``: pins that drive servos. ``BoardError``: a pin that cannot do what it is to do."""
        self.signals = signals
        stopped = _pwm_without_timer(len(capabilities.pins), servos)
        self._pulled_up = [one for one in signals.inputs if one.kind == "pull-up"]
        self._answers = PinMode.INPUT_PULLUP in {mode for pin in capabilities.pins for mode in pin}
        """whether the sketch says what a port is at when it is told to report it: those from 2.5 on do"""
        modes = {one.channel: _MODES[one.kind] for one in signals.inputs}
        modes |= {one.channel: _output_mode(one) for one in signals.outputs}
        if self._answers:
            modes |= {one.channel: PinMode.INPUT_PULLUP for one in self._pulled_up}
        self.modes: Mapping[int, PinMode] = modes
        """by pin, what it is set to"""
        for one in (*signals.inputs, *signals.outputs):
            able = capabilities.pins_with(modes[one.channel])
            if one.kind == "pwm":
                able = tuple(pin for pin in able if pin not in stopped)
            if one.channel in stopped and one.kind == "pwm":
                raise BoardError(
                    f"{one.title}: pin {one.channel} has no PWM while servos are on: they take its timer; "
                    f"the pins that have: {pin_ranges(able)}; change the robot file"
                )
            if one.channel not in able:
                raise BoardError(
                    f"{one.title}: pin {one.channel} of this board cannot be {one.kind}; the pins that can: "
                    f"{pin_ranges(able)}; change the robot file"
                )
        # The sketch numbers its analog channels in the order of their pins (Boards.h).
        self._analog = {pin: number for number, pin in enumerate(capabilities.pins_with(PinMode.ANALOG))}
        self._digital = [one.channel for one in signals.inputs if one.kind != "analog"]
        self.settled = not self._digital
        """whether what the sketch says of its digital inputs has been waited for"""
        self._bits: dict[int, int] = {}
        """by port, what was reported of its digital inputs"""
        self._shares: dict[int, float] = {}
        """by analog channel"""
        self._outputs = {one.channel: 0.0 for one in signals.outputs}
        """by pin, the level that it is to have"""
        self._unsure: dict[int, int] = {}
        """outputs that the sketch has not confirmed, and how often they were written"""
        self._reminded_at = self._asked_at = -math.inf

    def carry_on(self, earlier: FirmataSignals) -> None:
        """Take over what is known, where the pins are the same: the sketch may not say it once more."""
        if earlier.settled and (earlier.signals, earlier.modes) == (self.signals, self.modes):
            self.settled, self._bits, self._shares = True, earlier._bits, earlier._shares
            self._outputs, self._unsure = earlier._outputs, earlier._unsure

    def stale(self, states: Mapping[int, PinState]) -> tuple[int, ...]:
        """Inputs of which an old sketch says nothing until they change: it was told to report them before."""
        if self._answers or self.settled:
            return ()
        return tuple(pin for pin in self._digital if pin in states and states[pin].mode == PinMode.INPUT)

    def hide(self, pins: Sequence[int]) -> bytes:
        """What lets an old sketch take inputs for low until they are set up again: it reports them anew then.

        It listens to pins in the mode ANALOG, too, and drives none of them.
        """
        return self.report() + b"".join(codec.pin_mode(pin, PinMode.ANALOG) for pin in pins)

    def report(self) -> bytes:
        """What has digital inputs reported."""
        ports = sorted({pin // codec.PORT for pin in self._digital})
        return b"".join(map(codec.report_digital, ports))

    def settle(self) -> None:
        """Reports that were asked for have had their time: what an old sketch does not report is low."""
        self.settled = True
        if not self._answers:
            self._bits = {pin // codec.PORT: 0 for pin in self._digital} | self._bits

    def set_up(self, states: Mapping[int, PinState]) -> bytes:
        """What sets the pins up that are not yet; an output that is one keeps its level."""
        request = b""
        for pin, mode in self.modes.items():
            state = states.get(pin)
            if state is None or state.mode != mode:
                request += codec.pin_mode(pin, mode)
                if state is not None and pin in self._digital:
                    self.settled = False
                    self._bits.pop(pin // codec.PORT, None)
            elif pin in self._outputs and pin not in self._unsure:
                full = codec.PWM_FULL if mode is PinMode.PWM else 1
                self._outputs[pin] = min(1.0, state.value / full)
        for port in sorted({one.channel // codec.PORT for one in self._pulled_up}):
            request += self._port(port)
        if any(one.kind == "analog" for one in self.signals.inputs):
            request += codec.sampling_interval(_SAMPLING_MS)
        return request

    def is_set_up(self, states: Mapping[int, PinState]) -> bool:
        """Whether every pin has its mode."""
        return all(pin in states and states[pin].mode == mode for pin, mode in self.modes.items())

    def take(self, reply: Reply) -> None:
        """Take note of a report, or of the state of an output."""
        match reply:
            case DigitalReport(port, bits):
                self._bits[port] = bits
            case AnalogReport(channel, value):
                self._shares[channel] = min(1.0, value / codec.ANALOG_FULL)
            case PinState(pin, mode, value) if pin in self._unsure:
                if mode == self.modes[pin] and value == self._written(pin):
                    del self._unsure[pin]
            case _:
                pass

    def put(self, output: Output, level: float, *, pull_up: bool = True) -> bytes:
        """What drives an output at a level 0 ... 1.

        Without ``pull_up`` a board that may have started anew does not drive the inputs high: until it is
        told, they are outputs.
        """
        pin = output.channel
        self._outputs[pin] = level
        self._unsure[pin] = 1
        return self._write(pin, pull_up=pull_up)

    def due(self, now: float) -> bytes:
        """What is to be sent now: an output that is not confirmed again, with a question, and reminders."""
        request = b""
        if self._unsure and now - self._asked_at >= _ASK_S:
            self._asked_at = now
            pin, times = next(iter(self._unsure.items()))
            if times >= _ATTEMPTS:
                title = next(one.title for one in self.signals.outputs if one.channel == pin)
                raise BoardError(
                    f"{title}: the board did not switch pin {pin} though told {times} times; check the USB "
                    "cable, then connect again"
                )
            del self._unsure[pin]
            self._unsure[pin] = times + 1  # behind the others
            again = self._write(pin) if times > 1 else b""
            request += again + codec.pin_state_query(pin)
        if now - self._reminded_at >= _REMIND_S and self.signals.inputs:
            self._reminded_at = now
            request += self.report()
            for one in self.signals.inputs:
                if one.kind == "analog":
                    request += codec.report_analog(self._analog[one.channel])
        return request

    def doubt(self) -> None:
        """The board was silent: what it got of the last writes is not known."""
        self._unsure = dict.fromkeys(self._outputs, 1)
        self._reminded_at = -math.inf

    @property
    def inputs(self) -> dict[str, float]:
        """Levels by name, of those that were reported: no input is low because nothing is known of it."""
        levels = {one.name: self._level(one) for one in self.signals.inputs}
        return {name: level for name, level in levels.items() if level is not None}

    @property
    def outputs(self) -> dict[str, float]:
        """Levels by name, as last sent or found."""
        return {one.name: self._outputs[one.channel] for one in self.signals.outputs}

    def _level(self, one: Input) -> float | None:
        if one.kind == "analog":
            return self._shares.get(self._analog[one.channel])
        port, bit = divmod(one.channel, codec.PORT)
        bits = self._bits.get(port)
        return None if bits is None else float(bits >> bit & 1)

    def _written(self, pin: int) -> int:
        """The value that the sketch keeps for an output."""
        level = self._outputs[pin]
        return round(codec.PWM_FULL * level) if self.modes[pin] is PinMode.PWM else int(level > ON)

    def _write(self, pin: int, *, pull_up: bool = True) -> bytes:
        if self.modes[pin] is PinMode.PWM:
            return codec.pwm_write(pin, self._written(pin))
        return self._port(pin // codec.PORT, pull_up=pull_up)

    def _port(self, port: int, *, pull_up: bool = True) -> bytes:
        """All pins of a port: outputs, and inputs that an old sketch pulls up where they are written high."""
        high = [one.channel for one in self._pulled_up if pull_up]
        high += [pin for pin, level in self._outputs.items() if level > ON]
        return codec.digital_write(
            port, sum(1 << pin % codec.PORT for pin in high if pin // codec.PORT == port)
        )


_DOZEN, _FIRST_SERVO_PIN = 12, 2
_TIMERS = {70: ((44, 45, 46), (11, 12), (2, 3, 5), (6, 7, 8)), 20: ((9, 10),), 22: ((9, 10),)}
"""By how many pins a board has (Mega; Uno, Nano): the PWM pins that lose their timer to each dozen of servos,
in the order in which the Servo library takes the timers (ServoTimers.h)."""


def _pwm_without_timer(pins: int, servos: Sequence[int]) -> set[int]:
    """PWM pins that stand still while servos are on.

    Old sketches have a servo for each pin, later ones give servos out in the order in which they come.
    """
    dozens = {(pin - _FIRST_SERVO_PIN) // _DOZEN for pin in servos}
    dozens |= set(range(-(-(len(servos) + 1) // _DOZEN))) if servos else set()
    timers = _TIMERS.get(pins, ())
    return {pin for dozen in dozens if 0 <= dozen < len(timers) for pin in timers[dozen]}


def _output_mode(output: Output) -> PinMode:
    return PinMode.PWM if output.kind == "pwm" else PinMode.OUTPUT
