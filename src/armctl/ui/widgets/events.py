"""Clicks, edits, and buttons and keys that act while they are held."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

import viser

Action = Callable[[], Awaitable[object] | None]
On = Callable[[Callable[..., object], Action], None]
"""Runs an action on a handle's event (its ``on_click`` or ``on_update``); a page's session gives it."""
HOLD_HZ = 20.0
_NEW_HOLD_S = 0.3


class Hold:
    """Tells the ticks of one hold from those of the next, so that one hold is refused once."""

    def __init__(self, silence_s: float = _NEW_HOLD_S) -> None:
        """What was silent for ``silence_s`` was let go."""
        self._silence_s = silence_s
        self._last_s = -math.inf
        self._refused = False

    def wants(self, now_s: float) -> bool:
        """One tick of what is held at the controller's clock; False when this hold was refused before."""
        if now_s - self._last_s > self._silence_s:
            self._refused = False
        self._last_s = now_s
        return not self._refused

    def refuse(self) -> None:
        """Nothing more of this hold is sent."""
        self._refused = True


def attach_hold(button: viser.GuiButtonHandle, callback: Callable[[Any], Coroutine[Any, Any, None]]) -> None:
    """Call back ``HOLD_HZ`` times a second while the button is held."""
    button.on_hold(callback, HOLD_HZ)  # pyright: ignore[reportUnknownMemberType]
