"""What the board sends: answers, status lines, events and the banner at its start."""

from __future__ import annotations

import re
from dataclasses import dataclass

from armctl.errors import ArmctlError, BoardError, BoardProtocolError, StateError
from armctl.hardware.encoder.frame import LARGEST_SEQUENCE, unseal
from armctl.hardware.encoder.status import Status, decode_status

FIRMWARE = "armctl-encoder"
PROTOCOL = 2

_ANSWER = re.compile(r"(\d{1,5}) (?:ok(?: (.*))?|err ([A-Z]+)(?: (.*))?)")
_BANNER = re.compile(r"(\S+) (\S+) proto=(\d{1,4}) axes=(\d{1,2}) reset=([a-z]+)")
_OF_STATE = frozenset({"MOVING", "NOTHOMED", "OFF", "HOLD", "FAULT", "BUSY"})
_WHY = {
    "MOVING": "the motors are on; release first",
    "NOTHOMED": "an axis has not found its zero; home first",
    "OFF": "the motors are off",
    "HOLD": "the board holds",
    "FAULT": "a fault is latched; see to it and release, which clears it",
    "BUSY": "the board is homing; wait until it is done, or stop it",
    "LIMIT": "outside the soft limits",
}


@dataclass(frozen=True, slots=True)
class Answer:
    """The board has done what line ``sequence`` asked for."""

    sequence: int
    text: str


@dataclass(frozen=True, slots=True)
class Refusal:
    """The board has not done what line ``sequence`` asked for; 0: it could not read a line."""

    sequence: int
    code: str
    text: str

    def __str__(self) -> str:
        """Why, in words for the user."""
        said = f"{self.code} {self.text}".rstrip()
        return (
            f"{_WHY[self.code]} (the board says: {said})" if self.code in _WHY else f"the board says: {said}"
        )

    def error(self, asked: str) -> ArmctlError:
        """What to raise where this refuses the request ``asked``."""
        if self.code in _OF_STATE:
            kind = StateError
        else:
            kind = BoardError if self.code == "LIMIT" else BoardProtocolError
        return kind(f"the board refused {asked!r}: {self}")


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened on the board: ``("homed", "3")``."""

    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Banner:
    """Who the board is, and why it last started."""

    firmware: str
    version: str
    protocol: int
    axes: int
    reset: str

    def encode(self) -> str:
        """As the board says it, without the ``#``."""
        return f"{self.firmware} {self.version} proto={self.protocol} axes={self.axes} reset={self.reset}"


Message = Answer | Refusal | Status | Event | Banner


def decode(line: bytes) -> Message:
    """The message in a line from the board, without its end.

    Raises:
        BoardProtocolError: garbled, or nothing that the firmware sends.
    """
    text = unseal(line)
    kind, rest = text[:2], text[2:]
    if kind == "@ ":
        return decode_status(rest)
    if kind == "! ":
        return Event(tuple(rest.split(" ")))
    if kind == "# ":
        return decode_banner(rest)
    return _decode_answer(text)


def decode_banner(text: str) -> Banner:
    """The banner in ``text``: what follows the ``#``, or the answer to HELLO.

    Raises:
        BoardProtocolError: no banner.
    """
    found = _BANNER.fullmatch(text)
    if found is None:
        raise BoardProtocolError(f"{text!r} is not how an armctl encoder board introduces itself")
    firmware, version, protocol, axes, reset = found.groups()
    return Banner(firmware, version, int(protocol), int(axes), reset)


def _decode_answer(text: str) -> Answer | Refusal:
    found = _ANSWER.fullmatch(text)
    if found is None or int(found[1]) > LARGEST_SEQUENCE:
        raise BoardProtocolError(f"{text!r} is nothing that an armctl encoder board says")
    sequence = int(found[1])
    if found[3] is None:
        return Answer(sequence, found[2] or "")
    return Refusal(sequence, found[3], found[4] or "")
