"""The configured pins of a Firmata board and what each may be sent."""

from __future__ import annotations

import math
from collections.abc import Sequence

from armctl.errors import BoardError
from armctl.hardware.channel_scale import ChannelScale
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.firmata.codec import LARGEST_PULSE_US, SMALLEST_PULSE_US

MOST_SERVOS = 16
"""16 setpoints of 6 bytes are 96 of the 115 bytes that 57600 baud carry in a servo frame of 20 ms"""
SCALE = ChannelScale("pin", "µs")


class PinTable:
    """Settings by pin, checked once, and the last gate before the wire.

    Args:
        settings: what each pin may do; pulse widths in µs.
        servo_pins: the pins that the board can drive a servo on.

    Raises:
        BoardError: a pin that drives no servo, twice the same one, a range that cannot be, or too many.
    """

    def __init__(self, settings: Sequence[ChannelSettings], servo_pins: Sequence[int]) -> None:
        if len(settings) > MOST_SERVOS:
            raise BoardError(
                f"{len(settings)} servos: at 57600 baud a Firmata board can be sent {MOST_SERVOS} setpoints "
                "in each servo frame; put the others on a second board"
            )
        self._settings: dict[int, ChannelSettings] = {}
        for one in settings:
            if one.channel not in servo_pins:
                raise BoardError(
                    f"pin {one.channel} cannot drive a servo on this board; the pins that can: "
                    f"{_ranges(servo_pins)}; change the robot's servo map"
                )
            if one.channel in self._settings:
                raise BoardError(f"pin {one.channel} is configured twice; give each joint a pin of its own")
            _check_range(one)
            self._settings[one.channel] = one

    @property
    def pins(self) -> tuple[int, ...]:
        """The configured pins, lowest first."""
        return tuple(sorted(self._settings))

    def range_us(self, pin: int) -> tuple[int, int]:
        """The shortest and the longest pulse that a configured pin may be sent [µs]."""
        return SCALE.whole_range(self._settings[pin])

    def admit(self, pin: int, pulse_us: float) -> int:
        """The setpoint [µs] as a whole number, as near as the range allows, if it may be sent at all.

        Raises:
            BoardError: not configured, not finite, or outside the range.
        """
        return SCALE.admit(self._settings, pin, pulse_us)


def _check_range(settings: ChannelSettings) -> None:
    bounds = (settings.minimum, settings.maximum)
    if all(map(math.isfinite, bounds)) and SMALLEST_PULSE_US <= settings.minimum:
        lowest, highest = SCALE.whole_range(settings)
        if lowest <= highest <= LARGEST_PULSE_US:
            return
    raise BoardError(
        f"pin {settings.channel}: {settings.minimum:g} … {settings.maximum:g} µs is no range for a servo on "
        f"a Firmata board; it must lie within {SMALLEST_PULSE_US} … {LARGEST_PULSE_US} µs, the smaller "
        f"number first (the sketch takes anything below {SMALLEST_PULSE_US} as degrees)"
    )


def _ranges(pins: Sequence[int]) -> str:
    """Numbers in words: ``2 … 13, 22``."""
    parts: list[tuple[int, int]] = []
    for pin in sorted(pins):
        if parts and parts[-1][1] == pin - 1:
            parts[-1] = (parts[-1][0], pin)
        else:
            parts.append((pin, pin))
    return (
        ", ".join(f"{first} … {last}" if last > first else f"{first}" for first, last in parts)
        or "none at all"
    )
