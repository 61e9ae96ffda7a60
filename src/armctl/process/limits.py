"""What clients may cost: places, records and bytes a second; and who gives way where there is too much.

A client that is no owner can be anybody who has the link. Whatever such clients do, the ticks of the arm come
in time, its process stays small, and there is room for others.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar, cast

from armctl.errors import InputError
from armctl.runtime.pin import near

MOST_BYTES_A_SECOND = 8 * 1024 * 1024
"""of one client"""
_IN_ALL = 3
"""so many times as much as one client may send, all of them may send together"""
MOST_CONTROL_A_SECOND = 20
"""commands of one client about who operates"""


def source_of(peer: object) -> str:
    """Which computer a connection comes from, by what its socket says; empty: not known."""
    host = str(cast("tuple[object, ...]", peer)[0]) if isinstance(peer, tuple) and peer else ""
    try:
        ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return ""
    return near(host)


@dataclass(eq=False)
class Meter:
    """What one client has sent in the present second."""

    shut_out: Callable[[str], None]
    """ends its connection, and says why"""
    records: int = 0
    size: int = 0
    second: int = -1
    control: int = 0
    """commands about who operates"""


class Traffic:
    """Counts what clients send, second by second, each alone and all together."""

    def __init__(self, now: Callable[[], float]) -> None:
        """``now``: a clock [s]."""
        self._now = now
        self._all: dict[Meter, None] = {}
        """those that have sent something in the present second"""
        self._second = -1

    def count(self, meter: Meter, records: int, size: int, most: int) -> None:
        """Count records, and their bytes; ``most`` records a second are allowed.

        ``InputError``: this client sends more. Where all together send too much, whoever sends most is shut
        out.
        """
        second = int(self._now())
        if second != self._second:
            self._second = second
            self._all.clear()
        if meter.second != second:
            meter.second, meter.records, meter.size, meter.control = second, 0, 0, 0
        self._all[meter] = None
        meter.records += records
        meter.size += size
        if meter.records > most:
            raise InputError(f"more than {most} records in a second; send less")
        if meter.size > MOST_BYTES_A_SECOND:
            raise InputError(f"more than {MOST_BYTES_A_SECOND >> 20} MiB in a second; send less")
        for what, limit in (("records", _IN_ALL * most), ("size", _IN_ALL * MOST_BYTES_A_SECOND)):
            if sum(getattr(one, what) for one in self._all) > limit:
                largest = max(self._all, key=lambda one: getattr(one, what))
                del self._all[largest]
                largest.shut_out("all programs together send too much, and this one most; send less")


class Seat(Protocol):
    """A client that has a place."""

    @property
    def source(self) -> str:
        """Where it comes from."""
        ...

    @property
    def name(self) -> str:
        """What it calls itself."""
        ...


SeatT = TypeVar("SeatT", bound=Seat)


def who_gives_way(seated: Sequence[SeatT], source: str, name: str) -> SeatT | None:
    """Who gives its place to a newcomer, where all are taken; ``seated`` in the order in which they came.

    The places are shared fairly among the computers that clients come from, and those of one computer among
    the names that its clients give: the last one of whoever has most, if that is more than the newcomer's
    side would have. None: nobody does.
    """
    crowd = _crowd(seated, lambda one: one.source, source)
    if crowd is None:
        same = [one for one in seated if one.source == source]
        crowd = _crowd(same, lambda one: one.name, name)
    return None if crowd is None else crowd[-1]


def _crowd(
    seated: Iterable[SeatT], side: Callable[[SeatT], Hashable], newcomer: Hashable
) -> Sequence[SeatT] | None:
    """Those of the side that has most, unless the newcomer's side would have as many."""
    sides: dict[Hashable, list[SeatT]] = {}
    for one in seated:
        sides.setdefault(side(one), []).append(one)
    largest = max(sides, key=lambda key: len(sides[key]), default=newcomer)
    if largest == newcomer or len(sides[largest]) <= len(sides.get(newcomer, ())) + 1:
        return None
    return sides[largest]
