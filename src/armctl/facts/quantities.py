"""What a board measures of a joint besides where it is, and when that is worth a warning."""

from __future__ import annotations

from dataclasses import fields
from typing import Literal

from armctl.facts.reasons import Reason
from armctl.lazy_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Quantities:
    """Numbers of one moment; None: not measured, or for once not known."""

    load: float | None = None
    """force of its motor, as a signed share of the largest"""
    temperature_c: float | None = None
    """[°C]"""
    voltage_v: float | None = None
    """of its supply [V]"""
    current_a: float | None = None
    """[A]"""

    def __str__(self) -> str:
        """As people read them: ``load −12 %, 41 °C``."""
        numbers = self.load, self.temperature_c, self.voltage_v, self.current_a
        told = [
            form.format(scale * value)
            for value, (scale, form) in zip(numbers, _FORMS, strict=True)
            if value is not None
        ]
        words = ", ".join(told)
        return words.replace("-0 ", "0 ").replace("-", "−") if "-" in words else words


NAMES = tuple(one.name for one in fields(Quantities))
_FORMS = ((100, "load {:.0f} %"), (1, "{:.0f} °C"), (1, "{:.1f} V"), (1, "{:.2f} A"))


@dataclass(frozen=True, slots=True)
class QuantityLimits:
    """What the motor of a joint may come to, as its servo or the robot file has it; None: not known."""

    load: float | None = None
    """share of its largest force"""
    temperature_c: float | None = None
    """at which it switches itself off [°C]"""
    voltage_v: float | None = None
    """the least supply at which it runs [V]"""
    current_a: float | None = None
    """[A]"""
    supply_v: float | None = None
    """its supply without load [V]"""

    @property
    def temperature_level_c(self) -> float | None:
        """From here on its heat is warned of [°C]."""
        return None if self.temperature_c is None else self.temperature_c - NEAR_HOTTEST_C

    @property
    def voltage_level_v(self) -> float | None:
        """From here down its supply is warned of [V]."""
        low = None if self.supply_v is None else LOW_SUPPLY * self.supply_v
        if low is None or self.voltage_v is None:
            return self.voltage_v if low is None else low
        return max(self.voltage_v, low)


NEAR_HOTTEST_C = 10.0
"""so near to the temperature at which it switches itself off a motor is warned of"""
LOW_SUPPLY = 0.9
"""share of the supply without load from which down it is warned of"""
LOAD_S = 1.0
"""how long a load may be above its limit until it is warned of"""
_ROUNDING = 0.005
"""of a share that a servo tells in steps of 0.1 %, and keeps to its limit by"""


@dataclass(frozen=True, slots=True)
class LevelPassed(Reason):
    """What a board measures of a joint has passed the level from which on it is warned of."""

    part: str
    """title of the joint"""
    output: str
    """which motor of the board: "servo 3" """
    quantity: Literal["load", "temperature", "voltage"]
    value: float
    """the worst since it passed the level: a share, [°C] or [V]"""
    level: float
    """which was passed"""
    reference: float
    """what the level is told from: the limit of load or heat; of a supply, what it is without load"""

    def is_worse_than(self, other: LevelPassed) -> bool:
        """Whether it has gone on from there by what is worth telling."""
        worse = self.value - other.value if self.quantity != "voltage" else other.value - self.value
        return worse >= _TELLING[self.quantity]


_TELLING = {"load": 0.05, "temperature": 1.0, "voltage": 0.2}


def levels_passed(part: str, output: str, now: Quantities, limits: QuantityLimits) -> tuple[LevelPassed, ...]:
    """Which levels a joint, or a gripper, is beyond at this moment."""
    found: list[LevelPassed] = []
    if now.load is not None and limits.load is not None and abs(now.load) > limits.load - _ROUNDING:
        found.append(LevelPassed(part, output, "load", abs(now.load), limits.load, limits.load))
    heat, hottest, warm = now.temperature_c, limits.temperature_c, limits.temperature_level_c
    if heat is not None and hottest is not None and warm is not None and heat >= warm:
        found.append(LevelPassed(part, output, "temperature", heat, warm, hottest))
    low = limits.voltage_level_v
    if now.voltage_v is not None and low is not None and now.voltage_v <= low:
        usual = low if limits.supply_v is None else limits.supply_v
        found.append(LevelPassed(part, output, "voltage", now.voltage_v, low, usual))
    return tuple(found)
