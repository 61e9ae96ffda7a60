"""What is true now and the user should know."""

from __future__ import annotations

import math

from armctl.runtime.log import EventLog


class Notices:
    """Named warnings that stay until they are cleared or their time is over."""

    def __init__(self, log: EventLog) -> None:
        self._log = log
        self._texts: dict[str, tuple[str, float]] = {}

    def set(self, key: str, text: str, until: float = math.inf) -> None:
        """Show ``text`` until the clock says ``until``; a new one is logged once."""
        if key not in self._texts:
            self._log.warning(text)
        self._texts[key] = (text, until)

    def clear(self, key: str) -> None:
        """It is no longer true."""
        self._texts.pop(key, None)

    def clear_all(self) -> None:
        """Nothing is known any more."""
        self._texts.clear()

    def current(self, now: float) -> tuple[str, ...]:
        """The texts to show at ``now``, oldest first."""
        for key in [key for key, (_, until) in self._texts.items() if until < now]:
            del self._texts[key]
        return tuple(text for text, _ in self._texts.values())
