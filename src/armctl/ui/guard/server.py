"""A viser server that is safe to run next to a robot arm."""

from __future__ import annotations

import asyncio
import http.client
import ipaddress
import logging
import re
import socket
import threading
import traceback
import types
from collections.abc import AsyncGenerator, Callable, Generator, Sequence
from contextlib import asynccontextmanager, closing, contextmanager
from functools import partial
from http import HTTPStatus
from typing import Any

import rich
import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from armctl.errors import ServerError
from armctl.ui.guard.door import Door, listening_socket, url_host
from armctl.ui.guard.filter import LOG, MAX_FRAME_BYTES, GuardedConnection, Tally

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
    listener: socket.socket, door: Door, client_of: Callable[[ServerConnection], viser.ClientHandle | None]
) -> Generator[list[Exception | None]]:
    """Replace ``serve`` for viser alone, so that it listens on ``listener`` behind ``door``.

    ``client_of`` finds the client of a connection, once it has introduced itself. The list that is given
    has one entry for each server that viser opened this way: None, or why it could not be opened.
    """
    module = websockets.asyncio.server
    opened: list[Exception | None] = []
    wire = logging.Logger("armctl.ui.guard.wire")
    wire.addHandler(_WireLog())

    def guarded(handler: Callable[..., Any], host: Any = None, port: Any = None, **options: Any) -> Any:
        if getattr(handler, "__module__", "") != _VISER_SERVER:
            return serve(handler, host, port, **options)
        serve_page = options["process_request"]

        def process_request(connection: ServerConnection, request: Request) -> Response | None:
            response = door.answer(connection, request)
            return serve_page(connection, request) if response is None else response

        options |= {
            "sock": listener,
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
            return serve(handler, **options)
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


def _probe(address: str, port: int, *, token_needed: bool) -> None:
    """Knock at the server's own door as those who must not come in.

    Raises:
        ServerError: a stranger was let in (or one without token, if that is needed), or nothing answered.
    """
    ip = ipaddress.ip_address(address)
    if ip.is_unspecified:
        ip = ipaddress.ip_address("127.0.0.1" if ip.version == 4 else "::1")
    here = f"{url_host(ip)}:{port}"
    strangers = {
        "a page of a foreign origin": {"Host": here, "Origin": f"http://{_FOREIGN}"},
        "a page under a foreign name": {"Host": f"{_FOREIGN}:{port}", "Origin": f"http://{_FOREIGN}:{port}"},
        "a websocket without origin": {"Host": here},
    }
    if token_needed:
        strangers["a page without token"] = {"Host": here, "Origin": f"http://{here}"}
    websocket = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Protocol": f"viser-v{viser.__version__}",
    }
    for who, headers in strangers.items():
        try:
            with closing(http.client.HTTPConnection(str(ip), port, timeout=_TIMEOUT_S)) as connection:
                connection.request("GET", "/", headers=websocket | headers)
                status = connection.getresponse().status
        except (OSError, http.client.HTTPException) as cause:
            raise ServerError(f"the web server does not answer on port {port}: {cause}") from cause
        if status not in _REFUSALS:
            raise ServerError(
                f"the web server's guard is not effective: {who} was answered with {status}; "
                f"armctl does not run unguarded, report this with the version of viser ({viser.__version__})"
            )


_VISER_VERSION = "1.1.1"
_TOKEN = re.compile(r"[A-Za-z0-9_-]{16,256}")
_HOST_NAME = re.compile(r"[A-Za-z0-9._-]{1,253}|\[[0-9A-Fa-f:.]+\]")


class GuardedServer(viser.ViserServer):
    """A viser server without public tunnel; ``guarded_server`` makes it, the class alone guards nothing."""

    def __init__(self, tally: Tally, *, host: str, port: int, label: str | None) -> None:
        self._tally = tally
        self._stopped = False
        super().__init__(  # pyright: ignore[reportUnknownMemberType]  # its deprecated options
            host=host, port=port, label=label, verbose=False
        )

    @property
    def refusals(self) -> dict[str, int]:
        """How often the guard refused what since the start."""
        return self._tally.counts

    def client_of(self, connection: ServerConnection) -> viser.ClientHandle | None:
        """The client of a connection; None before it has introduced itself."""
        live = self._websock_server._live_connections  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]
        ids = [number for number, one in tuple(live.items()) if one is connection]
        return self.get_clients().get(ids[0]) if ids else None

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
        if self.refusals:
            LOG.info("refused in all: %s", ", ".join(f"{why}: {n}" for why, n in self.refusals.items()))


def guarded_server(
    host: str = "127.0.0.1",
    port: int = 8080,
    *,
    extra_hosts: Sequence[str] = (),
    token: str | None = None,
    label: str | None = None,
) -> GuardedServer:
    """Start a viser server behind the guard, and try from outside whether the guard holds.

    Args:
        host: address to listen on; one that other computers can reach needs a token.
        port: TCP port; 0 takes any free one.
        extra_hosts: names by which other computers call this one (``arm.lab``), without port. Loopback
            names and the address connected to are always allowed.
        token: secret of at least 16 letters, digits, ``-`` or ``_``, which pages bring as ``/?token=…``
            once; a cookie keeps it.
        label: title of the main panel.

    Raises:
        ServerError: the address cannot be had, an option is unsafe, or the guard turns out not to hold.
    """
    if viser.__version__ != _VISER_VERSION:
        raise ServerError(
            f"the guard is made for viser {_VISER_VERSION}, but {viser.__version__} is installed; "
            f"install viser=={_VISER_VERSION}"
        )
    if token is not None and not _TOKEN.fullmatch(token):
        raise ServerError("the token must be 16 … 256 letters, digits, '-' or '_'")
    for name in extra_hosts:
        if not _HOST_NAME.fullmatch(name):
            raise ServerError(f"{name!r} is no host name; give it without scheme, port and path")
    tally = Tally()
    listener = listening_socket(host, port, beyond_loopback=token is not None)
    address, bound_port = listener.getsockname()[:2]
    server: GuardedServer | None = None
    door = Door(tuple(extra_hosts), token, tally)
    rich.get_console().quiet = True  # viser prints a banner and notices, also when it is stopped
    try:
        with _guarded_serve(
            listener, door, lambda one: None if server is None else server.client_of(one)
        ) as opened:
            server = GuardedServer(tally, host=host, port=bound_port, label=label)
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
        _probe(address, bound_port, token_needed=token is not None)
    except BaseException:
        if server is not None:
            server.stop()
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
