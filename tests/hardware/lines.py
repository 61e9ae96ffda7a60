"""Lines to simulated boards without a pty: one in memory, and faults on purpose, the same each time."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable
from enum import Enum

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


class Fault(Enum):
    """What may happen to one burst of bytes."""

    DROP_COMMAND = "drop command"  # the host's burst never reaches the board
    GARBLE_COMMAND = "garble command"  # one bit of the host's burst flips
    DROP_REPLY = "drop reply"
    GARBLE_REPLY = "garble reply"  # one bit of the answer flips
    HALF_REPLY = "half reply"  # the second half of the answer is lost
    DELAY_REPLY = "delay reply"  # the answer comes late


_ON_COMMAND = (Fault.DROP_COMMAND, Fault.GARBLE_COMMAND)


class FaultyModel:
    """A simulated board behind a bad line: itself a byte model that wraps another.

    Faults are armed by name and strike the next bursts that they fit, in order; nothing is left to
    chance but which bit flips, and that follows the seed.
    """

    def __init__(self, inner: ByteModel, seed: int = 0) -> None:
        self._inner = inner
        self._random = random.Random(seed)
        self._armed: deque[tuple[Fault, float]] = deque()
        self._late: list[tuple[float, bytes]] = []
        self._unplugged = False
        self._dark_until: float | None = None
        self._now = 0.0

    def inject(self, fault: Fault, count: int = 1, delay_s: float = 0.0) -> None:
        """Let ``fault`` strike the next ``count`` bursts; ``delay_s`` is for ``DELAY_REPLY``."""
        self._armed.extend([(fault, delay_s)] * count)

    def unplug(self) -> None:
        """Pull the USB cable: the line breaks, and a board fed over USB loses its power."""
        self._unplugged = True
        self._late.clear()
        self._inner.reset()

    def plug_in(self) -> None:
        """Put the cable back; the board has started anew."""
        self._unplugged = False

    def brown_out(self, duration_s: float) -> None:
        """Let the supply sag: the board starts anew and is deaf and dumb for ``duration_s``."""
        self._inner.reset()
        self._late.clear()
        self._dark_until = self._now + duration_s

    @property
    def pending(self) -> int:
        """How many armed faults have not struck yet."""
        return len(self._armed)

    def advance(self, now: float) -> bytes:
        """Let time pass, and hand out the late answers that are due."""
        self._now = now
        if self._dark_until is not None and now >= self._dark_until:
            self._dark_until = None
        unasked = self._inner.advance(now)
        self._check_plugged()
        if self._dark_until is not None:
            return b""
        due = b"".join(reply for at, reply in self._late if at <= now)
        self._late = [(at, reply) for at, reply in self._late if at > now]
        return due + unasked

    def feed(self, data: bytes) -> bytes:
        """Pass a burst to the board and its answer back, through whatever fault is next."""
        self._check_plugged()
        if self._dark_until is not None:
            return b""
        match self._take(on_command=True):
            case (Fault.DROP_COMMAND, _):
                data = b""
            case (Fault.GARBLE_COMMAND, _):
                data = self._garbled(data)
        reply = self._inner.feed(data)
        match self._take(on_command=False) if reply else None:
            case (Fault.GARBLE_REPLY, _):
                return self._garbled(reply)
            case (Fault.HALF_REPLY, _):
                return reply[: len(reply) // 2]
            case (Fault.DELAY_REPLY, delay_s):
                self._late.append((self._now + delay_s, reply))
                return b""
            case (Fault.DROP_REPLY, _):
                return b""
        return reply

    def reset(self) -> None:
        """Start the board anew; armed faults stay armed."""
        self._inner.reset()

    def _garbled(self, data: bytes) -> bytes:
        if not data:
            return data
        spoilt = bytearray(data)
        spoilt[self._random.randrange(len(spoilt))] ^= 1 << self._random.randrange(8)
        return bytes(spoilt)

    def _take(self, *, on_command: bool) -> tuple[Fault, float] | None:
        armed = next((one for one in self._armed if (one[0] in _ON_COMMAND) == on_command), None)
        if armed is not None:
            self._armed.remove(armed)
        return armed

    def _check_plugged(self) -> None:
        if self._unplugged:
            raise BoardError("the simulated board was unplugged; plug it in and connect again")


def holding_maestro(**settings) -> SimulatedMaestro:
    """A Maestro that would give any error away: channel 0 holds 1500 µs, and its home is somewhere else."""
    channels = {0: ChannelConfig(home=HomeMode.GO_TO, home_us=1200.0)}
    board = SimulatedMaestro(settings=MaestroSettings(channels=channels, **settings))
    board.advance(100.0)
    board.feed(bytes.fromhex("84 00 70 2e 2b") if settings.get("crc") else bytes.fromhex("84 00 70 2e"))
    return board
