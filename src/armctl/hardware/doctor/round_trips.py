"""How long questions to a board and their answers take."""

from __future__ import annotations

import statistics
from collections.abc import Callable

from armctl.errors import BoardError
from armctl.hardware.doctor.finding import Finding, failed, ok, warning

CHECK = "round trips"
_ROUNDS = 50
_TICK_S = 0.020
_SLOW_MEDIAN_S = 0.010
_MOST_LATE = _ROUNDS // 20

_SLOW_ADVICE = (
    "the arm is controlled every 20 ms, and each time the board is asked once: plug it into the computer "
    "itself, not into a hub; an FTDI adapter holds answers back for 16 ms until its latency timer is set to "
    "1 (/sys/bus/usb-serial/devices/ttyUSB0/latency_timer); a busy computer is late as well"
)


def round_trips(ask: Callable[[], object], now: Callable[[], float]) -> Finding:
    """Ask often and say how long it took: median and worst [ms].

    Args:
        ask: puts one question and returns with the answer; raises ``BoardError`` without one.
        now: the clock [s].
    """
    took: list[float] = []
    for _ in range(_ROUNDS):
        before = now()
        try:
            ask()
        except BoardError as error:
            return failed(CHECK, f"{len(took)} of {_ROUNDS} answered, then: {error}")
        took.append(now() - before)
    late = sum(one > _TICK_S for one in took)
    seen = (
        f"{_ROUNDS} questions answered, median {1000 * statistics.median(took):.1f} ms, "
        f"worst {1000 * max(took):.1f} ms"
    )
    if statistics.median(took) > _SLOW_MEDIAN_S or late > _MOST_LATE:
        return warning(CHECK, f"{seen}, {late} later than 20 ms", _SLOW_ADVICE)
    return ok(CHECK, seen)
