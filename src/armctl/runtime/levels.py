"""Warns of loads, heat and voltages that have passed their levels, and of each once, with its worst value."""

from __future__ import annotations

from armctl.facts import Found, LevelPassed, say
from armctl.facts.quantities import LOAD_S
from armctl.runtime.notices import Notices

SHOWN_S = 5.0
"""how long a level is told of after it was passed last: a value may waver about it"""
_Key = tuple[str, str]


class Levels:
    """Which levels are passed now."""

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._since: dict[_Key, float] = {}
        """when each was passed; loads count once that is a second ago"""
        self._told: dict[_Key, tuple[LevelPassed, float]] = {}
        """with the worst value since then, and when it was seen last"""

    @property
    def passed(self) -> tuple[LevelPassed, ...]:
        """Those that are warned of."""
        return tuple([level for level, _ in self._told.values()])

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
            self._notices.set(name, say(Found(worst, worst.part)), until=now + SHOWN_S)
        if self._told:
            self._told = {key: told for key, told in self._told.items() if now - told[1] <= SHOWN_S}
