"""STOP beside viser: what is laid over its page, and a websocket that waits for no page to be built.

Every page opens one at ``/stop`` (``overlay.js``). It sends ``{"page": name}`` once, ``{"stop": n}`` for each
press and ``{"beat": n, "tabs": [label, ...]}`` with the tabs that are open, five times a second from the
thread that runs the page. The answers are ``{"stopped": n}`` and ``{"beat": n}``. A page that falls silent
while it operates has frozen, was closed or has lost its network.

``{"ask": n}`` is answered with ``{"server": id, "known": whether viser has this page}``: where another server
answers than before, or viser has lost the page, the page loads itself anew. So it adds ``"of": id`` to its
name once a server has answered.
"""

from __future__ import annotations

import asyncio
import gzip
import math
import secrets
import socket
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from importlib import resources

import msgspec
from websockets.asyncio.connection import Connection
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.http11 import Response
from websockets.protocol import State
from websockets.server import ServerProtocol

from armctl.ui.guard.filter import LOG, FloodGauge
from armctl.ui.viser_seam import CONSOLE_STYLE, SCRIPT, dressed

STOP_PATH = "/stop"
_CHECK_S = 0.05
_LATE_S = 0.1
_AGAIN_S = 0.5
"""how soon a page that goes on being silent is reported again"""
_FORGOTTEN_S = 10.0
"""a line that says nothing for so long is closed; its page opens another one when it wakes up"""
_THERE_S = 0.6
"""three beats"""
_MOST_PAGES = 1000
_MAX_BYTES = 256
_NO_NAME = "a browser page"
_OUR_ICON = (
    "<link rel=icon href=\"data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'"
    " fill='none' stroke='%231864ab' stroke-width='2.5' stroke-linecap='round'%3E%3Cpath"
    " d='M2 14.5h9M6 14V9l-3-4 6-3 4 4v3'/%3E%3C/svg%3E\">"
)
"""a small arm"""
_STOP_NOTE = "The arm stops and holds, with power (Escape). Software only: it replaces no emergency stop."
_FRAME = (
    "<section id=armctl-top aria-label=Control>"
    f"<button type=button data-armctl-stop aria-hidden=true title='{_STOP_NOTE}'>STOP</button>"
    "<armctl-part name=bar></armctl-part></section>"
    "<section id=armctl-over><div><armctl-part name=where></armctl-part>"
    "<armctl-part name=telemetry></armctl-part></div>"
    "<armctl-part name=alerts role=status></armctl-part><p id=armctl-why role=status></p></section>"
    "<section id=armctl-under aria-label='Next pose'><armctl-part name=next></armctl-part>"
    "<armctl-part name=timeline></armctl-part></section><armctl-part name=menu></armctl-part>"
)
"""what of the console lies around viser's page"""


class _PageMessage(msgspec.Struct, forbid_unknown_fields=True):
    """One message of a page."""

    page: str | None = None
    of: str = ""
    stop: int | None = None
    beat: int | None = None
    tabs: tuple[str, ...] = ()
    ask: int | None = None


_DECODER = msgspec.json.Decoder(_PageMessage)


