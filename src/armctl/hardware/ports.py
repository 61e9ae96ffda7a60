"""The serial ports of this computer: which boards are there, which port to use, and why not the others."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from serial.tools.list_ports import comports
from serial.tools.list_ports_common import ListPortInfo

from armctl.errors import NoBoardError
from armctl.hardware.access import TakenDevice, permission_hint, port_notes, program_using, taken_devices
from armctl.hardware.board_type import ANY_PRODUCT, BoardType
from armctl.hardware.boards import board_type, board_types
from armctl.hardware.transport import UNKNOWN, PortInfo, resolved
from armctl.system import may_open

_BY_ID = Path("/dev/serial/by-id")
_LOCATION_INTERFACE = re.compile(r":\d+\.(\d+)$")  # "1-1.2:1.0": bus-port:configuration.interface
_BY_ID_INTERFACE = re.compile(r"-if([0-9a-fA-F]{2})(-port\d+)?$")
_BY_ID_SERIAL = re.compile(r"_([0-9A-Za-z]+)-if[0-9a-fA-F]{2}(-port\d+)?$")


def listing_of(vendor: int | None, product: int | None) -> str:
    """How a device with these USB numbers is listed: as a board says, or ``UNKNOWN``."""
    for number in (product, ANY_PRODUCT):
        for board in board_types():
            if vendor is not None and (listing := board.usb.get((vendor, number))) is not None:
                return listing
    return UNKNOWN


def boards_listed_as(listing: str | None) -> list[BoardType]:
    """The kinds of board that may be behind a port that is listed so."""
    return [board for board in board_types() if any(listing in group for group in board.likely)]


@dataclass(frozen=True, slots=True)
class PortChecks:
    """What the system says about a device without opening it."""

    may_open: Callable[[str], bool] = may_open
    used_by: Callable[[str], str | None] = program_using
    notes: Callable[[str], tuple[str, ...]] = port_notes
    taken: Callable[[], Iterable[TakenDevice]] = taken_devices


_SYSTEM = PortChecks()


def list_ports(
    comports: Callable[[], Iterable[ListPortInfo]] = comports,
    by_id: Path = _BY_ID,
    checks: PortChecks = _SYSTEM,
) -> list[PortInfo]:
    """Every serial port, known boards first. Opens none: that would reset an Arduino."""
    stable_names = _stable_names(by_id)
    ports: list[PortInfo] = []

    def add(
        device: str,
        kind: str,
        description: str,
        serial_number: str | None,
        name: str | None,
        interface: int | None,
    ) -> None:
        refusals = (board.port_refusal(kind, interface) for board in boards_listed_as(kind))
        why_not = next((refusal for refusal in refusals if refusal is not None), None)
        if why_not is None and not checks.may_open(device):
            why_not = f"no permission to open it; {permission_hint(device)}"
        elif why_not is None and (program := checks.used_by(device)) is not None:
            why_not = f"in use by another program: {program}; close that and try again"
        # For boards only: an unknown device may well be a modem, or a Braille display.
        notes = () if kind == UNKNOWN else checks.notes(device)
        usable = why_not is None
        ports.append(PortInfo(device, kind, description, serial_number, usable, why_not, name, notes))

    for port in comports():
        # Ports that the kernel made up (ttyS0 … ttyS31) have no hardware behind them and no description.
        if port.hwid != "n/a" or port.device.startswith(("/dev/ttyACM", "/dev/ttyUSB")):
            name = stable_names.get(resolved(port.device))
            interface = _interface(port.location, _LOCATION_INTERFACE, 10)
            if interface is None:
                interface = _interface(name, _BY_ID_INTERFACE, 16)
            kind = listing_of(port.vid, port.pid)
            add(port.device, kind, port.description, port.serial_number, name, interface)
    listed = {resolved(port.device) for port in ports}
    for device, name in stable_names.items():
        if device not in listed:  # only the name tells: it holds maker, product, serial number and interface
            kinds = (board.listed_by_name(name) for board in board_types())
            kind = next((kind for kind in kinds if kind is not None), UNKNOWN)
            found = _BY_ID_SERIAL.search(name)
            interface = _interface(name, _BY_ID_INTERFACE, 16)
            add(device, kind, Path(name).name, found[1] if found else None, name, interface)
    for one in checks.taken():
        kind = listing_of(one.vendor, one.product)
        if kind != UNKNOWN:
            device = f"USB {one.place}"
            ports.append(PortInfo(device, kind, kind, one.serial_number, False, one.why, missing=True))
    return sorted(ports, key=lambda port: (_rank(port.kind), not port.usable, port.device))


def find_board(ports: Sequence[PortInfo], kind: str | None) -> PortInfo:
    """The one usable port among ``ports`` that has, or may have, a board of this kind; None: of any kind.

    Whether an Arduino runs the right sketch shows only when it is opened; what calls itself a Mega goes
    before what may be anything. ``NoBoardError`` where there is none, or several.
    """
    wanted = board_types() if kind is None else (board_type(kind),)
    noun = "board" if kind is None else wanted[0].plugged_in
    candidates: list[PortInfo] = []
    for groups in zip_longest(*(board.likely for board in wanted), fillvalue=()):
        same = [port for port in ports if any(port.kind in group for group in groups)]
        candidates += same
        usable = [port for port in same if port.usable]
        if len(usable) == 1:
            return usable[0]
        if usable:
            names = ", ".join(f"{port.device} ({port.kind}, {port.serial_number})" for port in usable)
            raise NoBoardError(f"several {noun}s may be meant: {names}; name one of them as the port")
    if candidates:
        reasons = "; ".join(f"{port.device}: {port.why_not}" for port in candidates)
        raise NoBoardError(f"the {noun} that is plugged in cannot be used: {reasons}")
    others = ", ".join(f"{port.device} ({port.kind})" for port in ports) or "none at all"
    raise NoBoardError(
        f"no {noun} found; serial ports: {others}; plug one in, or use the simulated board (port sim)"
    )


def _rank(kind: str) -> int:
    """The listings that a board is likeliest behind first, unknown devices last."""
    places = [place for board in board_types() for place, group in enumerate(board.likely) if kind in group]
    return min(places, default=sys.maxsize)


def _interface(text: str | None, pattern: re.Pattern[str], base: int) -> int | None:
    found = pattern.search(text) if text else None
    return int(found[1], base) if found else None


def _stable_names(by_id: Path) -> dict[str, str]:
    """Stable name by resolved device."""
    try:
        entries = sorted(by_id.iterdir())
    except OSError:  # udev makes the folder for the first device and removes it with the last
        return {}
    return {resolved(str(entry)): str(entry) for entry in entries}
