"""What clients may cost: places, records and bytes a second; and who gives way where there is too much.

A client that is no owner can be anybody who has the link. Whatever such clients do, the ticks of the arm come
in time, its process stays small, and there is room for others.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Protocol, TypeVar, cast

from armctl.errors import InputError
from armctl.lazy_dataclass import dataclass
from armctl.process.records import BIG, CONTROL, MOST_ELSE, MOST_OF_PROGRAM

MOST_BYTES_A_SECOND, MOST_BYTES_WATCHING = 8 * 1024 * 1024, 1024 * 1024
"""of the client that operates, of another one"""
_IN_ALL = 3, 2 * 1024 * 1024
"""Those that do not operate together: so many times the records of one, and bytes, in a second."""
_NOT_MUCH = 300, 128 * 1024
"""records and bytes of one that goes on where all together send too much"""
_AT_ONCE, _REFILL_PER_S, _MOST_SOURCES = 120.0, 10.0, 1000
"""connections of one computer, at once and each second after that; computers that are remembered"""
MOST_CONTROL_A_SECOND = 20
"""commands of one client about who operates"""
_MOST_OF_CONTROL = 4 * 1024
_NETWORK_BITS = 64


def most_bytes(tag: str) -> int:
    """How large a client's record may be that asks for a kind of command."""
    if tag in CONTROL:
        return _MOST_OF_CONTROL
    return MOST_OF_PROGRAM if tag in BIG else MOST_ELSE


def source_of(peer: object) -> str:
    """Which computer a connection comes from, by what its socket says; empty: not known."""
    host = str(cast("tuple[object, ...]", peer)[0]) if isinstance(peer, tuple) and peer else ""
    try:
        ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return ""
    return near(host)


def near(address: str) -> str:
    """What stands for an address where guesses are counted: of IPv6 its network, as a computer has many."""
    try:
        ip = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(ip, ipaddress.IPv6Address) and ip.ipv4_mapped is not None:
        ip = ip.ipv4_mapped
    if ip.version == 4 or ip.is_loopback:
        return str(ip)
    return str(ipaddress.ip_network((ip, _NETWORK_BITS), strict=False))


@dataclass(eq=False)
class Meter:
    """What one client has sent in the present second."""

    second: int = -1
    records: int = 0
    size: int = 0
    control: int = 0
    """commands about who operates"""


class Traffic:
    """Counts what clients send, second by second, each alone and those together that do not operate."""

    def __init__(self, now: Callable[[], float]) -> None:
        """``now``: a clock [s]."""
        self._now = now
        self._all = Meter()

    def count(self, meter: Meter, records: int, size: int, most: int, *, operates: bool) -> None:
        """Count records, and their bytes; ``most`` records a second are allowed.

        ``InputError``: it is too much, of this client or of all together and not little of this one. So who
        floods anew after each connection does not get far, and who sends little goes on.
        """
        second = int(self._now())
        for one in (meter, self._all):
            if one.second != second:
                one.second, one.records, one.size, one.control = second, 0, 0, 0
        meter.records += records
        meter.size += size
        if meter.records > most:
            raise InputError(f"more than {most} records in a second; send less")
        largest = MOST_BYTES_A_SECOND if operates else MOST_BYTES_WATCHING
        if meter.size > largest:
            raise InputError(f"more than {largest >> 20} MiB in a second; send less")
        if operates:
            return
        self._all.records += records
        self._all.size += size
        factor, bytes_in_all = _IN_ALL
        if (self._all.records > factor * most and meter.records > _NOT_MUCH[0]) or (
            self._all.size > bytes_in_all and meter.size > _NOT_MUCH[1]
        ):
            raise InputError("all that do not operate the arm together send too much; send less")


class Arrivals:
    """Bounds how often each computer connects: a whole class may come at once, but not again and again."""

    def __init__(self, now: Callable[[], float]) -> None:
        """``now``: a clock [s]."""
        self._now = now
        self._left: dict[str, tuple[float, float]] = {}
        """how often a computer may connect, and when [s] that was"""

    def take(self, source: str) -> bool:
        """Count a connection; whether it may be served."""
        now = self._now()
        left, at = self._left.pop(source, (_AT_ONCE, now))
        left = min(_AT_ONCE, left + _REFILL_PER_S * (now - at))
        self._left[source] = (left - 1.0 if left >= 1.0 else left), now
        if len(self._left) > _MOST_SOURCES:
            del self._left[next(iter(self._left))]
        return left >= 1.0


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
