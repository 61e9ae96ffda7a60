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
from html import escape

import msgspec
import viser
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode

from armctl.ui.guard.filter import FloodGauge

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
        self._unsent: set[str] = set()
        self._changed = asyncio.Event()
        self._actions: dict[str, Callable[[str], object]] = {}

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
            self._unsent.add(name)
            self._changed.set()

    def on(self, do: str, action: Callable[[str], object]) -> None:
        """Call ``action(key)`` where this is done to something with that key."""
        self._actions[do] = action

    def done(self, do: str, key: str) -> None:
        """Something is done on the page. What nobody knows may be of a part that has gone."""
        if (action := self._actions.get(do)) is not None:
            action(key)

    async def tell(self, send: Callable[[str], Awaitable[None]]) -> None:
        """Send all parts, and from then on what changes, until cancelled."""
        self._unsent = set(self._html)
        while True:
            if self._unsent:
                names, self._unsent = sorted(self._unsent), set()
                parts = {name: self._html[name] for name in names}
                await send(msgspec.json.encode({"parts": parts}).decode())
            self._changed.clear()
            if not self._unsent:
                await self._changed.wait()


class PartLines:
    """All pages' lines for their parts. Event loop only."""

    def __init__(self) -> None:
        self._parts: dict[str, Parts] = {}
        """by the name that the page gave itself"""
        self._lines: dict[str, ServerConnection] = {}
        self._linked = asyncio.Event()

    def link(self, page: str, parts: Parts) -> None:
        """These are the parts of ``page`` from now on; a line that served others comes again."""
        self._parts[page] = parts
        self._linked.set()
        self._linked = asyncio.Event()
        if (line := self._lines.pop(page, None)) is not None:
            line.transport.close()

    def unlink(self, parts: Parts) -> None:
        """Their page is gone."""
        self._parts = {page: one for page, one in self._parts.items() if one is not parts}

    async def handle(self, line: ServerConnection) -> None:
        """Serve a line that the web server has let in, until it ends."""
        gauge = FloodGauge(asyncio.get_running_loop().time)
        with suppress(ConnectionClosed):
            try:
                async with asyncio.timeout(_UNKNOWN_S):
                    page = _said(await line.recv()).page or ""
                    while page not in self._parts:
                        await self._linked.wait()
                parts, self._lines[page] = self._parts[page], line
                telling = asyncio.create_task(parts.tell(line.send))
                try:
                    async for raw in line:
                        said = _said(raw)
                        if not gauge.charge(len(raw), refused=False):
                            await line.close(CloseCode.POLICY_VIOLATION, "too many messages")
                        elif self._parts.get(page) is parts:
                            parts.done(said.do, said.key)
                finally:
                    telling.cancel()
                    if self._lines.get(page) is line:
                        del self._lines[page]
            except TimeoutError:
                await line.close(CloseCode.POLICY_VIOLATION, "no page of this name")
            except msgspec.DecodeError:
                await line.close(CloseCode.INVALID_DATA, "no message of a page")


def _said(raw: str | bytes) -> _Said:
    if len(raw) > _MOST_BYTES:
        raise msgspec.DecodeError("a message that is too long")
    return _DECODER.decode(raw)
