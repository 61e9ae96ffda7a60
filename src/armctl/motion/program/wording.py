"""msgspec's refusals in the words of the other messages."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple, cast, get_args

import msgspec
from msgspec import inspect

from armctl.motion.program.program import Program, Step
from armctl.robot.decoding_words import must_be

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
