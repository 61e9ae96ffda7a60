"""How boards introduce themselves, picked out of whatever else is on the line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from armctl.errors import BoardProtocolError
from armctl.hardware.encoder.frame import LONGEST_MESSAGE
from armctl.hardware.encoder.line_reader import LineReader
from armctl.hardware.encoder.messages import FIRMWARE, Banner, decode
from armctl.hardware.encoder.status import Status
from armctl.hardware.firmata.replies import FirmwareReport, ReplyParser, VersionReport
from armctl.robot.robot import BoardKind


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
