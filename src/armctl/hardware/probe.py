"""Who answers on a port: asked in an order in which no question can move or upset any of the boards.

1. Listen. An Arduino is reset by opening its port and then introduces itself: StandardFirmata with its
   name and version, armctl's encoder firmware with its banner and a status line 50 times a second. A
   Maestro never speaks unasked. Nothing is sent to a board that may still be in its bootloader.
2. Only where a Maestro may be and nothing was heard: Get Errors (``A1``), and after silence the CRC byte
   that would complete it (``1B``). To a Maestro neither can be an error (see ``MaestroLine.probe``), and one
   in a UART mode ignores all that comes over USB (Pololu's guide 0J40, section 5.a). StandardFirmata has no
   command ``A0`` … ``AF`` and skips data bytes that belong to none. Only who answered ``A1`` like a
   Maestro gets the next question.
3. Only where an Arduino may be and no Maestro answered: Firmata's version query (``F9``), and after its
   answer the firmware query (``F0 79 F7``). To a Maestro they would be protocol errors, which send its servos
   home: that is why they come last.

armctl's own lines of text are never sent before the encoder firmware has been heard: to a Maestro each
letter is a data byte that belongs to nothing, an error as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError, InputError
from armctl.hardware.encoder.frame import LONGEST_MESSAGE, LineReader
from armctl.hardware.encoder.messages import FIRMWARE, Banner, Status, decode
from armctl.hardware.firmata.codec import BAUD as FIRMATA_BAUD
from armctl.hardware.firmata.codec import firmware_query, version_query
from armctl.hardware.firmata.replies import FirmwareReport, ReplyParser, VersionReport
from armctl.hardware.maestro.codec import COMPACT, error_words
from armctl.hardware.maestro.line import MaestroLine
from armctl.hardware.ports import ARDUINO_MEGA, MaestroModel
from armctl.hardware.transport import Transport
from armctl.robot.robot import BoardKind

# How boards introduce themselves, picked out of whatever else is on the line.


@dataclass(frozen=True, slots=True)
class Introduction:
    """What a board says of itself."""

    board: BoardKind
    name: str
    version: str | None = None
    details: tuple[str, ...] = ()


class Ear(Protocol):
    """Listens for one kind of board."""

    def feed(self, data: bytes) -> Introduction | None:
        """Take what came, in any pieces; the introduction once it is complete."""
        ...


class EncoderEar:
    """Hears armctl's encoder firmware: its banner, or a status line where it has been running for long."""

    def __init__(self) -> None:
        self._reader = LineReader(LONGEST_MESSAGE)

    def feed(self, data: bytes) -> Introduction | None:
        """Take what came; a line counts only with the right checksum."""
        for line in self._reader.feed(data):
            if line is None:
                continue
            try:
                message = decode(line)
            except BoardProtocolError:  # noise, half a line, or another board
                continue
            if isinstance(message, Banner):
                details = (f"{message.axes} axes", f"last started by: {message.reset}")
                return Introduction("encoder", message.firmware, message.version, details)
            if isinstance(message, Status):
                return Introduction("encoder", FIRMWARE, details=(f"{len(message.counts)} axes",))
        return None


class FirmataEar:
    """Hears a Firmata sketch: its name and version, which it tells when it starts and when asked."""

    def __init__(self) -> None:
        self._parser = ReplyParser()
        self.protocol: VersionReport | None = None
        """the protocol version, where it was told"""

    def feed(self, data: bytes) -> Introduction | None:
        """Take what came; the sketch's name counts, since a version alone may be noise."""
        for reply in self._parser.feed(data):
            if isinstance(reply, VersionReport):
                self.protocol = reply
            elif isinstance(reply, FirmwareReport):
                name = reply.name.removesuffix(".ino").removesuffix(".cpp")
                return Introduction("firmata", name, f"{reply.major}.{reply.minor}", self.details)
        return None

    @property
    def details(self) -> tuple[str, ...]:
        """The protocol version in words."""
        return () if self.protocol is None else (_protocol_words(self.protocol),)


def _protocol_words(report: VersionReport) -> str:
    return f"Firmata protocol {report.major}.{report.minor}"


ENCODER_BAUD = 115_200
"""also where a Maestro is behind a serial adapter; its own USB port ignores the rate"""

_START_S = 5.0
"""What a Mega's bootloader and its sketch may take to be heard."""
_RUNNING_S = 0.3
"""What a board that is not reset by opening may take: it says its state 50 times a second, or nothing."""
_UNDERSTOOD_WITHIN_S = 1.0
"""How long somebody may speak without being understood."""
_READ_S = 0.05
_ANSWER_S = 1.0
_KEPT = 64


@dataclass(frozen=True, slots=True)
class Probed:
    """Who answers on a port.

    Args:
        port: the port as the user named it.
        board: the kind of board; None: nobody that armctl knows.
        name: what the board or its firmware is called.
        version: of the firmware, where the board tells it.
        details: what else it told, in words.
        reported: errors that it had kept from before, in words; a Maestro has now forgotten them.
        heard: the first bytes of what nobody could make sense of.
    """

    port: str
    board: BoardKind | None = None
    name: str | None = None
    version: str | None = None
    details: tuple[str, ...] = ()
    reported: tuple[str, ...] = ()
    heard: bytes = b""

    def __str__(self) -> str:
        """One line for people."""
        if self.board is None:
            said = f"it says {self.heard.decode('ascii', 'backslashreplace')!r}"
            return "; ".join(("nobody that armctl knows answers", *self.details, *[said] * bool(self.heard)))
        about = " ".join(word for word in (self.name, self.version) if word)
        return "; ".join((about, *self.details, *(f"it had reported: {words}" for words in self.reported)))


