"""A line that carries bytes to a board and back, and the port that it is opened on."""

from __future__ import annotations

import errno
import logging
import os
import socket
import struct
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Protocol
from urllib.parse import urlsplit

import serial

from armctl.errors import BoardError, BoardTimeoutError, PortError
from armctl.hardware.access import permission_hint
from armctl.lazy_dataclass import dataclass
from armctl.system import is_pseudo_terminal, keep_others_out, line_errors


class Transport(Protocol):
    """An open line. Every method but ``close`` may raise ``BoardError`` when the line is gone."""

    @property
    def name(self) -> str:
        """The line as the user named it."""
        ...

    def write(self, data: bytes) -> None:
        """Send all of ``data``, or raise."""

    def read(self, count: int, timeout_s: float) -> bytes:
        """Return ``count`` bytes, or the fewer that came within ``timeout_s``."""
        ...

    def discard_input(self) -> None:
        """Forget everything received and not yet read."""

    def close(self) -> None:
        """Give the line up. Never raises; safe to call twice."""


_STEP_S = 0.05
_CHUNK = 4096


def pieces(line: Transport, wait_s: float, now: Callable[[], float]) -> Iterator[bytes]:
    """What comes on ``line`` within ``wait_s`` [s], piece by piece; empty ones while it is silent."""
    # Silence is counted as well as timed: the clock of a simulation may stand still.
    deadline, silent_s = now() + wait_s, 0.0
    while (left := min(deadline - now(), wait_s - silent_s)) > 0.0:
        step_s = min(_STEP_S, left)
        data = line.read(1, step_s)
        if not data:
            silent_s += step_s
        yield data and data + line.read(_CHUNK, 0.0)


# A serial port, a pty or a ``socket://host:port`` through pyserial, with errors in words for the user.

_NETWORK = "socket://"
_PORT_NAMES = f"name a device such as /dev/ttyACM0, or {_NETWORK}HOST:PORT"
_LOGGER = logging.getLogger("armctl.hardware")
_BAUD = 115_200
_FIRST_TIMEOUT_S = 0.05
NO_SUCH_PORT = "no such port; is the board plugged in? `armctl ports` lists what is there"

# What pyserial lets through: flushing the input of an unplugged port raises an error of the system's own.
_LINE_ERRORS = (serial.SerialException, *line_errors())


