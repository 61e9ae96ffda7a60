"""Who may come in: the checks on a request, before a page is served or a websocket opened.

A hostile page in the operator's own browser can reach a server on the loopback address: by its own
requests (which carry its Origin) or by a name of its own that it points at 127.0.0.1 (which the browser
puts in Host). Both headers therefore have to name this server.
"""

from __future__ import annotations

import hmac
import html
import ipaddress
import re
import secrets
import socket
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import field
from http import HTTPStatus
from urllib.parse import parse_qs

from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from armctl.lazy_dataclass import dataclass
from armctl.ui.docs import DOCS_PATH, ServedDocs
from armctl.ui.guard.filter import GuardedConnection, Tally
from armctl.ui.guard.listening import url_host

HOST_NAME = re.compile(r"[A-Za-z0-9._-]{1,253}|\[[0-9A-Fa-f:.]+\]")
_LOOPBACK_NAMES = ("127.0.0.1", "localhost", "[::1]")
_PAGE = ("/", "/index.html")
_READ_ONCE = ("Host", "Origin", "Upgrade", "Accept-Encoding", "Authorization", "Cookie")
_MAX_QUERY = 1024
"""characters of a query in which a token is looked for"""

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
_DOCS_HEADERS = {
    # Its pages have no script and no style of their own: what they load are files of this server.
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
        "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
}


@dataclass(frozen=True)
class SocketDoor:
    """A websocket of armctl's own beside viser's, and a document that describes it."""

    handle: Callable[[ServerConnection], Awaitable[None]]
    """serves one connection; bounds of its frames and of their rate are its own"""
    for_programs: bool = False
    """whether a client without Origin, which is no browser, may come in with the token itself"""
    hand_over: Callable[[socket.socket, bytes], bool] | None = None
    """gives the connection, with its request, to another process; False: ``handle`` serves it"""
    schema: bytes | None = None
    """JSON, served at the path with ``/schema`` added"""


class Guesses:
    """Slows down who sends wrong tokens: after ten in a minute, each answer to an address comes late.

    What keeps a guesser out is the token's length (16 or more of 64 characters). The right token never
    waits, whoever else guesses from the same address: nobody can lock the owner out.
    """

    FREE = 10.0
    REFILL_PER_S = 10.0 / 60.0
    DELAY_S = 1.0
    MOST_ADDRESSES = 1000

    def __init__(self) -> None:
        self._left: dict[str, tuple[float, float]] = {}
        """free guesses of an address and when [s] that was"""

    def delay_s(self, address: str, now_s: float) -> float:
        """Count one wrong token; how long [s] its answer is to wait."""
        left, at_s = self._left.pop(address, (self.FREE, now_s))
        left = min(self.FREE, left + self.REFILL_PER_S * (now_s - at_s)) - 1.0
        self._left[address] = max(left, -1.0), now_s
        if len(self._left) > self.MOST_ADDRESSES:
            del self._left[next(iter(self._left))]
        return 0.0 if left >= 0.0 else self.DELAY_S