@dataclass(frozen=True, slots=True)
class Approach:
    """How a port is to be met, after what is known of it.

    Args:
        bauds: rates to listen at, likeliest first; the last questions are asked at the one at hand.
        listen_s: how long a board may take to be heard after the port has been opened.
        maestro: whether a Maestro may be there.
        firmata: whether an Arduino may be there that is not reset by opening its port.
    """

    bauds: tuple[int, ...]
    listen_s: float
    maestro: bool
    firmata: bool


def approach(label: str | None, expected: BoardKind | None = None) -> Approach:
    """How to meet a port with the listing's ``label`` (None: no USB device, such as a pty or a socket).

    What is behind a USB-to-serial chip may be anything, so nothing is asked there unless the user has
    said what to expect: an Arduino is heard anyway, and any byte could upset another device.
    """
    if label is None:
        return Approach((ENCODER_BAUD,), _RUNNING_S, maestro=True, firmata=expected != "maestro")
    if MaestroModel.from_label(label) is not None:
        return Approach((ENCODER_BAUD,), 0.0, maestro=True, firmata=False)
    if expected == "maestro" and label != ARDUINO_MEGA:
        return Approach((ENCODER_BAUD,), _RUNNING_S, maestro=True, firmata=False)
    bauds = (ENCODER_BAUD, FIRMATA_BAUD) if expected == "encoder" else (FIRMATA_BAUD, ENCODER_BAUD)
    return Approach(bauds, _START_S, maestro=False, firmata=label == ARDUINO_MEGA or expected == "firmata")


def probe(open_line: Callable[[int], Transport], how: Approach, now: Callable[[], float]) -> Probed:
    """Find out who answers, and close the line again. Resets an Arduino: for when the user asks only.

    Args:
        open_line: opens the port at a baud rate.
        how: see ``approach``.
        now: the clock [s].

    Raises:
        BoardError: the port cannot be opened, or its line breaks.
    """
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
            found, heard = _listen(line, (EncoderEar(), FirmataEar()), how.listen_s, now)
            if found is not None:
                return line, _probed(line, found)
            # A silent board is as silent at any other rate: it is asked at this one. What spoke and was
            # not understood may be understood at the next.
            if not heard or len(how.bauds) == 1:
                return line, _ask(line, how, heard, now)
            if rate == len(how.bauds):
                return line, Probed(line.name, heard=heard)
        except BoardError:
            line.close()
            raise
        line.close()
    raise InputError("to probe a port at least one baud rate is needed")


def _listen(
    line: Transport,
    ears: Sequence[Ear],
    for_s: float,
    now: Callable[[], float],
    until: Callable[[], bool] = lambda: False,
) -> tuple[Introduction | None, bytes]:
    """Who introduces himself, and the first of what was heard."""
    heard = bytearray()
    deadline = now() + for_s
    # Waiting is counted as well as timed: the clock of a simulation may stand still.
    waited = 0.0
    while (left := min(deadline - now(), for_s - waited)) > 0.0:
        step = min(_READ_S, left)
        data = line.read(256, step)
        waited += step
        for ear in ears:
            if (found := ear.feed(data)) is not None:
                return found, bytes(heard)
        if until():
            break
        if data and not heard:
            deadline = min(deadline, now() + _UNDERSTOOD_WITHIN_S)
        heard += data[: _KEPT - len(heard)]
    return None, bytes(heard)


def _ask(line: Transport, how: Approach, heard: bytes, now: Callable[[], float]) -> Probed:
    """Put the questions that this port allows."""
    if how.maestro and not heard:
        try:
            return _ask_maestro(line)
        except BoardTimeoutError:
            pass  # nobody, or a Firmata
        except BoardProtocolError as error:
            return Probed(line.name, details=(str(error),))
    if how.firmata and (found := _ask_firmata(line, now)) is not None:
        return found
    return Probed(line.name, heard=heard)


def _ask_maestro(line: Transport) -> Probed:
    board = MaestroLine(line, COMPACT, _ANSWER_S)
    earlier = board.probe()
    details = ("commands carry a CRC",) if board.framing.crc else ()
    return Probed(line.name, "maestro", "Pololu Maestro", details=details, reported=error_words(earlier))


def _ask_firmata(line: Transport, now: Callable[[], float]) -> Probed | None:
    """First for the version: in a sketch that was left in the middle of a message it ends nothing."""
    ear = FirmataEar()
    line.write(version_query())
    found, _ = _listen(line, [ear], _ANSWER_S, now, until=lambda: ear.protocol is not None)
    if found is None and ear.protocol is not None:
        line.write(firmware_query())
        found, _ = _listen(line, [ear], _ANSWER_S, now)
    if found is not None:
        return _probed(line, found)
    return None if ear.protocol is None else Probed(line.name, "firmata", "Firmata", details=ear.details)


def _probed(line: Transport, found: Introduction) -> Probed:
    return Probed(line.name, found.board, found.name, found.version, found.details)
