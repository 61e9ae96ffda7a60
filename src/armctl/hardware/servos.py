"""Setting servos up, as ``armctl servos`` does: what a board whose servos have settings can tell and do."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from armctl.facts import QuantityLimits


@dataclass(frozen=True, slots=True)
class ServoSettings:
    """What stands in the EEPROM of a servo, as far as the host must know it."""

    model: int
    firmware: str
    lowest: int
    """the least goal that it takes [steps]"""
    highest: int
    offset: int = 0
    """homing offset [steps]"""
    findings: tuple[str, ...] = ()
    """what is unusual, in words, each with what to do"""
    unfit: str | None = None
    """why no torque may be switched on, in words"""
    limits: QuantityLimits = field(default_factory=QuantityLimits)
    """what it protects itself from"""


@dataclass(frozen=True, slots=True)
class FoundServo:
    """A servo that answers."""

    id: int
    baud: int
    model: str
    settings: ServoSettings
    position: int | None = None
    """[steps]"""
    voltage: float | None = None
    """[V]"""
    temperature: float | None = None
    """[°C]"""
    on: bool | None = None
    """whether its torque is on"""
    faults: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Difference:
    """What is not as the arm needs it, and what to do."""

    servo: int
    what: str
    cure: str


class ServoSetup(Protocol):
    """The servos of a board that is not connected, to be looked at and changed one at a time."""

    def close(self) -> None:
        """Close the port. Never raises."""

    def scan(
        self,
        bauds: Sequence[int] | None = None,
        ids: Iterable[int] = ...,
        likely: Iterable[int] = ...,
        progress: Callable[[float], None] = ...,
    ) -> list[FoundServo]:
        """All that answer, at any of ``bauds`` (None: all), by rate and id.

        ``likely`` ids are asked with more patience.
        ``progress`` is called with the share of the work that is done, and may raise to end it.
        """
        ...

    def look(self, baud: int, servo: int) -> FoundServo | None:
        """A servo that answers; None where it does not."""
        ...

    def change_id(self, baud: int, old: int, new: int) -> FoundServo:
        """Give the servo ``old`` another id, for good."""
        ...

    def write(self, baud: int, servo: int, name: str, number: int) -> None:
        """Write a register, for good, by its name."""

    def nudge(self, baud: int, servo: int, degrees: float = ...) -> None:
        """Turn it a little and back, weakly, to show which one it is."""
