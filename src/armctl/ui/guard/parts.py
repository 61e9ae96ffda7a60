"""Parts of the page that armctl draws itself, on a line of its own beside viser's.

A part stands in viser's page as ``<armctl-part name=…>``, a text that viser never changes. ``parts.js``
fills it with the HTML that comes on the line ``/page``, keeps every node that can be kept, so that the focus
and the place in a list outlive a change, and says what is done there. The script knows no part, the server
all.

A page sends ``{"page": name}`` once, with the name that it gave itself (``overlay.js``), then ``{"do": what,
"key": of which}``. It gets ``{"parts": {name: html}}`` with what has changed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from html import escape

import msgspec
import viser
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode

from armctl.ui.guard.filter import LOG, FloodGauge

PARTS_PATH = "/page"
_MOST_BYTES = 256
_UNKNOWN_S = 60.0
"""how long a line may wait until viser has its page"""


class _Said(msgspec.Struct, forbid_unknown_fields=True):
    """One message of a page."""

    page: str | None = None
    do: str = ""
    key: str = ""


_DECODER = msgspec.json.Decoder(_Said)


class Parts:
    """The parts of one page: what they show, and what is done there. Event loop only."""

    def __init__(self) -> None:
        self._html: dict[str, str] = {}
        self._lines: list[tuple[set[str], asyncio.Event]] = []
        """of each line what is not sent yet, and that there is something"""
        self._actions: dict[str, Callable[[str], Awaitable[object] | None]] = {}

    def __getitem__(self, name: str) -> str:
        """What a part shows."""
        return self._html[name]

    def add(self, gui: viser.GuiApi, name: str) -> viser.GuiHtmlHandle:
        """Put a part into the present container, empty at first."""
        self.show(name, "")
        return gui.add_html(f'<armctl-part name="{escape(name)}"></armctl-part>')

    def show(self, name: str, html: str) -> None:
        """Replace what a part shows. The caller escapes what is not its own."""
        if html != self._html.get(name):
            self._html[name] = html
            for unsent, some in self._lines:
                unsent.add(name)
                some.set()

    def drop(self, name: str) -> None:
        """A part is shown no more; what a page still shows of it is left there."""
        if self._html.pop(name, None) is not None:
            for unsent, _ in self._lines:
                unsent.discard(name)

    def on(self, do: str, action: Callable[[str], Awaitable[object] | None]) -> None:
        """Run ``action(key)`` where this is done to something with that key."""
        self._actions[do] = action

    async def done(self, do: str, key: str) -> None:
        """Something is done on the page. What nobody knows may be of a part that has gone."""
        if (action := self._actions.get(do)) is not None and (work := action(key)) is not None:
            await work

    async def tell(self, send: Callable[[str], Awaitable[None]]) -> None:
        """Send all parts, and from then on what changes, until cancelled."""
        unsent, some = set(self._html), asyncio.Event()
        some.set()
        self._lines.append((unsent, some))
        try:
            while await some.wait():
                some.clear()
                parts = {name: self._html[name] for name in sorted(unsent)}
                unsent.clear()
                await send(msgspec.json.encode({"parts": parts}).decode())
        finally:
            self._lines = [line for line in self._lines if line[1] is not some]


class _Gauge(FloodGauge):
    """A key that is held down does something thirty times a second; nobody does more."""

    CAPACITY, REFILL_PER_S = 200.0, 60.0


class PartLines:
    """All pages' lines for their parts, one a page. Event loop only."""

    def __init__(self) -> None:
        self._parts: dict[str, Parts] = {}
        """by the name that the page gave itself"""
        self._lines: dict[str, ServerConnection] = {}
        self._linked = asyncio.Event()

    def link(self, page: str, parts: Parts) -> None:
        """These are the parts of ``page`` from now on. A line with others ends; the page opens a new one."""
        self._end(page)
        self._parts[page] = parts
        self._linked.set()
        self._linked = asyncio.Event()

    def unlink(self, parts: Parts) -> None:
        """These are the parts of no page any more."""
        for page in [page for page, one in self._parts.items() if one is parts]:
            del self._parts[page]
            self._end(page)

    def _end(self, page: str) -> None:
        if (line := self._lines.pop(page, None)) is not None:
            line.transport.abort()

    async def handle(self, line: ServerConnection) -> None:
        """Serve a line that the web server has let in, until it ends. What is done there waits its turn."""
        gauge = _Gauge(asyncio.get_running_loop().time)
        with suppress(ConnectionClosed):
            try:
                async with asyncio.timeout(_UNKNOWN_S):
                    page = _said(await line.recv()).page or ""
                    while page not in self._parts:
                        await self._linked.wait()
                self._end(page)
                parts, self._lines[page] = self._parts[page], line
                telling = asyncio.create_task(parts.tell(line.send))
                telling.add_done_callback(partial(_told, line))
                try:
                    async for raw in line:
                        said = _said(raw)
                        if not gauge.charge(len(raw), refused=False):
                            await line.close(CloseCode.POLICY_VIOLATION, "too many messages")
                        elif self._lines.get(page) is line:
                            await parts.done(said.do, said.key)
                finally:
                    telling.cancel()
                    if self._lines.get(page) is line:
                        del self._lines[page]
            except TimeoutError:
                await line.close(CloseCode.POLICY_VIOLATION, "no page of this name")
            except (msgspec.DecodeError, UnicodeDecodeError):
                await line.close(CloseCode.INVALID_DATA, "no message of a page")


def _told(line: ServerConnection, telling: asyncio.Task[None]) -> None:
    """A line on which nothing is said any more ends: its page opens another one."""
    error = None if telling.cancelled() else telling.exception()
    if error is not None and not isinstance(error, ConnectionClosed):
        LOG.error("the parts of a page could not be sent", exc_info=error)
    line.transport.abort()


def _said(raw: str | bytes) -> _Said:
    if len(raw) > _MOST_BYTES:
        raise msgspec.DecodeError("a message that is too long")
    return _DECODER.decode(raw)
