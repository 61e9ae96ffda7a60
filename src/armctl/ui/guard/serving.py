"""The one place where viser is changed: how it opens its server, and where it prints.

viser 1.1.1 exposes none of the options of ``websockets.asyncio.server.serve`` that the guard needs, but
looks the function up when it starts. While a server is constructed, this module puts another function in
its place, which passes on viser's call with the guard's options added; only documented ones are used.
"""

from __future__ import annotations

import importlib
import logging
import socket
import sys
import threading
import types
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import websockets.asyncio.server
from typing_extensions import override
from websockets.asyncio.server import Server, ServerConnection
from websockets.http11 import Request, Response
from websockets.server import ServerProtocol

from armctl.ui.guard.connection import GuardedConnection
from armctl.ui.guard.door import Door
from armctl.ui.guard.handles import ServerSlot
from armctl.ui.guard.tally import LOG

MAX_FRAME_BYTES = 16 << 20
"""Pictures of the scene are the largest frames; viser itself would take 50 MiB."""

_VISER_SERVER = "viser.infra._infra"
_PARTS_OF_RICH = ("rich", "rich.box", "rich.panel", "rich.style", "rich.table")
_REPLACING = threading.Lock()  # what is replaced belongs to the process, so the lock does too


class _WireLog(logging.Handler):
    """Takes what ``websockets`` reports: broken handshakes are noise, failing handlers are our defects."""

    @override
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
        slot: where connections find the server whose handles they check values against.
        calls: how often viser opened a server this way; 0 means that the guard is not in place.
        failure: why ``websockets`` did not open the server, if so; nothing is served then.
    """

    listener: socket.socket
    door: Door
    slot: ServerSlot
    calls: int = field(default=0, init=False)
    failure: Exception | None = field(default=None, init=False)

    @contextmanager
    def in_place(self) -> Generator[None]:
        """Replace ``serve``, and ``rich.print`` for viser alone, while a ``ViserServer`` is constructed."""
        module = websockets.asyncio.server
        for name in _PARTS_OF_RICH:  # what is imported while ``rich`` is replaced would miss in the real one
            importlib.import_module(name)
        with _REPLACING:
            serve, real_rich = module.serve, sys.modules["rich"]
            quiet_rich = types.ModuleType("rich")
            quiet_rich.__dict__.update(real_rich.__dict__)
            quiet_rich.__dict__["print"] = _to_log
            module.serve = self._replacement(serve)  # pyright: ignore[reportAttributeAccessIssue]
            sys.modules["rich"] = quiet_rich
            try:
                yield
            finally:
                module.serve = serve
                sys.modules["rich"] = real_rich

    def _replacement(self, serve: Callable[..., Any]) -> Callable[..., Any]:
        def guarded(handler: Callable[..., Any], host: Any = None, port: Any = None, **options: Any) -> Any:
            if getattr(handler, "__module__", "") != _VISER_SERVER:
                return serve(handler, host, port, **options)
            self.calls += 1
            try:
                options.update(self._options(options["process_request"]))
                return serve(handler, **options)
            except (
                Exception
            ) as cause:  # raised here, viser's thread would die and its constructor wait for ever
                self.failure = cause
                return _NotServing()

        return guarded

    def _options(self, serve_page: Callable[..., Response | None]) -> dict[str, Any]:
        def process_request(connection: ServerConnection, request: Request) -> Response | None:
            response = self.door.answer(connection, request)
            return serve_page(connection, request) if response is None else response

        def connection(protocol: ServerProtocol, server: Server, **options: Any) -> GuardedConnection:
            return GuardedConnection(protocol, server, slot=self.slot, tally=self.door.tally, **options)

        wire = logging.Logger("armctl.ui.guard.wire")
        wire.addHandler(_WireLog())
        return {
            "sock": self.listener,
            "process_request": process_request,
            "process_response": self.door.finish,
            "create_connection": connection,
            "server_header": None,
            "max_size": MAX_FRAME_BYTES,
            "ping_interval": 2,
            "ping_timeout": 4,
            "close_timeout": 1,
            "logger": wire,
        }


def _to_log(*words: object, **options: object) -> None:
    """Take the place of ``rich.print`` in viser: its banner and notices are not the user's business."""
    del options
    LOG.debug("viser: %s", " ".join(word for word in words if isinstance(word, str)))
