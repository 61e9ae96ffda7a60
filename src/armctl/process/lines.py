"""Lines to an arm process: its local socket, the WebSocket of a console, and lines that are handed to it."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Protocol
from urllib.parse import parse_qs, urlsplit

from websockets.exceptions import InvalidMessage, InvalidStatus, WebSocketException
from websockets.sync.client import ClientConnection, connect

from armctl.errors import ArmProcessError, BoardError, InputError
from armctl.process.records import MOST_BYTES, Codec, Trust

_CONNECT_S = 10.0
_PING_S, _GONE_S, _GOODBYE_S = 5.0, 30.0, 2.0
"""A network that is pulled out says nothing: a console that leaves a ping unanswered for so long is gone."""


class ProcessLine(Protocol):
    """Carries records to an arm process and back. One thread sends, another receives.

    ``OSError``: it is broken; after ``close``, also for a thread that waits in ``receive``.
    """

    def send(self, data: bytes) -> None:
        """Send a record."""
        ...

    def receive(self) -> bytes:
        """The next record."""
        ...

    def close(self) -> None:
        """End it, from any thread. May be called more than once."""
        ...


class LocalLine:
    """The local socket of an arm process; each record has its length in front."""

    def __init__(self, address: Path | tuple[str, int], secret: str, *, adopts: bool = False) -> None:
        """Connect; ``adopts``: to an arm process that nobody owns. ``BoardError``: nobody answers there."""
        self.address, self.secret = address, secret
        self._socket = _connected(address)
        try:
            self.send(Codec().encode(Trust(secret, adopts=adopts)))
        except OSError as cause:
            raise ArmProcessError(f"no arm process answers at {address}: {cause.strerror}") from cause

    def send(self, data: bytes) -> None:
        """Send a record."""
        self._socket.sendall(len(data).to_bytes(4) + data)

    def receive(self) -> bytes:
        """The next record."""
        size = int.from_bytes(self._exactly(4))
        if size > MOST_BYTES:
            raise ConnectionError(f"a record of {size} bytes")
        return self._exactly(size)

    def close(self) -> None:
        """End it."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # wakes who waits in receive
        self._socket.close()

    def _exactly(self, count: int) -> bytes:
        data = bytearray()
        while len(data) < count:
            part = self._socket.recv(count - len(data))
            if not part:
                raise ConnectionError("the connection was closed")
            data += part
        return bytes(data)


class RemoteLine:
    """The WebSocket of a console, ``http://host:8080`` or ``https://…``."""

    def __init__(self, url: str, token: str | None) -> None:
        """Connect. ``BoardError``: nobody answers, or the token is not the one that it wants."""
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise InputError(f"{url!r} is no address of a console; it looks like http://192.168.1.20:8080")
        given = parse_qs(parts.query).get("token", [""])[0]
        headers = {"Authorization": f"Bearer {token or given}"} if token or given else {}
        address = f"{'wss' if parts.scheme == 'https' else 'ws'}://{parts.netloc}/api"
        try:
            self._socket = _opened(address, headers)
        except InvalidStatus as cause:
            text = (cause.response.body or b"").decode(errors="replace").strip().splitlines()
            why = " ".join(text) or f"status {cause.response.status_code}"
            raise BoardError(f"{parts.netloc}: {why}") from cause
        except (OSError, WebSocketException) as cause:
            raise BoardError(f"no console answers at {parts.netloc}: {cause}") from cause

    def send(self, data: bytes) -> None:
        """Send a record."""
        try:
            self._socket.send(data)
        except WebSocketException as cause:
            raise ConnectionError(str(cause)) from cause

    def receive(self) -> bytes:
        """The next record."""
        try:
            data = self._socket.recv()
        except (EOFError, WebSocketException) as cause:
            raise ConnectionError(str(cause)) from cause
        return data if isinstance(data, bytes) else data.encode()

    def close(self) -> None:
        """End it."""
        self._socket.close()


def _opened(address: str, headers: Mapping[str, str], tries: int = 3) -> ClientConnection:
    """A websocket, also where the first ones are ended without an answer.

    An arm process that is being killed still takes what the console hands to it, and it ends with it.
    """
    try:
        return connect(
            address, additional_headers=headers, max_size=MOST_BYTES, compression=None,
            open_timeout=_CONNECT_S, ping_interval=_PING_S, ping_timeout=_GONE_S,
            close_timeout=_GOODBYE_S, proxy=None,
        )  # fmt: skip
    except (InvalidMessage, ConnectionResetError) as cause:
        if isinstance(cause, InvalidMessage) and not isinstance(cause.__cause__, EOFError):
            raise
        if tries > 1:
            return _opened(address, headers, tries - 1)
        raise ConnectionResetError("it ends each connection without an answer") from cause


def _connected(address: Path | tuple[str, int]) -> socket.socket:
    try:
        if isinstance(address, tuple):
            return socket.create_connection(address, _CONNECT_S)
        line = socket.socket(socket.AF_UNIX)
        line.connect(str(address))
    except OSError as cause:
        raise ArmProcessError(f"no arm process answers at {address}: {cause.strerror or cause}") from cause
    return line


# A connection that one process hands to another: its file descriptor, over a socket beside the local one.


def hands_of(address: Path) -> Path:
    """The socket that takes connections for the arm process at ``address``."""
    return address.with_suffix(".hand")


def hand_over(address: Path, secret: str, line: socket.socket, request: bytes) -> None:
    """Give a connection to the arm process at ``address``, with the request that came on it.

    Raises ``OSError`` where it cannot be taken.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as hands:
        hands.setblocking(False)
        hands.connect(str(hands_of(address)))
        socket.send_fds(hands, [secret.encode() + b"\n" + request], [line.fileno()])
