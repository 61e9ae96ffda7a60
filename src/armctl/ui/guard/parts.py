"""Parts of the page that armctl draws itself, on a line of its own beside viser's.

A part stands in viser's page as ``<armctl-part name=…>``, a text that viser never changes. ``parts.js``
fills it with the HTML that comes on the line ``/page``, keeps every node that can be kept, so that the focus
and the place in a list outlive a change, and says what is done there. The script knows no part, the server
all.

A long list is a part's element ``data-rows=name``. Its rows travel by key: one that changes is sent alone.

A page sends ``{"page": name, "load": which}`` once, with the name that it gave itself (``overlay.js``) and
one for each time that it is loaded, then ``{"do": what, "key": of which, "value": as typed}``; ``drawn`` once
it shows the first of them. It gets
``{"parts": {name: html}, "rows": {name: {"order": keys, "html": {key: html}}}, "done": number}`` with what
has changed, and how much of what was done is in it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable
from contextlib import suppress
from dataclasses import field
from functools import partial
from html import escape
from typing import Annotated, NamedTuple
from urllib.parse import parse_qs

import msgspec
import viser
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode

from armctl.lazy_dataclass import dataclass
from armctl.ui.guard.filter import LOG, FloodGauge

PARTS_PATH = "/page"
_MOST_BYTES = 16 << 10
MOST_TYPED = 2000
"""characters of a value, each of which may take several bytes"""
_LONGEST_NAME = 128
_Name = Annotated[str, msgspec.Meta(max_length=_LONGEST_NAME)]
_UNKNOWN_S = 60.0
"""how long a line may wait until viser has its page"""


class PageLoad(NamedTuple):
    """What a page calls itself, and which of the times that it was loaded this is."""

    page: str
    load: str


def page_load(path: str) -> PageLoad | None:
    """What the path of viser's line says of its page (``nameLine`` in ``viser_seam.js``); None: nothing."""
    query = path.partition("?")[2]
    if len(query) > 4 * _LONGEST_NAME:
        return None
    said = parse_qs(query)
    names = [said.get(name, [""])[0] for name in PageLoad._fields]
    return PageLoad(*names) if all(0 < len(name) <= _LONGEST_NAME for name in names) else None


class _Said(msgspec.Struct, forbid_unknown_fields=True):
    """One message of a page."""

    page: _Name | None = None
    load: _Name = ""
    do: _Name = ""
    key: _Name = ""
    value: Annotated[str, msgspec.Meta(max_length=MOST_TYPED)] = ""


_DECODER = msgspec.json.Decoder(_Said)


@dataclass
class _Unsent:
    """What one line of a page has not been sent yet."""

    parts: set[str]
    orders: set[str]
    """lists whose rows are others, or in another order"""
    rows: dict[str, set[str]]
    """by list, the keys of its rows that have changed"""
    some: asyncio.Event = field(default_factory=asyncio.Event)
    """there is something"""


class Parts:
    """The parts of one page: what they show, and what is done there. Event loop only."""

    def __init__(self) -> None:
        self._html: dict[str, str] = {}
        self._rows: dict[str, dict[str, str]] = {}
        """by list: the HTML of its rows by key, in order"""
        self._lines: list[_Unsent] = []
        self._actions: dict[str, Callable[[str], Awaitable[object] | None]] = {}
        self._values: dict[str, Callable[[str, str], Awaitable[object] | None]] = {}
        self._drawn = asyncio.Event()
        self.on("drawn", lambda _: self._drawn.set())

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
            for line in self._lines:
                line.parts.add(name)
                line.some.set()

    def rows(self, name: str, rows: Iterable[tuple[str, str]]) -> None:
        """Make these (key, HTML) the rows of a list; those that are as before are not sent.

        Each is one element with its key as ``data-key``. The caller escapes what is not its own.
        """
        before, now = self._rows.get(name, {}), dict(rows)
        self._rows[name] = now
        changed = {key for key, html in now.items() if before.get(key) != html}
        moved = len(now) != len(before) or any(a != b for a, b in zip(now, before, strict=True))
        if changed or moved:
            for line in self._lines:
                line.rows.setdefault(name, set()).update(changed)
                line.orders.update([name] * moved)
                line.some.set()

    def row(self, name: str, key: str, html: str) -> None:
        """Change one row of a list."""
        if html != self._rows[name][key]:
            self._rows[name][key] = html
            for line in self._lines:
                line.rows.setdefault(name, set()).add(key)
                line.some.set()

    def shown_rows(self, name: str) -> dict[str, str]:
        """The HTML of a list's rows by key, in order."""
        return dict(self._rows.get(name, {}))

    def drop(self, name: str) -> None:
        """A part is shown no more; what a page still shows of it is left there."""
        if self._html.pop(name, None) is not None:
            for line in self._lines:
                line.parts.discard(name)

    def on(self, do: str, action: Callable[[str], Awaitable[object] | None]) -> None:
        """Run ``action(key)`` where this is done to something with that key."""
        self._actions[do] = action

    def on_value(self, do: str, action: Callable[[str, str], Awaitable[object] | None]) -> None:
        """Run ``action(key, value)`` where something with that key is given a value: what is typed."""
        self._values[do] = action

    async def drawn(self) -> None:
        """Wait until the page shows the first of them."""
        await self._drawn.wait()

    async def done(self, do: str, key: str, value: str = "") -> None:
        """Something is done on the page. What nobody knows may be of a part that has gone."""
        if do in self._values:
            work = self._values[do](key, value)
        else:
            work = self._actions[do](key) if do in self._actions else None
        if work is not None:
            await work

    async def tell(self, send: Callable[[str], Awaitable[None]], done: Callable[[], int] = int) -> None:
        """Send all parts, and from then on what changes, until cancelled.

        ``done``: how much was done on that line since it was last asked.
        """
        rows = {name: set(rows) for name, rows in self._rows.items()}
        line = _Unsent(set(self._html), set(rows), rows)
        line.some.set()
        self._lines.append(line)
        try:
            while await line.some.wait():
                await send(self._take(line, done()))
        finally:
            self._lines = [one for one in self._lines if one is not line]

    def _take(self, line: _Unsent, done: int) -> str:
        """The message that tells a line all that is unsent."""
        parts = {name: self._html[name] for name in sorted(line.parts)}
        said: dict[str, object] = {"parts": parts, "done": done}
        lists: dict[str, dict[str, object]] = {}
        for name, changed in line.rows.items():
            rows = self._rows[name]
            lists[name] = {"html": {key: rows[key] for key in changed if key in rows}}
            if name in line.orders:
                lists[name]["order"] = list(rows)
        if lists:
            said["rows"] = lists
        line.some.clear()
        for unsent in (line.parts, line.orders, line.rows):
            unsent.clear()
        return msgspec.json.encode(said).decode()


