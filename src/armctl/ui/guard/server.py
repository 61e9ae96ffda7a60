"""A viser server that is safe to run next to a robot arm."""

from __future__ import annotations

import asyncio
import http.client
import ipaddress
import logging
import re
import socket
import ssl
import threading
import traceback
import types
from collections.abc import AsyncGenerator, Callable, Generator, Mapping, Sequence
from contextlib import asynccontextmanager, closing, contextmanager
from functools import partial
from http import HTTPStatus
from typing import Any

import rich
import viser
import websockets.asyncio.server
from viser import _assignable_props_api as props_api
from viser import _gui_api as gui_api  # pyright: ignore[reportPrivateUsage]
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from armctl.errors import ServerError
from armctl.ui.guard.connection import GuardedConnection
from armctl.ui.guard.door import HOST_NAME, Door, SocketDoor
from armctl.ui.guard.filter import LOG, MAX_FRAME_BYTES, Tally
from armctl.ui.guard.listening import is_name, listening_socket, names_of, url_host
from armctl.ui.guard.stop_line import STOP_PATH, OverlaidPage, StopLines

_TIMEOUT_S = 3.0
_REFUSALS = {HTTPStatus.FORBIDDEN, HTTPStatus.MISDIRECTED_REQUEST, HTTPStatus.UNAUTHORIZED}
_FOREIGN = "armctl-probe.invalid"


class _WireLog(logging.Handler):
    """Takes what ``websockets`` reports: broken handshakes are noise, failing handlers are our defects."""

    def emit(self, record: logging.LogRecord) -> None:
        if record.getMessage() == "connection handler failed":
            LOG.error("a connection failed", exc_info=record.exc_info)
        else:
            LOG.debug("websocket: %s", record.getMessage())


# The one place where viser is changed: how it opens its server.
#
# viser 1.1.1 exposes none of the options of ``websockets.asyncio.server.serve`` that the guard needs, but
# looks the function up when it starts. While a server is constructed, this module puts another function in
# its place, which passes on viser's call with the guard's options added; only documented ones are used.

_VISER_SERVER = "viser.infra._infra"
_REPLACING = threading.Lock()  # what is replaced belongs to the process, so the lock does too