class SerialTransport:
    """A line over anything pyserial can open; ``PortError`` says why one cannot be opened, and what to do.

    ``port`` is a device, a pty or ``socket://host:port``. A write that blocks for ``write_timeout_s`` means
    that the board is stuck; on a busy computer a quarter of a second passes with nothing wrong at all.

    A device is opened for this program alone: ``flock`` keeps out programs that ask for it, TIOCEXCL every
    other one. Neither keeps out what has the device open already, root's programs, and what speaks USB past
    the port (the Maestro Control Center). A pty gets no TIOCEXCL: it would stay locked after a crash, because
    its server keeps it open.
    """

    def __init__(self, port: str, *, baud: int = _BAUD, write_timeout_s: float = 1.0) -> None:
        self.name = port
        self._timeout_s = _FIRST_TIMEOUT_S
        _check_address(port)
        try:
            # exclusive: two programs that write to one board interleave their commands.
            self._serial = serial.serial_for_url(
                port, baudrate=baud, timeout=self._timeout_s, write_timeout=write_timeout_s, exclusive=True
            )
        except ValueError as error:
            raise PortError(f"{port}: not a port that can be opened ({error}); {_PORT_NAMES}") from error
        except _LINE_ERRORS as error:
            raise PortError(f"{port}: {_why_not_opened(port, error)}") from error
        with suppress(*_LINE_ERRORS):  # a driver without it: the lock remains
            if port.startswith(_NETWORK):
                # else a setpoint is held back until the one before it is acknowledged (40 … 200 ms)
                _set_option(self._serial.fileno(), socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            elif not is_pseudo_terminal(port):
                keep_others_out(self._serial.fileno())
                # An FTDI adapter (U2D2) else keeps each answer for 16 ms; a driver may know no such thing.
                ask: Callable[[bool], None] = getattr(self._serial, "set_low_latency_mode")  # noqa: B009
                with suppress(ValueError, NotImplementedError):
                    ask(True)

    def write(self, data: bytes) -> None:
        """Send all of ``data``; ``BoardTimeoutError`` where the board takes no more bytes.

        Then what the system still holds of it is dropped, also what was written before: a board that goes on
        later must not get old setpoints.
        """
        with self._translated("writing to"):
            try:
                self._serial.write(data)
            except serial.SerialTimeoutException as error:
                self._drop_unsent()
                raise BoardTimeoutError(
                    f"{self.name}: the board takes no more bytes; unplug it, plug it in again and reconnect"
                ) from error

    def read(self, count: int, timeout_s: float) -> bytes:
        """Return ``count`` bytes, or the fewer that came within ``timeout_s``."""
        with self._translated("reading from"):
            if timeout_s == 0.0 and not self.name.startswith(_NETWORK):  # whose system counts no bytes
                waiting = min(count, self._serial.in_waiting)
                return self._serial.read(waiting) if waiting else b""
            if timeout_s != self._timeout_s:
                # Each assignment makes pyserial reconfigure the port: only when it changes.
                self._serial.timeout = timeout_s
                self._timeout_s = timeout_s
            return self._serial.read(count)

    def discard_input(self) -> None:
        """Forget everything received and not yet read."""
        with self._translated("clearing the input of"):
            self._serial.reset_input_buffer()

    def close(self) -> None:
        """Close the port. Never raises, also after an unplug."""
        with suppress(*_LINE_ERRORS):
            self._serial.close()

    def _drop_unsent(self) -> None:
        if self.name.startswith(_NETWORK):
            # what is not sent yet is lost when it is closed
            _set_option(self._serial.fileno(), socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        else:
            self._serial.reset_output_buffer()

    @contextmanager
    def _translated(self, action: str) -> Generator[None]:
        """What the system says of a line that is gone, as ``BoardError``."""
        try:
            yield
        except _LINE_ERRORS as error:
            _LOGGER.info("%s the port %s failed: %s", action, self.name, _reason(error))
            raise BoardError(
                f"{self.name}: the line to the board is gone: was the board unplugged, or its power lost? "
                "Check the cable and the power, then connect again"
            ) from error


def _check_address(port: str) -> None:
    """Refuse a network address without host or port, and every other address.

    pyserial knows addresses that overwrite any file of the user (``spy://…?file=``), and who operates the
    arm from another computer may name the port.
    """
    if "://" not in port:
        return
    if not port.startswith(_NETWORK):
        raise PortError(f"{port}: not a port that can be opened; {_PORT_NAMES}")
    try:
        parts = urlsplit(port)
        complete = bool(parts.hostname and parts.port)
    except ValueError:  # no number, or above 65535
        complete = False
    if not complete:
        raise PortError(f"{port}: a network address is {_NETWORK}HOST:PORT, with a port of 1 … 65535")


def _set_option(descriptor: int, level: int, option: int, value: int | bytes) -> None:
    """Set an option of a network line."""
    line = socket.socket(fileno=descriptor)
    try:
        line.setsockopt(level, option, value)
    finally:
        line.detach()  # it is pyserial's


def _why_not_opened(port: str, error: Exception) -> str:
    """What kept a port from opening and what to do about it."""
    match error.errno if isinstance(error, OSError) else None:
        case errno.EACCES | errno.EPERM:
            return f"no permission to open it; {permission_hint(port)}"
        case errno.ENOENT:
            return NO_SUCH_PORT
        case errno.ENODEV | errno.ENXIO:
            return "the device is gone; plug the board in again"
        case errno.EIO:
            return "nothing is at the other end; plug the board in again or restart its simulator"
        case errno.EBUSY | errno.EAGAIN:
            return (
                "in use by another program (another armctl, the Maestro Control Center, the Arduino IDE's "
                "serial monitor, a terminal, ModemManager); close that and try again"
            )
        case errno.EISDIR:
            return "a directory, not a port; `armctl ports` lists what is there"
        case _ if port.startswith(_NETWORK):
            return f"cannot connect ({_reason(error)}); is the program at the other end running?"
        case _:
            return f"cannot be opened as a serial port ({_reason(error)}); `armctl ports` lists what is there"


def _reason(error: Exception) -> str:
    """The last and most specific part of an exception's text."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error.args[-1]) if error.args else type(error).__name__


# A serial port of this computer, and the port of a driver.

UNKNOWN = "unknown"
"""what the listing calls a device that no board is known by"""


@dataclass(frozen=True, slots=True)
class PortInfo:
    """One serial port."""

    device: str  # what to open
    kind: str
    """what its USB numbers say, as ``BoardType.usb`` puts it, or ``UNKNOWN``. What an Arduino has been
    flashed with does not show here: ``probe`` finds out"""
    description: str  # what the operating system says
    serial_number: str | None  # the board's USB serial number
    usable: bool  # whether it can be opened and is the port to talk to the board on
    why_not: str | None  # what speaks against it, and what to do; None when usable
    stable_name: str | None = None  # a name below ``/dev/serial/by-id`` that survives replugging
    notes: tuple[str, ...] = ()  # what to know about a port that can be used
    missing: bool = False  # the board is plugged in, and has no port that could be opened


def describe_port(name: str, ports: Sequence[PortInfo]) -> PortInfo | None:
    """The entry of ``ports`` that ``name`` means, by device, stable name or any link to the device."""
    device = resolved(name)
    return next((port for port in ports if resolved(port.device) == device), None)


def resolved(device: str) -> str:
    """The device that a name or a link stands for."""
    return os.path.realpath(device)


AcceptBoard = Callable[[str | None], None]
"""Gets the serial number of the board behind an open port; raises ``PortError`` for the wrong one."""


def any_board(_serial_number: str | None) -> None:
    """Accept whatever board is there."""


@dataclass(frozen=True, slots=True)
class Connection:
    """Where a driver finds its board, and how it opens the line to it.

    Which board is behind the name of a port is certain only while the port is open: until then another one
    may be plugged in there. So it is looked up before opening, and once more after.
    """

    line: str | Callable[[], Transport]
    """a device, a pty or ``socket://host:port``; or what opens the transport"""
    now: Callable[[], float]  # the clock [s]
    ports: Callable[[], Sequence[PortInfo]] = tuple
    """the listing of serial ports; a simulated board, a pty or a socket is not among them"""
    accept: AcceptBoard = any_board  # judges the board that is there, before it is spoken to
    simulated: bool = False
    """whether a simulated board of this program is at the other end: late on a busy computer, never gone"""
    baud: int = _BAUD  # what the kind of board says

    @property
    def restarts_board(self) -> bool:
        """Whether opening the line starts an Arduino anew, as a device's control lines do."""
        return isinstance(self.line, str) and "://" not in self.line and not is_pseudo_terminal(self.line)

    def open(self) -> tuple[Transport, PortInfo | None]:
        """Open the line, and see which board is behind it; None where the system does not tell.

        Opening the line of an Arduino starts it anew and lets its servos or motors go, so a board that is
        listed as another one is left alone. ``PortError``: the line cannot be opened or used, or the board
        is not the one that is wanted.
        """
        info = self._listed()
        if info is not None and not info.usable:
            raise PortError(f"{self.line}: {info.why_not}")
        if info is not None:
            self.accept(info.serial_number)
        transport = SerialTransport(self.line, baud=self.baud) if isinstance(self.line, str) else self.line()
        try:
            info = self._listed()
            if not self.simulated:
                self.accept(None if info is None else info.serial_number)
        except BaseException:
            transport.close()
            raise
        return transport, info

    def _listed(self) -> PortInfo | None:
        if not isinstance(self.line, str) or self.simulated:
            return None
        return describe_port(self.line, self.ports())
