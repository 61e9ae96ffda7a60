"""One servo of a simulated sketch: what the Arduino Servo library does with what it is given."""

from __future__ import annotations

from dataclasses import dataclass

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
