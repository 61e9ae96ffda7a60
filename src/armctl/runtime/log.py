"""The controller's log: bounded, in the snapshot, and passed on to Python's logging."""

from __future__ import annotations

import logging
import math

from armctl.runtime.clock import wall_time
from armctl.runtime.snapshot import Event

_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
_LOGGER = logging.getLogger("armctl.runtime")


class EventLog:
    """The newest lines, oldest first. Only the controller thread writes."""

    def __init__(self, lines: int = 200, repeat_s: float = 5.0) -> None:
        self._lines = lines
        self._repeat_s = repeat_s
        self.events: tuple[Event, ...] = ()

    def info(self, text: str) -> None:
        """Something happened."""
        self._add("info", text)

    def warning(self, text: str) -> None:
        """Something the user should know."""
        self._add("warning", text)

    def error(self, text: str) -> None:
        """Something broke."""
        self._add("error", text)

    def _add(self, level: str, text: str) -> None:
        stamp = wall_time()
        if self.events:
            last = self.events[-1]
            if (last.level, last.text) == (level, text) and 0 <= stamp - last.stamp < self._repeat_s:
                return  # a held key must not flood the log
        self.events = (*self.events, Event(stamp, level, text))[-self._lines :]
        _LOGGER.log(_LEVELS[level], "%s", text)


class Notices:
    """Warnings by name, shown until they are cleared or their time is over."""

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
        """Clear all of them: nothing is known any more."""
        self._texts.clear()

    def current(self, now: float) -> tuple[str, ...]:
        """The texts to show at ``now``, oldest first."""
        for key, (_, until) in tuple(self._texts.items()):
            if until < now:
                del self._texts[key]
        return tuple(text for text, _ in self._texts.values())
