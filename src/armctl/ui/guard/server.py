"""A viser server that is safe to run next to a robot arm."""

from __future__ import annotations

import asyncio
import http.client
import ipaddress
import logging
import re
import socket
import ssl
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from functools import partial
from http import HTTPStatus
from typing import Any

import viser
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from armctl.errors import ServerError
from armctl.ui.docs import ServedDocs
from armctl.ui.guard.door import HOST_NAME, Door, SocketDoor
from armctl.ui.guard.filter import LOG, MAX_FRAME_BYTES, GuardedConnection, Tally
from armctl.ui.guard.listening import is_name, listening_socket, names_of, url_host
from armctl.ui.guard.parts import PARTS_PATH, PageLoad, PartLines, page_load
from armctl.ui.guard.stop_line import STOP_PATH, OverlaidPage, StopLines
from armctl.ui.viser_seam import (
    SUBPROTOCOL,
    Handler,
    PageServer,
    connections_of,
    failed_in_viser,
    hold_viser,
    opening_through,
)

_TIMEOUT_S = 3.0
_DOCS = ThreadPoolExecutor(1, "armctl docs")
"""renders pages one at a time: whoever moves an arm waits for none"""
_REFUSALS = {HTTPStatus.FORBIDDEN, HTTPStatus.MISDIRECTED_REQUEST, HTTPStatus.UNAUTHORIZED}
_FOREIGN = "armctl-probe.invalid"


class _WireLog(logging.Handler):
    """Takes what ``websockets`` reports: broken handshakes are noise, failing handlers are our defects."""

    def emit(self, record: logging.LogRecord) -> None:
        if record.getMessage() == "connection handler failed":
            LOG.error("a connection failed", exc_info=record.exc_info)
        else:
            LOG.debug("websocket: %s", record.getMessage())


def _arrangement(
    listener: socket.socket,
    door: Door,
    tls: ssl.SSLContext | None,
    client_of: Callable[[ServerConnection], viser.ClientHandle | None],
    *,
    overlay: bool,
) -> Callable[[Handler, PageServer], tuple[Handler, dict[str, Any]]]:
    """How viser's server is to be opened: on ``listener``, behind ``door``.

    ``client_of`` finds the client of a connection, once it has introduced itself.
    """
    overlaid = OverlaidPage(overlay=overlay)
    wire = logging.Logger("armctl.ui.guard.wire", logging.INFO)  # else every frame is put into words
    wire.addHandler(_WireLog())

    def own_socket(connection: ServerConnection) -> SocketDoor | None:
        path = connection.socket_path if isinstance(connection, GuardedConnection) else None
        return None if path is None else door.sockets[path]

    def arrange(handler: Handler, serve_page: PageServer) -> tuple[Handler, dict[str, Any]]:
        async def process_request(connection: ServerConnection, request: Request) -> Response | None:
            response = door.answer(connection, request)
            if response is None and isinstance(connection, GuardedConnection) and connection.docs_path:
                loop = asyncio.get_running_loop()
                return await loop.run_in_executor(_DOCS, door.document, connection.docs_path)
            if response is None:
                own = own_socket(connection)
                if own is None:
                    page = serve_page(connection, request)
                    return None if page is None else overlaid.answer(page)
                if own.hand_over is not None and isinstance(connection, GuardedConnection):
                    connection.hand_over(own.hand_over, request)
                return None
            await asyncio.sleep(door.delay_s(connection, request, response))
            return response

        async def route(connection: ServerConnection) -> None:
            own = own_socket(connection)
            if own is None:
                await handler(connection)
            elif not (isinstance(connection, GuardedConnection) and connection.handed_over):
                await own.handle(connection)

        return route, {
            "sock": listener,
            "ssl": tls,
            "process_request": process_request,
            "process_response": door.finish,
            "create_connection": partial(GuardedConnection, client_of=client_of, tally=door.tally),
            "server_header": None,
            "max_size": MAX_FRAME_BYTES,
            "ping_interval": 2,
            "ping_timeout": 4,
            "close_timeout": 1,
            "logger": wire,
        }

    return arrange


