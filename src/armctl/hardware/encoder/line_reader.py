"""Bytes to lines, whatever pieces they come in and whatever is between them."""

from __future__ import annotations


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
