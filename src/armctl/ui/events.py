"""Clicks and edits: what runs on one, which answer still counts, and what a page is notified of."""

from __future__ import annotations

import asyncio
import math
import threading
from collections.abc import Awaitable, Callable
from functools import partial
from html import escape
from typing import Any, Literal, Protocol, TypeVar

import viser

from armctl.apart import GIVEN_UP
from armctl.errors import ArmctlError
from armctl.facts.commands import Stopped
from armctl.lazy_dataclass import dataclass
from armctl.protocol import Origin, Ticket
from armctl.ui.viser_seam import id_of_notification

Action = Callable[[], Awaitable[object] | None]
On = Callable[[Callable[..., object], Action], None]
"""Runs an action on a handle's event (its ``on_click`` or ``on_update``); a page's session gives it."""
Color = Literal["blue", "yellow", "red"]
_AT_ONCE_S = 0.3
"""what is done by then is not said to be at work"""
_MOST_NOTICES = 3
"""at a time: they lie over the scene, and older ones answer older clicks"""
_LETTERS_A_SECOND = 12
_MORE = '<a href="{}" target="_blank" rel="noopener" title="opens the documentation">What to do</a>'


@dataclass(frozen=True)
class LastStop:
    """The newest STOP that is known."""

    page: Origin | None = None
    """that of a page, which is known at once; None: there was none"""
    count: int = 0
    """how many have come to the arm from anywhere, as its snapshot says a moment later"""
    by: Stopped | None = None
    """whose the newest of these was"""

    def since(self, before: LastStop) -> Stopped | None:
        """Whose STOP came after ``before``; None: nobody's."""
        if self.page is not None and self.page is not before.page:
            return Stopped(self.page.who)
        if self.count <= before.count or self.by is None:
            return None
        # That of a page may have been pressed before, and have come to the arm since.
        known = before.page is not None and before.page.who == self.by.by
        return None if known else self.by


async def came_to_end(ticket: Ticket) -> bool:
    """Wait for a motion; whether it came to its end. The session tells why it did not."""
    try:
        await asyncio.wrap_future(ticket.finished)
    except ArmctlError:
        return False
    return True


class Newest:
    """Tells the newest of several requests from older ones, whose answers are dropped. Event loop only."""

    def __init__(self) -> None:
        self._count = 0

    def begin(self) -> Callable[[], bool]:
        """Begin a request; returns a function that tells whether it is still the newest."""
        self._count += 1
        mine = self._count
        return lambda: mine == self._count

    def drop(self) -> None:
        """No answer is wanted any more until the next request begins."""
        self._count += 1


class OneAtATime:
    """Runs an action once more if it was requested while it ran, however often that was."""

    def __init__(self, action: Callable[[], Awaitable[None]]) -> None:
        self._action = action
        self._running = self._requested = False

    async def run(self) -> None:
        """Run the action, or let the one that runs now do it again when it has ended."""
        self._requested = True
        if self._running:
            return
        self._running = True
        try:
            while self._requested:
                self._requested = False
                await self._action()
        finally:
            self._running = False


class GivenUpError(Exception):
    """The user has cancelled what was being worked out; its text, if any, says what is as before."""


T = TypeVar("T")


class NotificationParts(Protocol):
    """The parts of a page (``guard/parts.py``), of which a notification has one by its id."""

    def show(self, name: str, html: str) -> None:
        """Replace what a part shows."""
        ...

    def drop(self, name: str) -> None:
        """A part is shown no more."""
        ...


