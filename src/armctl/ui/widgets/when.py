"""Times as people read them."""

from __future__ import annotations

from datetime import datetime


def time_of_day(stamp: float) -> str:
    """Local time of day of seconds since the epoch."""
    return datetime.fromtimestamp(stamp).astimezone().strftime("%H:%M:%S")
