"""A line in memory to a simulated board: no threads, no waiting, the same bytes every time."""

from __future__ import annotations

from collections.abc import Callable

from armctl.errors import BoardError
from armctl.hardware.simulation.pty_server import ByteModel

_STEP_S = 0.001


class LoopTransport:
    """Carries bytes straight into a simulated board's model.

    Args:
        model: the board at the other end.
        now: the clock [s].
        wait: lets that clock go on by so many seconds, which is how a read waits for a late answer;
            without it a read returns at once with what is there.
        name: how the line is called in messages.
    """

    def __init__(
        self,
        model: ByteModel,
        now: Callable[[], float],
        wait: Callable[[float], None] | None = None,
        name: str = "loop",
    ) -> None:
        self._model = model
        self._now = now
        self._wait = wait
        self._name = name
        self._received = bytearray()
        self._open = True

    @property
    def name(self) -> str:
        """How the line is called in messages."""
        return self._name

    def write(self, data: bytes) -> None:
        """Hand ``data`` to the board; its answer can be read at once."""
        self._pump()
        self._received += self._model.feed(data)

    def read(self, count: int, timeout_s: float) -> bytes:
        """Return ``count`` bytes, or the fewer that came within ``timeout_s``."""
        self._pump()
        if self._wait is not None:
            deadline = self._now() + timeout_s
            while len(self._received) < count and (left := deadline - self._now()) > 0.0:
                self._wait(min(_STEP_S, left))
                self._pump()
        taken = bytes(self._received[:count])
        del self._received[:count]
        return taken

    def discard_input(self) -> None:
        """Forget everything received and not yet read."""
        self._pump()
        self._received.clear()

    def close(self) -> None:
        """Give the line up; the board goes on without it."""
        self._open = False

    def _pump(self) -> None:
        if not self._open:
            raise BoardError(f"{self._name}: the line is closed; connect again")
        self._received += self._model.advance(self._now())
