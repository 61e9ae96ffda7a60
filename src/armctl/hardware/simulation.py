"""Lines to simulated boards: a pseudo-terminal for any program, one in memory, and faults on purpose."""

from __future__ import annotations

import os
import random
import selectors
import threading
import tty
from collections import deque
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import TracebackType
from typing import Generic, Self, TypeVar

from armctl.errors import BoardError, PortError
from armctl.hardware.board_type import ByteModel

Model = TypeVar("Model", bound=ByteModel)

_CHUNK = 4096
_LARGEST_BACKLOG = 65_536


class PtyServer(Generic[Model]):
    """Serves a byte model on a pty, from a thread of its own, while the context is open.

    Args:
        model: the board. The thread owns it; look at it through ``inspect`` only.
        now: the clock [s].
        link: a path at which the pty is to be found; its own (``/dev/pts/7``) when None.
        tick_s: how often the board's time goes on while nobody speaks to it.

    Raises (on entering):
        PortError: no pty to be had, or the link's path is taken.
    """

    def __init__(
        self, model: Model, now: Callable[[], float], *, link: Path | None = None, tick_s: float = 0.01
    ) -> None:
        self._model = model
        self._now = now
        self._link_path = link
        self._tick_s = tick_s
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._link: DeviceLink | None = None
        self._device: str | None = None
        self._master = self._slave = self._wake_read = self._wake_write = -1
        self._backlog = bytearray()

    @property
    def port(self) -> str:
        """What a client opens: the link when there is one, else the pty.

        Raises:
            PortError: the server is not running.
        """
        if self._device is None:
            raise PortError("the simulated board is not being served; open its server first")
        return str(self._link_path) if self._link_path is not None else self._device

    @contextmanager
    def inspect(self) -> Generator[Model]:
        """The board, brought up to the present and held still as long as the context is open."""
        with self._lock:
            # A board that has left the line can still be looked at.
            with suppress(BoardError):
                self._backlog += self._model.advance(self._now())
            yield self._model

    def __enter__(self) -> Self:
        """Open the pty and start serving."""
        try:
            self._master, self._slave = os.openpty()
        except OSError as error:
            raise PortError(f"no pseudo-terminal for the simulated board: {error.strerror}") from error
        try:
            # Raw, or the line discipline echoes the host's bytes and rewrites 0x0D and 0x03.
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self._device = os.ttyname(self._slave)
            if self._link_path is not None:
                self._link = DeviceLink(self._link_path, self._device)
        except BaseException:
            self._close_pty()
            raise
        self._wake_read, self._wake_write = os.pipe()
        self._thread = threading.Thread(target=self._serve, name=f"simulated board {self.port}", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop serving, close the pty and take the link away."""
        self.close()

    def close(self) -> None:
        """Stop serving; safe to call twice."""
        if self._thread is None:
            return
        os.write(self._wake_write, b"x")
        self._thread.join()
        self._thread = None
        if self._link is not None:
            self._link.remove()
        self._close_pty()
        os.close(self._wake_read)
        os.close(self._wake_write)

    def _serve(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._wake_read, selectors.EVENT_READ)
            selector.register(self._master, selectors.EVENT_READ)
            while True:
                events = {key.fd for key, _ in selector.select(self._tick_s)}
                if self._wake_read in events:
                    return
                try:
                    with self._lock:
                        self._pump(readable=self._master in events)
                        wanted = selectors.EVENT_READ | (selectors.EVENT_WRITE if self._backlog else 0)
                except BoardError:
                    # The board is unplugged: its clients must see a broken line.
                    selector.unregister(self._master)
                    self._close_pty()
                    return
                selector.modify(self._master, wanted)

    def _pump(self, *, readable: bool) -> None:
        data = b""
        if readable:
            with suppress(BlockingIOError):
                data = os.read(self._master, _CHUNK)
        self._backlog += self._model.advance(self._now())
        if data:
            self._backlog += self._model.feed(data)
        if self._backlog:
            # A client that never reads fills the pty; a board would lose the bytes as well.
            del self._backlog[_LARGEST_BACKLOG:]
            with suppress(BlockingIOError):
                del self._backlog[: os.write(self._master, self._backlog)]

    def _close_pty(self) -> None:
        # The slave is held open while serving: else the master reads EIO after the first client has left.
        self._device = None
        for descriptor in (self._slave, self._master):
            if descriptor >= 0:
                os.close(descriptor)
        self._master = self._slave = -1


# A symlink with a name of the user's choice to a pty, which has none of its own.

_PTY_FOLDER = "/dev/pts/"


class DeviceLink:
    """A symlink to a pty, made on construction and removed on ``remove``.

    Args:
        path: where the link goes.
        device: the pty that it points to.

    Raises:
        PortError: something is there that is not a stale link of an earlier simulator.
    """

    def __init__(self, path: Path, device: str) -> None:
        self._path = path
        self._device = device
        if _is_stale(path, device):
            path.unlink()
        elif path.is_symlink() or path.exists():
            raise PortError(
                f"{path}: already there, and not a left-over of a simulator; "
                "choose another name, or remove it if no simulator is running"
            )
        try:
            path.symlink_to(device)
        except OSError as error:
            raise PortError(
                f"{path}: no link can be made there ({error.strerror}); choose another place"
            ) from error

    def remove(self) -> None:
        """Take the link away, unless somebody has put something else in its place."""
        with suppress(OSError):
            if self._path.is_symlink() and str(self._path.readlink()) == self._device:
                self._path.unlink()


def _is_stale(path: Path, device: str) -> bool:
    """Whether ``path`` is a link to a pty that is gone, or to the one that is ours now.

    The kernel gives pty numbers out again, so the left-over of a crash may well point to our own.
    """
    if not path.is_symlink():
        return False
    target = str(path.readlink())
    return target == device or (target.startswith(_PTY_FOLDER) and not Path(target).exists())


# A line in memory.

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


# Faults on the line, on purpose and the same each time.


class Fault(Enum):
    """What may happen to one burst of bytes."""

    DROP_COMMAND = "drop command"  # the host's burst never reaches the board
    GARBLE_COMMAND = "garble command"  # one bit of the host's burst flips
    DROP_REPLY = "drop reply"
    GARBLE_REPLY = "garble reply"  # one bit of the answer flips
    HALF_REPLY = "half reply"  # the second half of the answer is lost
    DELAY_REPLY = "delay reply"  # the answer comes late


_ON_COMMAND = (Fault.DROP_COMMAND, Fault.GARBLE_COMMAND)


@dataclass(slots=True)
class _Armed:
    fault: Fault
    delay_s: float


class FaultyModel:
    """A simulated board behind a bad line: itself a byte model that wraps another.

    Faults are armed by name and strike the next bursts that they fit, in order; nothing is left to
    chance but which bit flips, and that follows the seed.

    Args:
        inner: the board that works.
        seed: of the generator that picks the bits.
    """

    def __init__(self, inner: ByteModel, seed: int = 0) -> None:
        self._inner = inner
        self._random = random.Random(seed)
        self._armed: deque[_Armed] = deque()
        self._late: list[tuple[float, bytes]] = []
        self._unplugged = False
        self._dark_until: float | None = None
        self._now = 0.0

    def inject(self, fault: Fault, count: int = 1, delay_s: float = 0.0) -> None:
        """Let ``fault`` strike the next ``count`` bursts; ``delay_s`` is for ``DELAY_REPLY``."""
        self._armed.extend(_Armed(fault, delay_s) for _ in range(count))

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
        if (armed := self._take(lambda fault: fault in _ON_COMMAND)) is not None:
            data = b"" if armed.fault is Fault.DROP_COMMAND else self._garbled(data)
        reply = self._inner.feed(data)
        if not reply:
            return reply
        armed = self._take(lambda fault: fault not in _ON_COMMAND)
        return reply if armed is None else self._spoilt(armed, reply)

    def reset(self) -> None:
        """Start the board anew; armed faults stay armed."""
        self._inner.reset()

    def _spoilt(self, armed: _Armed, reply: bytes) -> bytes:
        match armed.fault:
            case Fault.GARBLE_REPLY:
                return self._garbled(reply)
            case Fault.HALF_REPLY:
                return reply[: len(reply) // 2]
            case Fault.DELAY_REPLY:
                self._late.append((self._now + armed.delay_s, reply))
                return b""
            case _:
                return b""

    def _garbled(self, data: bytes) -> bytes:
        if not data:
            return data
        spoilt = bytearray(data)
        spoilt[self._random.randrange(len(spoilt))] ^= 1 << self._random.randrange(8)
        return bytes(spoilt)

    def _take(self, fits: Callable[[Fault], bool]) -> _Armed | None:
        armed = next((candidate for candidate in self._armed if fits(candidate.fault)), None)
        if armed is not None:
            self._armed.remove(armed)
        return armed

    def _check_plugged(self) -> None:
        if self._unplugged:
            raise BoardError("the simulated board was unplugged; plug it in and connect again")
