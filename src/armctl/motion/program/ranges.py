"""Which numbers a step may hold, told in words: the ranges that its file format states."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

from msgspec import inspect

from armctl.motion.program.program import Step

_WORDS = {
    "duration_s": "a motion takes {allowed} s, not {value}; leave it open",
    "blend_mm": "a blend radius is {allowed} mm, not {value}",
    "speed_mm_s": "the speed of the tool is {allowed} mm/s, not {value}",
    "open_percent": "the gripper opens {allowed} %, not {value}",
    "seconds": "a wait takes {allowed} s, not {value}",
    "percent": "a speed is {allowed} %, not {value}",
    "times": "a block is repeated {allowed} times, not {value}",
}


@dataclass(frozen=True, slots=True)
class _Range:
    key: str
    low: float
    high: float
    open_below: bool
    """``low`` itself is not allowed"""

    def allows(self, value: float) -> bool:
        """Whether a number lies within; none that is not finite does."""
        above = value > self.low if self.open_below else value >= self.low
        return above and value <= self.high and math.isfinite(value)

    def __str__(self) -> str:
        if math.isinf(self.high):
            return f"more than {self.low:.0f}" if self.open_below else f"{self.low:.0f} or more"
        return f"{self.low:.0f} … {self.high:.0f}"


def out_of_range(step: Step) -> str | None:
    """What is wrong with the first number of a step that lies out of its range; None: all are inside."""
    for allowed in _ranges(type(step)):
        value: float | None = getattr(step, allowed.key)
        if value is not None and not allowed.allows(value):
            return _WORDS[allowed.key].format(allowed=allowed, value=value)
    return None


@cache
def _ranges(kind: type[Step]) -> tuple[_Range, ...]:
    """Of all keys of a kind of step that have one."""
    record = inspect.type_info(kind)
    fields = record.fields if isinstance(record, inspect.StructType) else ()
    found: list[_Range] = []
    for field in fields:
        types = field.type.types if isinstance(field.type, inspect.UnionType) else (field.type,)
        for number in types:
            if not isinstance(number, inspect.FloatType | inspect.IntType):
                continue
            low = number.ge if number.gt is None else number.gt
            if low is not None:
                high = math.inf if number.le is None else number.le
                found.append(_Range(field.name, low, high, open_below=number.gt is not None))
    return tuple(found)
