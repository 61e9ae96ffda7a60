"""Lines with a checksum, and the single bytes that are no part of any line (firmware/README.md)."""

from __future__ import annotations

import binascii
from enum import IntEnum

from armctl.errors import BoardProtocolError, InputError

LONGEST_REQUEST = 96  # bytes without the line end
LONGEST_MESSAGE = 192  # the longest that the board sends is a status line of about 120
LARGEST_SEQUENCE = 0xFFFF

_CRC_START = 0xFFFF
_TAIL = 5  # "*" and four hexadecimal digits
_HEX = frozenset(b"0123456789ABCDEF")


class Realtime(IntEnum):
    """Bytes that the board obeys as they arrive, in the middle of a line too."""

    HOLD = 0x21  # "!"
    STATUS = 0x3F  # "?"
    MOTORS_OFF = 0x18  # control-X
    RELEASE_HOLD = 0x7E  # "~"


def crc16(data: bytes) -> int:
    """CRC-16/IBM-3740: polynomial 0x1021 from 0xFFFF, most significant bit first."""
    return binascii.crc_hqx(data, _CRC_START)


def seal(text: str) -> bytes:
    """The line for ``text``: with its checksum and the line end."""
    body = text.encode("ascii")
    return body + b"*%04X\n" % crc16(body)


def unseal(line: bytes) -> str:
    """The text of a line (without its end) whose checksum is right.

    Raises:
        BoardProtocolError: no checksum, a wrong one, or bytes that are no text.
    """
    body, tail = line[:-_TAIL], line[-_TAIL:]
    if len(tail) < _TAIL or tail[:1] != b"*" or not _HEX.issuperset(tail[1:]):
        raise BoardProtocolError(f"{_shown(line)} has no checksum; this is no armctl encoder board")
    if int(tail[1:], 16) != crc16(body):
        raise BoardProtocolError(f"{_shown(line)} has a wrong checksum; the line garbles bytes")
    if not all(0x20 <= byte <= 0x7E for byte in body):
        raise BoardProtocolError(f"{_shown(line)} is no text; the line garbles bytes")
    return body.decode("ascii")


def request(sequence: int, text: str) -> bytes:
    """The line that asks the board for ``text``.

    Raises:
        InputError: longer than the board takes, or with a byte in it that the board would obey at once.
    """
    line = seal(f"{sequence} {text}")
    if len(line) - 1 > LONGEST_REQUEST:
        raise InputError(f"{text!r} is longer than the {LONGEST_REQUEST} bytes that an encoder board takes")
    if not set(Realtime).isdisjoint(line):
        raise InputError(f"{text!r} contains a byte that an encoder board obeys at once")
    return line


def _shown(line: bytes) -> str:
    return repr(line[:40].decode("ascii", "backslashreplace"))


# Bytes to lines, whatever pieces they come in and whatever is between them.


class LineReader:
    """Collects bytes until a line end. A line that is too long is dropped whole.

    Args:
        longest: bytes that a line may have without its end.
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._pending = bytearray()
        self._dropping = False

    def feed(self, data: bytes) -> list[bytes | None]:
        """The lines that ``data`` completes, without their ends; None for each that was too long."""
        lines: list[bytes | None] = []
        *ended, rest = data.split(b"\n")
        for piece in ended:
            self._append(piece)
            lines.append(None if self._dropping else bytes(self._pending).removesuffix(b"\r"))
            self._pending.clear()
            self._dropping = False
        self._append(rest)
        return lines

    def _append(self, piece: bytes) -> None:
        # One more than allowed may be the \r that belongs to the line end.
        room = self._longest + 1 - len(self._pending)
        self._dropping |= len(piece) > room
        self._pending += piece[:room]
        self._dropping |= len(self._pending) > self._longest and not self._pending.endswith(b"\r")
