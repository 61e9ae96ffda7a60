"""msgspec's refusals in the words of the other messages."""

from __future__ import annotations

import re
from typing import NamedTuple, get_args

import msgspec

from armctl.motion.program.program import Step

_UNKNOWN = re.compile(r"Object contains unknown field `(.+)`", re.DOTALL)
_MISSING = re.compile(r"Object missing required field `(.+)`", re.DOTALL)
_KIND = re.compile(r"Invalid value '(.+)'", re.DOTALL)
_BOUND = re.compile(r"Expected `(?:float|int)` (>=|<=|>|<) (\S+)")
_BOUND_WORDS = {">=": "at least", "<=": "at most", ">": "more than", "<": "less than"}


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
    if match := _BOUND.fullmatch(what):
        return Refusal(where, None, f"must be {_BOUND_WORDS[match.group(1)]} {float(match.group(2)):.15g}")
    if where.rpartition(".")[2] == "do" and (match := _KIND.fullmatch(what)):
        kinds = ", ".join(str(kind.__struct_config__.tag) for kind in get_args(Step))
        return Refusal(where, None, f"there is no step {match.group(1)!r}; there are {kinds}")
    what = what.replace("`", "")
    return Refusal(where, None, f"{what[:1].lower()}{what[1:]}")
