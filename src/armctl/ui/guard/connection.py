"""One connection: the HTTP method of its request, and the frames that it lets through."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Any

import viser
from websockets.asyncio.server import Server, ServerConnection
from websockets.frames import CloseCode
from websockets.http11 import Request
from websockets.server import ServerProtocol

from armctl.ui.guard.filter import FrameFilter, Tally

_REFUSED_METHODS = frozenset((b"POST", b"PUT", b"DELETE", b"PATCH", b"OPTIONS", b"TRACE", b"CONNECT"))
_LONGEST_METHOD = 7
_METHOD_NOT_ALLOWED = (
    b"HTTP/1.1 405 Method Not Allowed\r\nAllow: GET, HEAD\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
)


class GuardedConnection(ServerConnection):
    """Drops bad frames and keeps the connection; a page that floods is disconnected (1008)."""

    def __init__(
        self,
        protocol: ServerProtocol,
        server: Server,
        *,
        client_of: Callable[[ServerConnection], viser.ClientHandle | None],
        tally: Tally,
        **options: Any,
    ) -> None:
        super().__init__(protocol, server, **options)
        self._tally = tally
        self._filter = FrameFilter(tally, self.loop.time, lambda: client_of(self))
        self._begin: bytes | None = b""
        """what has come of a request whose method is not known yet"""
        self._refused = False
        self.head_only = False
        """whether the request is HEAD: the answer is that to GET, without its body"""
        self.handed_over = False
        self.socket_path: str | None = None
        """path of the armctl socket that the door let it in to; None for viser's page"""

    def hand_over(self, give: Callable[[socket.socket, bytes], bool], request: Request) -> bool:
        """Have another process go on with this connection; whether it does."""
        if self.transport.get_extra_info("sslcontext") is not None:
            return False  # what it is encrypted with cannot be handed over
        line = self.transport.get_extra_info("socket")
        with socket.fromfd(line.fileno(), line.family, line.type) as copy:
            if not give(copy, request.serialize()):
                return False
        self.handed_over = True
        self.transport.abort()  # our own copy; nothing is sent on it
        return True

    def data_received(self, data: bytes) -> None:
        """Read the method first: ``websockets`` knows GET alone and hangs up on everything else."""
        if self._begin is not None:
            data = self._begin + data
            method, space, rest = data.partition(b" ")
            if not space and len(data) <= _LONGEST_METHOD:
                self._begin = data
                return
            self._begin = None
            if method == b"HEAD" and space:
                self.head_only, data = True, b"GET " + rest
            elif method in _REFUSED_METHODS:
                self._refused = True
                self._tally.refuse("another method than GET and HEAD")
                self.transport.write(_METHOD_NOT_ALLOWED)
        if not self._refused:  # else it is the rest of the request; the client hangs up, or is timed out
            super().data_received(data)

    async def recv(self, decode: bool | None = None) -> Any:
        """Receive the next frame, for viser the next admissible one; see ``websockets``."""
        while True:
            raw = await super().recv(decode)
            if self.socket_path is not None or self._filter.admits(raw):
                return raw
            if self._filter.flooded:
                await self.close(CloseCode.POLICY_VIOLATION, "too many messages")