def _probe(address: str, port: int, door: Door) -> None:
    """Knock at each of the server's own doors as those who must not come in.

    Raises:
        ServerError: a stranger was let in (or one without token, if that is needed), or nothing answered.
    """
    ip = ipaddress.ip_address(address)
    if ip.is_unspecified:
        ip = ipaddress.ip_address("127.0.0.1" if ip.version == 4 else "::1")
    here, foreign = f"{url_host(ip)}:{port}", f"{_FOREIGN}:{port}"
    strangers = {
        "a page of a foreign origin": {"Host": here, "Origin": f"{door.scheme}://{_FOREIGN}"},
        "a page under a foreign name": {"Host": foreign, "Origin": f"{door.scheme}://{foreign}"},
        "a websocket without origin": {"Host": here},
    }
    if door.token is not None:
        strangers["a page without token"] = {"Host": here, "Origin": f"{door.scheme}://{here}"}
    websocket = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Protocol": SUBPROTOCOL,
    }
    for path in ("/", *door.sockets):
        for who, headers in strangers.items():
            if (
                "Origin" not in headers
                and path != "/"
                and door.token is None
                and door.sockets[path].for_programs
            ):
                continue  # without token, all programs of this computer are let in
            status = _status(str(ip), port, door.scheme, path, websocket | headers)
            if status not in _REFUSALS:
                raise ServerError(
                    f"the web server's guard is not effective: {who} was answered with {status} at {path}; "
                    f"armctl does not run unguarded, report this with the version of viser "
                    f"({viser.__version__})"
                )


def _status(address: str, port: int, scheme: str, path: str, headers: Mapping[str, str]) -> int:
    """The status of the server's answer to a request of its own."""
    if scheme == "https":
        unverified = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        unverified.check_hostname, unverified.verify_mode = False, ssl.CERT_NONE
        opened = http.client.HTTPSConnection(address, port, timeout=_TIMEOUT_S, context=unverified)
    else:
        opened = http.client.HTTPConnection(address, port, timeout=_TIMEOUT_S)
    try:
        with closing(opened) as connection:
            connection.request("GET", path, headers=headers)
            return connection.getresponse().status
    except (OSError, http.client.HTTPException) as cause:
        raise ServerError(f"the web server does not answer on port {port}: {cause}") from cause


TOKEN = re.compile(r"[A-Za-z0-9_-]{16,256}")
"""what a token may look like"""


