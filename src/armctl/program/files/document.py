"""msgspec's refusals in the words of the other messages."""

from __future__ import annotations

import math
import re
import reprlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, cast, get_args

import msgspec
from msgspec import inspect

from armctl.errors import ProgramError
from armctl.program.program import Program, Step
from armctl.robot.file import must_be

_UNKNOWN = re.compile(r"Object contains unknown field `(.+)`", re.DOTALL)
_MISSING = re.compile(r"Object missing required field `(.+)`", re.DOTALL)
_CHOICE = re.compile(r"Invalid (?:enum )?value (.+)", re.DOTALL)
_BOUND = re.compile(r"Expected `(?:float|int)` (>=|<=|>|<) (\S+)")
_BOUND_WORDS = {">=": "at least", "<=": "at most", ">": "more than", "<": "less than"}
_TYPE = re.compile(r"Expected `([a-z| ]+)`, got `\w+`")
_TYPE_WORDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "array": "a list",
    "object": "a table",
    "null": "left out",
}
_PLACE = re.compile(r"\[(\d+)\]|([^.\[]+)")


class Refusal(NamedTuple):
    """What a record was refused for."""

    where: str
    """path to the value, e.g. ``steps[2].x_mm``; empty: the record itself"""
    key: str | None
    """the key that is unknown or missing there"""
    what: str


def refusal_of(error: msgspec.ValidationError, record: object) -> Refusal:
    """Take a decoder's message apart.

    Args:
        error: what the decoder raised.
        record: what it was to decode: a program's record, a step's, or one like them.
    """
    message = str(error)
    what, _, where = message.rpartition(" - at `")
    if not what:
        what, where = message, "$`"
    where = where.removesuffix("`").removeprefix("$").removeprefix(".")
    if match := _UNKNOWN.fullmatch(what):
        return Refusal(where, match.group(1), f"unknown key {match.group(1)!r}; mistyped?")
    if match := _MISSING.fullmatch(what):
        return Refusal(where, match.group(1), f"the key {match.group(1)!r} is missing")
    got = reprlib.repr(_value_at(record, where))
    if match := _BOUND.fullmatch(what):
        allowed = f"{float(match.group(2)):.15g}"
        return Refusal(where, None, f"must be {_BOUND_WORDS[match.group(1)]} {allowed}, not {got}")
    if match := _TYPE.fullmatch(what):
        allowed = " or ".join(_TYPE_WORDS.get(name, name) for name in match.group(1).split(" | "))
        return Refusal(where, None, f"must be {allowed}, not {got}")
    key = where.rpartition(".")[2]
    if match := _CHOICE.fullmatch(what):
        if key == "do":
            return Refusal(where, None, f"there is no step {got}; there are {', '.join(_kinds())}")
        return Refusal(where, None, f"{must_be(_choices()[key])}, not {got}")
    what = what.replace("`", "")
    return Refusal(where, None, f"{what[:1].lower()}{what[1:]}")


def _value_at(record: object, where: str) -> object:
    """The value that a decoder's path leads to."""
    value = record
    for index, key in _PLACE.findall(where):
        if index:
            value = cast("list[object]", value)[int(index)]
        else:
            value = cast("dict[str, object]", value)[key]
    return value


def _kinds() -> Iterator[str]:
    return (str(kind.__struct_config__.tag) for kind in get_args(Step))


@cache
def _choices() -> dict[str, tuple[object, ...]]:
    """What may stand under each key that knows only some values; alike in all kinds of steps."""
    found: dict[str, tuple[object, ...]] = {}
    for kind in (Program, *get_args(Step)):
        record = inspect.type_info(kind)
        for field in record.fields if isinstance(record, inspect.StructType) else ():
            if isinstance(field.type, inspect.LiteralType):
                found[field.encode_name] = tuple(field.type.values)
    return found


# Text of files from other programs.

_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def plain_text(text: bytes | str) -> str:
    """The text of a file: UTF-8, without a byte order mark, lines ended as they are.

    Raises:
        ProgramError: another encoding; says what to do.
    """
    if isinstance(text, bytes):
        if text.startswith(_UTF16):
            raise ProgramError("is not a text file in UTF-8 but in UTF-16; save it as UTF-8")
        try:
            text = text.decode()
        except UnicodeDecodeError as cause:
            raise ProgramError(
                f"is not a text file in UTF-8: byte {cause.start + 1} cannot be read; save it as UTF-8"
            ) from cause
    return text.removeprefix("\ufeff")


# On which line of a program's TOML text a step, or a key of it, stands.

_SKIPPED = (
    r'"""(?:\\.|[^\\])*?"""'  # strings may hold what looks like a header or a key
    r"|'''.*?'''"
    r'|"(?:\\.|[^"\\\n])*"'
    r"|'[^'\n]*'"
    r"|#[^\n]*"
)
_HEADER = r"^[ \t]*\[\[?[^\n]*"
_STEPS = re.compile(r"""[ \t]*\[\[[ \t]*(steps|"steps"|'steps')[ \t]*\]\]""")


def line_of(text: str, step: int | None, key: str | None) -> int | None:
    """Line, from 1, of a key; of the step's header where the key does not stand there.

    Args:
        text: valid TOML.
        step: index of the step; None: a key of the program itself.
        key: its name; None: the step as a whole.

    Returns:
        None where it cannot be told, e.g. for steps that are written as an array of inline tables.
    """
    begin, end = _region(text, step)
    if begin is None:
        return None
    found = None if key is None else _key(text, key, begin, end)
    if found is None:
        found = begin if step is not None else _table(text, key)
    return None if found is None else text.count("\n", 0, found) + 1


def _region(text: str, step: int | None) -> tuple[int | None, int]:
    """Where a step's header begins and where its table ends; with None, what stands before any table."""
    count = -1
    begin: int | None = 0 if step is None else None
    for match in _found(text, _HEADER, 0, len(text)):
        if begin is not None:
            return begin, match.start()
        if _STEPS.match(match.group()):
            count += 1
            if count == step:
                begin = match.start()
    return begin, len(text)


def _key(text: str, key: str, begin: int, end: int) -> int | None:
    name = re.escape(key)
    pattern = rf"""^[ \t]*(?:{name}|"{name}"|'{name}')[ \t]*="""
    return next((match.start() for match in _found(text, pattern, begin, end)), None)


def _table(text: str, key: str | None) -> int | None:
    """Header of a table of the program itself."""
    for match in _found(text, _HEADER, 0, len(text)):
        if match.group().strip(" \t[]").strip("\"'") == key:
            return match.start()
    return None


def _found(text: str, pattern: str, begin: int, end: int) -> Iterator[re.Match[str]]:
    """Matches of a pattern outside strings and comments."""
    scanner = re.compile(f"(?P<wanted>{pattern})|{_SKIPPED}", re.MULTILINE | re.DOTALL)
    for match in scanner.finditer(text, begin, end):
        if match.group("wanted") is not None:
            yield match


# Which numbers a step may hold, told in words: the ranges that its file format states.

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
