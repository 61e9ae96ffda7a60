"""Servo pulses out of a pin's edges."""

from __future__ import annotations

from dataclasses import dataclass

from tests.avr.avr import Avr
from tests.avr.mega import PINS


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