class Heartbeats:
    """Judges whether the page that operates has been silent for too long."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self._page: str | None = None
        self._heard_s = self._reported_s = self._checked_s = -math.inf

    def watch(self, page: str | None, now_s: float) -> None:
        """From now on this page has to beat; None: no page has to."""
        if page != self._page:
            self._page, self._heard_s, self._reported_s = page, now_s, -math.inf

    def beat(self, page: str, now_s: float) -> None:
        """A page gives a sign of life."""
        if page == self._page:
            self._heard_s, self._reported_s = now_s, -math.inf

    def overdue(self, now_s: float) -> str | None:
        """Check: the page, when it has been silent for longer than the limit; again after a while.

        A check that comes late itself proves nothing: what the page has sent meanwhile is not read yet.
        """
        late = now_s - self._checked_s > _LATE_S
        self._checked_s = now_s
        if late or now_s - self._heard_s <= self._limit_s or now_s - self._reported_s < _AGAIN_S:
            return None
        self._reported_s = now_s
        return self._page


async def stop_door(
    connection: Connection,
    stop: Callable[[str], None],
    beat: Callable[[str, tuple[str, ...]], None],
    introduce: Callable[[str, str], None],
    about: Callable[[str], dict[str, object]],
) -> None:
    """Serve one page's line until it ends; all are called from this loop, with the page's name.

    ``introduce``: a page has said its name, and by which server it was loaded. ``about``: what a page is told
    that asks.
    """
    gauge = FloodGauge(asyncio.get_running_loop().time)
    page = ""
    try:
        await connection.send('{"line":"open"}')  # a page says nothing before: the line may change hands
        while True:
            async with asyncio.timeout(_FORGOTTEN_S):
                raw = await connection.recv()
            said = _DECODER.decode(raw)
            if said.page is not None:
                page = said.page
                introduce(page, said.of)
            if said.stop is not None:
                stop(page)
                await connection.send(msgspec.json.encode({"stopped": said.stop}).decode())
            if said.beat is not None:
                beat(page, said.tabs)
                await connection.send(msgspec.json.encode({"beat": said.beat}).decode())
            if said.ask is not None:
                await connection.send(msgspec.json.encode(about(page)).decode())
            if not gauge.charge(len(raw), refused=False):
                await connection.close(CloseCode.POLICY_VIOLATION, "too many messages")
    except (msgspec.DecodeError, UnicodeDecodeError):
        await connection.close(CloseCode.INVALID_DATA, "no message of a page")
    except (ConnectionClosed, TimeoutError):
        return


class StopLines:
    """All pages' lines, on a thread of their own: they wait for no page that is being built."""

    def __init__(self) -> None:
        self._stop: Callable[[str], None] | None = None
        self._silent: Callable[[str], None] | None = None
        self._heartbeats = Heartbeats(math.inf)
        self._names: dict[str, str] = {}
        """what people call a page, by the name that it gave itself"""
        self._tabs: dict[str, tuple[str, ...]] = {}
        self._heard: dict[str, float] = {}
        """when a page has beaten last, by the name that it gave itself"""
        self._loaded: dict[str, None] = {}
        """the pages that were loaded by this server, as far as they have said so, the newest last"""
        self._server = secrets.token_hex(8)
        """tells this server from the one before it"""
        self._wires: set[socket.socket] = set()
        self._closed = False
        self._lock = threading.Lock()
        ready: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = Future()
        self._thread = threading.Thread(target=asyncio.run, args=(self._watch(ready),), name="armctl-stop")
        self._thread.daemon = True
        self._thread.start()
        self._loop, self._ended = ready.result()

    def attend(
        self, stop: Callable[[str], None], silent: Callable[[str], None], silence_s: float = math.inf
    ) -> None:
        """Call ``stop(who)`` for each press, ``silent(who)`` while the operator's page gives no sign of life.

        Both are called from the lines' own thread and must not block; ``who`` is what people call the page.
        """
        self._stop, self._silent, self._heartbeats = stop, silent, Heartbeats(silence_s)

    def link(self, page: str, who: str) -> None:
        """The line of ``page`` is that of the page which people call ``who``."""
        self.unlink(who)
        self._names[page] = who

    def unlink(self, who: str) -> None:
        """That page is gone."""
        self._names = {page: name for page, name in self._names.items() if name != who}
        self._tabs.pop(who, None)

    def tabs(self, who: str) -> tuple[str, ...]:
        """The labels of the tabs that are open on a page; empty: it has not said so."""
        return self._tabs.get(who, ())

    def who_is(self, page: str) -> str | None:
        """What people call the page which calls itself so; None: viser does not have it, or loses it soon."""
        return self._names.get(page) if page in self._loaded else None

    def page_of(self, who: str | None) -> str | None:
        """What a page calls itself; None: it has not said so, or is gone."""
        return next((page for page, name in self._names.items() if name == who), None)

    def is_there(self, page: str) -> bool:
        """Whether the page which calls itself so beats, on whatever line."""
        return self._loop.time() - self._heard.get(page, -math.inf) < _THERE_S

    def watch(self, who: str | None) -> None:
        """This page operates: it has to give signs of life once it is linked. None: no page does."""
        self._heartbeats.watch(self.page_of(who), self._loop.time())

    async def handle(self, connection: ServerConnection) -> None:
        """Take a line that the web server has let in; returns at once, but for an encrypted one."""
        if self._stop is None:
            return  # nobody could stop anything yet; the page comes again
        if connection.transport.get_extra_info("ssl_object") is not None:
            # its keys stay with this loop
            await stop_door(connection, self._pressed, self._beats, self._introduced, self._about)
            return
        wire = connection.transport.get_extra_info("socket").dup()
        connection.transport.abort()  # lets go of the line without a word: it lives on in ``wire``
        await connection.wait_closed()
        wire.setblocking(False)
        with self._lock:
            if self._closed:
                wire.close()
            else:
                self._wires.add(wire)
                asyncio.run_coroutine_threadsafe(self._serve(wire), self._loop)

    def close(self) -> None:
        """End all lines, and the thread; a second call does nothing."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()
        for wire in self._wires:
            wire.close()

    def _pressed(self, page: str) -> None:
        if self._stop is not None:
            self._stop(self._names.get(page, _NO_NAME))

    def _introduced(self, page: str, server: str) -> None:
        self._loaded.pop(page, None)
        if server in ("", self._server):  # else it loads itself anew at once
            self._loaded[page] = None
        while len(self._loaded) > _MOST_PAGES:
            del self._loaded[next(iter(self._loaded))]

    def _about(self, page: str) -> dict[str, object]:
        return {"server": self._server, "known": page in self._names}

    def _beats(self, page: str, tabs: tuple[str, ...]) -> None:
        now = self._loop.time()
        self._heartbeats.beat(page, now)
        self._heard.pop(page, None)
        self._heard[page] = now
        while now - self._heard[(oldest := next(iter(self._heard)))] > _FORGOTTEN_S:
            del self._heard[oldest]
        if page in self._names:
            self._tabs[self._names[page]] = tabs

    async def _serve(self, wire: socket.socket) -> None:
        protocol = ServerProtocol(state=State.OPEN, max_size=_MAX_BYTES)
        _, connection = await self._loop.connect_accepted_socket(
            lambda: Connection(protocol, ping_interval=None, close_timeout=1), wire
        )
        try:
            await stop_door(connection, self._pressed, self._beats, self._introduced, self._about)
        except Exception:
            LOG.exception("a line for STOP failed")
        finally:
            connection.transport.abort()
            self._wires.discard(wire)

    async def _watch(self, ready: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]]) -> None:
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        ready.set_result((loop, ended))
        while not ended.is_set():
            page = self._heartbeats.overdue(loop.time())
            if page is not None and self._silent is not None:
                self._silent(self._names.get(page, _NO_NAME))
            with suppress(TimeoutError):
                await asyncio.wait_for(ended.wait(), _CHECK_S)


class OverlaidPage:
    """The page of viser with styles and, where an arm is driven, our scripts ahead of its own."""

    def __init__(self, *, overlay: bool = True) -> None:
        here = resources.files("armctl.ui.guard")
        styles, scripts = (
            [here.joinpath(f"{name}.{kind}").read_text() for name in names]
            for kind, names in (
                ("css", ("overlay", "frame", "parts")),
                ("js", ("overlay", "parts", "sticks")),
            )
        )
        style = f"<style>{CONSOLE_STYLE}{''.join(styles)}</style>"
        self._overlay = style + "".join(f"<script>{one}</script>" for one in (SCRIPT, *scripts)) * overlay
        self._frame = _FRAME * overlay
        self._bodies: dict[str, bytes | bytearray] = {}

    def answer(self, response: Response) -> Response:
        """The answer of viser to a request for its page, with the overlay in it."""
        encoding = response.headers["Content-Encoding"]
        if encoding not in self._bodies:
            page = gzip.decompress(response.body) if encoding == "gzip" else response.body
            looks = {"ahead": self._overlay, "behind": self._frame, "title": "armctl", "icon": _OUR_ICON}
            page = dressed(page.decode(), **looks).encode()
            self._bodies[encoding] = gzip.compress(page) if encoding == "gzip" else page
        response.body = self._bodies[encoding]
        del response.headers["Content-Length"]  # setting it adds another one
        response.headers["Content-Length"] = str(len(response.body))
        return response
