"""Arduinos with StandardFirmata: its line, its servo pins and their pulse widths."""

from __future__ import annotations

from collections.abc import Sequence

from armctl.errors import BoardError
from armctl.hardware.driver import ChannelScale, ChannelSettings, ChannelTable

BAUD = 57_600
SERVO_FRAME_S = 0.020
BYTE_S = 10 / BAUD  # 8N1: start bit, eight data bits, stop bit
SCALE = ChannelScale("pin", "µs")
HOW_TO_LOAD = (
    "load the sketch: Arduino IDE, File > Examples > Firmata > StandardFirmata, Upload; then connect again"
)
SMALLEST_PULSE_US = 544
"""anything below is taken as degrees (the Servo library's MIN_PULSE_WIDTH)"""
LARGEST_PULSE_US = 2912
"""the longest limit that the Servo library can hold"""
MOST_SERVOS = 16
"""16 setpoints of 6 bytes are 96 of the 115 bytes that 57600 baud carry in a servo frame of 20 ms"""


def pin_table(settings: Sequence[ChannelSettings], servo_pins: Sequence[int]) -> ChannelTable:
    """The configured pins, pulse widths in µs, where they are among the board's ``servo_pins``."""
    if len(settings) > MOST_SERVOS:
        raise BoardError(
            f"{len(settings)} servos: at 57600 baud a Firmata board can be sent {MOST_SERVOS} setpoints "
            "in each servo frame; put the others on a second board"
        )

    def check(one: ChannelSettings) -> None:
        if one.channel not in servo_pins:
            raise BoardError(
                f"pin {one.channel} cannot drive a servo on this board; the pins that can: "
                f"{pin_ranges(servo_pins)}; change the robot's servo map"
            )
        if not SCALE.holds_range(one, SMALLEST_PULSE_US, LARGEST_PULSE_US):
            raise BoardError(
                f"pin {one.channel}: {one.minimum:g} … {one.maximum:g} µs is no range for a servo on a "
                f"Firmata board; it must lie within {SMALLEST_PULSE_US} … {LARGEST_PULSE_US} µs, the smaller "
                f"number first (the sketch takes anything below {SMALLEST_PULSE_US} as degrees)"
            )

    return ChannelTable(SCALE, settings, check)


def pin_ranges(pins: Sequence[int]) -> str:
    """Numbers in words: ``2 … 13, 22``."""
    parts: list[list[int]] = []
    for pin in sorted(pins):
        if parts and parts[-1][-1] == pin - 1:
            parts[-1].append(pin)
        else:
            parts.append([pin])
    words = (f"{part[0]} … {part[-1]}" if len(part) > 1 else f"{part[0]}" for part in parts)
    return ", ".join(words) or "none at all"
