"""A line to a simulated board without a pty: in memory."""

from __future__ import annotations

from collections.abc import Callable

from armctl.errors import BoardError
from armctl.hardware import ByteModel
from armctl.hardware.maestro.simulated import ChannelConfig, HomeMode, MaestroSettings, SimulatedMaestro

_SHORTEST_S = 1e-6  # less may not be a cycle of a simulated CPU's clock
_STEP_S = 0.001


class LoopTransport:
    """Carries bytes straight into a simulated board's model.

    ``wait`` lets the clock go on by so many seconds, which is how a read waits for a late answer; without it
    a read returns at once with what is there.
    """

    def __init__(
        self,
        model: ByteModel,
        now: Callable[[], float],
        wait: Callable[[float], None] | None = None,
        name: str = "loop",
    ) -> None:
        self._model, self._now, self._wait = model, now, wait
        self.name = name
        self._received = bytearray()
        self._open = True

    def write(self, data: bytes) -> None:
        """Hand ``data`` to the board; its answer can be read at once."""
        self._pump()
        self._received += self._model.feed(data)

    def read(self, count: int, timeout_s: float) -> bytes:
        self._pump()
        if self._wait is not None:
            deadline = self._now() + timeout_s
            while len(self._received) < count and (left := deadline - self._now()) > 0.0:
                self._wait(min(_STEP_S, max(_SHORTEST_S, left)))
                self._pump()
        taken = bytes(self._received[:count])
        del self._received[:count]
        return taken

    def discard_input(self) -> None:
        self._pump()
        self._received.clear()

    def close(self) -> None:
        """Give the line up; the board goes on without it."""
        self._open = False

    def _pump(self) -> None:
        if not self._open:
            raise BoardError(f"{self.name}: the line is closed; connect again")
        self._received += self._model.advance(self._now())


def holding_maestro(**settings) -> SimulatedMaestro:
    """A Maestro that would give any error away: channel 0 holds 1500 µs, and its home is somewhere else."""
    channels = {0: ChannelConfig(home=HomeMode.GO_TO, home_us=1200.0)}
    board = SimulatedMaestro(settings=MaestroSettings(channels=channels, **settings))
    board.advance(100.0)
    board.feed(bytes.fromhex("84 00 70 2e 2b") if settings.get("crc") else bytes.fromhex("84 00 70 2e"))
    return board