class GuardedServer(viser.ViserServer):
    """A viser server without public tunnel; ``guarded_server`` makes it, the class alone guards nothing."""

    links: tuple[str, ...]
    """addresses of the page, each with the token; those that work from other computers first"""
    encrypted: bool
    beyond_loopback: bool
    """whether other computers can reach it"""

    stop_lines: StopLines
    """every page's own line for STOP"""
    part_lines: PartLines
    """and the one for what armctl draws itself"""

    def __init__(
        self,
        door: Door,
        stop_lines: StopLines,
        part_lines: PartLines,
        listener: socket.socket,
        names: Sequence[str],
        *,
        host: str,
        label: str | None,
    ) -> None:
        self._door, self._tally, self.stop_lines, self.part_lines = door, door.tally, stop_lines, part_lines
        address, port = listener.getsockname()[:2]
        self.encrypted = door.scheme == "https"
        self.beyond_loopback = not ipaddress.ip_address(address).is_loopback
        self._pages = [f"{door.scheme}://{name}:{port}" for name in names]
        self.links = tuple(_with_token(page, door.token) for page in self._pages)
        self._stopped = False
        super().__init__(  # pyright: ignore[reportUnknownMemberType]  # its deprecated options
            host=host, port=port, label=label, verbose=False
        )

    @property
    def refusals(self) -> dict[str, int]:
        """How often the guard refused what since the start."""
        return self._tally.counts

    def link_for_one_browser(self) -> str:
        """The first link with a token that works once: others can see what a browser is started with."""
        return _with_token(self._pages[0], self._door.single_use_token())

    def client_of(self, connection: ServerConnection) -> viser.ClientHandle | None:
        """The client of a connection; None before it has introduced itself."""
        ids = [number for number, one in connections_of(self).items() if one is connection]
        return self.get_clients().get(ids[0]) if ids else None

    def address_of(self, client_id: int) -> str:
        """The address that a client comes from; empty: it is gone."""
        connection = connections_of(self).get(client_id)
        return "" if connection is None else str(connection.remote_address[0])

    def introduced(self, client_id: int) -> PageLoad | None:
        """How the page of a client has introduced itself where it opened its line; None: not at all."""
        connection = connections_of(self).get(client_id)
        request = None if connection is None else connection.request
        return None if request is None else page_load(request.path)

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: a public tunnel would let anybody drive the arm."""
        del verbose
        self._tally.refuse("a public tunnel")
        return None

    def stop(self) -> None:
        """Stop serving and wait for the threads; a second call does nothing."""
        if self._stopped:
            return
        self._stopped = True
        with suppress(RuntimeError):  # viser ended it already, as at the end of the program
            self.get_event_loop().call_soon_threadsafe(self.part_lines.close)
        super().stop()
        self.stop_lines.close()
        if self.refusals:
            LOG.info("refused in all: %s", ", ".join(f"{why}: {n}" for why, n in self.refusals.items()))


def _with_token(page: str, token: str | None) -> str:
    return page if token is None else f"{page}/?token={token}"


def guarded_server(
    host: str = "127.0.0.1",
    port: int = 8080,
    *,
    extra_hosts: Sequence[str] = (),
    token: str | None = None,
    tls: ssl.SSLContext | None = None,
    sockets: Mapping[str, SocketDoor] = {},
    docs: ServedDocs | None = None,
    label: str | None = None,
    overlay: bool = True,
) -> GuardedServer:
    """Start a viser server behind the guard, and try from outside whether the guard holds.

    Args:
        host: address to listen on, or a name of this computer; one that others can reach needs a token.
        port: TCP port; 0 takes any free one.
        extra_hosts: names by which other computers call this one (``arm.lab``), without port. Loopback
            names, the address connected to and a name given as ``host`` are always allowed.
        token: secret of at least 16 letters, digits, ``-`` or ``_``, which pages bring as ``/?token=…``
            once; a cookie keeps it.
        tls: encrypts the line (https), see ``encryption``.
        sockets: websockets of armctl's own by path (``/api``), which viser never sees.
        docs: the documentation, served under ``/docs`` to whom the page is served.
        label: title of the main panel.
        overlay: with the STOP button over the page; without it where no arm is driven.

    Raises:
        ServerError: the address cannot be had, an option is unsafe, or the guard turns out not to hold.
    """
    hold_viser()
    _require_usable(token, extra_hosts)
    listener = listening_socket(host, port, beyond_loopback=token is not None)
    extra_hosts = tuple(dict.fromkeys((*((host,) if is_name(host) else ()), *extra_hosts)))
    address, bound_port = listener.getsockname()[:2]
    server: GuardedServer | None = None
    tally, stop_lines, part_lines = Tally(), StopLines(), PartLines()
    sockets = {STOP_PATH: SocketDoor(stop_lines.handle), PARTS_PATH: SocketDoor(part_lines.handle), **sockets}
    door = Door(extra_hosts, token, tally, "http" if tls is None else "https", sockets, docs)
    try:
        arrange = _arrangement(
            listener, door, tls, lambda one: server and server.client_of(one), overlay=overlay
        )
        with opening_through(arrange) as opened:
            names = names_of(listener, host, extra_hosts)
            server = GuardedServer(door, stop_lines, part_lines, listener, names, host=host, label=label)
        _require_guarded(opened, server, bound_port)
        _probe(address, bound_port, door)
    except BaseException:
        if server is not None:
            server.stop()
        stop_lines.close()
        listener.close()  # viser may not have taken it
        raise
    tally.open()
    server.get_event_loop().set_exception_handler(partial(_on_loop_error, tally))
    return server


def _require_usable(token: str | None, hosts: Sequence[str]) -> None:
    if token is not None and not TOKEN.fullmatch(token):
        raise ServerError("the token must be 16 … 256 letters, digits, '-' or '_'")
    for name in hosts:
        if not HOST_NAME.fullmatch(name):
            raise ServerError(f"{name!r} is no host name; give it without scheme, port and path")


def _require_guarded(opened: Sequence[Exception | None], server: GuardedServer, port: int) -> None:
    """``opened``: what ``opening_through`` tells; ``port``: the one that was bound."""
    if opened and (failure := opened[0]) is not None:
        raise ServerError(
            f"the web server cannot be opened: {failure}; "
            "is the installed version of websockets one that viser supports?"
        ) from failure
    if len(opened) != 1 or server.get_port() != port:  # a server that was not opened has no port to tell
        raise ServerError(
            "the web server's guard is not effective: viser did not open its server through it; "
            "armctl does not run unguarded"
        )


def _on_loop_error(tally: Tally, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """A value of a wrong type fails where viser casts it: that is a refusal. All else is a defect.

    A callback of armctl that fails inside viser is a defect, too.
    """
    error = context.get("exception")
    if failed_in_viser(error):
        tally.refuse("a value that viser cannot take")
        LOG.debug("refused by viser", exc_info=error)
    else:
        loop.default_exception_handler(context)