@dataclass(frozen=True)
class Door:
    """Answers requests: None lets one pass to viser, or to the socket noted in the connection."""

    extra_hosts: tuple[str, ...]
    """names, besides loopback and the address connected to, by which pages may call us"""
    token: str | None
    """the secret that a page must bring, or None on the loopback address"""
    tally: Tally
    scheme: str = "http"
    """http, or https on a line that is encrypted"""
    sockets: Mapping[str, SocketDoor] = field(default_factory=dict[str, SocketDoor])
    """armctl's own websockets by path"""
    docs: ServedDocs | None = None
    """what is below ``/docs``; a connection that it lets in there has its ``docs_path``"""
    guesses: Guesses = field(default_factory=Guesses)
    _single_use: set[str] = field(default_factory=set[str])

    def single_use_token(self) -> str | None:
        """A token that lets one page in, once: it may stand in a command line, which others can see."""
        if self.token is None:
            return None
        token = secrets.token_urlsafe(24)
        self._single_use.add(token)
        return token

    def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Judge a request; the result is what ``process_request`` of ``websockets`` expects."""
        headers = request.headers
        if not isinstance(connection, GuardedConnection):
            return self._refuse(request, HTTPStatus.INTERNAL_SERVER_ERROR, "a connection without filter")
        if any(len(headers.get_all(name)) > 1 for name in _READ_ONCE):
            return self._refuse(request, HTTPStatus.BAD_REQUEST, "a header given twice")
        host = headers.get("Host", "").lower()
        hosts, port = self._hosts(connection), connection.local_address[1]
        if host not in hosts:
            advice = _advice_on_host(host, port)
            return self._refuse(request, HTTPStatus.MISDIRECTED_REQUEST, "a foreign host name", *advice)
        path, _, query = request.path.partition("?")
        is_websocket = "Upgrade" in headers
        if is_websocket and connection.head_only:
            return self._refuse(request, HTTPStatus.BAD_REQUEST, "a websocket asked for by HEAD")
        socket_path = path.removesuffix("/schema")
        own = self.sockets.get(socket_path)
        origin = headers.get("Origin")
        if origin is not None and origin.lower() != f"{self.scheme}://{host}":
            return self._refuse(request, HTTPStatus.FORBIDDEN, "a foreign origin")
        for_programs = own is not None and own.for_programs
        knows = for_programs and self._knows_token(headers, query)
        if origin is None and is_websocket and not for_programs:
            return self._refuse(request, HTTPStatus.FORBIDDEN, "a websocket without origin")
        if self.token is not None and not knows:
            # A browser sends a host's cookies to all its ports: each console has a cookie of its own.
            cookie = f"armctl-{port}={self.token}"
            if path in _PAGE and not is_websocket and self._opens(connection, query):
                # Lax, so that the link works from mail and chat. A cookie that comes with a link of another
                # site can only fetch the page; what commands is a websocket, which must have our Origin.
                more = f"{cookie}; HttpOnly; SameSite=Lax; Path=/" + "; Secure" * (self.scheme == "https")
                return _respond(HTTPStatus.FOUND, "", {"Location": "/", "Set-Cookie": more})
            cookies = headers.get("Cookie", "").split(";")
            is_program = origin is None and is_websocket  # a browser's websocket has an Origin
            if is_program or not any(_same(part.strip(), cookie) for part in cookies):
                advice = (_BEARER,) if for_programs else _ADVICE_ON_TOKEN
                return self._refuse(request, HTTPStatus.UNAUTHORIZED, "no valid token", *advice)
        if own is not None:
            return self._answer_at_socket(connection, own, socket_path, path, is_websocket)
        if self.docs is not None and f"{path}/".startswith(f"{DOCS_PATH}/") and not is_websocket:
            connection.docs_path = path
            return None
        if path not in _PAGE:
            return _respond(HTTPStatus.NOT_FOUND, "There is nothing here.\n")
        if query and not is_websocket:
            # viser's page would follow ?websocket= and ?playbackPath= to any server.
            return _respond(HTTPStatus.FOUND, "", {"Location": "/"})
        return None

    def document(self, path: str) -> Response:
        """The documentation at a path that ``answer`` has let in to; it takes a while: not for the loop."""
        found = None if self.docs is None else self.docs(path)
        if found is None:
            return _respond(HTTPStatus.NOT_FOUND, "There is no such page in the documentation.\n")
        if found.moved_to:
            return _respond(HTTPStatus.FOUND, "", {"Location": found.moved_to, **_DOCS_HEADERS})
        return _respond(HTTPStatus.OK, found.body, {"Content-Type": found.kind, **_DOCS_HEADERS})

    def finish(self, connection: ServerConnection, request: Request, response: Response) -> None:
        """Add the protective headers to every response (``process_response`` of ``websockets``)."""
        del request
        for name, value in _PAGE_HEADERS.items():
            if name not in response.headers:
                response.headers[name] = value
        if isinstance(connection, GuardedConnection) and connection.head_only:
            response.body = b""

    def delay_s(self, connection: ServerConnection, request: Request, response: Response) -> float:
        """How long [s] the answer to a wrong token is to wait; who brings none does not guess."""
        shown = any(name in request.headers for name in ("Cookie", "Authorization")) or "?" in request.path
        if response.status_code != HTTPStatus.UNAUTHORIZED or not shown:
            return 0.0
        return self.guesses.delay_s(str(connection.remote_address[0]), connection.loop.time())

    def _hosts(self, connection: ServerConnection) -> frozenset[str]:
        # An address typed by the user cannot be a foreign page's name, so the one connected to is fine.
        address, port = connection.local_address[:2]
        literal = url_host(ipaddress.ip_address(address))
        names = (*_LOOPBACK_NAMES, literal, *(name.lower() for name in self.extra_hosts))
        is_default = port == (443 if self.scheme == "https" else 80)
        return frozenset(f"{name}:{port}" for name in names) | frozenset(names if is_default else ())

    def _knows_token(self, headers: Headers, query: str) -> bool:
        """Tell whether a program brings the token, as ``Authorization: Bearer …`` or as ``?token=…``."""
        kind, _, bearer = headers.get("Authorization", "").partition(" ")
        given = (bearer.strip() if kind.lower() == "bearer" else "", _token_in(query))
        return self.token is None or any(_same(one, self.token) for one in given)

    def _opens(self, connection: GuardedConnection, query: str) -> bool:
        """Tell whether a link's token is the token, or one for a single use, which a GET uses up."""
        given = _token_in(query)
        if given in self._single_use and not connection.head_only:
            self._single_use.remove(given)
            return True
        return self.token is not None and _same(given, self.token)

    def _answer_at_socket(
        self, connection: GuardedConnection, own: SocketDoor, socket_path: str, path: str, is_websocket: bool
    ) -> Response | None:
        if path == socket_path:
            if not is_websocket:
                text = "A websocket is to be opened here.\n"
                return _respond(HTTPStatus.UPGRADE_REQUIRED, text, {"Upgrade": "websocket"})
            connection.socket_path = socket_path
            return None
        if is_websocket or own.schema is None:
            return _respond(HTTPStatus.NOT_FOUND, "There is nothing here.\n")
        return _respond(HTTPStatus.OK, own.schema, {"Content-Type": "application/json"})

    def _refuse(self, request: Request, status: HTTPStatus, reason: str, *advice: str) -> Response:
        self.tally.refuse(reason)
        said = (f"armctl refused this request: {reason}.", *(advice or (_OPEN_THE_LINK,)))
        if "text/html" not in ",".join(request.headers.get_all("Accept")):
            return _respond(status, "\n".join(said) + "\n")
        text = _HTML.format(
            "".join(f"<p>{html.escape(words)}</p>" for words in said[1:]), html.escape(said[0])
        )
        return _respond(status, text, {"Content-Type": "text/html; charset=utf-8"})


