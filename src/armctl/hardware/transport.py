"""A line that carries bytes to a board and back."""

from __future__ import annotations

from typing import Protocol


class Transport(Protocol):
    """An open line. Every method but ``close`` may raise ``BoardError`` when the line is gone."""

    @property
    def name(self) -> str:
        """The line as the user named it."""
        ...

    def write(self, data: bytes) -> None:
        """Send all of ``data``, or raise."""
        ...

    def read(self, count: int, timeout_s: float) -> bytes:
        """Return ``count`` bytes, or the fewer that came within ``timeout_s``."""
        ...

    def discard_input(self) -> None:
        """Forget everything received and not yet read."""
        ...

    def close(self) -> None:
        """Give the line up. Never raises; safe to call twice."""
        ...
