"""How much of the time a tick counts for."""

from __future__ import annotations

import math

LONGEST_TICKS = 2
"""A tick counts for no more periods: time that was missed is not made up for, or the arm would jump."""
_LATE_S = 0.06
"""a tick that comes so long after the one before it is late"""
GAP_S = 0.5
"""after so long without a tick nothing goes on by itself: suspended, frozen or too busy"""
LATE_SHOWN_S = 5.0
"""how long a late tick is shown, and how long no tick may be late before the next one is logged"""
_ROUNDING_S = 1e-6


class TickTime:
    """Measures the time from tick to tick, and counts the late ones that follow each other."""

    def __init__(self, period: float) -> None:
        """``period``: from tick to tick [s]."""
        self.late_s: float | None = None
        """how much later the last tick came than it should; None: in time"""
        self.gap_s: float | None = None
        """time from the tick before to the last one, where it was longer than ``GAP_S``"""
        self.late_before: str | None = None
        """text for the log at the last tick: several before it came late, and that is over"""
        self._period = period
        self._at = -math.inf
        self._count = 0
        self._longest_s = 0.0
        self._late_at = -math.inf

    def restart(self, now: float) -> None:
        """Something begins now: what went before counts no more."""
        self._at = now

    def take(self, now: float, *, urgent: bool) -> float | None:
        """What the tick that ends now counts for [s]; None: too early, the time counts at the next one."""
        elapsed = now - self._at
        if elapsed <= 0 or (elapsed < 0.25 * self._period and not urgent):
            return None
        self._at = now
        late = elapsed > max((LONGEST_TICKS + 1) * self._period, _LATE_S)
        self.late_s = elapsed - self._period if late else None
        self.gap_s = elapsed if GAP_S + _ROUNDING_S < elapsed < math.inf else None
        self.late_before = None
        if self._count and now > self._late_at + LATE_SHOWN_S:
            self.late_before = self._text() if self._count > 1 else None
            self._count, self._longest_s = 0, 0.0
        return min(elapsed, LONGEST_TICKS * self._period)

    def count_late(self, now: float) -> str:
        """Count the last tick, which came late and halted a motion; gives the text of the notice."""
        self._count += 1
        self._longest_s = max(self._longest_s, self.late_s or 0.0)
        self._late_at = now
        return self._text()

    def _text(self) -> str:
        longest_ms = 1000 * self._longest_s
        if self._count == 1:
            return f"the controller was {longest_ms:.0f} ms late; the motion halted and goes on from rest"
        return (
            f"the controller was late {self._count} times, by up to {longest_ms:.0f} ms; each time the "
            "motion halted and went on from rest: this computer is too busy, or the board answers late"
        )
