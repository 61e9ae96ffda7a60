"""The log of an arm, and its warnings."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable

from armctl.facts import Found, LevelPassed, say
from armctl.facts.quantities import LOAD_S
from armctl.protocol import Event, Message, wall_time
from armctl.protocol.snapshot import printable

_LOGGER = logging.getLogger("armctl.runtime")
_LOG_LINES = 200
_LONGEST_LINE = 2000
_REPEAT_S = 5.0
"""a line of the log is not repeated sooner: a held key must not flood it"""
_LEVEL_SHOWN_S = 5.0
"""how long a level is told of after it was passed last: a value may waver about it"""


class EventLog:
    """The newest lines, oldest first, passed on to Python's logging. Only the controller thread writes."""

    def __init__(self) -> None:
        self.events: tuple[Event, ...] = ()

    def add(self, text: str, level: str = "info", about: str = "") -> None:
        """Add a line; ``level`` is info, warning (the user should know) or error (something broke).

        ``about``: as in ``Event``.

        What a client has said may be in it: it is cut, and shows no control characters.
        """
        stamp, text = wall_time(), printable(text[:_LONGEST_LINE])
        if self.events:
            last = self.events[-1]
            if (last.level, last.text) == (level, text) and 0 <= stamp - last.stamp < _REPEAT_S:
                return
        self.events = (*self.events, Event(stamp, level, text, about))[-_LOG_LINES:]
        _LOGGER.log(getattr(logging, level.upper()), "%s", text)

    def said(self, text: str, seconds: float) -> bool:
        """Whether a line was added within the last ``seconds``."""
        now = wall_time()
        return any(event.text == text and 0 <= now - event.stamp < seconds for event in self.events[-10:])

    def warn(self, text: str, about: str = "") -> None:
        """Add a line that the user should know of."""
        self.add(text, "warning", about)


class MessageBoard:
    """What programs have told the person last."""

    def __init__(self, log: EventLog) -> None:
        self._log = log
        self._number, self._text = 0, ""

    def tell(self, text: str) -> int:
        """Show a text, and keep it in the log; its number."""
        self._number, self._text = self._number + 1, printable(text)
        self._log.add(f"message: {text}")
        return self._number

    def shown(self, awaited: int | None) -> Message | None:
        """The last one; ``awaited``: number of that which the arm waits with."""
        if not self._number:
            return None
        return Message(self._text, self._number, self._number == awaited)


class Notices:
    """Warnings by name, shown until they are cleared or their time is over; among them what is waited for."""

    def __init__(self, log: EventLog) -> None:
        self._log = log
        self._texts: dict[str, tuple[str, float]] = {}
        self._told = frozenset[str]()
        self._awaited = frozenset[str]()
        """names of those that only say what is waited for"""

    def set(
        self, key: str, text: str, until: float = math.inf, *, awaited: bool = False, about: str = ""
    ) -> None:
        """Show ``text`` until the clock says ``until``; a new one is logged once.

        ``awaited``: it only says what is waited for, as it was asked to; nothing is wrong. ``about``: as in
        ``Event``.
        """
        if key not in self._texts or awaited is not (key in self._awaited):
            self._log.add(text, "info" if awaited else "warning", about)
        self._awaited = self._awaited | {key} if awaited else self._awaited - {key}
        self._texts[key] = (text, until)

    def clear(self, key: str) -> None:
        """It is no longer true."""
        self._texts.pop(key, None)

    def clear_from(self, start: str) -> None:
        """Clear all whose names begin so."""
        self._texts = {key: shown for key, shown in self._texts.items() if not key.startswith(start)}

    def clear_all(self) -> None:
        """Clear all of them: nothing is known any more."""
        self._texts.clear()

    def told_by_cause(self, keys: Iterable[str]) -> None:
        """The cause of the present state tells these, and no others, for as long as they are shown."""
        self._told = frozenset(keys)

    def current(self, now: float) -> tuple[tuple[str, ...], tuple[int, ...], tuple[int, ...]]:
        """The texts to show at ``now``, oldest first.

        Then the indices of those that the cause tells, too, and of those that only say what is waited for.
        """
        self._texts = {key: shown for key, shown in self._texts.items() if shown[1] >= now}
        self._told &= self._texts.keys()  # one that comes again is news
        texts = tuple([text for text, _ in self._texts.values()])
        return texts, self._places(self._told), self._places(self._awaited)

    def _places(self, keys: frozenset[str]) -> tuple[int, ...]:
        return tuple([k for k, key in enumerate(self._texts) if key in keys]) if keys else ()


class Levels:
    """Warns of loads, heat and voltages that have passed their levels, and of each once, with its worst."""

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._since: dict[tuple[str, str], float] = {}
        """when each was passed; loads count once that is a second ago"""
        self._told: dict[tuple[str, str], tuple[LevelPassed, float]] = {}
        """with the worst value since then, and when it was seen last"""
        self.passed: tuple[LevelPassed, ...] = ()
        """those that are warned of"""

    def take(self, seen: tuple[LevelPassed, ...], now: float) -> None:
        """What is beyond its level at a reading."""
        found = {(level.part, level.quantity): level for level in seen}
        self._since = {key: self._since.get(key, now) for key in found}
        for key, level in found.items():
            if level.quantity == "load" and now - self._since[key] < LOAD_S:
                continue
            told = self._told.get(key)
            worst = level if told is None or level.is_worse_than(told[0]) else told[0]
            self._told[key] = worst, now
            name = f"{worst.quantity} of {worst.part}"
            self._notices.set(name, say(Found(worst, worst.part)), until=now + _LEVEL_SHOWN_S)
        self._told = {key: told for key, told in self._told.items() if now - told[1] <= _LEVEL_SHOWN_S}
        self.passed = tuple([level for level, _ in self._told.values()])
