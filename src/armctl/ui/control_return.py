"""Control goes back to the page that had it: after a restart of the server, or once the page answers again.

Never while somebody else operates, and nothing moves by it. A page is recognised by the name that it gives
itself on its line for STOP, and keeps when it is loaded again.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from armctl.documents import write_atomically
from armctl.protocol import Control, Party
from armctl.system import private_folder
from armctl.ui.events import OneAtATime
from armctl.ui.guard.stop_line import StopLines

LOG = logging.getLogger("armctl.ui")
_COMES_S = 5.0
"""for so long after the start control is kept for who had it; a page knocks three times a second"""
_BUILT_S = 60.0
"""for so long, once that page has knocked"""
_LOADED_S = 10.0
"""so long that page may be silent then: it is loaded anew, and a page that is loaded does not knock"""


class Former(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The page that operated last."""

    page: str
    """what it calls itself"""
    name: str = ""
    """what its user has called it; empty: nothing"""

    @property
    def words(self) -> str:
        """How other pages are told of it."""
        return self.name or "the page that had it"


class ControlReturn:
    """Knows to whom control goes back. On the event loop, but for ``fell_silent``."""

    def __init__(self, lines: StopLines, path: Path | None, now: Callable[[], float] | None = None) -> None:
        """``path``: where the present operator is kept for the next start; None: nowhere."""
        self._lines, self._path = lines, path
        self._now = now or (lambda: asyncio.get_running_loop().time())
        self.former = self._kept = _read(path)
        """who operated before this start, as long as control is kept for it; None: nobody"""
        self._began: float | None = None
        self._knocked = -math.inf
        self._silent: set[str] = set()
        self._writing = OneAtATime(self._write)

    def fell_silent(self, who: str) -> None:
        """This page operated, and has lost control because it gave no sign of life."""
        self._silent.add(who)

    def due(self, control: Control, pages: Sequence[str]) -> str | None:
        """Which of the ``pages``, in the order in which they came, gets control now; asked at each frame."""
        operator = control.operator
        if operator is not None:
            if operator.id not in self._silent:
                self._silent.clear()
                self.former = None
                self._note(self._as_kept(operator))
            return None
        if control.locked:
            return None
        if self.former is not None:
            return self._return_to(self.former, pages)
        self._note(None)
        back = next((who for who in pages if who in self._silent and self._answers(who)), None)
        if back is not None:
            self._silent.discard(back)
        return back

    def _return_to(self, former: Former, pages: Sequence[str]) -> str | None:
        began = self._began = self._now() if self._began is None else self._began
        back = self._lines.who_is(former.page)
        if back not in pages:
            back = None
            now = self._now()
            if self._lines.is_there(former.page):
                self._knocked = now
            if now - began < (_BUILT_S if now - self._knocked < _LOADED_S else _COMES_S):
                return None
        self.former = None
        return back if back is not None else next(iter(pages), None)

    def _answers(self, who: str) -> bool:
        page = self._lines.page_of(who)
        return page is not None and self._lines.is_there(page)

    def _as_kept(self, operator: Party) -> Former | None:
        page = self._lines.page_of(operator.id)
        name = "" if operator.name == operator.id else operator.name
        return None if page is None else Former(page, name)

    def _note(self, operator: Former | None) -> None:
        if operator != self._kept:
            self._kept = operator
            if self._path is not None:
                self._task = asyncio.create_task(self._writing.run())

    async def _write(self) -> None:
        if self._path is None:
            return
        try:
            if self._kept is None:
                await asyncio.to_thread(self._path.unlink, missing_ok=True)
            else:
                await asyncio.to_thread(private_folder, self._path.parent)
                content = msgspec.json.encode(self._kept)
                await asyncio.to_thread(write_atomically, self._path, content, private=True)
        except OSError as cause:
            LOG.warning("who operates is not kept for the next start: %s: %s", self._path, cause.strerror)


def _read(path: Path | None) -> Former | None:
    """Who operated when the server before this one ended; None: nobody, or that cannot be read."""
    if path is None:
        return None
    try:
        return msgspec.json.decode(path.read_bytes(), type=Former)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError) as cause:
        LOG.warning("who operated before is not known: %s: %s", path, cause)
        return None
