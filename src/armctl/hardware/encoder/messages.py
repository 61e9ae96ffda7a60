"""What goes over the line: sealed lines, answers, status, events and banner (firmware/README.md)."""

from __future__ import annotations

import binascii
import re
from enum import Enum, IntEnum, IntFlag

from armctl.errors import ArmctlError, BoardError, BoardProtocolError, InputError, StateError
from armctl.lazy_dataclass import dataclass

# Lines with a checksum, and the single bytes that are no part of any line.

LONGEST_REQUEST = 96  # bytes without the line end
LONGEST_MESSAGE = 192  # the longest that the board sends is a status line of about 120
LARGEST_SEQUENCE = 0xFFFF

_SEALED = re.compile(rb"(.*)\*([0-9A-F]{4})", re.DOTALL)


class Realtime(IntEnum):
    """Bytes that the board obeys as they arrive, in the middle of a line too."""

    HOLD = 0x21  # "!"
    STATUS = 0x3F  # "?"
    MOTORS_OFF = 0x18  # control-X
    RELEASE_HOLD = 0x7E  # "~"


def crc16(data: bytes) -> int:
    """CRC-16/IBM-3740: polynomial 0x1021 from 0xFFFF, most significant bit first."""
    return binascii.crc_hqx(data, 0xFFFF)


def seal(text: str) -> bytes:
    """The line for ``text``: with its checksum and the line end."""
    body = text.encode("ascii")
    return body + b"*%04X\n" % crc16(body)


def unseal(line: bytes) -> str:
    """The text of a line (without its end); ``BoardProtocolError`` where its checksum is wrong or missing."""
    shown = repr(line[:40].decode("ascii", "backslashreplace"))
    found = _SEALED.fullmatch(line)
    if found is None:
        raise BoardProtocolError(f"{shown} has no checksum; this is no armctl encoder board")
    if int(found[2], 16) != crc16(found[1]):
        raise BoardProtocolError(f"{shown} has a wrong checksum; the line garbles bytes")
    if not all(0x20 <= byte <= 0x7E for byte in found[1]):
        raise BoardProtocolError(f"{shown} is no text; the line garbles bytes")
    return found[1].decode("ascii")


def request(sequence: int, text: str) -> bytes:
    """The line that asks for ``text``; ``InputError`` where the board would take it for something else."""
    line = seal(f"{sequence} {text}")
    if len(line) - 1 > LONGEST_REQUEST:
        raise InputError(f"{text!r} is longer than the {LONGEST_REQUEST} bytes that an encoder board takes")
    if not set(Realtime).isdisjoint(line):
        raise InputError(f"{text!r} contains a byte that an encoder board obeys at once")
    return line


class LineReader:
    """Collects bytes until a line end; a line of more than ``longest`` bytes is dropped whole."""

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._pending = b""

    def feed(self, data: bytes) -> list[bytes | None]:
        """The lines that ``data`` completes, without their ends; None for each that was too long."""
        *ended, rest = (self._pending + data).split(b"\n")
        self._pending = rest[: self._longest + 2]  # enough to know that it is too long, with or without \r
        lines = [line.removesuffix(b"\r") for line in ended]
        return [line if len(line) <= self._longest else None for line in lines]


# What the board finds wrong with an axis or with itself, and the words for it.

MOST_LOST_EDGES = 4
"""with more of them since homing the zero of an axis is gone"""
COUNTS_OF_AN_EDGE = 2
"""how far an axis may be off for each, in either direction: both channels changed at once"""


class FaultKind(IntFlag):
    """Faults of one axis, as the board names them; each switches all motors off until it is cleared."""

    STALL = 1
    FOLLOW = 2
    ENCODER = 4
    HOMING = 8
    LIMIT = 16
    LOST = 32


class BoardFlag(IntFlag):
    """What the board reports of itself."""

    WATCHDOG = 1
    LINE_LOST = 2  # nothing is lost for good: a line without an answer is sent again
    BROWN_OUT = 4
    STOPPED = 8
    INTERRUPTED = 16
    LATE = 32


