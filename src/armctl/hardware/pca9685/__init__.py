"""PCA9685: sixteen channels of pulses from a chip on I²C. What its descriptor says, too: it is light.

Facts and registers: NXP, PCA9685 product data sheet, revision 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta

from armctl.errors import BoardError
from armctl.hardware.driver import ChannelScale, ChannelSettings, ChannelTable
from armctl.robot.file import Strict

CHANNELS = 16
SCALE = ChannelScale("channel", "µs")
STEPS = 4096
"""of a period; a pulse is a whole number of them"""
LOWEST_ADDRESS, HIGHEST_ADDRESS = 0x40, 0x7F
ALL_CHIPS = 0x70
"""address at which every chip listens that has not been told otherwise"""
SCHEME = "i2c"
PI_BUS = "I²C bus of a Raspberry Pi"
"""how the bus on the pins 3 and 5 is listed"""
_SHARE = 0.95
"""of a period that a pulse may fill"""


class Pca9685Options(Strict, frozen=True):
    """`[board]` of a PCA9685."""

    address: Annotated[int, Meta(ge=LOWEST_ADDRESS, le=HIGHEST_ADDRESS)] = LOWEST_ADDRESS
    """on the I²C bus, `0x40` … `0x7F`; one in the port (`i2c://1/0x41`) counts more"""
    frequency_hz: Annotated[float, Meta(ge=40, le=400)] = 50.0
    """pulses a second of all channels; 50 suits every servo, digital ones take more, in finer steps"""
    oscillator_mhz: Annotated[float, Meta(ge=20, le=30)] = 25.0
    """clock of this one chip: most are off by several percent, and so is every pulse; measure one"""


def channel_table(settings: Sequence[ChannelSettings], period_us: float) -> ChannelTable:
    """The configured channels, pulse widths in µs, where they fit into the chip's period [µs]."""

    def check(one: ChannelSettings) -> None:
        if not 0 <= one.channel < CHANNELS:
            raise BoardError(
                f"channel {one.channel}: a PCA9685 has channels 0 … {CHANNELS - 1}; change the servo map"
            )
        longest, step_us = int(_SHARE * period_us), period_us / STEPS
        holds = SCALE.holds_range(one, int(2 * step_us) + 1, longest)
        if not holds or one.maximum // step_us < -(-one.minimum // step_us):
            raise BoardError(
                f"channel {one.channel}: {one.minimum:g} … {one.maximum:g} µs is no range for pulses that "
                f"come {1e6 / period_us:.0f} times a second; the largest is {longest} µs, the smaller number "
                f"goes first, and it holds a step of {step_us:.1f} µs; change the servo map, or "
                "frequency_hz in [board]"
            )

    return ChannelTable(SCALE, settings, check)
