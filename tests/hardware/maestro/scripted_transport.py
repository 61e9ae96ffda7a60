"""A line that knows every byte of a session beforehand."""

from __future__ import annotations

LONGEST_WAIT_S = 1.0


class ScriptedTransport:
    """Fails on a wrong byte, on a missing one and on one that nobody reads.

    Args:
        exchanges: what the host must write in one go, and what the board answers to it, in hex.
    """

    name = "scripted"

    def __init__(self, *exchanges: tuple[str, str]) -> None:
        self._exchanges = list(exchanges)
        self._reply = b""
        self.closed = 0

    def write(self, data: bytes) -> None:
        assert self._reply == b"", f"nobody read {self._reply.hex(' ')}"
        assert self._exchanges, f"unexpected {data.hex(' ')}"
        expected, reply = self._exchanges.pop(0)
        assert data.hex(" ") == " ".join(expected.split())
        self._reply = bytes.fromhex(reply)

    def read(self, count: int, timeout_s: float) -> bytes:
        assert 0.0 < timeout_s <= LONGEST_WAIT_S
        taken, self._reply = self._reply[:count], self._reply[count:]
        return taken

    def discard_input(self) -> None:
        assert self._reply == b"", f"{self._reply.hex(' ')} thrown away unread"

    def close(self) -> None:
        self.closed += 1

    def assert_done(self) -> None:
        assert self._exchanges == [], "the driver did not send all of it"
        assert self._reply == b"", f"nobody read {self._reply.hex(' ')}"
