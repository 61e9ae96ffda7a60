"""The serial ports of this computer: which boards are there, who answers, and why not the others."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from itertools import zip_longest
from pathlib import Path

from serial.tools.list_ports import comports
from serial.tools.list_ports_common import ListPortInfo

from armctl.errors import BoardError, BoardProtocolError, InputError, NoBoardError
from armctl.hardware.access import TakenDevice, permission_hint, port_notes, program_using, taken_devices
from armctl.hardware.board_type import ANY_PRODUCT, BoardType, Introduction, listen
from armctl.hardware.boards import board_of_address, board_type, board_types, find_board_type
from armctl.hardware.driver import translated
from armctl.hardware.transport import UNKNOWN, PortInfo, SerialTransport, Transport, resolved
from armctl.lazy_dataclass import dataclass
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
    """Every serial port and what boards list themselves, known boards first.

    Opens none: that would reset an Arduino.
    """
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
    ports += (port for board in board_types() for port in board.own_ports())
    return sorted(ports, key=lambda port: (_rank(port.kind), not port.usable, port.device))


def open_line(port: str, baud: int) -> Transport:
    """Open a port, as its board does it where the address is one of that board's own."""
    board = board_of_address(port)
    return SerialTransport(port, baud=baud) if board is None else board.open_line(port)


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


# Who answers on a port: asked in an order in which no question can move or upset any of the boards.
#
# 1. Listen. An Arduino is reset by opening its port and then introduces itself: StandardFirmata with its
#    name and version, armctl's encoder firmware with its banner and a status line 50 times a second. A
#    Maestro never speaks unasked. Nothing is sent to a board that may still be in its bootloader.
# 2. Only where a Maestro may be and nothing came: Get Errors (``A1``), and after silence the CRC byte
#    that would complete it (``1B``). To a Maestro neither can be an error (see ``MaestroLine.probe``), and
#    one in a UART mode ignores all that comes over USB (Pololu's guide 0J40, section 5.a). StandardFirmata
#    has no command ``A0`` … ``AF`` and skips data bytes that belong to none. Only who answered ``A1`` like a
#    Maestro gets the next question.
# 3. Only where an Arduino may be and no Maestro answered: Firmata's version query (``F9``), and after its
#    answer the firmware query (``F0 79 F7``). To a Maestro they would be protocol errors, which send its
#    servos home: that is why they come last.
# 4. Any other board, in its turn, where its port is listed as its own or the user expects it.
#
# armctl's own lines of text are never sent before the encoder firmware has introduced itself: to a Maestro
# each letter is a data byte that belongs to nothing, an error as well.

_USUAL_BAUD = 115_200
"""where the rate does not matter: a pty, a socket, a USB port without a UART behind it"""
_START_S = 5.0
"""how long a Mega's bootloader and its sketch may take to speak"""
_RUNNING_S = 0.3
"""so a board that is not reset by opening: it says its state 50 times a second, or nothing"""


@dataclass(frozen=True, slots=True)
class Probed:
    """Who answers on a port."""

    port: str  # as the user named it
    board: str | None = None  # the kind of board; None: none that armctl knows
    name: str | None = None  # of the board or its firmware; this and the next three as in ``Introduction``
    version: str | None = None
    details: tuple[str, ...] = ()
    reported: tuple[str, ...] = ()
    heard: bytes = b""  # the first bytes of what no board is known by

    def __str__(self) -> str:
        """One line for people."""
        if self.board is None:
            said = f"it says {self.heard.decode('ascii', 'backslashreplace')!r}"
            return "; ".join(("nobody that armctl knows answers", *self.details, *[said] * bool(self.heard)))
        about = " ".join(word for word in (self.name, self.version) if word)
        return "; ".join((about, *self.details, *(f"it had reported: {words}" for words in self.reported)))


@dataclass(frozen=True, slots=True)
class Approach:
    """How a port is to be met, after what is known of it."""

    bauds: tuple[int, ...]
    """rates to listen at, likeliest first; the last questions are asked at the one at hand"""
    listen_s: float  # how long a board may take to speak after the port has been opened
    asked: tuple[BoardType, ...]  # the boards that are asked, in this order, where none has spoken


def approach(listing: str | None, expected: str | None = None, port: str = "") -> Approach:
    """How to meet a port that is listed so (None: no USB device, such as a pty or a socket).

    One whose address is of a board's own form has that kind of board, or none.

    What is behind a USB-to-serial chip may be anything, so nothing is asked there unless the user has
    said which kind of board to expect: an Arduino speaks anyway, and any byte could upset another device.
    """
    if (owner := board_of_address(port)) is not None:
        return Approach((owner.baud,), 0.0, (owner,))
    wanted = None if expected is None else find_board_type(expected)
    listed = boards_listed_as(listing)
    for board in listed:
        if listing in board.own_listings:
            return Approach((board.baud,), _START_S if board.restarts else 0.0, (board,))
    named = any(listing in board.likely[0] for board in listed)
    if wanted is not None and not wanted.restarts and not named:
        return Approach((wanted.baud,), _RUNNING_S, (wanted,))
    if listing is None:
        return Approach((_USUAL_BAUD,), _RUNNING_S, board_types())
    if named and not any(board.restarts for board in listed):
        return Approach(tuple(dict.fromkeys(board.baud for board in listed)), 0.0, tuple(listed))
    restarting = [board for board in board_types() if board.restarts]
    restarting.sort(key=lambda board: board is not wanted)
    asked = listed if named else [wanted] if wanted is not None else []
    return Approach(tuple(dict.fromkeys(board.baud for board in restarting)), _START_S, tuple(asked))


def probe(open_line: Callable[[int], Transport], how: Approach, now: Callable[[], float]) -> Probed:
    """Find out who answers and close the line; resets an Arduino. ``BoardError`` where the line breaks."""
    line, probed = reach(open_line, how, now)
    line.close()
    return probed


def reach(
    open_line: Callable[[int], Transport], how: Approach, now: Callable[[], float]
) -> tuple[Transport, Probed]:
    """The same, with the line left open for whoever goes on asking: opening it again would be a reset."""
    for rate, baud in enumerate(how.bauds, start=1):
        line = open_line(baud)
        try:
            known = [(board, one) for board in board_types() if (one := board.listener()) is not None]
            found, heard = listen(line, [one for _, one in known], how.listen_s, now)
            if found is not None:
                return line, _probed(line, known[found[0]][0], found[1])
            # A silent board is as silent at any other rate: it is asked at this one. What spoke and was
            # not understood may be understood at the next.
            if not heard or len(how.bauds) == 1:
                return line, _ask(line, how.asked, heard, now)
            if rate == len(how.bauds):
                return line, Probed(line.name, heard=heard)
        except BoardError:
            line.close()
            raise
        line.close()
    raise InputError("to probe a port at least one baud rate is needed")


def _ask(line: Transport, boards: Sequence[BoardType], heard: bytes, now: Callable[[], float]) -> Probed:
    """Put the questions that this port allows; after any bytes only those of boards that speak unasked."""
    for board in boards:
        if heard and board.listener() is None:
            continue
        try:
            introduction = translated(f"asking for a {board.title}", board.ask, line, now)
        except BoardProtocolError as error:
            return Probed(line.name, details=(str(error),))
        if introduction is not None:
            return _probed(line, board, introduction)
    return Probed(line.name, heard=heard)


def _probed(line: Transport, board: BoardType, found: Introduction) -> Probed:
    return Probed(line.name, board.kind, found.name, found.version, found.details, found.reported)