HOMED_AGAIN = FaultKind.HOMING | FaultKind.LIMIT | FaultKind.LOST
"""faults whose words say to home again"""
RESET_FLAGS = {
    "brownout": BoardFlag.BROWN_OUT,
    "unexpected": BoardFlag.INTERRUPTED,
    "watchdog": BoardFlag.INTERRUPTED,
}
"""the flag that the board sets when it starts for this reason; the likelier of two reasons comes first"""

_AXIS_WORDS = {
    FaultKind.STALL: "stalled: the motor was driven at its limit and did not move; see what is in its way",
    FaultKind.FOLLOW: (
        "fell too far behind its setpoint (following error); is it overloaded, its supply weak, or the "
        "speed too high?"
    ),
    FaultKind.ENCODER: (
        "its encoder counted nothing, or nonsense, while the motor was driven; check its plug and wires"
    ),
    FaultKind.HOMING: "homing failed; see to its home switch and what is in its way, and home again",
    FaultKind.LIMIT: "went beyond its soft limit; move it back by hand and home again",
    FaultKind.LOST: (
        f"its encoder lost more than {MOST_LOST_EDGES} edges since homing, so nobody knows where it is; "
        "check the encoder's plug, wires and supply, and home again"
    ),
}
_BOARD_WORDS = {
    BoardFlag.WATCHDOG: (
        "watchdog: the board heard nothing from this computer for too long (was it busy, or the cable "
        "loose?) and switched its motors off"
    ),
    BoardFlag.BROWN_OUT: "brown-out: the board's supply voltage sagged and it started anew; check the supply",
    BoardFlag.STOPPED: "the motors were switched off at once by the emergency byte",
    BoardFlag.INTERRUPTED: (
        "the board started anew while a program worked with it: its supply sagged, its reset button was "
        "pressed, another program opened its port, or its own program hung"
    ),
    BoardFlag.LATE: (
        "the board had no time to control its motors as often as it should: an axis turns too fast; release, "
        "and see what turns it, or lower its speed"
    ),
}


def fault_words(faults: FaultKind, detail: str = "") -> str:
    """What is wrong with one axis, in words that do not name it; ``detail``: what the board said to it."""
    words = "; ".join(words for kind, words in _AXIS_WORDS.items() if kind in faults)
    return f"{words} ({detail})" if words and detail else words


def lost_words(edges: int) -> str:
    """That an axis has lost some edges and keeps its zero, in words that do not name it."""
    return (
        f"its encoder has lost {edges} {'edge' if edges == 1 else 'edges'} since homing: it may be off by "
        f"{COUNTS_OF_AN_EDGE * edges} counts; home again where that matters, and check the encoder's wires"
    )


def flag_words(flags: BoardFlag) -> tuple[str, ...]:
    """What the board reports of itself, in words."""
    return tuple(words for flag, words in _BOARD_WORDS.items() if flag in flags)


# The status line: what the board says 50 times a second of itself and its axes.

SPARE_PINS = tuple(range(42, 50))
"""pins of the Mega that a host may name as inputs and outputs"""
CHANGES = 16
"""the board counts changes of a pin modulo this"""
NO_CHANGES = (0,) * len(SPARE_PINS)

_ALL_FAULTS = sum(FaultKind)
_ALL_FLAGS = sum(BoardFlag)


class Mode(Enum):
    """What the motors do."""

    OFF = "O"
    ON = "N"
    HOMING = "H"
    HELD = "B"
    TRIPPED = "T"

    @property
    def powered(self) -> bool:
        """Whether the motors are on."""
        return self in (Mode.ON, Mode.HOMING, Mode.HELD)


