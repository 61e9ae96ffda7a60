"""A simulated board on a pseudo-terminal, for any program that opens serial ports."""

from __future__ import annotations

import os
import selectors
import threading
import tty
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, suppress
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

    The thread owns ``model``; look at it through ``inspect`` only. ``link`` is a path at which the pty is to
    be found, besides its own (``/dev/pts/7``). The board's time goes on every ``tick_s`` while no client
    speaks to it. A board that leaves the line breaks it for its clients. When it comes back, it is served on
    a new pty, as a device that is plugged in again may get another name; the link follows it. Entering
    raises ``PortError`` where no pty is to be had, or the link's path is taken.
    """

    def __init__(
        self, model: Model, now: Callable[[], float], *, link: Path | None = None, tick_s: float = 0.01
    ) -> None:
        self._model = model
        self._now = now
        self._link = link
        self._tick_s = tick_s
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._cleanup = ExitStack()
        self._device: str | None = None
        self._master = self._slave = self._wake_read = self._wake_write = -1
        self._backlog = bytearray()

    @property
    def port(self) -> str:
        """What a client opens: the link when there is one, else the pty; ``PortError`` when not running."""
        address = self.address
        if address is None:
            raise PortError("the simulated board is not being served; open its server first")
        return address

    @property
    def address(self) -> str | None:
        """The same; None while the board is off its line."""
        device = self._device
        return device if device is None or self._link is None else str(self._link)

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
        with ExitStack() as stack:
            stack.callback(self._close_pty)
            self._open_pty()
            self._wake_read, self._wake_write = os.pipe()
            stack.callback(os.close, self._wake_read)
            stack.callback(os.close, self._wake_write)
            self._cleanup = stack.pop_all()
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
        self._cleanup.close()

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
                    if self._device is None:
                        self._open_pty()
                        selector.register(self._master, selectors.EVENT_READ)
                except BoardError:
                    # The board is unplugged: its clients must see a broken line.
                    if self._device is not None:
                        selector.unregister(self._master)
                    self._close_pty()
                    self._backlog.clear()
                    continue
                selector.modify(self._master, wanted)

    def _pump(self, *, readable: bool) -> None:
        data = b""
        if readable:
            with suppress(BlockingIOError):
                data = os.read(self._master, _CHUNK)
        self._backlog += self._model.advance(self._now())
        if data:
            self._backlog += self._model.feed(data)
        if self._backlog and self._device is not None:
            # A client that never reads fills the pty; a board would lose the bytes as well.
            del self._backlog[_LARGEST_BACKLOG:]
            with suppress(BlockingIOError):
                del self._backlog[: os.write(self._master, self._backlog)]

    def _open_pty(self) -> None:
        try:
            self._master, self._slave = os.openpty()
        except OSError as error:
            raise PortError(f"no pseudo-terminal for the simulated board: {error.strerror}") from error
        # Raw, or the line discipline echoes the host's bytes and rewrites 0x0D and 0x03.
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        device = os.ttyname(self._slave)
        if self._link is not None:
            make_link(self._link, device)
        self._device = device

    def _close_pty(self) -> None:
        # The slave is held open while serving: else the master reads EIO after the first client has left.
        if self._device is not None and self._link is not None:
            remove_link(self._link, self._device)
        self._device = None
        for descriptor in (self._slave, self._master):
            if descriptor >= 0:
                os.close(descriptor)
        self._master = self._slave = -1


# A symlink with a name of the user's choice to a pty, which has none of its own.

_PTY_FOLDER = "/dev/pts/"


def make_link(path: Path, device: str) -> None:
    """A symlink to a pty; ``PortError`` where anything but a stale link of an earlier simulator is there."""
    target = str(path.readlink()) if path.is_symlink() else ""
    # The kernel gives pty numbers out again, so the left-over of a crash may well point to our own.
    if target == device or (target.startswith(_PTY_FOLDER) and not Path(target).exists()):
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


def remove_link(path: Path, device: str) -> None:
    """Take the link away, unless another one has been put in its place."""
    with suppress(OSError):
        if path.is_symlink() and str(path.readlink()) == device:
            path.unlink()