class _Gauge(FloodGauge):
    """A key that is held down does something thirty times a second; nobody does more."""

    CAPACITY, REFILL_PER_S = 200.0, 60.0


class _Count:
    """Of what was done on a line since that was last told."""

    number = 0

    def take(self) -> int:
        number, self.number = self.number, 0
        return number


class PartLines:
    """All pages' lines for their parts, one a page. Event loop only."""

    def __init__(self) -> None:
        self._parts: dict[str, Parts] = {}
        """by the name that the page gave itself"""
        self._lines: dict[str, ServerConnection] = {}
        self._loads: dict[str, str] = {}
        """by page, which time of its being loaded its parts are of"""
        self._changed = asyncio.Event()
        """set once, when a page has its parts or a line that waits has ended"""
        self._serving: set[asyncio.Task[None]] = set()

    def link(self, page: str, load: str, parts: Parts) -> None:
        """These are the parts of ``page`` from now on, as it was loaded this time.

        A line with others ends; the page opens a new one.
        """
        if self._parts.get(page) is parts and self._loads[page] == load:
            return
        self._end(page)
        self._parts[page], self._loads[page] = parts, load
        self._wake()

    def unlink(self, parts: Parts) -> None:
        """These are the parts of no page any more."""
        for page in [page for page, one in self._parts.items() if one is parts]:
            del self._parts[page], self._loads[page]
            self._end(page)

    def _end(self, page: str) -> None:
        if (line := self._lines.pop(page, None)) is not None:
            line.transport.abort()

    async def _wait_for(self, line: ServerConnection, page: str, load: str) -> None:
        """Wait until a page has its parts; raises ``ConnectionClosed`` where its line ends before."""
        closed = asyncio.create_task(line.wait_closed())
        closed.add_done_callback(lambda _: self._wake())
        try:
            while self._loads.get(page) != load:
                await self._changed.wait()
                if closed.done():
                    raise line.protocol.close_exc
        finally:
            closed.cancel()

    def _wake(self) -> None:
        """Let all lines that wait look again."""
        self._changed.set()
        self._changed = asyncio.Event()

    def close(self) -> None:
        """The server ends: nobody waits for what is still being done."""
        for serving in self._serving:
            serving.cancel()

    async def handle(self, line: ServerConnection) -> None:
        """Serve a line that the web server has let in, until it ends, or all do. What is done waits its turn.

        A page that is loaded anew keeps its name. On a busy computer its line may be here before anybody
        knows that the page before it has gone, and that one's line after its parts have come: each gets its
        own parts only, as what is pressed ends with them.
        """
        serving = asyncio.create_task(self._serve(line))
        self._serving.add(serving)
        try:
            await asyncio.wait({serving})
        finally:
            serving.cancel()
            self._serving.discard(serving)
        if not serving.cancelled():
            serving.result()

    async def _serve(self, line: ServerConnection) -> None:
        gauge = _Gauge(asyncio.get_running_loop().time)
        with suppress(ConnectionClosed):
            try:
                async with asyncio.timeout(_UNKNOWN_S):
                    begun = _said(await line.recv())
                    page = begun.page or ""
                    await self._wait_for(line, page, begun.load)
                self._end(page)
                parts, self._lines[page] = self._parts[page], line
                answered = _Count()
                telling = asyncio.create_task(parts.tell(line.send, answered.take))
                telling.add_done_callback(partial(_told, line))
                try:
                    async for raw in line:
                        said = _said(raw)
                        if not gauge.charge(len(raw), refused=False):
                            await line.close(CloseCode.POLICY_VIOLATION, "too many messages")
                        elif self._lines.get(page) is line:
                            await parts.done(said.do, said.key, said.value)
                            answered.number += 1
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
