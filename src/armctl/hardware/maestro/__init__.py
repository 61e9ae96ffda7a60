"""Pololu's Maestro boards. What their descriptor says as well as their driver stands here: it is light."""

from __future__ import annotations

from enum import Enum

from armctl.hardware.driver import ChannelScale

QUARTERS_PER_US = 4
DEFAULT_DEVICE_NUMBER = 12
"""of the Pololu form of commands"""
SCALE = ChannelScale("channel", "µs", QUARTERS_PER_US)
FACTORY_MINIMUM_US, FACTORY_MAXIMUM_US = 992.0, 2000.0
HIGH_FROM = 6000
"""an output is high from this target on [quarter µs], a servo's middle (guide, section 5.e)"""
FULL_SCALE = 1023
"""what an input at the board's 5 V reads; those from channel 12 on read this or 0"""
FIRST_DIGITAL_CHANNEL = 12
"""inputs from here on tell no more than low and high"""
SILENT_ADVICE = (
    'set the serial mode to "USB Dual Port" in the Maestro Control Center (Serial Settings): in the '
    'factory\'s "UART, detect baud rate" the board silently ignores commands over USB. Check also that this '
    "is the command port (…-if00)"
)


class MaestroModel(Enum):
    """A member of the family: name, channels, USB product number."""

    MICRO_6 = ("Pololu Micro Maestro 6-channel", 6, 0x0089)
    MINI_12 = ("Pololu Mini Maestro 12-channel", 12, 0x008A)
    MINI_18 = ("Pololu Mini Maestro 18-channel", 18, 0x008B)
    MINI_24 = ("Pololu Mini Maestro 24-channel", 24, 0x008C)

    def __init__(self, label: str, channels: int, usb_product: int) -> None:
        self.label = label
        self.channels = channels
        self.usb_product = usb_product

    @property
    def has_multiple_targets(self) -> bool:
        """Whether it knows Set Multiple Targets; to the Micro that command is a protocol error."""
        return self is not MaestroModel.MICRO_6

    @classmethod
    def from_label(cls, label: str) -> MaestroModel | None:
        """The model of this name, None when there is none."""
        return next((model for model in cls if model.label == label), None)

    @classmethod
    def with_channels(cls, count: int) -> MaestroModel:
        """The smallest model with at least ``count`` channels (the largest if none has that many)."""
        return next((model for model in cls if model.channels >= count), cls.MINI_24)
