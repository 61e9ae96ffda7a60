"""The check-up of a board: its findings, what it starts from, and how long answers take."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import partial

from armctl.errors import BoardError
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.transport import Transport


class Verdict(Enum):
    """How a check ended."""

    OK = "ok"
    WARNING = "warning"
    FAILED = "failed"
    NOT_CHECKED = "not checked"


@dataclass(frozen=True, slots=True)
class Finding:
    """One check: what was looked at, what was seen, and what to do about it."""

    check: str
    verdict: Verdict = field(kw_only=True)
    seen: str
    advice: str = ""


ok = partial(Finding, verdict=Verdict.OK)
warning = partial(Finding, verdict=Verdict.WARNING)  # it works, but the user should know
failed = partial(Finding, verdict=Verdict.FAILED)
not_checked = partial(Finding, verdict=Verdict.NOT_CHECKED)  # unknown, or an earlier failure stands before it


@dataclass(frozen=True, slots=True)
class ChannelsToCheck:
    """The channels of a robot file, or why none can be checked."""

    channels: Sequence[ChannelSettings] = ()
    why_none: str = "no robot was named"
    advice: str = "name one with --robot"

    def not_known(self, check: str) -> Finding:
        """The finding of a check that takes a robot file for this board."""
        return not_checked(check, self.why_none, self.advice)


OF_ANOTHER_BOARD = ChannelsToCheck(
    why_none="the robot file is for another kind of board", advice="choose the robot that belongs to this one"
)


@dataclass(frozen=True, slots=True)
class CheckUp:
    """A board that answers and is to be examined."""

    line: Transport  # open
    now: Callable[[], float]  # the clock [s]
    needs: ChannelsToCheck = ChannelsToCheck()
    listing: str | None = None  # how the port is listed; None: it is not
    reported: tuple[str, ...] = ()  # errors that the board had kept from before
    simulated: bool = False


# How long questions to a board and their answers take.

_CHECK = "round trips"
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
    """Ask often (``ask`` raises ``BoardError`` without an answer) and say how long it took [ms]."""
    took: list[float] = []
    for _ in range(_ROUNDS):
        before = now()
        try:
            ask()
        except BoardError as error:
            return failed(_CHECK, f"{len(took)} of {_ROUNDS} answered, then: {error}")
        took.append(now() - before)
    late, median = sum(one > _TICK_S for one in took), statistics.median(took)
    seen = f"{_ROUNDS} questions answered, median {1000 * median:.1f} ms, worst {1000 * max(took):.1f} ms"
    if median > _SLOW_MEDIAN_S or late > _MOST_LATE:
        return warning(_CHECK, f"{seen}, {late} later than 20 ms", _SLOW_ADVICE)
    return ok(_CHECK, seen)
