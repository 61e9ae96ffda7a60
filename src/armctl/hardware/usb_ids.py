"""USB numbers of the boards that armctl drives, and of what hides behind a common USB-to-serial chip."""

from __future__ import annotations

from armctl.hardware.maestro_models import MaestroModel

ARDUINO_MEGA = "Arduino Mega"
USB_SERIAL = "Arduino or clone (USB-serial)"
UNKNOWN = "unknown"

ARDUINO_USB_VENDORS = (0x2341, 0x2A03)
_MEGA_USB = frozenset(
    [(vendor, product) for vendor in ARDUINO_USB_VENDORS for product in (0x0010, 0x0042)]
    + [(0x2341, 0x0210), (0x2341, 0x0242)]
)
USB_SERIAL_CHIPS = {
    (0x1A86, 0x7523): "CH340",
    (0x1A86, 0x5523): "CH341",
    (0x1A86, 0x55D4): "CH9102",
    (0x0403, 0x6001): "FT232R",
    (0x0403, 0x6015): "FT231X",
    (0x10C4, 0xEA60): "CP2102",
    (0x067B, 0x2303): "PL2303",
}
"""Chips on clones of the Mega and the Uno, and in plain adapter cables: the numbers do not tell which."""


def board_kind(vendor: int | None, product: int | None) -> str:
    """The label of the board with these USB numbers: a ``MaestroModel`` label or one of the constants."""
    model = MaestroModel.from_usb(vendor, product)
    if model is not None:
        return model.label
    if (vendor, product) in _MEGA_USB:
        return ARDUINO_MEGA
    if vendor in ARDUINO_USB_VENDORS or (vendor, product) in USB_SERIAL_CHIPS:
        return USB_SERIAL
    return UNKNOWN
