"""Who may come in: the checks on a request, before a page is served or a websocket opened.

A hostile page in the operator's own browser can reach a server on the loopback address: by its own
requests (which carry its Origin) or by a name of its own that it points at 127.0.0.1 (which the browser
puts in Host). Both headers therefore have to name this server.
"""

from __future__ import annotations

import errno
import hmac
import ipaddress
import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from urllib.parse import parse_qs

from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from armctl.errors import ServerError
from armctl.ui.guard.filter import GuardedConnection, Tally

_LOOPBACK_NAMES = ("127.0.0.1", "localhost", "[::1]")
_PAGE = ("/", "/index.html")
_READ_ONCE = ("Host", "Origin", "Upgrade", "Accept-Encoding", "Cookie")

_PAGE_HEADERS = {
    # The page is one file with everything inline, unpacked by eval; it needs no other server at all.
    "Content-Security-Policy": (
        "default-src 'none'; "
        "script-src 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob: data:; worker-src blob: data:; "
        "style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; "
        "connect-src 'self' blob: data:; "
        "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
}


@dataclass(frozen=True)
class Door:
    """Answers requests: None lets one pass to viser."""

    extra_hosts: tuple[str, ...]
    """names, besides loopback and the address connected to, by which pages may call us"""
    token: str | None
    """the secret that a page must bring, or None on the loopback address"""
    tally: Tally

    def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Judge a request; the result is what ``process_request`` of ``websockets`` expects."""
        headers = request.headers
        if not isinstance(connection, GuardedConnection):
            return self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, "a connection without filter")
        if any(len(headers.get_all(name)) > 1 for name in _READ_ONCE):
            return self._refuse(HTTPStatus.BAD_REQUEST, "a header given twice")
        host = headers.get("Host", "").lower()
        if host not in self._hosts(connection):
            return self._refuse(HTTPStatus.MISDIRECTED_REQUEST, "a foreign host name")
        is_websocket = "Upgrade" in headers
        origin = headers.get("Origin")
        if origin is None and is_websocket:
            return self._refuse(HTTPStatus.FORBIDDEN, "a websocket without origin")
        if origin is not None and origin.lower() != f"http://{host}":
            return self._refuse(HTTPStatus.FORBIDDEN, "a foreign origin")
        path, _, query = request.path.partition("?")
        if self.token is not None:
            # A browser sends a host's cookies to all its ports: each console has a cookie of its own.
            cookie = f"armctl-{connection.local_address[1]}={self.token}"
            given = parse_qs(query).get("token", [""])[0] if len(query) <= 1024 else ""
            if not is_websocket and _same(given, self.token):
                more = {"Location": "/", "Set-Cookie": f"{cookie}; HttpOnly; SameSite=Strict; Path=/"}
                return _respond(HTTPStatus.FOUND, "", more)
            if not any(_same(part.strip(), cookie) for part in headers.get("Cookie", "").split(";")):
                return self._refuse(HTTPStatus.UNAUTHORIZED, "no valid token")
        if path not in _PAGE:
            return _respond(HTTPStatus.NOT_FOUND, "There is nothing here.\n")
        if query and not is_websocket:
            # viser's page would follow ?websocket= and ?playbackPath= to any server.
            return _respond(HTTPStatus.FOUND, "", {"Location": "/"})
        return None

    def finish(self, connection: ServerConnection, request: Request, response: Response) -> None:
        """Add the protective headers to every response (``process_response`` of ``websockets``)."""
        del connection, request
        for name, value in _PAGE_HEADERS.items():
            response.headers[name] = value

    def _hosts(self, connection: ServerConnection) -> frozenset[str]:
        # An address typed by the user cannot be a foreign page's name, so the one connected to is fine.
        address, port = connection.local_address[:2]
        literal = url_host(ipaddress.ip_address(address))
        names = (*_LOOPBACK_NAMES, literal, *(name.lower() for name in self.extra_hosts))
        return frozenset(f"{name}:{port}" for name in names) | frozenset(names if port == 80 else ())

    def _refuse(self, status: HTTPStatus, reason: str) -> Response:
        self.tally.refuse(reason)
        advice = "Open the address that armctl printed."
        return _respond(status, f"armctl refused this request: {reason}.\n{advice}\n")


def _same(given: str, secret: str) -> bool:
    """Compare in constant time; ``given`` may hold bytes as ``websockets`` decoded them."""
    return hmac.compare_digest(given.encode(errors="surrogateescape"), secret.encode())


def _respond(status: HTTPStatus, text: str, more: Mapping[str, str] = {}) -> Response:
    body = text.encode()
    headers = Headers(
        {
            "Content-Type": "text/plain; charset=utf-8",
            "Content-Length": str(len(body)),
            "Connection": "close",
            **more,
        }
    )
    return Response(status.value, status.phrase, headers, body)


def url_host(ip: ipaddress.IPv4Address | ipaddress.IPv6Address) -> str:
    """An address as it is written in a URL."""
    return f"[{ip}]" if ip.version == 6 else str(ip)


# The listening socket, bound before viser starts.
#
# viser itself takes the next port when one is busy, and waits for ever when it cannot bind at all.

_BACKLOG = 100


def listening_socket(host: str, port: int, *, beyond_loopback: bool) -> socket.socket:
    """Bind and listen; the caller closes the socket. Port 0 lets the system choose a free one.

    Raises:
        ServerError: the address is unknown, or reachable from outside without ``beyond_loopback``, or the
            port is not to be had.
    """
    if not 0 <= port <= 65535:
        raise ServerError(f"port {port} does not exist; choose 1 … 65535 with --http-port (0: any free one)")
    try:
        infos = socket.getaddrinfo(host or "?", port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as cause:
        raise ServerError(f"cannot listen on {host!r}: no such address; use --host 127.0.0.1") from cause
    family, kind, protocol, _, address = infos[0]
    ip = ipaddress.ip_address(str(address[0]))
    if not ip.is_loopback and not beyond_loopback:
        raise ServerError(
            f"{host} can be reached from other computers, so a token is needed: "
            f"give one, or listen on 127.0.0.1 only"
        )
    listener = socket.socket(family, kind, protocol)
    try:
        if os.name == "posix":  # elsewhere it would let two servers share one port
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(_BACKLOG)
    except OSError as cause:
        listener.close()
        other = port + 1 if port < 65535 else 8080
        why = {
            errno.EADDRINUSE: f"port {port} on {host} is in use by another program (another armctl?): "
            f"close it, or choose another port with --http-port {other}",
            errno.EACCES: f"port {port} is reserved for the system: choose one above 1023 with --http-port",
            errno.EADDRNOTAVAIL: f"{host} is no address of this computer: use --host 127.0.0.1",
        }.get(cause.errno or 0, f"cannot listen on {host}, port {port}: {cause.strerror or cause}")
        raise ServerError(why) from cause
    return listener
