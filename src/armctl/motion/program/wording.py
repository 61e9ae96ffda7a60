"""msgspec's refusals in the words of the other messages."""

from __future__ import annotations

import re
from typing import NamedTuple

import msgspec

_UNKNOWN = re.compile(r"Object contains unknown field `(.+)`", re.DOTALL)
_MISSING = re.compile(r"Object missing required field `(.+)`", re.DOTALL)


class Refusal(NamedTuple):
    """What a record was refused for."""

    where: str
    """path to the value, e.g. ``steps[2].x_mm``; empty: the record itself"""
    key: str | None
    """the key that is unknown or missing there"""
    what: str


def refusal_of(error: msgspec.ValidationError) -> Refusal:
    """Take a decoder's message apart."""
    message = str(error)
    what, _, where = message.rpartition(" - at `")
    if not what:
        what, where = message, "$`"
    where = where.removesuffix("`").removeprefix("$").removeprefix(".")
    if match := _UNKNOWN.fullmatch(what):
        return Refusal(where, match.group(1), f"unknown key {match.group(1)!r}; mistyped?")
    if match := _MISSING.fullmatch(what):
        return Refusal(where, match.group(1), f"the key {match.group(1)!r} is missing")
    what = what.replace("`", "")
    return Refusal(where, None, f"{what[:1].lower()}{what[1:]}")
