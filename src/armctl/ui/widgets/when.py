"""Times as people read them."""

from __future__ import annotations

from datetime import datetime


def time_of_day(stamp: float) -> str:
    """Local time of day of seconds since the epoch."""
    return datetime.fromtimestamp(stamp).astimezone().strftime("%H:%M:%S")


def date_and_time(stamp: str) -> str:
    """Local day and time of an ISO stamp."""
    return datetime.fromisoformat(stamp).astimezone().strftime("%Y-%m-%d %H:%M")


def iso_time(stamp: float) -> str:
    """Local day and time, with its offset, of seconds since the epoch (ISO 8601)."""
    return datetime.fromtimestamp(stamp).astimezone().isoformat(timespec="seconds")
