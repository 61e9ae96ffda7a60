"""Setting servos up: what a board whose servos have settings can tell and do.

The page *Main → Servos* and ``armctl servos`` do it by this protocol.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import field
from typing import Protocol

from armctl.facts import QuantityLimits, Reason
from armctl.facts.words import advice, say
from armctl.lazy_dataclass import dataclass


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
    mode: int = 0
    """operating mode, as its make counts them"""
    findings: tuple[str, ...] = ()
    """what is unusual, in words, each with what to do"""
    unfit: str | None = None
    """why no torque may be switched on, in words"""
    cure: tuple[tuple[str, int], ...] = ()
    """registers and the numbers that make it fit"""
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
class Mend:
    """One change of one servo that ends a difference: another id, another baud rate, or some registers."""

    servo: int
    """its id now"""
    baud: int
    """at which it answers now"""
    new_id: int | None = None
    new_baud: int | None = None
    numbers: tuple[tuple[str, int], ...] = ()
    """registers by name, and what is written into them"""

    def carry_out(self, setup: ServoSetup) -> FoundServo | None:
        """Do it, each write kept, locked and read back; the servo as it is then.

        ``BoardError``: it was not done, or not all of it; the error says how far.
        """
        if self.new_id is not None:
            return setup.change_id(self.baud, self.servo, self.new_id)
        if self.new_baud is not None:
            return setup.change_baud(self.baud, self.servo, self.new_baud)
        for name, number in self.numbers:
            setup.write(self.baud, self.servo, name, number)
        return setup.look(self.baud, self.servo)

    @property
    def words(self) -> str:
        """As on a button."""
        if self.new_id is not None:
            return f"Give servo {self.servo} the id {self.new_id}"
        if self.new_baud is not None:
            return f"Set servo {self.servo} to {self.new_baud} baud"
        numbers = ", ".join(f"{name} = {number}" for name, number in self.numbers)
        return f"Write {numbers} into servo {self.servo}"


@dataclass(frozen=True, slots=True)
class Difference:
    """What is not as the arm needs it, and what to do."""

    servo: int
    fact: Reason
    mend: Mend | None = None
    """what armctl can do about it, if it is asked to"""

    @property
    def what(self) -> str:
        """In words."""
        return say(self.fact)

    @property
    def cure(self) -> str:
        """What to do, in words; empty: nothing needs to be done."""
        return advice(self.fact)


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

    def change_baud(self, baud: int, servo: int, new: int) -> FoundServo:
        """Have a servo answer at another baud rate, for good."""
        ...

    def write(self, baud: int, servo: int, name: str, number: int) -> None:
        """Write a register, for good: ``offset``, ``lowest``, ``highest``, ``mode``, or its make's name."""

    def nudge(self, baud: int, servo: int, degrees: float = ...) -> None:
        """Turn it a little and back, weakly, to show which one it is."""
