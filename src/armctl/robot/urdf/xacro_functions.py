"""The values, functions and methods that the expressions of xacro files know.

What is not in these tables, no file can call. Each takes values and returns a value.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NoReturn, TypeAlias, cast

from armctl.errors import RobotFileError
from armctl.lazy_dataclass import dataclass

Value: TypeAlias = Any
"""int, float, str, bool, None, list, tuple, dict, set, range, Function; ``weight`` refuses others"""
LONGEST = 100_000
"""characters of a text"""
MOST_PARTS = 20_000
"""elements of a value, as many as it prints"""
_MOST_PLACES = 20
"""to which ``round`` goes"""
_MOST_SHOWN = 120
"""characters of a file in a message"""


@dataclass(frozen=True, slots=True)
class Function:
    """A function of the tables."""

    name: str
    call: Callable[..., Any]
    kind: type | None = None
    """the type that ``isinstance`` asks about"""

    def __str__(self) -> str:
        return f"<function {self.name}>"

    __repr__ = __str__


@dataclass(frozen=True, slots=True)
class Module:
    """A table of functions behind a name: ``math.cos``."""

    entries: Mapping[str, Value]

    def get(self, name: str) -> Value:
        """An entry; raises ``KeyError`` where there is none."""
        return self.entries[name]


class FixedList(list[Any]):
    """A list of a YAML file, which no expression changes."""


def shown(text: str) -> str:
    """A text of a file in a message: one line that is not too long."""
    line = " ".join(text[: 4 * _MOST_SHOWN].split())
    return line if len(line) <= _MOST_SHOWN else f"{line[:_MOST_SHOWN]}…"


LARGEST_INT = 2**60
"""whole numbers from here on are refused: large ones take long to compute with, and many hash alike"""


def weight(value: Value) -> int:
    """Parts of a value as often as it prints them, with their characters; refuses too many."""
    count, waiting = 0, [value]
    while waiting:
        one = waiting.pop()
        count += 1
        if isinstance(one, str):
            count += len(one) >> 4
        elif isinstance(one, dict):
            waiting.extend(cast("dict[Any, Any]", one))
            waiting.extend(cast("dict[Any, Any]", one).values())
        elif isinstance(one, list | tuple | set):
            waiting.extend(cast("Iterable[Any]", one))
        elif isinstance(one, range):
            count += len(one)
        elif isinstance(one, int) and not -LARGEST_INT < one < LARGEST_INT:
            raise OverflowError("a whole number of more than 18 digits")
        elif not isinstance(one, int | float | Function | None):
            raise TypeError(f"a {type(one).__name__.lower()} is no value of a robot file")
        if count + len(waiting) > MOST_PARTS:
            raise OverflowError(f"a value of more than {MOST_PARTS} parts")
    return count


# Functions.


def _rounded(number: float, ndigits: int | None = None) -> float:
    if ndigits is not None and abs(ndigits) > _MOST_PLACES:
        raise OverflowError(f"round goes to {_MOST_PLACES} places at most")
    return round(number, ndigits)


def _is_kind(value: Value, kinds: Function | tuple[Function, ...]) -> bool:
    types = [one.kind for one in (kinds if isinstance(kinds, tuple) else (kinds,))]
    if None in types:
        raise TypeError("isinstance takes int, float, str, bool, list, tuple, dict or set")
    return isinstance(value, tuple(cast("list[type]", types)))


def _mapped(function: Function, *items: Iterable[Value]) -> list[Value]:
    if function.kind not in (int, float, str, bool):
        raise TypeError("map takes int, float, str or bool")
    return [function.call(*row) for row in zip(*items, strict=False)]


def _total(items: Iterable[Value], start: float = 0) -> float:
    numbers = [*items, start]
    if not all(isinstance(one, int | float) for one in numbers):
        raise TypeError("sum takes numbers")
    return sum(numbers)


def _enumerated(items: Iterable[Value], start: int = 0) -> list[Value]:
    return list(enumerate(items, start))


def _reversed(items: Sequence[Value]) -> list[Value]:
    return list(reversed(items))


def _sorted(items: Iterable[Value], reverse: bool = False) -> list[Value]:
    return sorted(items, reverse=reverse)


def _zipped(*items: Iterable[Value]) -> list[Value]:
    return list(zip(*items, strict=False))


def _tokens(text: str, sep: str = ",; ", skip_empty: bool = True) -> list[str]:
    for character in sep:
        text = text.replace(character, sep[0])
    return [part for part in text.split(sep[0]) if part or not skip_empty]


def _silent(*_: Value, **__: Value) -> str:
    return ""


def _fatal(*words: Value) -> NoReturn:
    raise RobotFileError(f"the file says: {shown(' '.join(map(str, words)))}")


# Methods.

_FIELD = re.compile(r"\{\{|\}\}|\{(?P<name>\w*)(?::(?P<spec>[^{}]*))?\}|[{}]")
_SPEC = re.compile(r"[<>^]?[+-]?0?\d{0,2}(?:\.\d{1,2})?[dfgeEGsx%]?")


def _formatted(pattern: str, *given: Value, **named: Value) -> str:
    """``str.format`` of plain fields, by place or name and how wide; nothing inside of a value."""
    places = iter(range(len(given)))

    def filled(match: re.Match[str]) -> str:
        if match[0] in ("{{", "}}"):
            return match[0][0]
        name, spec = match["name"], match["spec"] or ""
        if name is None or not _SPEC.fullmatch(spec):
            raise ValueError(f"the field {match[0]!r} of a format")
        if name and not name.isdecimal():
            value = named[name]
        else:
            value = given[int(name) if name else next(places, len(given))]
        if spec and not isinstance(value, int | float | str):
            raise TypeError(f"the field {match[0]!r} takes a number or a text")
        return format(value, spec) if spec else str(value)

    return _FIELD.sub(filled, pattern)


def _keys(values: dict[Any, Any]) -> list[Value]:
    return list(values)


def _values(values: dict[Any, Any]) -> list[Value]:
    return list(values.values())


def _items(values: dict[Any, Any]) -> list[Value]:
    return list(values.items())


def _popped(values: list[Any], index: int = -1) -> Value:
    return values.pop(index)


# How much some of them make, or look at one by one.


def _joined_length(between: str, items: Sequence[str]) -> int:
    return sum(len(one) + len(between) for one in items)


def _replaced_length(text: str, old: str, new: str, *_: Value) -> int:
    return (text.count(old) + 1) * len(new) + len(text)


def _filled_length(_text: str, width: int) -> int:
    return width


def _formatted_length(pattern: str, *given: Value, **named: Value) -> int:
    widest = max(map(weight, (*given, *named.values())), default=0)
    return len(pattern) + pattern.count("{") * (100 + 16 * widest)


def _compared(text: str, other: str | None = None, *_: Value, **__: Value) -> int:
    return len(text) * len(other or "")


def _compared_tokens(text: str, sep: str = ",; ", *_: Value, **__: Value) -> int:
    return len(text) * len(sep)


_MATH: Mapping[str, Value] = {
    name: Function(name, getattr(math, name))
    for name in (
        "acos acosh asin asinh atan atan2 atanh ceil copysign cos cosh degrees dist erf exp expm1 fabs floor "
        "fmod fsum gcd hypot isclose isfinite isinf isnan log log10 log1p log2 modf pow radians remainder "
        "sin sinh sqrt tan tanh trunc"
    ).split()
} | {name: getattr(math, name) for name in ("pi", "tau", "e", "inf", "nan")}
_KINDS: Mapping[str, Value] = {
    kind.__name__: Function(kind.__name__, kind, kind)
    for kind in cast("Sequence[type]", (int, float, str, bool, list, tuple, dict, set))
}
_CALLS: Mapping[str, Callable[..., Any]] = {
    "abs": abs,
    "all": all,
    "any": any,
    "divmod": divmod,
    "enumerate": _enumerated,
    "isinstance": _is_kind,
    "len": len,
    "map": _mapped,
    "max": max,
    "min": min,
    "ord": ord,
    "range": range,
    "reversed": _reversed,
    "round": _rounded,
    "sorted": _sorted,
    "sum": _total,
    "zip": _zipped,
}
_PYTHON: Mapping[str, Value] = {**_KINDS, **{name: Function(name, call) for name, call in _CALLS.items()}}
XACRO: Mapping[str, Value] = {
    **{name: Function(name, _silent) for name in ("message", "warning", "error", "print_location")},
    "fatal": Function("fatal", _fatal),
    "tokenize": Function("tokenize", _tokens),
    "dotify": Function("dotify", dict),
}
"""what is behind ``xacro.`` and needs no files"""
FUNCTIONS: Mapping[str, Value] = {
    **_MATH,
    **{name: function for name, function in _PYTHON.items() if name not in ("set", "tuple")},
    "dotify": XACRO["dotify"],
    "math": Module(_MATH),
    "python": Module(_PYTHON),
    "xacro": Module(XACRO),
}
"""what every file knows"""
_TEXT_METHODS = (
    "capitalize count endswith find index isalnum isalpha isdecimal isdigit islower isnumeric isspace "
    "isupper join lower lstrip partition removeprefix removesuffix replace rfind rsplit rstrip split "
    "splitlines startswith strip swapcase title upper zfill"
)
METHODS: Mapping[type, Mapping[str, Callable[..., Any]]] = {
    str: {**{name: getattr(str, name) for name in _TEXT_METHODS.split()}, "format": _formatted},
    dict: {"get": dict[Any, Any].get, "items": _items, "keys": _keys, "values": _values},
    list: {"count": list[Any].count, "index": list[Any].index, "pop": _popped},
    FixedList: {"count": list[Any].count, "index": list[Any].index},
    tuple: {"count": tuple[Any, ...].count, "index": tuple[Any, ...].index},
    float: {"is_integer": float.is_integer},
}
"""by the type of what stands before the dot"""
SIZES: Mapping[Callable[..., Any], Callable[..., int]] = {
    str.join: _joined_length,
    str.replace: _replaced_length,
    str.zfill: _filled_length,
    _formatted: _formatted_length,
    _tokens: _compared_tokens,
    **dict.fromkeys((str.rfind, str.rsplit, str.strip, str.lstrip, str.rstrip), _compared),
}
"""how many characters a call makes or compares, where it is more than it is given: asked before the call"""
