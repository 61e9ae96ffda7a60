"""Time, in one place: the only module that reads a clock."""

from __future__ import annotations

import threading
import time
from typing import Protocol

AFTER_GAP_S = 0.25
"""for so long after a gap nothing begins: what was asked for meanwhile comes now, as if it were new"""
# The clock that goes on while the computer is suspended: on Linux CLOCK_BOOTTIME, on macOS CLOCK_MONOTONIC,
# on Windows Python's own monotonic one, which stops meanwhile on the other two.
_GOES_ON: int | None = getattr(time, "CLOCK_BOOTTIME", getattr(time, "CLOCK_MONOTONIC", None))
wall_time = time.time
"""Seconds since the epoch, for log lines and file names only."""


class Clock(Protocol):
    """Monotonic seconds, and a wait that something else may cut short."""

    def now(self) -> float:
        """Seconds since an arbitrary start; never goes back."""
        ...

    def wait_until(self, deadline: float, wake: threading.Event) -> bool:
        """Return at ``deadline`` (False) or as soon as ``wake`` is set (True)."""
        ...


class MonotonicClock:
    """The machine's monotonic clock, which also counts the time that the computer is suspended."""

    @staticmethod
    def now() -> float:
        """Seconds since an arbitrary start; never goes back."""
        return time.monotonic() if _GOES_ON is None else time.clock_gettime(_GOES_ON)

    def wait_until(self, deadline: float, wake: threading.Event) -> bool:
        """Return at ``deadline`` (False) or as soon as ``wake`` is set (True)."""
        return wake.wait(max(0.0, deadline - self.now()))


class ManualClock:
    """A clock that stands still until it is advanced: for tests and for offline runs."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Seconds, as last set."""
        return self._now

    def advance(self, seconds: float) -> None:
        """Go on by ``seconds`` (not negative)."""
        if seconds < 0:
            raise ValueError(f"a clock does not go back: advance({seconds})")
        self._now += seconds

    def wait_until(self, deadline: float, wake: threading.Event) -> bool:
        """Jump to ``deadline`` at once, unless ``wake`` is set."""
        if wake.is_set():
            return True
        self._now = max(self._now, deadline)
        return False
