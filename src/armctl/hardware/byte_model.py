"""What a simulated board is to whoever carries its bytes: bytes in, bytes out, and a time."""

from __future__ import annotations

from typing import Protocol


class ByteModel(Protocol):
    """A board's behaviour behind its serial line.

    The carrier (a loop transport, a pty server) calls ``advance`` with its clock before every
    ``feed``. Either may raise ``BoardError``: the board has left the line.
    """

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the host, any number at a time, and return what the board answers."""
        ...

    def advance(self, now: float) -> bytes:
        """Let time pass up to ``now`` [s] and return what the board sends unasked."""
        ...

    def reset(self) -> None:
        """Start anew, as after a power cut."""
        ...
