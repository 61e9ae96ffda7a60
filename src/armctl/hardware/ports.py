"""The serial ports of this computer: which boards are there, which port to use, and why not the others."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from serial.tools.list_ports import comports
from serial.tools.list_ports_common import ListPortInfo

from armctl.errors import PortError
from armctl.hardware.maestro_models import MaestroModel
from armctl.hardware.permissions import may_open, permission_hint

ARDUINO_MEGA = "Arduino Mega"
UNKNOWN = "unknown"

_BY_ID = Path("/dev/serial/by-id")
_MEGA_USB = frozenset(
    [(vendor, product) for vendor in (0x2341, 0x2A03) for product in (0x0010, 0x0042)]
    + [(0x2341, 0x0210), (0x2341, 0x0242)]
)
_TTL_INTERFACE = 2
_LOCATION_INTERFACE = re.compile(r":\d+\.(\d+)$")  # "1-1.2:1.0": bus-port:configuration.interface
_BY_ID_INTERFACE = re.compile(r"-if([0-9a-fA-F]{2})(-port\d+)?$")
_BY_ID_SERIAL = re.compile(r"_([0-9A-Za-z]+)-if[0-9a-fA-F]{2}(-port\d+)?$")
_BY_ID_MAESTRO = re.compile(r"Pololu_.*Maestro_(6|12|18|24)-Servo")


@dataclass(frozen=True, slots=True)
class PortInfo:
    """One serial port.

    Args:
        device: what to open.
        kind: the board: a ``MaestroModel`` label, ``ARDUINO_MEGA`` or ``UNKNOWN``.
        description: what the operating system says.
        serial_number: the board's USB serial number.
        usable: whether it can be opened and is the port to talk to the board on.
        why_not: what speaks against it, and what to do; None when usable.
        stable_name: a name below ``/dev/serial/by-id`` that survives replugging.
    """

    device: str
    kind: str
    description: str
    serial_number: str | None
    usable: bool
    why_not: str | None
    stable_name: str | None = None


def list_ports(
    comports: Callable[[], Iterable[ListPortInfo]] = comports,
    by_id: Path = _BY_ID,
    may_open: Callable[[str], bool] = may_open,
) -> list[PortInfo]:
    """Every serial port, boards that armctl knows first.

    Args:
        comports: pyserial's listing.
        by_id: udev's folder of stable names.
        may_open: whether this user may open a device.
    """
    stable_names = _stable_names(by_id)
    ports = [
        _from_listing(port, stable_names.get(_resolved(port.device)), may_open)
        for port in comports()
        # Ports that the kernel made up (ttyS0 … ttyS31) have no hardware behind them and no description.
        if port.hwid != "n/a" or port.device.startswith(("/dev/ttyACM", "/dev/ttyUSB"))
    ]
    listed = {_resolved(port.device) for port in ports}
    unlisted = [(device, name) for device, name in stable_names.items() if device not in listed]
    ports += [_from_stable_name(device, name, may_open) for device, name in unlisted]
    return sorted(ports, key=lambda port: (port.kind == UNKNOWN, not port.usable, port.device))


def find_maestro(ports: Sequence[PortInfo]) -> PortInfo:
    """The one usable Maestro command port among ``ports``.

    Raises:
        PortError: there is none (with the reason, when one is there but not usable), or several.
    """
    maestros = [port for port in ports if MaestroModel.from_label(port.kind) is not None]
    usable = [port for port in maestros if port.usable]
    if len(usable) == 1:
        return usable[0]
    if usable:
        names = ", ".join(f"{port.device} ({port.kind}, {port.serial_number})" for port in usable)
        raise PortError(f"several Maestros are plugged in: {names}; name one of them as the port")
    if maestros:
        reasons = "; ".join(f"{port.device}: {port.why_not}" for port in maestros)
        raise PortError(f"a Maestro is plugged in but cannot be used: {reasons}")
    others = ", ".join(f"{port.device} ({port.kind})" for port in ports) or "none at all"
    raise PortError(
        f"no Maestro found; serial ports: {others}; plug one in, or use the simulated board (port sim)"
    )


def describe_port(name: str, ports: Sequence[PortInfo]) -> PortInfo | None:
    """The entry of ``ports`` that ``name`` means, by device, stable name or any link to the device."""
    resolved = _resolved(name)
    return next((port for port in ports if _resolved(port.device) == resolved), None)


def _from_listing(port: ListPortInfo, stable_name: str | None, may_open: Callable[[str], bool]) -> PortInfo:
    model = MaestroModel.from_usb(port.vid, port.pid)
    if model is not None:
        kind = model.label
    elif (port.vid, port.pid) in _MEGA_USB:
        kind = ARDUINO_MEGA
    else:
        kind = UNKNOWN
    interface = _interface(port.location, _LOCATION_INTERFACE, 10)
    if interface is None:
        interface = _interface(stable_name, _BY_ID_INTERFACE, 16)
    why_not = _why_not(port.device, model, interface, may_open)
    return PortInfo(
        device=port.device,
        kind=kind,
        description=port.description,
        serial_number=port.serial_number,
        usable=why_not is None,
        why_not=why_not,
        stable_name=stable_name,
    )


def _from_stable_name(device: str, name: str, may_open: Callable[[str], bool]) -> PortInfo:
    """A port that only udev's folder knows; its name holds maker, product, serial number and interface."""
    channels = _BY_ID_MAESTRO.search(name)
    model = MaestroModel.with_channels(int(channels[1])) if channels else None
    serial_number = _BY_ID_SERIAL.search(name)
    why_not = _why_not(device, model, _interface(name, _BY_ID_INTERFACE, 16), may_open)
    return PortInfo(
        device=device,
        kind=model.label if model else UNKNOWN,
        description=Path(name).name,
        serial_number=serial_number[1] if serial_number else None,
        usable=why_not is None,
        why_not=why_not,
        stable_name=name,
    )


def _why_not(
    device: str, model: MaestroModel | None, interface: int | None, may_open: Callable[[str], bool]
) -> str | None:
    if model is not None and interface == _TTL_INTERFACE:
        return "this is the Maestro's TTL port, which passes bytes to its TX pin; use the port ending in if00"
    if not may_open(device):
        return f"no permission to open it; {permission_hint(device)}"
    return None


def _interface(text: str | None, pattern: re.Pattern[str], base: int) -> int | None:
    found = pattern.search(text) if text else None
    return int(found[1], base) if found else None


def _stable_names(by_id: Path) -> dict[str, str]:
    """Stable name by resolved device."""
    try:
        entries = sorted(by_id.iterdir())
    except OSError:  # udev makes the folder for the first device and removes it with the last
        return {}
    return {_resolved(str(entry)): str(entry) for entry in entries}


def _resolved(device: str) -> str:
    return str(Path(device).resolve())
