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
from armctl.hardware.port_users import modem_manager_note, program_using
from armctl.hardware.usb_ids import ARDUINO_MEGA, UNKNOWN, USB_SERIAL, board_kind
from armctl.robot.robot import BoardKind

_BY_ID = Path("/dev/serial/by-id")
_TTL_INTERFACE = 2
_LOCATION_INTERFACE = re.compile(r":\d+\.(\d+)$")  # "1-1.2:1.0": bus-port:configuration.interface
_BY_ID_INTERFACE = re.compile(r"-if([0-9a-fA-F]{2})(-port\d+)?$")
_BY_ID_SERIAL = re.compile(r"_([0-9A-Za-z]+)-if[0-9a-fA-F]{2}(-port\d+)?$")
_MAESTROS = ("Maestro", (tuple(model.label for model in MaestroModel),))
_ARDUINOS = ("Arduino", ((ARDUINO_MEGA,), (USB_SERIAL,)))
"""what a board is called, and the kinds of port that it may be behind, likeliest first"""
_BY_ID_MAESTRO = re.compile(r"Pololu_.*Maestro_(6|12|18|24)-Servo")


@dataclass(frozen=True, slots=True)
class PortInfo:
    """One serial port.

    Args:
        device: what to open.
        kind: the board: a ``MaestroModel`` label, ``ARDUINO_MEGA``, ``USB_SERIAL`` or ``UNKNOWN``. What an
            Arduino has been flashed with does not show here: ``probe`` finds out.
        description: what the operating system says.
        serial_number: the board's USB serial number.
        usable: whether it can be opened and is the port to talk to the board on.
        why_not: what speaks against it, and what to do; None when usable.
        stable_name: a name below ``/dev/serial/by-id`` that survives replugging.
        notes: what to know about a port that can be used.
    """

    device: str
    kind: str
    description: str
    serial_number: str | None
    usable: bool
    why_not: str | None
    stable_name: str | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PortChecks:
    """What the system says about a device without opening it.

    Args:
        may_open: whether this user may open it.
        used_by: the program that has it open.
        note: what else there is to know.
    """

    may_open: Callable[[str], bool] = may_open
    used_by: Callable[[str], str | None] = program_using
    note: Callable[[str], str | None] = modem_manager_note


_SYSTEM = PortChecks()


def list_ports(
    comports: Callable[[], Iterable[ListPortInfo]] = comports,
    by_id: Path = _BY_ID,
    checks: PortChecks = _SYSTEM,
) -> list[PortInfo]:
    """Every serial port, boards that armctl knows first. Opens none: that would reset an Arduino.

    Args:
        comports: pyserial's listing.
        by_id: udev's folder of stable names.
        checks: what the system says about a device.
    """
    stable_names = _stable_names(by_id)
    ports = [
        _from_listing(port, stable_names.get(_resolved(port.device)), checks)
        for port in comports()
        # Ports that the kernel made up (ttyS0 … ttyS31) have no hardware behind them and no description.
        if port.hwid != "n/a" or port.device.startswith(("/dev/ttyACM", "/dev/ttyUSB"))
    ]
    listed = {_resolved(port.device) for port in ports}
    unlisted = [(device, name) for device, name in stable_names.items() if device not in listed]
    ports += [_from_stable_name(device, name, checks) for device, name in unlisted]
    return sorted(ports, key=lambda port: (_rank(port.kind), not port.usable, port.device))


def find_board(ports: Sequence[PortInfo], kind: BoardKind) -> PortInfo:
    """The one usable port among ``ports`` that has, or for an Arduino may have, a board of this kind.

    Whether an Arduino runs the right sketch shows only when it is opened; what calls itself a Mega goes
    before what may be anything.

    Raises:
        PortError: there is none (with the reason, when one is there but not usable), or several.
    """
    noun, likely = _MAESTROS if kind == "maestro" else _ARDUINOS
    candidates = [port for labels in likely for port in ports if port.kind in labels]
    usable = [port for port in candidates if port.usable]
    for labels in likely:
        same = [port for port in usable if port.kind in labels]
        if len(same) == 1:
            return same[0]
        if same:
            names = ", ".join(f"{port.device} ({port.kind}, {port.serial_number})" for port in same)
            raise PortError(f"several {noun}s may be meant: {names}; name one of them as the port")
    if candidates:
        reasons = "; ".join(f"{port.device}: {port.why_not}" for port in candidates)
        raise PortError(f"the {noun} that is plugged in cannot be used: {reasons}")
    others = ", ".join(f"{port.device} ({port.kind})" for port in ports) or "none at all"
    raise PortError(
        f"no {noun} found; serial ports: {others}; plug one in, or use the simulated board (port sim)"
    )


def describe_port(name: str, ports: Sequence[PortInfo]) -> PortInfo | None:
    """The entry of ``ports`` that ``name`` means, by device, stable name or any link to the device."""
    resolved = _resolved(name)
    return next((port for port in ports if _resolved(port.device) == resolved), None)


def _from_listing(port: ListPortInfo, stable_name: str | None, checks: PortChecks) -> PortInfo:
    kind = board_kind(port.vid, port.pid)
    interface = _interface(port.location, _LOCATION_INTERFACE, 10)
    if interface is None:
        interface = _interface(stable_name, _BY_ID_INTERFACE, 16)
    why_not = _why_not(port.device, kind, interface, checks)
    return PortInfo(
        device=port.device,
        kind=kind,
        description=port.description,
        serial_number=port.serial_number,
        usable=why_not is None,
        why_not=why_not,
        stable_name=stable_name,
        notes=_notes(port.device, kind, checks),
    )


def _from_stable_name(device: str, name: str, checks: PortChecks) -> PortInfo:
    """A port that only udev's folder knows; its name holds maker, product, serial number and interface."""
    channels = _BY_ID_MAESTRO.search(name)
    kind = MaestroModel.with_channels(int(channels[1])).label if channels else UNKNOWN
    serial_number = _BY_ID_SERIAL.search(name)
    why_not = _why_not(device, kind, _interface(name, _BY_ID_INTERFACE, 16), checks)
    return PortInfo(
        device=device,
        kind=kind,
        description=Path(name).name,
        serial_number=serial_number[1] if serial_number else None,
        usable=why_not is None,
        why_not=why_not,
        stable_name=name,
        notes=_notes(device, kind, checks),
    )


def _why_not(device: str, kind: str, interface: int | None, checks: PortChecks) -> str | None:
    if MaestroModel.from_label(kind) is not None and interface == _TTL_INTERFACE:
        return "this is the Maestro's TTL port, which passes bytes to its TX pin; use the port ending in if00"
    if not checks.may_open(device):
        return f"no permission to open it; {permission_hint(device)}"
    program = checks.used_by(device)
    if program is not None:
        return f"in use by another program: {program}; close that and try again"
    return None


def _notes(device: str, kind: str, checks: PortChecks) -> tuple[str, ...]:
    """For boards only: to an unknown device ModemManager may well be meant to talk."""
    note = None if kind == UNKNOWN else checks.note(device)
    return () if note is None else (note,)


def _rank(kind: str) -> int:
    return {UNKNOWN: 2, USB_SERIAL: 1}.get(kind, 0)


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