class Notifications:
    """One page's newest few notifications; the same again replaces the first, one too many the oldest."""

    def __init__(self, client: viser.ClientHandle, parts: NotificationParts) -> None:
        self._client, self._parts = client, parts
        self._shown: dict[tuple[str, str, Color], viser.NotificationHandle] = {}

    def show(self, title: str, text: str, color: Color, more: str = "") -> None:
        """Show a message; with a link to ``more``, an address in the documentation, if that is given."""
        key = (title, text, color)
        if (same := self._shown.pop(key, None)) is not None:
            self._remove(same)
        while len(self._shown) >= _MOST_NOTICES:
            self._remove(self._shown.pop(next(iter(self._shown))))
        self._shown[key] = shown = self._client.add_notification(
            title, text, auto_close_seconds=reading_seconds(text, color), color=color
        )
        if more:
            self._parts.show(_part(shown), _MORE.format(escape(more)))

    def _remove(self, shown: viser.NotificationHandle) -> None:
        self._parts.drop(_part(shown))
        shown.remove()


class AtWork:
    """Something that was pressed, shown from a moment on until it is done, or until the arm acts on it.

    What it has worked out beside the event loop (``work_out``) can be cancelled there.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        parts: NotificationParts,
        label: str,
        key: str,
        last_stop: LastStop | None = None,
    ) -> None:
        """``key``: what the button *Cancel* says it is of. ``last_stop``: as in ``Console``, when pressed."""
        self._client, self._parts, self._label = client, parts, label
        self.last_stop = LastStop() if last_stop is None else last_stop
        self._cancel = f"<button type=button data-do=cancel-work data-key={key}>Cancel</button>"
        self._shown: viser.NotificationHandle | None = None
        self._given_up: asyncio.Future[None] | None = None
        self._timer = asyncio.get_running_loop().call_later(_AT_ONCE_S, self._show)

    def _show(self) -> None:
        self._shown = self._client.add_notification(
            self._label, "Working …", loading=True, with_close_button=False
        )
        self._offer()

    def _offer(self) -> None:
        if self._shown is not None:
            self._parts.show(_part(self._shown), "" if self._given_up is None else self._cancel)

    def end(self) -> None:
        """It is done, or the arm shows it from here on."""
        self._timer.cancel()
        if self._shown is not None:
            self._parts.drop(_part(self._shown))
            self._shown.remove()
            self._shown = None

    def give_up(self) -> None:
        """Nobody waits for it any more."""
        if self._given_up is not None and not self._given_up.done():
            self._given_up.set_result(None)

    async def work_out(
        self, work: Callable[..., T], *given: object, undo: Callable[[T], object] | None = None
    ) -> T:
        """As ``asyncio.to_thread``, for what can be left: ``GivenUpError`` where the user cancels it.

        A process that ``apart`` has begun for it ends then; a thread goes on where it does not ask
        ``is_given_up``, and nobody hears of it. What it makes all the same is given to ``undo``, on a thread.
        """
        given_up = threading.Event()
        token = GIVEN_UP.set(given_up)
        try:
            thread = asyncio.ensure_future(asyncio.to_thread(work, *given))
        finally:
            GIVEN_UP.reset(token)
        self._given_up = asyncio.get_running_loop().create_future()
        self._offer()
        heard = False
        try:
            await asyncio.wait({thread, self._given_up}, return_when=asyncio.FIRST_COMPLETED)
            if not thread.done():
                raise GivenUpError
            heard = True
            return thread.result()
        finally:
            given_up.set()
            if not heard:
                thread.add_done_callback(partial(_unheard, undo))
            self._given_up = None
            self._offer()


def _unheard(undo: Callable[[Any], object] | None, thread: asyncio.Future[Any]) -> None:
    if thread.cancelled() or thread.exception() is not None:  # asked for, so that it is not reported as lost
        return
    if undo is not None:
        asyncio.get_running_loop().run_in_executor(None, undo, thread.result())


def _part(shown: viser.NotificationHandle) -> str:
    return f"notification {id_of_notification(shown)}"


def reading_seconds(text: str, color: Color) -> float:
    """How long a message stays [s]: information may be missed, a refusal has to be read."""
    return max(5.0 if color == "blue" else 10.0, math.ceil(len(text) / _LETTERS_A_SECOND))
