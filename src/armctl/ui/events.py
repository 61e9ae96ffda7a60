"""Clicks and edits: what runs on one, which answer still counts, and what a page is notified of."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from html import escape
from typing import Literal, Protocol

import viser

from armctl.ui.viser_seam import id_of_notification

Action = Callable[[], Awaitable[object] | None]
On = Callable[[Callable[..., object], Action], None]
"""Runs an action on a handle's event (its ``on_click`` or ``on_update``); a page's session gives it."""
Color = Literal["blue", "yellow", "red"]
_MOST_NOTICES = 3
"""at a time: they lie over the scene, and older ones answer older clicks"""
_LETTERS_A_SECOND = 12
_MORE = '<a href="{}" target="_blank" rel="noopener" title="opens the documentation">What to do</a>'


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


def _part(shown: viser.NotificationHandle) -> str:
    return f"notification {id_of_notification(shown)}"


def reading_seconds(text: str, color: Color) -> float:
    """How long a message stays [s]: information may be missed, a refusal has to be read."""
    return max(5.0 if color == "blue" else 10.0, math.ceil(len(text) / _LETTERS_A_SECOND))
