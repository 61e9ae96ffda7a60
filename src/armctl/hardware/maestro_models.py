"""The four boards of the Maestro family and how they differ."""

from __future__ import annotations

from enum import Enum

POLOLU_USB_VENDOR = 0x1FFB


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
    def from_usb(cls, vendor: int | None, product: int | None) -> MaestroModel | None:
        """The model with these USB numbers, None when they are not a Maestro's."""
        if vendor != POLOLU_USB_VENDOR:
            return None
        return next((model for model in cls if model.usb_product == product), None)

    @classmethod
    def from_label(cls, label: str) -> MaestroModel | None:
        """The model of this name, None when there is none."""
        return next((model for model in cls if model.label == label), None)

    @classmethod
    def with_channels(cls, count: int) -> MaestroModel:
        """The smallest model with at least ``count`` channels (the largest if none has that many)."""
        return next((model for model in cls if model.channels >= count), cls.MINI_24)