@dataclass(frozen=True, slots=True)
class Status:
    """One status line. Tuples go by axis number."""

    time_ms: int  # since the board started; starts again at 0 after 49.7 days
    mode: Mode
    homed: tuple[bool, ...]
    switches: tuple[bool, ...]  # home switches that are closed
    flags: BoardFlag
    faults: tuple[FaultKind, ...]
    lost: tuple[int, ...]  # edges that its encoders have lost since homing; 15: or more
    counts: tuple[int, ...]  # joint counts
    changes: tuple[int, ...] = NO_CHANGES
    """of each spare pin modulo 16 since it is in use; odd: it is high now"""

    @property
    def latched(self) -> bool:
        """Whether there are flags or faults that CLR clears."""
        return bool(self.flags) or any(self.faults) or self.mode is Mode.TRIPPED

    def words(self) -> list[str]:
        """What is wrong with the board and its axes, in words."""
        axes = enumerate(self.faults)
        return [*flag_words(self.flags), *(f"axis {axis}: {fault_words(one)}" for axis, one in axes if one)]

    def encode(self) -> str:
        """The fields as the board sends them, without the ``@``."""
        faults = "".join(f"{fault:02x}" for fault in self.faults)
        lost, changes = ("".join(f"{one:x}" for one in several) for several in (self.lost, self.changes))
        return (
            f"{self.time_ms} {self.mode.value} {_bits(self.homed):02x} {_bits(self.switches):02x} "
            f"{self.flags:02x} {faults} {lost} {changes} {' '.join(map(str, self.counts))}"
        )


def decode_status(text: str) -> Status:
    """The status in ``text``, the fields without the ``@``; ``BoardProtocolError`` where it is none."""
    fields = text.split(" ")
    try:
        time_ms, mode, homed, switches, flags, faults, lost, changes, *counts = fields
        bits = bytes.fromhex(faults)
        if not counts or not len(bits) == len(lost) == len(counts):
            raise ValueError("as many faults and lost edges as counts, and at least one")
        return Status(
            time_ms=int(time_ms),
            mode=Mode(mode),
            homed=_flags(homed, len(counts)),
            switches=_flags(switches, len(counts)),
            flags=BoardFlag(_known(int(flags, 16), _ALL_FLAGS)),
            faults=tuple(FaultKind(_known(one, _ALL_FAULTS)) for one in bits),
            lost=tuple(int(digit, 16) for digit in lost),
            counts=tuple(map(int, counts)),
            changes=decode_changes(changes),
        )
    except (ValueError, BoardProtocolError) as error:
        raise BoardProtocolError(
            f"{text!r} is no status of an armctl encoder board ({error}); its firmware is another one"
        ) from error


def decode_changes(digits: str) -> tuple[int, ...]:
    """Of each spare pin; ``BoardProtocolError`` where that is not a digit a pin."""
    if len(digits) != len(SPARE_PINS) or not set(digits) <= set("0123456789abcdef"):
        raise BoardProtocolError(f"{digits!r} is not a digit for each of {len(SPARE_PINS)} spare pins")
    return tuple(int(digit, 16) for digit in digits)


def _bits(flags: tuple[bool, ...]) -> int:
    return sum(flag << axis for axis, flag in enumerate(flags))


def _flags(text: str, count: int) -> tuple[bool, ...]:
    bits = _known(int(text, 16), (1 << count) - 1)
    return tuple(bool(bits >> axis & 1) for axis in range(count))


def _known(bits: int, all_known: int) -> int:
    if bits & ~all_known:
        raise ValueError(f"bits {bits:#x} where only {all_known:#x} are known")
    return bits


FIRMWARE = "armctl-encoder"
PROTOCOL = 4

_ANSWER = re.compile(r"(\d{1,5}) (?:ok(?: (.*))?|err ([A-Z]+)(?: (.*))?)")
_BANNER = re.compile(r"(\S+) (\S+) proto=(\d{1,4}) axes=(\d{1,2}) reset=([a-z]+)")
_WHY = {
    "MOVING": "the motors are on; release first",
    "NOTHOMED": "an axis has not found its zero; home first",
    "OFF": "the motors are off",
    "HOLD": "the board holds",
    "FAULT": "a fault is latched; see to it and release, which clears it",
    "BUSY": "the board is homing; wait until it is done, or stop it",
    "LIMIT": "outside the soft limits",
    "NOTOUT": "the pin is no output of this board now",
}


