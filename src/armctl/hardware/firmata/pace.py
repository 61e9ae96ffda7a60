"""How much the serial line can still carry: nothing may queue up in front of a setpoint."""

from __future__ import annotations

import math

from armctl.hardware.firmata.codec import BAUD

_BITS_PER_BYTE = 10  # 8N1: start bit, eight data bits, stop bit
BYTE_S = _BITS_PER_BYTE / BAUD
_ROUNDING_SLACK = 1e-6


class LinePace:
    """Keeps account of the time that the bytes given to the line take on it.

    The operating system and the USB adapter take far more bytes than the line carries; whoever
    writes faster than it only makes the setpoints old.

    Args:
        period_s: what may be spent is reckoned per so many seconds.
        share: which part of them may be spent.
    """

    def __init__(self, period_s: float, share: float) -> None:
        self._allowed_s = period_s * share
        self._busy_until = 0.0

    def waiting(self, now: float) -> int:
        """How many of the bytes written so far have not gone out yet."""
        return math.ceil(self._backlog_s(now) / BYTE_S - _ROUNDING_SLACK)

    def room(self, now: float) -> int:
        """How many more bytes may be written now."""
        return max(0, math.floor((self._allowed_s - self._backlog_s(now)) / BYTE_S + _ROUNDING_SLACK))

    def charge(self, count: int, now: float) -> None:
        """Note that ``count`` bytes were written at ``now`` [s]."""
        self._busy_until = max(self._busy_until, now) + count * BYTE_S

    def _backlog_s(self, now: float) -> float:
        return max(0.0, self._busy_until - now)
