"""Clicks and edits: what runs on one, and which answer still counts when it comes from a worker thread."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

Action = Callable[[], Awaitable[object] | None]
On = Callable[[Callable[..., object], Action], None]
"""Runs an action on a handle's event (its ``on_click`` or ``on_update``); a page's session gives it."""


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
