"""I²C buses of this computer as lines: their addresses, and their transfers as bytes.

A transfer writes some bytes to an address and then reads some. As bytes it is ``tag, address, number written,
number read, what is written``; its answer is ``tag, ACKNOWLEDGED, what was read``, or ``tag, REFUSED``. So
a bus is a line as any other: simulated ones are byte models, and faults strike them as serial lines.
"""

from __future__ import annotations

import errno
import logging
import re
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

from armctl.errors import BoardError, PortError
from armctl.hardware.pca9685 import ALL_CHIPS, HIGHEST_ADDRESS, LOWEST_ADDRESS, PI_BUS, SCHEME
from armctl.hardware.transport import PortInfo
from armctl.system import group_of, may_open

_LOGGER = logging.getLogger("armctl.hardware")
_HOW = f"name a bus and an address, as in {SCHEME}://1/0x40, or the bus alone"
_FORM = re.compile(rf"{SCHEME}://(\d{{1,3}})(?:/(0x[0-9a-fA-F]{{1,2}}|\d{{1,3}}))?")
ACKNOWLEDGED, REFUSED = 0, 1

Transfer: TypeAlias = Callable[[int, bytes, int], "bytes | None"]
"""One transfer: address, what is written, how many bytes are read then. None: nobody acknowledges."""


def is_bus(port: str) -> bool:
    """Whether a port is written as an I²C bus."""
    return port.startswith(f"{SCHEME}://")


def bus_and_address(port: str) -> tuple[int, int | None]:
    """The number of a bus and the address, where the port says one; ``PortError`` where it is no bus."""
    found = _FORM.fullmatch(port)
    if found is None:
        raise PortError(f"{port}: not an I²C bus; {_HOW}")
    address = None if found[2] is None else int(found[2], 0 if found[2].startswith("0x") else 10)
    if address is not None and (not LOWEST_ADDRESS <= address <= HIGHEST_ADDRESS or address == ALL_CHIPS):
        raise PortError(
            f"{port}: a PCA9685 has an address of {LOWEST_ADDRESS:#x} … {HIGHEST_ADDRESS:#x}, but not "
            f"{ALL_CHIPS:#x}, at which all of them listen; `i2cdetect -y {found[1]}` shows who answers"
        )
    return int(found[1]), address


# Transfers as bytes.

_HEAD = 4
TAGS = 256


def request(tag: int, address: int, data: bytes, count: int) -> bytes:
    """The bytes of one transfer; its answer has the same ``tag``."""
    return bytes((tag, address, len(data), count)) + data


def carried_out(requests: bytes, transfer: Transfer) -> Iterator[bytes]:
    """The answers to requests, in order. One that is not whole is no transfer."""
    at = 0
    while at + _HEAD <= len(requests):
        tag, address, length, count = requests[at : at + _HEAD]
        data = requests[at + _HEAD : at + _HEAD + length]
        at += _HEAD + length
        if at > len(requests):
            return
        found = transfer(address, data, count)
        yield bytes((tag, REFUSED)) if found is None else bytes((tag, ACKNOWLEDGED)) + found


# A bus of Linux, through smbus2.

_REFUSALS = (errno.EREMOTEIO, errno.ENXIO)
"""what drivers of buses report where nobody acknowledges"""
_MODEL = Path("/sys/firmware/devicetree/base/model")
_DEVICES = Path("/dev")
_PI_BUS_NUMBER = 1


class BusTransport:
    """A bus of Linux as a line. The bus is not locked: other programs may use other chips on it."""

    def __init__(self, port: str) -> None:
        self.name = port
        number, _ = bus_and_address(port)
        self._device = f"/dev/i2c-{number}"
        try:
            self._library: Any = import_module("smbus2")
        except ImportError as error:
            raise PortError(
                f"{port}: I²C takes the package smbus2, which is not installed: pip install smbus2"
            ) from error
        try:
            self._bus: Any = self._library.SMBus(number)
        except OSError as error:
            raise PortError(f"{port}: {_why_not_opened(self._device, error)}") from error
        self._received = bytearray()

    def write(self, data: bytes) -> None:
        """Carry out the transfers of ``data``; their answers can be read at once."""
        self._received += b"".join(carried_out(data, self._transfer))

    def read(self, count: int, timeout_s: float) -> bytes:
        """Return ``count`` bytes, or the fewer that there are: nothing comes by itself."""
        taken = bytes(self._received[:count])
        del self._received[:count]
        return taken

    def discard_input(self) -> None:
        """Forget what was not read."""
        self._received.clear()

    def close(self) -> None:
        """Close the device."""
        try:
            self._bus.close()
        except OSError as error:  # the adapter was pulled: there is nothing left to close
            _LOGGER.info("closing %s: %s", self._device, error.strerror)

    def _transfer(self, address: int, data: bytes, count: int) -> bytes | None:
        message = self._library.i2c_msg
        parts: list[Any] = [message.write(address, data)] if data else []
        parts += [message.read(address, count)] if count else []
        try:
            self._bus.i2c_rdwr(*parts)
        except OSError as error:
            if error.errno in _REFUSALS:
                return None
            _LOGGER.info("a transfer on %s failed: %s", self._device, error.strerror)
            raise BoardError(
                f"{self.name}: the I²C bus failed ({error.strerror}): look for a short between SDA, SCL and "
                "GND, and for a board without power on the bus, then connect again"
            ) from error
        return bytes(parts[-1]) if count else b""


def _why_not_opened(device: str, error: OSError) -> str:
    if isinstance(error, FileNotFoundError):
        return (
            f"there is no {device}: switch I²C on (Raspberry Pi: `sudo raspi-config nonint do_i2c 0`, then "
            "restart it); elsewhere load the module, `sudo modprobe i2c-dev`"
        )
    if isinstance(error, PermissionError):
        return f"no permission to open {device}; {_permission(device)}"
    return f"{device} cannot be opened ({error.strerror})"


def _permission(device: str) -> str:
    group = group_of(device) or "i2c"
    group = "i2c" if group == "root" else group
    return f"run `sudo usermod -aG {group} $USER`, then log out and in again (a new terminal is not enough)"


def pi_buses(model: Path = _MODEL, devices: Path = _DEVICES) -> tuple[PortInfo, ...]:
    """The bus on the pins of a Raspberry Pi. Other computers have their memory and screens on such buses."""
    device = devices / f"i2c-{_PI_BUS_NUMBER}"
    try:
        text = model.read_text(encoding="utf-8", errors="replace").rstrip("\0")
    except OSError:  # a computer without a device tree
        return ()
    if "Raspberry Pi" not in text or not device.exists():
        return ()
    usable = may_open(str(device))
    why_not = None if usable else f"no permission to open it; {_permission(str(device))}"
    return (PortInfo(f"{SCHEME}://{_PI_BUS_NUMBER}", PI_BUS, text, None, usable, why_not),)
