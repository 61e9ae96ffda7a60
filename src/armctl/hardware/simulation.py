"""A simulated board on a line of its own, for any program that opens serial ports."""

from __future__ import annotations

import os
import selectors
import socket
import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Generic, Protocol, Self, TypeVar

from armctl.errors import BoardError, PortError
from armctl.hardware.board_type import ByteModel
from armctl.system import is_pseudo_terminal, open_pseudo_terminal

Descriptor = int | socket.socket
Model = TypeVar("Model", bound=ByteModel)

_Selector: type[selectors.BaseSelector] = getattr(selectors, "PollSelector", selectors.SelectSelector)
"""takes no descriptor; Windows has the second only"""
TICK_S = 0.025
"""how often a board may speak unasked, unless it is told otherwise [s]"""
_CHUNK = 4096
_LARGEST_BACKLOG = 65_536


class _SimulatorLine(Protocol):
    """The board's end of a line."""

    address: str
    """what a client opens"""

    def inputs(self) -> Sequence[Descriptor]:
        """What to wait for, until bytes or a client come."""
        ...

    def outputs(self) -> Sequence[Descriptor]:
        """What to wait for, until bytes can be sent."""
        ...

    def receive(self) -> bytes:
        """What has come; empty: nothing has. Never waits."""
        ...

    def send(self, data: bytearray) -> int:
        """Send what goes without waiting; the number of bytes that are sent, or lost."""
        ...

    def close(self) -> None:
        """Break the line for its clients."""
        ...


class Player(Protocol):
    """Something that goes on in the world around a simulated board."""

    def advance(self, model: ByteModel, now: float) -> bytes:
        """Let the board's time pass up to ``now`` [s]; what the board sends unasked meanwhile."""
        ...


class _PseudoTerminal:
    """A line on a pty: any program takes it for a serial port."""

    def __init__(self, server: int, clients: int, address: str) -> None:
        # The clients' end is held open, too: else the server's reads EIO after the first client has left.
        self._server, self._clients, self.address = server, clients, address

    def inputs(self) -> Sequence[Descriptor]:
        return (self._server,)

    outputs = inputs

    def receive(self) -> bytes:
        with suppress(BlockingIOError):
            return os.read(self._server, _CHUNK)
        return b""

    def send(self, data: bytearray) -> int:
        with suppress(BlockingIOError):
            return os.write(self._server, data)
        return 0

    def close(self) -> None:
        os.close(self._clients)
        os.close(self._server)


