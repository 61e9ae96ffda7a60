"""How often the guard refused what."""

from __future__ import annotations

import logging
import threading
from collections import Counter

LOG = logging.getLogger("armctl.ui.guard")


class Tally:
    """Counts refusals by reason, and logs the 1st, 10th, 100th … of each: a flood must not fill the log."""

    def __init__(self) -> None:
        self._is_open = False
        self._counts: Counter[str] = Counter()
        self._lock = threading.Lock()

    def open(self) -> None:
        """Start counting: what is refused before are the guard's own probes."""
        self._is_open = True

    def refuse(self, reason: str) -> None:
        """Count one refusal.

        Args:
            reason: a few fixed words; nothing that the client sent, since it ends up in the log.
        """
        if not self._is_open:
            return
        with self._lock:
            self._counts[reason] += 1
            count = self._counts[reason]
        if str(count).strip("0") == "1":
            LOG.warning("refused: %s (%d so far)", reason, count)

    @property
    def counts(self) -> dict[str, int]:
        """How often each reason was given, as a copy."""
        with self._lock:
            return dict(self._counts)
