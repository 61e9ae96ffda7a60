"""The serial ports of this computer: which boards are there, which port to use, and why not the others."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from serial.tools.list_ports import comports
from serial.tools.list_ports_common import ListPortInfo

from armctl.errors import PortError
from armctl.hardware.access import may_open, modem_manager_note, permission_hint, program_using
from armctl.hardware.transport import SerialTransport, Transport
from armctl.robot.robot import BoardKind

# The four boards of the Maestro family and how they differ.

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


# USB numbers of the boards that armctl drives, and of what hides behind a common USB-to-serial chip.

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


# The port of a driver: what the system says of it, how it is opened, and which board is behind it then.

AcceptBoard = Callable[[str | None], None]
"""Is told the serial number of the board behind an open port; raises ``PortError`` for the wrong one."""
_BAUD = 115_200
_PTY_FOLDER = "/dev/pts/"


def any_board(_serial_number: str | None) -> None:
    """Whatever board is there."""


class BoardPort:
    """A port by its name, or what opens a transport.

    Which board is behind a name is certain only while the port is open: until then another one may be
    plugged in there. So it is looked up before opening, and once more after.

    Args:
        line: port name (device, pty, ``socket://host:port``), or what opens the transport.
        ports: the listing of serial ports; a simulated board, a pty or a socket is not among them.
        accept: judges the board that is there.
        simulated: whether a simulated board is at the other end.
    """

    def __init__(
        self,
        line: str | Callable[[], Transport],
        ports: Callable[[], Sequence[PortInfo]],
        accept: AcceptBoard,
        *,
        simulated: bool,
    ) -> None:
        self._line, self._ports, self._accept, self._simulated = line, ports, accept, simulated

    @property
    def restarts_board(self) -> bool:
        """Whether opening the line starts an Arduino anew, as a device's control lines do."""
        if not isinstance(self._line, str) or "://" in self._line:
            return False
        return not str(Path(self._line).resolve()).startswith(_PTY_FOLDER)

    def look_up(self) -> PortInfo | None:
        """What is listed under the name now; None where nothing is.

        Opening the line of an Arduino starts it anew and lets its servos or motors go, so a board that is
        listed as another one is left alone.

        Raises:
            PortError: it is listed as one that cannot be used, or that is not the one that is wanted.
        """
        info = self._listed()
        if info is not None and not info.usable:
            raise PortError(f"{self._line}: {info.why_not}")
        if info is not None:
            self._accept(info.serial_number)
        return info

    def open(self, baud: int = _BAUD) -> tuple[Transport, PortInfo | None]:
        """Open the line, and see which board is behind it; None where the system does not tell.

        Raises:
            PortError: it cannot be opened, or the board is not the one that is wanted.
        """
        transport = SerialTransport(self._line, baud=baud) if isinstance(self._line, str) else self._line()
        try:
            info = self._listed()
            if not self._simulated:
                self._accept(None if info is None else info.serial_number)
        except BaseException:
            transport.close()
            raise
        return transport, info

    def _listed(self) -> PortInfo | None:
        if not isinstance(self._line, str) or self._simulated:
            return None
        return describe_port(self._line, self._ports())
