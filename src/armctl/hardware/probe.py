"""Who answers on a port: asked in an order in which no question can move or upset any of the boards.

1. Listen. An Arduino is reset by opening its port and then introduces itself: StandardFirmata with its
   name and version, armctl's encoder firmware with its banner and a status line 50 times a second. A
   Maestro never speaks unasked. Nothing is sent to a board that may still be in its bootloader.
2. Only where a Maestro may be and nothing came: Get Errors (``A1``), and after silence the CRC byte
   that would complete it (``1B``). To a Maestro neither can be an error (see ``MaestroLine.probe``), and one
   in a UART mode ignores all that comes over USB (Pololu's guide 0J40, section 5.a). StandardFirmata has no
   command ``A0`` … ``AF`` and skips data bytes that belong to none. Only who answered ``A1`` like a
   Maestro gets the next question.
3. Only where an Arduino may be and no Maestro answered: Firmata's version query (``F9``), and after its
   answer the firmware query (``F0 79 F7``). To a Maestro they would be protocol errors, which send its servos
   home: that is why they come last.
4. Any other board, in its turn, where its port is listed as its own or the user expects it.

armctl's own lines of text are never sent before the encoder firmware has introduced itself: to a Maestro
each letter is a data byte that belongs to nothing, an error as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from armctl.errors import BoardError, BoardProtocolError, InputError
from armctl.hardware.board_type import BoardType, Introduction, listen
from armctl.hardware.boards import board_types, find_board_type
from armctl.hardware.driver import translated
from armctl.hardware.ports import boards_listed_as
from armctl.hardware.transport import Transport

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


def approach(listing: str | None, expected: str | None = None) -> Approach:
    """How to meet a port that is listed so (None: no USB device, such as a pty or a socket).

    What is behind a USB-to-serial chip may be anything, so nothing is asked there unless the user has
    said which kind of board to expect: an Arduino speaks anyway, and any byte could upset another device.
    """
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
