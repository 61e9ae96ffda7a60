"""Chips on the I²C pins of a simulated CPU (simavr's ``avr_twi.h``)."""

from __future__ import annotations

import ctypes

from tests.avr.avr import Avr
from tests.avr.building import library

from armctl.hardware.firmata.simulated import I2cTransfer

_START, _STOP, _ACK, _WRITE, _READ = 1, 2, 8, 16, 32
_BUS = ctypes.CFUNCTYPE(ctypes.c_uint32, ctypes.c_uint8, ctypes.c_uint8, ctypes.c_uint8)


class I2cPins:
    """Puts chips on the bus: ``transfer`` gets what is written up to the next start or stop.

    What is read is asked for byte by byte, from where the chip has its pointer.
    """

    def __init__(self, avr: Avr, transfer: I2cTransfer) -> None:
        self._transfer = transfer
        self._address = 0
        self._written = bytearray()
        self._callback = _BUS(self._answer)  # kept: C code calls it
        shim = ctypes.CDLL(str(library("shim")))
        shim.sim_bus.argtypes = (ctypes.c_void_p, _BUS)
        shim.sim_bus(avr.handle, self._callback)

    def _answer(self, message: int, address: int, data: int) -> int:
        """The message that answers, and its data in the low byte; 0: nobody."""
        if message & (_START | _STOP) and self._written:
            self._transfer(self._address, bytes(self._written), 0)
            self._written.clear()
        if message & _START:
            self._address = address >> 1
            return 0 if self._transfer(self._address, b"", 0) is None else _ACK << 8 | 1
        if message & _WRITE:
            self._written.append(data)
            return _ACK << 8 | 1
        if message & _READ:
            found = self._transfer(self._address, b"", 1)
            return _READ << 8 | found[0] if found else 0
        return 0
