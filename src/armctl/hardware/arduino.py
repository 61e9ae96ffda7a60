"""How Arduinos, and the chips on clones of them, are listed as serial ports."""

from __future__ import annotations

from collections.abc import Mapping

ARDUINO_MEGA = "Arduino Mega"
USB_SERIAL = "Arduino or clone (USB-serial)"
LIKELY = ((ARDUINO_MEGA,), (USB_SERIAL,))
"""what calls itself a Mega goes before what may be anything"""

_VENDORS = (0x2341, 0x2A03)
_MEGAS = (
    *((vendor, product) for vendor in _VENDORS for product in (0x0010, 0x0042)),
    (0x2341, 0x0210),
    (0x2341, 0x0242),
)
_CHIPS = (
    (0x1A86, 0x7523),  # CH340
    (0x1A86, 0x5523),  # CH341
    (0x1A86, 0x55D4),  # CH9102
    (0x0403, 0x6001),  # FT232R
    (0x0403, 0x6015),  # FT231X
    (0x10C4, 0xEA60),  # CP2102
    (0x067B, 0x2303),  # PL2303
)
"""Chips on clones of the Mega and the Uno, and in plain adapter cables: the numbers do not tell which."""
USB: Mapping[tuple[int, int | None], str] = {
    **dict.fromkeys(_MEGAS, ARDUINO_MEGA),
    **dict.fromkeys(_CHIPS, USB_SERIAL),
    **{(vendor, None): USB_SERIAL for vendor in _VENDORS},
}
"""listing by USB vendor and product; None: every product"""
