"""How viser opens its web server, whom that has connected, and what viser does to its process."""

from __future__ import annotations

import threading
import traceback
import types
from collections.abc import AsyncGenerator, Awaitable, Callable, Generator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

import rich
import viser
import websockets.asyncio.server
from viser import _assignable_props_api as props_api
from viser import _gui_api as gui_api  # pyright: ignore[reportPrivateUsage]
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from armctl.errors import ServerError

VERSION = "1.1.1"
"""the one whose insides are held here"""
SUBPROTOCOL = f"viser-v{viser.__version__}"
"""what viser's page asks for when it opens its websocket (``infra/_infra.py``)"""
_OPENER = "viser.infra._infra"
"""the module that calls ``serve``, by which its call is told from those of others"""
_REPLACING = threading.Lock()  # what is replaced belongs to the process, so the lock does too

Handler = Callable[[ServerConnection], Awaitable[None]]
PageServer = Callable[[ServerConnection, Request], Response | None]


def require_version() -> None:
    """Refuse (``ServerError``) another viser than the one whose insides are held here."""
    if viser.__version__ != VERSION:
        raise ServerError(
            f"the guard is made for viser {VERSION}, but {viser.__version__} is installed; "
            f"install viser=={VERSION}"
        )


@contextmanager
def opening_through(
    arrange: Callable[[Handler, PageServer], tuple[Handler, dict[str, Any]]],
) -> Generator[list[Exception | None]]:
    """Have a server that viser opens meanwhile handle connections, and be opened, as ``arrange`` says.

    ``arrange`` gets what viser handles connections and serves its page with, and gives what handles them
    instead, with more options of ``websockets.asyncio.server.serve``. The list that is given has one entry
    for each server that viser opened this way: None, or why it could not be opened.

    Holds: ``viser.infra._infra`` looks ``serve`` up when a server starts, calls it as ``serve(handler, host,
    port, process_request=…)``, and waits for ever in its constructor where that raises.
    """
    module = websockets.asyncio.server
    opened: list[Exception | None] = []

    def arranged(handler: Handler, host: Any = None, port: Any = None, **options: Any) -> Any:
        if getattr(handler, "__module__", "") != _OPENER:
            return serve(handler, host, port, **options)
        opened.append(None)
        try:
            route, more = arrange(handler, options["process_request"])
            return serve(route, **options | more)
        except Exception as cause:
            opened[-1] = cause
            return _serving_nothing()

    with _REPLACING:
        serve: Callable[..., Any] = module.serve
        module.serve = arranged  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield opened
        finally:
            module.serve = serve


@asynccontextmanager
async def _serving_nothing() -> AsyncGenerator[types.SimpleNamespace]:
    """What viser gets for a server that could not be opened: it serves nothing until it is stopped.

    Holds: of what ``serve`` gives, viser asks for ``server.sockets`` alone.
    """
    yield types.SimpleNamespace(server=types.SimpleNamespace(sockets=()))


def connections_of(server: viser.ViserServer) -> dict[int, ServerConnection]:
    """The open connections by client id; one is there before its page has introduced itself.

    Holds: ``ViserServer._websock_server._live_connections``.
    """
    return dict(server._websock_server._live_connections)  # noqa: SLF001  # pyright: ignore[reportPrivateUsage]


def keep_quiet() -> None:
    """Have viser print neither its banner nor its notices.

    Holds: it prints through the console of ``rich`` that the whole process shares.
    """
    rich.get_console().quiet = True


def share_type_hints() -> None:
    """Have the types of a control's properties looked up once a kind, instead of once a control.

    That is half of the time in which a page is built, and nothing else runs on the event loop.

    Holds: ``_assignable_props_api.get_type_hints`` and ``_gui_api.get_type_hints_cached``.
    """
    props_api.get_type_hints = gui_api.get_type_hints_cached  # pyright: ignore[reportPrivateImportUsage]


def let_groups_be_disabled() -> None:
    """Let groups of buttons be disabled: viser refuses, though its page shows them so.

    Holds: ``GuiButtonGroupHandle.disabled``, a property that refuses and hides one like any other.
    """
    if "disabled" in vars(viser.GuiButtonGroupHandle):
        delattr(viser.GuiButtonGroupHandle, "disabled")


def failed_in_viser(error: BaseException | None) -> bool:
    """Tell whether it was viser that failed at what a page sent, not a callback that it has called.

    Holds: viser casts a value to the type of the present one in a task of its own, which fails there
    (``_gui_api._handle_gui_updates``).
    """
    frames = [] if error is None else [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    modules: list[str] = [frame.f_globals["__name__"] for frame in frames]
    below = ("armctl.ui.guard", "armctl.ui.viser_seam")
    is_ours = any(name.startswith("armctl.") and not name.startswith(below) for name in modules)
    return bool(modules) and modules[-1].startswith("viser.") and not is_ours
