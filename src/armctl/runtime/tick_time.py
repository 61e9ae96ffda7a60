"""How much time each tick counts for, and what is told of ticks that came late."""

from __future__ import annotations

import math
from dataclasses import dataclass

from armctl.runtime.log import EventLog, Notices

LONGEST_TICKS = 2
"""A tick counts for no more periods: time that was missed is not made up for, or the arm would jump."""
_LATE_S = 0.06
_KEY = "late"
_SHOWN_S = 5.0
"""how long a late tick is told, and how long a computer must be in time before the next one is news"""


@dataclass(frozen=True, slots=True)
class Tick:
    """One tick of the controller."""

    dt: float
    """what it counts for [s]"""
    late_s: float | None
    """how much later it came than it should; None: in time"""


class TickTime:
    """Measures from tick to tick.

    Late ticks that follow each other are one notice, which counts them, a line of the log when the notice
    begins, and one with the count when they are over.

    Args:
        period: from tick to tick [s].
        notices: where late ticks are told.
        log: where the count is kept.
    """

    def __init__(self, period: float, notices: Notices, log: EventLog) -> None:
        self._period = period
        self._notices, self._log = notices, log
        self._at = -math.inf
        self._count = 0
        self._longest_s = 0.0
        self._told_at = -math.inf

    def restart(self, now: float) -> None:
        """Something begins now: what went before counts no more."""
        self._at = now

    def take(self, now: float, *, urgent: bool) -> Tick | None:
        """The tick that ends now; None where it is too early for one: the time counts at the next one."""
        elapsed = now - self._at
        if elapsed <= 0 or (elapsed < 0.25 * self._period and not urgent):
            return None
        self._at = now
        if self._count and now > self._told_at + _SHOWN_S:
            self._conclude()
        late = elapsed > max((LONGEST_TICKS + 1) * self._period, _LATE_S)
        return Tick(min(elapsed, LONGEST_TICKS * self._period), elapsed - self._period if late else None)

    def tell_late(self, late_s: float, now: float) -> None:
        """A motion halted because a tick came late."""
        self._count += 1
        self._longest_s = max(self._longest_s, late_s)
        self._told_at = now
        self._notices.set(_KEY, self._words(), until=now + _SHOWN_S)

    def _words(self) -> str:
        longest_ms = 1000 * self._longest_s
        if self._count == 1:
            return f"the controller was {longest_ms:.0f} ms late; the motion halted and goes on from rest"
        return (
            f"the controller was late {self._count} times, by up to {longest_ms:.0f} ms; each time the "
            "motion halted and went on from rest: this computer is too busy"
        )

    def _conclude(self) -> None:
        if self._count > 1:
            self._log.warning(self._words())
        self._count, self._longest_s = 0, 0.0
