"""Clicks and edits."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

Action = Callable[[], Awaitable[object] | None]
On = Callable[[Callable[..., object], Action], None]
"""Runs an action on a handle's event (its ``on_click`` or ``on_update``); a page's session gives it."""