@contextmanager
def _guarded_serve(
    listener: socket.socket,
    door: Door,
    tls: ssl.SSLContext | None,
    client_of: Callable[[ServerConnection], viser.ClientHandle | None],
    *,
    overlay: bool,
) -> Generator[list[Exception | None]]:
    """Replace ``serve`` for viser alone, so that it listens on ``listener`` behind ``door``.

    ``client_of`` finds the client of a connection, once it has introduced itself. The list that is given
    has one entry for each server that viser opened this way: None, or why it could not be opened.
    """
    module = websockets.asyncio.server
    opened: list[Exception | None] = []
    overlaid = OverlaidPage(overlay=overlay)
    wire = logging.Logger("armctl.ui.guard.wire", logging.INFO)  # else every frame is put into words
    wire.addHandler(_WireLog())

    def guarded(handler: Callable[..., Any], host: Any = None, port: Any = None, **options: Any) -> Any:
        if getattr(handler, "__module__", "") != _VISER_SERVER:
            return serve(handler, host, port, **options)
        serve_page = options["process_request"]

        def own_socket(connection: ServerConnection) -> SocketDoor | None:
            path = connection.socket_path if isinstance(connection, GuardedConnection) else None
            return None if path is None else door.sockets[path]

        async def process_request(connection: ServerConnection, request: Request) -> Response | None:
            response = door.answer(connection, request)
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

        options |= {
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
        opened.append(None)
        try:
            return serve(route, **options)
        except Exception as cause:  # raised here, it would let viser's constructor wait for ever
            opened[-1] = cause
            return _serving_nothing()

    with _REPLACING:
        serve: Callable[..., Any] = module.serve
        module.serve = guarded  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield opened
        finally:
            module.serve = serve


@asynccontextmanager
async def _serving_nothing() -> AsyncGenerator[types.SimpleNamespace]:
    """What viser gets for a server that could not be opened: it serves nothing until it is stopped."""
    yield types.SimpleNamespace(server=types.SimpleNamespace(sockets=()))


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
        "Sec-WebSocket-Protocol": f"viser-v{viser.__version__}",
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


def _share_type_hints() -> None:
    """Let viser look up the types of a control's properties once a kind, instead of once a control.

    That is half of the time in which a page is built, and nothing else runs on the event loop.
    """
    props_api.get_type_hints = gui_api.get_type_hints_cached  # pyright: ignore[reportPrivateImportUsage]


def _let_groups_be_disabled() -> None:
    """Have viser disable groups of buttons, too: it refuses, though its page shows them so."""
    if "disabled" in vars(viser.GuiButtonGroupHandle):
        delattr(viser.GuiButtonGroupHandle, "disabled")  # it is a property like any other then


_VISER_VERSION = "1.1.1"
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

    def __init__(
        self,
        door: Door,
        stop_lines: StopLines,
        listener: socket.socket,
        names: Sequence[str],
        *,
        host: str,
        label: str | None,
    ) -> None:
        self._door, self._tally, self.stop_lines = door, door.tally, stop_lines
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
        live = self._websock_server._live_connections  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
        ids = [number for number, one in tuple(live.items()) if one is connection]
        return self.get_clients().get(ids[0]) if ids else None

    def address_of(self, client_id: int) -> str:
        """The address that a client comes from; empty: it is gone."""
        live = self._websock_server._live_connections  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
        connection = live.get(client_id)
        return "" if connection is None else str(connection.remote_address[0])

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
        label: title of the main panel.
        overlay: with the STOP button over the page; without it where no arm is driven.

    Raises:
        ServerError: the address cannot be had, an option is unsafe, or the guard turns out not to hold.
    """
    if viser.__version__ != _VISER_VERSION:
        raise ServerError(
            f"the guard is made for viser {_VISER_VERSION}, but {viser.__version__} is installed; "
            f"install viser=={_VISER_VERSION}"
        )
    if token is not None and not TOKEN.fullmatch(token):
        raise ServerError("the token must be 16 … 256 letters, digits, '-' or '_'")
    for name in extra_hosts:
        if not HOST_NAME.fullmatch(name):
            raise ServerError(f"{name!r} is no host name; give it without scheme, port and path")
    listener = listening_socket(host, port, beyond_loopback=token is not None)
    extra_hosts = tuple(dict.fromkeys((*((host,) if is_name(host) else ()), *extra_hosts)))
    address, bound_port = listener.getsockname()[:2]
    server: GuardedServer | None = None
    _share_type_hints()
    _let_groups_be_disabled()
    tally, stop_lines = Tally(), StopLines()
    sockets = {STOP_PATH: SocketDoor(stop_lines.handle), **sockets}
    door = Door(extra_hosts, token, tally, "http" if tls is None else "https", sockets)
    rich.get_console().quiet = True  # viser prints a banner and notices, also when it is stopped
    try:
        with _guarded_serve(
            listener,
            door,
            tls,
            lambda one: None if server is None else server.client_of(one),
            overlay=overlay,
        ) as opened:
            names = names_of(listener, host, extra_hosts)
            server = GuardedServer(door, stop_lines, listener, names, host=host, label=label)
        if opened and (failure := opened[0]) is not None:
            raise ServerError(
                f"the web server cannot be opened: {failure}; "
                "is the installed version of websockets one that viser supports?"
            ) from failure
        if len(opened) != 1 or server.get_port() != bound_port:
            raise ServerError(
                "the web server's guard is not effective: viser did not open its server through it; "
                "armctl does not run unguarded"
            )
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


def _on_loop_error(tally: Tally, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """A value of a wrong type fails where viser casts it: that is a refusal. All else is a defect.

    A callback of armctl that fails inside viser is a defect, too.
    """
    error = context.get("exception")
    frames = [] if error is None else [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    modules: list[str] = [frame.f_globals["__name__"] for frame in frames]
    is_ours = any(name.startswith("armctl.") and not name.startswith("armctl.ui.guard") for name in modules)
    if modules and modules[-1].startswith("viser.") and not is_ours:
        tally.refuse("a value that viser cannot take")
        LOG.debug("refused by viser", exc_info=error)
    else:
        loop.default_exception_handler(context)