@dataclass(frozen=True, slots=True)
class LineReply:
    """What the board answers to line ``sequence``; 0: it could not read a line."""

    sequence: int
    text: str
    refusal: str = ""  # why the board has not done what the line asked for, a code; empty: it has

    def __str__(self) -> str:
        """Why it has not, in words for the user."""
        said = f"the board says: {self.refusal} {self.text}".rstrip()
        return f"{_WHY[self.refusal]} ({said})" if self.refusal in _WHY else said

    def error(self, asked: str) -> ArmctlError:
        """What to raise where this refuses the request ``asked``."""
        if self.refusal == "LIMIT":
            kind = BoardError
        else:
            kind = StateError if self.refusal in _WHY else BoardProtocolError
        return kind(f"the board refused {asked!r}: {self}")


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


Message = LineReply | Status | Banner | tuple[str, ...]
"""a tuple: the words of an event on the board, as ``("homed", "3")``"""


def decode(line: bytes) -> Message:
    """The message in a line without its end; ``BoardProtocolError`` where it is garbled or unknown."""
    text = unseal(line)
    kind, rest = text[:2], text[2:]
    if kind == "@ ":
        return decode_status(rest)
    if kind == "! ":
        words = tuple(rest.split(" "))
        if words[0] == "pins":
            decode_changes(" ".join(words[1:]))
        return words
    if kind == "# ":
        return decode_banner(rest)
    found = _ANSWER.fullmatch(text)
    if found is None or int(found[1]) > LARGEST_SEQUENCE:
        raise BoardProtocolError(f"{text!r} is nothing that an armctl encoder board says")
    return LineReply(int(found[1]), found[2] or found[4] or "", found[3] or "")


def decode_banner(text: str) -> Banner:
    """The banner in ``text``, which HELLO is answered with, too; ``BoardProtocolError`` where it is none."""
    found = _BANNER.fullmatch(text)
    if found is None:
        raise BoardProtocolError(f"{text!r} is not how an armctl encoder board introduces itself")
    firmware, version, protocol, axes, reset = found.groups()
    return Banner(firmware, version, int(protocol), int(axes), reset)


# Requests as the firmware takes them apart, for a simulated board.

_NUMBER = re.compile(r"-?[0-9]{1,9}")


class RefusedRequest(Exception):  # noqa: N818  not an error: what the board answers
    """The request has no effect; it is answered by ``err`` with this code and text."""


class RequestWords:
    """The words of a line, one after the other; blanks part them, one or more."""

    def __init__(self, text: str) -> None:
        self.rest = [word for word in text.split(" ") if word]

    def take(self) -> str | None:
        """The next word; None at the end."""
        return self.rest.pop(0) if self.rest else None

    def end(self) -> None:
        """Nothing more may follow."""
        if self.rest:
            raise RefusedRequest("ARGS too many")

    def number(self, missing: str) -> int:
        """The next word as a number."""
        value = self.number_or(self.take())
        if value is None:
            raise RefusedRequest(missing)
        return value

    @staticmethod
    def number_or(word: str | None) -> int | None:
        """A word as a number, if it is one."""
        return int(word) if word is not None and _NUMBER.fullmatch(word) else None

    @classmethod
    def checked(cls, word: str | None) -> int:
        """A word that has to be a number."""
        value = cls.number_or(word)
        if value is None:
            raise RefusedRequest("ARGS not a number")
        return value


def within(value: int | None, span: tuple[int, int], refusal: str) -> int:
    """The value, where it is inside a span; else it is refused with this code and text."""
    if value is None or not span[0] <= value <= span[1]:
        raise RefusedRequest(refusal)
    return value
