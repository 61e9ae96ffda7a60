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
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from http import HTTPStatus
from typing import Any

import rich
import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from armctl.errors import ServerError
from armctl.ui.guard.door import Door, listening_socket
from armctl.ui.guard.filter import LOG, MAX_FRAME_BYTES, GuardedConnection, Tally

# The one place where viser is changed: how it opens its server.
#
# viser 1.1.1 exposes none of the options of ``websockets.asyncio.server.serve`` that the guard needs, but
# looks the function up when it starts. While a server is constructed, this module puts another function in
# its place, which passes on viser's call with the guard's options added; only documented ones are used.

_VISER_SERVER = "viser.infra._infra"
_REPLACING = threading.Lock()  # what is replaced belongs to the process, so the lock does too


class _WireLog(logging.Handler):
    """Takes what ``websockets`` reports: broken handshakes are noise, failing handlers are our defects."""

    def emit(self, record: logging.LogRecord) -> None:
        if record.getMessage() == "connection handler failed":
            LOG.error("a connection failed", exc_info=record.exc_info)
        else:
            LOG.debug("websocket: %s", record.getMessage())


class _NotServing:
    """What viser gets for a server that could not be opened: it serves nothing until it is stopped."""

    async def __aenter__(self) -> types.SimpleNamespace:
        return types.SimpleNamespace(server=types.SimpleNamespace(sockets=()))

    async def __aexit__(self, *of_no_interest: object) -> None:
        return None


@dataclass
class GuardedServing:
    """The guard's way to open viser's server.

    Attributes:
        listener: the socket to listen on, instead of viser's host and port.
        door: the checks on requests.
        client_of: finds the client of a connection, once it has introduced itself.
        calls: how often viser opened a server this way; 0 means that the guard is not in place.
        failure: why ``websockets`` did not open the server, if so; nothing is served then.
    """

    listener: socket.socket
    door: Door
    client_of: Callable[[ServerConnection], viser.ClientHandle | None]
    calls: int = field(default=0, init=False)
    failure: Exception | None = field(default=None, init=False)

    @contextmanager
    def in_place(self) -> Generator[None]:
        """Replace ``serve`` for viser alone, while a ``ViserServer`` is constructed."""
        module = websockets.asyncio.server
        with _REPLACING:
            serve = module.serve
            module.serve = self._replacement(serve)  # pyright: ignore[reportAttributeAccessIssue]
            try:
                yield
            finally:
                module.serve = serve

    def _replacement(self, serve: Callable[..., Any]) -> Callable[..., Any]:
        def guarded(handler: Callable[..., Any], host: Any = None, port: Any = None, **options: Any) -> Any:
            if getattr(handler, "__module__", "") != _VISER_SERVER:
                return serve(handler, host, port, **options)
            self.calls += 1
            try:
                return serve(handler, **{**options, **self._options(options["process_request"])})
            except Exception as cause:  # raised here, it would let viser's constructor wait for ever
                self.failure = cause
                return _NotServing()

        return guarded

    def _options(self, serve_page: Callable[..., Response | None]) -> dict[str, Any]:
        def process_request(connection: ServerConnection, request: Request) -> Response | None:
            response = self.door.answer(connection, request)
            return serve_page(connection, request) if response is None else response

        wire = logging.Logger("armctl.ui.guard.wire")
        wire.addHandler(_WireLog())
        return {
            "sock": self.listener,
            "process_request": process_request,
            "process_response": self.door.finish,
            "create_connection": partial(GuardedConnection, client_of=self.client_of, tally=self.door.tally),
            "server_header": None,
            "max_size": MAX_FRAME_BYTES,
            "ping_interval": 2,
            "ping_timeout": 4,
            "close_timeout": 1,
            "logger": wire,
        }


# Whether the guard holds: knock at the server's own door as those who must not come in.

_TIMEOUT_S = 3.0
_REFUSALS = {HTTPStatus.FORBIDDEN, HTTPStatus.MISDIRECTED_REQUEST, HTTPStatus.UNAUTHORIZED}
_FOREIGN = "armctl-probe.invalid"


def probe(address: str, port: int, *, token_needed: bool) -> None:
    """Try to get in from outside.

    Args:
        address: the address that the server is bound to.
        port: its port.
        token_needed: whether a stranger without token must be refused as well.

    Raises:
        ServerError: somebody was let in, or the server did not answer.
    """
    ip = ipaddress.ip_address(address)
    if ip.is_unspecified:
        ip = ipaddress.ip_address("127.0.0.1" if ip.version == 4 else "::1")
    here = f"[{ip}]:{port}" if ip.version == 6 else f"{ip}:{port}"
    strangers = {
        "a page of a foreign origin": {"Host": here, "Origin": f"http://{_FOREIGN}"},
        "a page under a foreign name": {"Host": f"{_FOREIGN}:{port}", "Origin": f"http://{_FOREIGN}:{port}"},
        "a websocket without origin": {"Host": here},
    }
    if token_needed:
        strangers["a page without token"] = {"Host": here, "Origin": f"http://{here}"}
    for who, headers in strangers.items():
        status = _knock(str(ip), port, headers)
        if status not in _REFUSALS:
            raise ServerError(
                f"the web server's guard is not effective: {who} was answered with {status}; "
                f"armctl does not run unguarded, report this with the version of viser ({viser.__version__})"
            )


def _knock(address: str, port: int, headers: dict[str, str]) -> int:
    connection = http.client.HTTPConnection(address, port, timeout=_TIMEOUT_S)
    try:
        connection.request(
            "GET",
            "/",
            headers={
                "Upgrade": "websocket",
                "Connection": "Upgrade",
                "Sec-WebSocket-Version": "13",
                "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
                "Sec-WebSocket-Protocol": f"viser-v{viser.__version__}",
                **headers,
            },
        )
        return connection.getresponse().status
    except (OSError, http.client.HTTPException) as cause:
        raise ServerError(f"the web server does not answer on port {port}: {cause}") from cause
    finally:
        connection.close()


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
    """Start a viser server behind the guard.

    Args:
        host: address to listen on; one that other computers can reach needs a token.
        port: TCP port; 0 takes any free one.
        extra_hosts: names by which other computers call this one (``arm.lab``), without port. Loopback
            names and the address connected to are always allowed.
        token: secret of at least 16 letters, digits, ``-`` or ``_``, which pages bring as ``/?token=…``
            once; a cookie keeps it.
        label: title of the main panel.

    Returns:
        The running server; it has already been tried from outside.

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
    serving = GuardedServing(
        listener,
        Door(tuple(extra_hosts), token, tally),
        lambda connection: None if server is None else server.client_of(connection),
    )
    rich.get_console().quiet = True  # viser prints a banner and notices, also when it is stopped
    try:
        with serving.in_place():
            server = GuardedServer(tally, host=host, port=bound_port, label=label)
    except BaseException:
        listener.close()
        raise
    try:
        if serving.failure is not None:
            raise ServerError(
                f"the web server cannot be opened: {serving.failure}; "
                "is the installed version of websockets one that viser supports?"
            ) from serving.failure
        if serving.calls != 1 or server.get_port() != bound_port:
            raise ServerError(
                "the web server's guard is not effective: viser did not open its server through it; "
                "armctl does not run unguarded"
            )
        probe(address, bound_port, token_needed=token is not None)
    except BaseException:
        server.stop()
        listener.close()  # nobody else does when viser did not take it
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
