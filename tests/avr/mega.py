"""The Arduino Mega 2560: the port bits of its pins, the duty of its PWM outputs, and servo pulses."""

from __future__ import annotations

from dataclasses import dataclass

from tests.avr.avr import Avr

PINS = (
    "E0 E1 E4 E5 G5 E3 H3 H4 H5 H6 B4 B5 B6 B7 J1 J0 H1 H0 D3 D2 D1 D0 "  # 0 … 21
    "A0 A1 A2 A3 A4 A5 A6 A7 C7 C6 C5 C4 C3 C2 C1 C0 D7 G2 G1 G0 "  # 22 … 41
    "L7 L6 L5 L4 L3 L2 L1 L0 B3 B2 B1 B0 "  # 42 … 53
    "F0 F1 F2 F3 F4 F5 F6 F7 K0 K1 K2 K3 K4 K5 K6 K7"  # 54 … 69: A0 … A15
).split()
"""Port bit by Arduino pin number (pinout diagram of the board)."""

_OUTPUTS = {
    2: "3B", 3: "3C", 4: "0B", 5: "3A", 6: "4A", 7: "4B", 8: "4C", 9: "2B", 10: "2A",
    11: "1A", 12: "1B", 13: "0A", 44: "5C", 45: "5B", 46: "5A",
}  # fmt: skip
"""Timer and compare channel by Arduino pin number."""
_CONTROL = {"0": 0x44, "1": 0x80, "2": 0xB0, "3": 0x90, "4": 0xA0, "5": 0x120}
"""Data address of TCCRnA by timer (ATmega2560 datasheet, register summary)."""


def duty(avr: Avr, pin: int) -> float:
    """The share of time a PWM pin is high, 0 … 1, from its timer's registers.

    A pin that its timer does not drive is at its port's level. (simavr does not bring every mode of
    hardware PWM out to the pin, so it cannot be measured there.)"""
    if pin not in _OUTPUTS:
        raise ValueError(f"pin {pin} of a Mega has no timer; {sorted(_OUTPUTS)} have")
    timer, channel = _OUTPUTS[pin]
    control = _CONTROL[timer]
    output = avr.data(control) >> {"A": 6, "B": 4, "C": 2}[channel] & 3  # COMnx1:0
    if output == 0:
        return float(avr.pin(PINS[pin]))
    if output == 1:
        raise ValueError(f"pin {pin} toggles on compare match: that is no PWM")
    top, fast = _span(avr, timer, control)
    compare = min(_compare(avr, timer, control, channel), top)
    share = (compare + 1) / (top + 1) if fast else compare / top
    return 1.0 - share if output == 3 else share


def _span(avr: Avr, timer: str, control: int) -> tuple[int, bool]:
    """Return the value a timer counts up to, and whether it then starts at 0 (fast PWM) or turns round."""
    a, b = avr.data(control), avr.data(control + 1)
    if timer in "02":
        mode = (b & 8) >> 1 | a & 3  # WGM2:0, table 16-8
        tops = {1: 0xFF, 3: 0xFF, 5: "A", 7: "A"}
        fast = mode in (3, 7)
    else:
        mode = (b & 0x18) >> 1 | a & 3  # WGM3:0, table 17-2
        tops = {1: 0xFF, 2: 0x1FF, 3: 0x3FF, 5: 0xFF, 6: 0x1FF, 7: 0x3FF}
        tops |= {8: "I", 9: "A", 10: "I", 11: "A", 14: "I", 15: "A"}
        fast = mode in (5, 6, 7, 14, 15)
    if mode not in tops:
        raise ValueError(f"timer {timer} counts in mode {mode}: that is no PWM")
    top = tops[mode]
    if isinstance(top, str):
        top = _word(avr, control + 6) if top == "I" else _compare(avr, timer, control, "A")
    return top, fast


def _compare(avr: Avr, timer: str, control: int, channel: str) -> int:
    if timer in "02":
        return avr.data(control + 3 + "AB".index(channel))
    return _word(avr, control + 8 + 2 * "ABC".index(channel))


def _word(avr: Avr, address: int) -> int:
    return avr.data(address) | avr.data(address + 1) << 8


@dataclass(frozen=True, slots=True)
class Pulse:
    """One pulse on an Arduino pin."""

    pin: int
    start_s: float
    width_us: float


class PulseMeter:
    """Measures the pulses on pins of a simulated Mega, from now on."""

    def __init__(self, avr: Avr, pins: tuple[int, ...]) -> None:
        self._avr = avr
        self._pin_of = {PINS[pin]: pin for pin in pins}
        self._risen: dict[int, int] = {}
        avr.watch(*self._pin_of)

    def take(self) -> list[Pulse]:
        """The pulses that have ended since the last call, in the order of their ends."""
        pulses: list[Pulse] = []
        for edge in self._avr.edges():
            pin = self._pin_of[edge.pin]
            if edge.level:
                self._risen[pin] = edge.cycle
            elif pin in self._risen:
                start = self._risen.pop(pin)
                clock_hz = self._avr.clock_hz
                pulses.append(Pulse(pin, start / clock_hz, (edge.cycle - start) * 1e6 / clock_hz))
        return pulses
