"""The keys of a kind of step, as files, forms, tables and scripts need them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal, cast, get_args, get_type_hints

import msgspec
from msgspec import inspect


@dataclass(frozen=True, slots=True)
class Field:
    """What people and other programs see of one key of a step."""

    label: str
    """of its field in the form; keys with the same label share one"""
    hint: str = ""
    place: int = 50
    """among the fields of the form and the columns of a CSV, from the left"""
    head: str = ""
    """of its CSV column, with the unit; empty: the key's name"""
    choices: tuple[str, ...] = ()
    """what the form offers where the key takes any text, or may be left open"""
    left_open: str = ""
    """what the form shows of a choice that is left open: what it means then"""
    turn: Literal["", "pitch", "orientation"] = ""
    """what of the tool's turn it is about; a step says something of its pitch or of its orientation"""


KeyForm = Literal["number", "integer", "numbers", "text", "choice"]
_FORMS: dict[type[inspect.Type], KeyForm] = {
    inspect.LiteralType: "choice",
    inspect.FloatType: "number",
    inspect.IntType: "integer",
    inspect.VarTupleType: "numbers",
}


@dataclass(frozen=True, slots=True)
class Key:
    """One key of a kind of step."""

    name: str
    field: Field
    form: KeyForm
    choices: tuple[str, ...]
    optional: bool
    """it may be left open"""
    default: object
    """``msgspec.NODEFAULT`` where it must be given"""
    head: str
    """of its CSV column"""


@cache
def keys_of(kind: type[msgspec.Struct]) -> tuple[Key, ...]:
    """The keys of a kind of step, in the order of their fields and columns."""
    hints = get_type_hints(kind, include_extras=True)
    keys: list[Key] = []
    for one in cast("inspect.StructType", inspect.type_info(kind)).fields:
        plain, *extras = get_args(hints[one.name]) or (hints[one.name],)
        shown = next((extra for extra in extras if isinstance(extra, Field)), Field(one.name))
        types = one.type.types if isinstance(one.type, inspect.UnionType) else (one.type,)
        optional = any(isinstance(part, inspect.NoneType) for part in types)
        form = "choice" if shown.choices else _FORMS.get(type(types[0]), "text")
        choices = shown.choices or (get_args(plain) if form == "choice" else ())
        keys.append(Key(one.name, shown, form, choices, optional, one.default, shown.head or one.name))
    return tuple(sorted(keys, key=lambda key: key.field.place))


def literal(value: object) -> str:
    """A value as Python writes it; of the plain types only: a subclass may show itself as anything."""
    match value:
        case bool() | int() | None:
            return repr(value)
        case float():
            return repr(float(value))
        case list() | tuple():
            return f"[{', '.join(map(literal, cast('Sequence[object]', value)))}]"
        case _:
            return repr(str(value))