class _LoopbackPort:
    """A line on a port of the loopback address, for systems without ptys; a second client waits."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self._client: socket.socket | None = None
        self.address = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"

    def inputs(self) -> Sequence[Descriptor]:
        return self.outputs() or (self._listener,)

    def outputs(self) -> Sequence[Descriptor]:
        return () if self._client is None else (self._client,)

    def receive(self) -> bytes:
        with suppress(BlockingIOError):
            if self._client is None:
                client, _ = self._listener.accept()
                client.setblocking(False)
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._client = client
                return b""
            with suppress(ConnectionError):
                if data := self._client.recv(_CHUNK):
                    return data
            self._client.close()  # it has left
            self._client = None
        return b""

    def send(self, data: bytearray) -> int:
        if self._client is None:  # as bytes on a plug that nobody has open
            return len(data)
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except ConnectionError:  # it has left, which ``receive`` will see
            return len(data)

    def close(self) -> None:
        self._listener.close()
        if self._client is not None:
            self._client.close()


def _new_line() -> _PseudoTerminal | _LoopbackPort:
    try:
        ends = open_pseudo_terminal()
        return _LoopbackPort() if ends is None else _PseudoTerminal(*ends)
    except OSError as error:
        raise PortError(f"no line for the simulated board: {error.strerror}") from error


class BoardServer(Generic[Model]):
    """Serves a byte model on a line, from a thread of its own, while the context is open.

    The line is a pty, or a port of the loopback address where the system has no ptys. The thread owns
    ``model``; look at it through ``inspect`` only. ``link`` is a path at which the pty is to be found,
    besides its own (``/dev/pts/7``). The board's time goes on every ``tick_s`` while no client speaks to it.
    A board that leaves the line breaks it for its clients. When it comes back, it is served on a new line, as
    a device that is plugged in again may get another name; the link follows it. Entering raises
    ``PortError`` where no line is to be had, or the link's path is taken.
    """

    def __init__(
        self, model: Model, now: Callable[[], float], *, link: Path | None = None, tick_s: float = TICK_S
    ) -> None:
        self._model = model
        self._now = now
        self._link = link
        self._tick_s = tick_s
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._cleanup = ExitStack()
        self._line: _SimulatorLine | None = None
        self._wake: socket.socket
        self._waker: socket.socket
        self._backlog = bytearray()
        self._player: Player | None = None

    def play(self, player: Player | None) -> None:
        """Have the board's time pass by ``player`` from now on, which may press its inputs; None: plainly."""
        with self._lock:
            self._player = player

    def _advance(self) -> bytes:
        now = self._now()
        return self._model.advance(now) if self._player is None else self._player.advance(self._model, now)

    @property
    def port(self) -> str:
        """What a client opens: the link when there is one, else the line; ``PortError`` when not running."""
        address = self.address
        if address is None:
            raise PortError("the simulated board is not being served; open its server first")
        return address

    @property
    def address(self) -> str | None:
        """The same; None while the board is off its line."""
        line = self._line
        return None if line is None else line.address if self._link is None else str(self._link)

    @contextmanager
    def inspect(self) -> Generator[Model]:
        """The board, brought up to the present and held still as long as the context is open."""
        with self._lock:
            # A board that has left the line can still be looked at.
            with suppress(BoardError):
                self._backlog += self._advance()
            yield self._model

    def __enter__(self) -> Self:
        """Open the line and start serving."""
        with ExitStack() as stack:
            stack.callback(self._close_line)
            self._open_line()
            self._wake, self._waker = socket.socketpair()
            stack.callback(self._wake.close)
            stack.callback(self._waker.close)
            self._cleanup = stack.pop_all()
        self._thread = threading.Thread(target=self._serve, name=f"simulated board {self.port}", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop serving, close the line and take the link away."""
        self.close()

    def close(self) -> None:
        """Stop serving; safe to call twice."""
        if self._thread is None:
            return
        self._waker.send(b"x")
        self._thread.join()
        self._thread = None
        self._cleanup.close()

    def _serve(self) -> None:
        while self._wait():
            try:
                with self._lock:
                    self._pump()
                if self._line is None:
                    self._open_line()
            except BoardError:
                # The board is unplugged: its clients must see a broken line.
                self._close_line()
                self._backlog.clear()

    def _wait(self) -> bool:
        """Wait for a tick, or less where there is something to do; False: it is over."""
        with _Selector() as selector:
            selector.register(self._wake, selectors.EVENT_READ)
            if self._line is not None:
                sending = self._line.outputs() if self._backlog else ()
                for one in self._line.inputs():
                    events = selectors.EVENT_WRITE if one in sending else 0
                    selector.register(one, selectors.EVENT_READ | events)
            ready = selector.select(self._tick_s)
        return not any(key.fileobj is self._wake for key, _ in ready)

    def _pump(self) -> None:
        data = b"" if self._line is None else self._line.receive()
        self._backlog += self._advance()
        if data:
            self._backlog += self._model.feed(data)
        if self._backlog and self._line is not None:
            # A client that never reads fills the line; a board would lose the bytes as well.
            del self._backlog[_LARGEST_BACKLOG:]
            del self._backlog[: self._line.send(self._backlog)]

    def _open_line(self) -> None:
        line = _new_line()
        try:
            if self._link is not None:
                make_link(self._link, line.address)
        except BaseException:
            line.close()
            raise
        self._line = line

    def _close_line(self) -> None:
        line, self._line = self._line, None
        if line is None:
            return
        if self._link is not None:
            remove_link(self._link, line.address)
        line.close()


# A symlink with a name of the user's choice to a pty, which has none of its own.


def make_link(path: Path, device: str) -> None:
    """A symlink to a pty; ``PortError`` where anything but a stale link of an earlier simulator is there."""
    if "://" in device:
        raise PortError(f"{path}: no link can be made to {device}; leave out --link and use that address")
    try:  # it may be taken away, or put there, at any moment
        target = str(path.readlink()) if path.is_symlink() else ""
        # The kernel gives pty numbers out again, so the left-over of a crash may well point to our own.
        if target == device or (is_pseudo_terminal(target) and not Path(target).exists()):
            path.unlink()
        elif path.is_symlink() or path.exists():
            raise PortError(
                f"{path}: already there, and not a left-over of a simulator; "
                "choose another name, or remove it if no simulator is running"
            )
        path.symlink_to(device)
    except OSError as error:
        raise PortError(
            f"{path}: no link can be made there ({error.strerror}); choose another place"
        ) from error


def remove_link(path: Path, device: str) -> None:
    """Take the link away, unless another one has been put in its place."""
    with suppress(OSError):
        if path.is_symlink() and str(path.readlink()) == device:
            path.unlink()
