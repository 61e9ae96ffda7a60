"""Time, in one place: the only module that reads a clock."""

from __future__ import annotations

import threading
import time
from typing import Protocol


class Clock(Protocol):
    """Monotonic seconds, and a wait that something else may cut short."""

    def now(self) -> float:
        """Seconds since an arbitrary start; never goes back."""
        ...

    def wait_until(self, deadline: float, wake: threading.Event) -> bool:
        """Return at ``deadline`` (False) or as soon as ``wake`` is set (True)."""
        ...


class MonotonicClock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        """Seconds of the monotonic clock."""
        return time.monotonic()

    def wait_until(self, deadline: float, wake: threading.Event) -> bool:
        """Return at ``deadline`` (False) or as soon as ``wake`` is set (True)."""
        return wake.wait(max(0.0, deadline - time.monotonic()))


class ManualClock:
    """A clock that stands still until it is told to go on: for tests and for offline runs."""

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


def wall_time() -> float:
    """Seconds since the epoch, for log lines and file names only."""
    return time.time()