_OPEN_THE_LINK = "Open the link that armctl printed when it started."
_ADVICE_ON_TOKEN = (
    "Open the whole link that armctl printed when it started. It ends in ?token=… and stands in the terminal "
    "where armctl runs, in the line that begins with “armctl:”.",
    "The link stays the same from start to start, unless armctl is started with --new-link. If that line "
    "cannot be seen any more, start armctl once more in another terminal, as the same user: it shows the "
    "link of the one that runs.",
)
_BEARER = (
    "A program brings the token as “Authorization: Bearer …” or as ?token=…; armctl prints it at its start."
)
_HTML = (
    '<!doctype html><html lang="en"><head><meta charset="utf-8">'
    '<meta name="viewport" content="width=device-width"><title>armctl</title><style>'
    "body{{font:1.1rem/1.5 system-ui,sans-serif;max-width:36rem;margin:12vh auto;padding:0 1rem}}"
    "small{{color:#555}}</style></head><body><h1>armctl</h1>{}<p><small>{}</small></p></body></html>\n"
)


def _advice_on_host(host: str, port: int) -> tuple[str, ...]:
    name, _, given_port = host.rpartition(":") if re.search(r":\d*$", host) else (host, "", "")
    if not HOST_NAME.fullmatch(name):
        return ()
    if given_port != str(port):
        return (_OPEN_THE_LINK, f"armctl listens on port {port}: the address has to name that port.")
    return (
        _OPEN_THE_LINK,
        f"If this computer is called {name} in your network, end armctl and start it with "
        f"--allow-host {name} as well.",
    )


def _token_in(query: str) -> str:
    return parse_qs(query).get("token", [""])[0] if len(query) <= _MAX_QUERY else ""


def _same(given: str, secret: str) -> bool:
    """Compare in constant time; ``given`` may hold bytes as ``websockets`` decoded them."""
    return hmac.compare_digest(given.encode(errors="surrogateescape"), secret.encode())


def _respond(status: HTTPStatus, text: str | bytes, more: Mapping[str, str] = {}) -> Response:
    body = text.encode() if isinstance(text, str) else text
    fixed = {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))}
    headers = Headers({**fixed, "Connection": "close", **more})
    return Response(status.value, status.phrase, headers, body)
