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
    """Answers requests: None lets one pass to viser.

    Attributes:
        extra_hosts: names, besides loopback and the address connected to, by which pages may call us.
        token: the secret that a page must bring, or None on the loopback address.
        tally: where refusals are counted.
    """

    extra_hosts: tuple[str, ...]
    token: str | None
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
            given = parse_qs(query).get("token", [""])[0] if len(query) <= 1024 else ""
            if given and not is_websocket and self._is_token(given):
                return _redirect(self._cookie(connection))
            if not self._is_token(_cookies(headers).get(_cookie_name(connection), "")):
                return self._refuse(HTTPStatus.UNAUTHORIZED, "no valid token")
        if path not in _PAGE:
            return _respond(HTTPStatus.NOT_FOUND, "There is nothing here.\n")
        if query and not is_websocket:
            # viser's page would follow ?websocket= and ?playbackPath= to any server.
            return _redirect()
        return None

    def finish(self, connection: ServerConnection, request: Request, response: Response) -> None:
        """Add the protective headers to every response (``process_response`` of ``websockets``)."""
        del connection, request
        for name, value in _PAGE_HEADERS.items():
            response.headers[name] = value

    def _hosts(self, connection: ServerConnection) -> frozenset[str]:
        # An address typed by the user cannot be a foreign page's name, so the one connected to is fine.
        local: tuple[str, int] = connection.local_address
        address, port = local[:2]
        literal = f"[{address}]" if ipaddress.ip_address(address).version == 6 else address
        names = (*_LOOPBACK_NAMES, literal, *(name.lower() for name in self.extra_hosts))
        return frozenset(f"{name}:{port}" for name in names) | frozenset(names if port == 80 else ())

    def _is_token(self, given: str) -> bool:
        return self.token is not None and hmac.compare_digest(
            given.encode(errors="surrogateescape"),  # as websockets decoded it
            self.token.encode(),
        )

    def _cookie(self, connection: ServerConnection) -> str:
        return f"{_cookie_name(connection)}={self.token}; HttpOnly; SameSite=Strict; Path=/"

    def _refuse(self, status: HTTPStatus, reason: str) -> Response:
        self.tally.refuse(reason)
        advice = "Open the address that armctl printed."
        return _respond(status, f"armctl refused this request: {reason}.\n{advice}\n")


def _cookie_name(connection: ServerConnection) -> str:
    # A browser sends the cookies of a host to all its ports: two consoles must not overwrite each other's.
    return f"armctl-{connection.local_address[1]}"


def _cookies(headers: Headers) -> dict[str, str]:
    pairs = (part.strip().partition("=") for part in headers.get("Cookie", "").split(";"))
    return {name: value for name, _, value in pairs}


def _redirect(cookie: str | None = None) -> Response:
    headers = {"Location": "/"} if cookie is None else {"Location": "/", "Set-Cookie": cookie}
    return _respond(HTTPStatus.FOUND, "", headers)


def _respond(status: HTTPStatus, text: str, more: dict[str, str] | None = None) -> Response:
    body = text.encode()
    headers = Headers(
        {
            "Content-Type": "text/plain; charset=utf-8",
            "Content-Length": str(len(body)),
            "Connection": "close",
            **(more or {}),
        }
    )
    return Response(status.value, status.phrase, headers, body)


# The listening socket, bound before viser starts.
#
# viser itself takes the next port when one is busy, and waits for ever when it cannot bind at all.

_BACKLOG = 100


def listening_socket(host: str, port: int, *, beyond_loopback: bool) -> socket.socket:
    """Bind and listen.

    Args:
        host: address or name to listen on.
        port: TCP port; 0 lets the system choose a free one.
        beyond_loopback: whether an address that other computers can reach is allowed.

    Returns:
        The socket; the caller closes it.

    Raises:
        ServerError: the address is unknown or reachable from outside, or the port is not to be had.
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
        raise ServerError(_why(cause, host, port)) from cause
    return listener


def _why(cause: OSError, host: str, port: int) -> str:
    match cause.errno:
        case errno.EADDRINUSE:
            return (
                f"port {port} on {host} is in use by another program (another armctl?): "
                f"close it, or choose another port with --http-port {port + 1 if port < 65535 else 8080}"
            )
        case errno.EACCES:
            return f"port {port} is reserved for the system: choose one above 1023 with --http-port"
        case errno.EADDRNOTAVAIL:
            return f"{host} is no address of this computer: use --host 127.0.0.1"
        case _:
            return f"cannot listen on {host}, port {port}: {cause.strerror or cause}"
