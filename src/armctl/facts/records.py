"""Reasons as plain records, for JSON and for other processes."""

from __future__ import annotations

from dataclasses import fields
from enum import Enum
from types import ModuleType
from typing import Any, cast

from armctl.facts import reasons
from armctl.facts.reasons import Reason
from armctl.facts.states import Need, State
from armctl.facts.words import advice, say


def _kinds(module: ModuleType) -> dict[str, type[Reason]]:
    found = (one for one in vars(module).values() if isinstance(one, type) and issubclass(one, Reason))
    return {one.__name__: one for one in found}


KINDS = _kinds(reasons)
_ENUMS = {"need": Need, "state": State}


def fact_record(reason: Reason) -> dict[str, Any]:
    """``fact``, the name of its class, and its fields; reasons inside likewise."""
    return {"fact": type(reason).__name__} | {
        one.name: _plain(getattr(reason, one.name)) for one in fields(reason)
    }


def _plain(value: Any) -> Any:
    if isinstance(value, Reason):
        return fact_record(value)
    if isinstance(value, tuple):
        return [_plain(one) for one in cast(tuple[Any, ...], value)]
    if isinstance(value, float):
        return float(value)  # numpy's is none that every format knows
    return value.value if isinstance(value, Enum) else value


def fact_of(record: dict[str, Any]) -> Reason | None:
    """The reason of a record; None where it is none that this version knows, or can say."""
    try:
        kind = KINDS[record["fact"]]
        reason = kind(**{one.name: _valued(one.name, record[one.name]) for one in fields(kind)})
        "".join([say(reason), advice(reason)])  # texts, or it is none
    except (KeyError, TypeError, ValueError, ArithmeticError, AttributeError, RecursionError):
        return None
    return reason


def _valued(name: str, value: Any) -> Any:
    if name in _ENUMS:
        return _ENUMS[name](value)
    if isinstance(value, dict):
        return fact_of(cast(dict[str, Any], value))
    if isinstance(value, list):
        return tuple(_valued("", one) for one in cast(list[Any], value))
    return value
