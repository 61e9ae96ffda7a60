"""How much one page may send: a bucket that fills with time and empties with frames."""

from __future__ import annotations

from collections.abc import Callable

_CAPACITY = 2000.0
_REFILL_PER_S = 500.0
_BYTES_PER_UNIT = 16 << 10
_PRICE_OF_A_REFUSAL = 10.0


class FloodGauge:
    """Counts frames against an allowance.

    A busy page sends some 100 frames a second (50 ms throttle a panel, camera, held buttons); an upload of
    8 MiB costs 512 units. Refused frames are dear, since the page of armctl itself hardly ever sends one.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._level = _CAPACITY
        self._at_s = now_s()

    def charge(self, size_bytes: int, *, refused: bool) -> bool:
        """Charge one frame; False when the allowance is used up and the connection is to be closed."""
        now_s = self._now_s()
        self._level = min(_CAPACITY, self._level + _REFILL_PER_S * (now_s - self._at_s))
        self._at_s = now_s
        self._level -= 1.0 + size_bytes / _BYTES_PER_UNIT + (_PRICE_OF_A_REFUSAL if refused else 0.0)
        return self._level >= 0.0
