"""armctl's Firmata driver on a simulated Mega with the image that others built."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tests.avr.avr import Avr
from tests.avr.mega import Pulse, PulseMeter
from tests.avr.serve import stepped_line

from armctl.hardware.driver import ChannelSettings
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.transport import Connection

FRAME_S = 0.020
"""what the Servo library takes from one pulse on a pin to the next"""
LOWEST_US, HIGHEST_US = 544, 2400

ONE_TIMER = tuple(range(2, 14))
"""pins whose pulses the library makes with one timer; with 14, 26 and 38 begin the next dozens"""
ALL_OVER = (2, 5, 13, 14, 22, 44, 49)
"""pins below and above 15, of three of the four timers"""


class FirmataRig:
    """The driver, connected and configured, and the meter on its pins; all in simulated time."""

    def __init__(self, avr: Avr, pins: Sequence[int]) -> None:
        self.avr = avr
        self.pins = tuple(pins)
        self.driver = FirmataDriver(Connection(stepped_line(avr), lambda: avr.now))
        self.identity = self.driver.open()
        self.driver.configure([ChannelSettings(pin, LOWEST_US, HIGHEST_US) for pin in pins])
        self.meter = PulseMeter(avr, self.pins)

    def stream(self, setpoints: Mapping[int, int], frames: int) -> list[Pulse]:
        """Write and read as the runtime does, every 20 ms, and return the pulses that ended meanwhile.

        (The driver switches pins on a few at a time.)
        """
        self.meter.take()
        for _ in range(frames):
            self.driver.write(setpoints)
            readback = self.driver.read()
            assert readback.errors == ()
            self.avr.run_for(FRAME_S)
        return self.meter.take()

    def pulses_of(self, seconds: float) -> list[Pulse]:
        """Let time pass and return the pulses that ended in it."""
        self.meter.take()
        self.avr.run_for(seconds)
        return self.meter.take()

    def settled_us(self, frames: int = 5) -> dict[int, float]:
        """The median width of the next pulses on each pin, with nothing under way on the line.

        (A single pulse is longer or shorter by as long as the CPU is busy with another interrupt.)
        """
        self.avr.run_for(2 * FRAME_S)
        widths: dict[int, list[float]] = {pin: [] for pin in self.pins}
        for pulse in self.pulses_of(frames * FRAME_S):
            widths[pulse.pin].append(pulse.width_us)
        return {pin: sorted(seen)[len(seen) // 2] for pin, seen in widths.items() if seen}
