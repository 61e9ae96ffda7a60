"""Decoding what people wrote into structs, and refusing it in plain words.

msgspec ends at the first thing that is wrong. A ``Decoder`` goes on and tells them all. ``line_of`` finds the
line of TOML text that a refusal is about.
"""

from __future__ import annotations

import math
import re
import reprlib
import sys
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from types import NoneType, UnionType
from typing import Annotated, Any, NamedTuple, TypeVar, Union, cast, get_args, get_origin

import msgspec
from msgspec import inspect

from armctl.errors import RefusedBeforeError

T = TypeVar("T")
Place = tuple[str | int, ...]
"""Where a value stands: keys and indices from the top, e.g. ("steps", 2, "x_mm")"""
MOST_REFUSALS = 50
"""A file with more mistakes than that is no such file; its other ones are not told."""


def _refuse(*_: object) -> Any:
    raise RefusedBeforeError


_USES = (
    "eq ne lt le gt ge hash bool len iter contains getitem getattr float int index str format array "
    "neg abs round add radd sub rsub mul rmul truediv rtruediv pow rpow"
)
REFUSED: Any = type("Refused", (), {f"__{use}__": _refuse for use in _USES.split()})()
"""Stands for a value that was refused: each use of it raises ``RefusedBeforeError``"""


def known(values: Sequence[T]) -> Sequence[T]:
    """A list that was decoded; empty where it was refused as a whole."""
    return () if values is REFUSED else values


class Decoder:
    """Decodes one record; ``refusals`` has what was wrong, in the order of the record."""

    def __init__(self, largest: float = math.inf) -> None:
        """``largest``: no number may be beyond that, nor not finite."""
        self._largest = largest
        self.refusals: list[Refusal] = []

    def decoded(self, value: Any, model: type[T], place: Place = ()) -> T:
        """A value as a ``model``; what is refused in it is ``REFUSED`` there."""
        refusal: Refusal | msgspec.ValidationError | None
        try:
            found = msgspec.convert(value, model)
            refusal = next(self._wrong_numbers(value, place), None)
            if refusal is None:
                return found
        except msgspec.ValidationError as cause:
            refusal = cause
        if len(self.refusals) >= MOST_REFUSALS:
            return REFUSED
        before = len(self.refusals)
        found = self._parts(value, _type_of(model, value), place)
        if len(self.refusals) == before:  # each part of it is right
            if isinstance(refusal, msgspec.ValidationError):
                refusal = refusal_of(refusal, value, model, place)
            self.refusals.append(refusal)
            return REFUSED
        return found

    def _parts(self, value: Any, model: Any, place: Place) -> Any:
        origin, types = get_origin(model), get_args(model)
        if isinstance(value, dict):
            entries = cast("dict[str, Any]", value)
            if isinstance(model, type) and issubclass(model, msgspec.Struct):
                return self._struct(entries, model, place)
            if origin is dict:
                return {
                    self.decoded(key, types[0], (*place, key)): self.decoded(one, types[1], (*place, key))
                    for key, one in entries.items()
                    if self._is_key(key, types[0], place)
                }
        elif isinstance(value, list | tuple) and origin in (list, tuple):
            values = cast("Sequence[Any]", value)
            inner = types if origin is tuple and types[-1] is not ... else (types[0],) * len(values)
            if len(inner) == len(values):
                return tuple(
                    self.decoded(one, kind, (*place, i))
                    for i, (one, kind) in enumerate(zip(values, inner, strict=True))
                )
        return REFUSED

    def _is_key(self, key: str, model: Any, place: Place) -> bool:
        """Whether a table may have such a key; refuses it."""
        before = len(self.refusals)
        self.decoded(key, model, (*place, key))
        return len(self.refusals) == before

    def _struct(self, value: dict[str, Any], model: type[msgspec.Struct], place: Place) -> Any:
        config = model.__struct_config__
        fields = {field.encode_name: field for field in msgspec.structs.fields(model)}
        mistyped = set[str]()
        """keys that are missing because another one is mistyped"""
        for key in value if config.forbid_unknown_fields else ():
            if key not in fields and key != config.tag_field:
                meant = _nearest(key, fields.keys() - value.keys()) or _nearest(key, fields)
                mistyped.add(meant)
                hint = f"Did you mean {meant!r}?" if meant else f"Here may stand {', '.join(fields)}"
                self.refusals.append(Refusal(place, key, f"unknown key {key!r}; mistyped? {hint}"))
        entries: dict[str, Any] = {}
        for key, field in fields.items():
            if key in value:
                entries[field.name] = self.decoded(value[key], field.type, (*place, key))
            elif key in mistyped:
                entries[field.name] = REFUSED
            elif field.required:
                self.refusals.append(_missing(key, place))
                entries[field.name] = REFUSED
        return model(**entries)

    def _wrong_numbers(self, value: object, place: Place) -> Iterator[Refusal]:
        """Every number in a value that was parsed that is not finite, or too large."""
        if isinstance(value, dict):
            for key, one in cast("dict[str, object]", value).items():
                yield from self._wrong_numbers(one, (*place, key))
        elif isinstance(value, list | tuple):
            for index, one in enumerate(cast("Sequence[object]", value)):
                yield from self._wrong_numbers(one, (*place, index))
        elif isinstance(value, float) and not math.isfinite(value):
            yield Refusal(place, None, f"{value} is no number to use")
        elif isinstance(value, float | int) and abs(value) > self._largest:
            allowed = f"must be within ±{self._largest:.0e}"
            yield Refusal(place, None, f"{allowed}, not {reprlib.repr(value)}")


def _type_of(model: Any, value: object) -> Any:
    """A type without what is annotated; of a union without None, the struct whose tag the value has."""
    if get_origin(model) is Annotated:
        return _type_of(get_args(model)[0], value)
    if get_origin(model) not in (Union, UnionType):
        return model
    kinds = [_type_of(one, value) for one in get_args(model) if one is not NoneType]
    if len(kinds) == 1:
        return kinds[0]
    tags = cast("dict[object, object]", value) if isinstance(value, dict) else {}
    for kind in kinds:
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            config = kind.__struct_config__
            if config.tag is not None and tags.get(config.tag_field) == config.tag:
                return kind
    return model


def did_you_mean(word: object, known: Iterable[object]) -> str:
    """``; did you mean 'elbow'?``, where something that is known is alike; else nothing."""
    near = _nearest(str(word), map(str, known))
    return f"; did you mean {near!r}?" if near else ""


def _nearest(word: str, known: Iterable[str]) -> str:
    """The word that is alike, whatever its case and its dashes, underscores and spaces."""
    from difflib import get_close_matches  # 2 ms that only a refusal needs

    plain = {_plain(one): one for one in known}
    return next((plain[one] for one in get_close_matches(_plain(word), plain, 1)), "")


def _plain(word: str) -> str:
    return re.sub(r"[-_ ]", "", word.casefold())


# Why msgspec refuses a record: its words are not read, the record is looked at again.


class Refusal(NamedTuple):
    """What a record was refused for."""

    place: Place
    key: str | None
    """the key that is unknown or missing there"""
    what: str


def refusal_of(error: msgspec.ValidationError, record: object, model: Any, place: Place = ()) -> Refusal:
    """The first thing that is wrong with a ``record`` at a place that the decoder refused as a ``model``."""
    found = _wrong(record, inspect.type_info(model), place)
    return found or Refusal(place, None, str(error.__cause__ or error))  # what a struct itself refuses


_KIND_WORDS = {
    "bool": "true or false", "int": "a whole number", "float": "a number", "str": "text",
    "object": "a table", "array": "a list", "null": "left out",
}  # fmt: skip
_KINDS: dict[type[inspect.Type], str] = {
    inspect.BoolType: "bool", inspect.IntType: "int", inspect.FloatType: "float", inspect.StrType: "str",
    inspect.DictType: "object", inspect.StructType: "object", inspect.NoneType: "null",
    inspect.ListType: "array", inspect.TupleType: "array", inspect.VarTupleType: "array",
}  # fmt: skip
_TAKEN_AS: dict[type, tuple[str, ...]] = {
    bool: ("bool",), int: ("int", "float"), float: ("float",), str: ("str",),
    dict: ("object",), list: ("array",), tuple: ("array",), NoneType: ("null",),
}  # fmt: skip


def _kinds(node: inspect.Type) -> set[str]:
    """What may stand where such a type is asked for; empty: anything."""
    if isinstance(node, inspect.UnionType):
        each = [_kinds(one) for one in node.types]
        return set[str]().union(*each) if all(each) else set()
    if isinstance(node, inspect.LiteralType):
        return {"int" if isinstance(value, int) else "str" for value in node.values}
    return {_KINDS[type(node)]} if type(node) in _KINDS else set()


def _wrong(value: object, node: inspect.Type, place: Place) -> Refusal | None:
    """The first thing that is wrong with a value that should be of the type ``node``; None: not found."""
    allowed = _kinds(node)
    if allowed and allowed.isdisjoint(_TAKEN_AS.get(type(value), ())):
        words = " or ".join(words for kind, words in _KIND_WORDS.items() if kind in allowed)
        return Refusal(place, None, f"must be {words}, not {reprlib.repr(value)}")
    node = _one_type(node, value)
    if isinstance(value, dict):
        return _wrong_table(cast("dict[str, Any]", value), node, place)
    if isinstance(value, list | tuple):
        return _wrong_list(cast("Sequence[Any]", value), node, place)
    what = _wrong_choice(value, node) or _wrong_number(value, node) or _wrong_text(value, node)
    return Refusal(place, None, what) if what else None


def _wrong_choice(value: Any, node: inspect.Type) -> str:
    """What is wrong with what should be one of some values; empty: nothing is."""
    for kind in node.types if isinstance(node, inspect.UnionType) else (node,):
        if isinstance(kind, inspect.LiteralType) and value not in (None, *kind.values):
            other = "" if kind is node else " or a list"
            return f"{must_be(kind.values)}{other}, not {value!r}{did_you_mean(value, kind.values)}"
    return ""


def _wrong_number(value: Any, node: inspect.Type) -> str:
    """What is wrong with a number; empty: nothing is."""
    if not isinstance(node, inspect.FloatType | inspect.IntType):
        return ""
    if isinstance(node, inspect.FloatType) and isinstance(value, int) and abs(value) > sys.float_info.max:
        return "number out of range"
    low = (node.ge is None or value >= node.ge) and (node.gt is None or value > node.gt)
    high = (node.le is None or value <= node.le) and (node.lt is None or value < node.lt)
    return "" if low and high else f"must be {range_words(node)}, not {reprlib.repr(value)}"


def _wrong_text(value: Any, node: inspect.Type) -> str:
    """What is wrong with a text; empty: nothing is."""
    if not isinstance(node, inspect.StrType):
        return ""
    if what := _wrong_length(value, node, "character"):
        return what
    matches = node.pattern is None or re.search(node.pattern, value)
    return "" if matches else f"a name must match {node.pattern}, not {reprlib.repr(value)}"


def _wrong_length(value: Any, node: Any, unit: str) -> str:
    """What is wrong with how much there is; empty: nothing is."""
    if node.min_length is not None and len(value) < node.min_length:
        return _must_have(f"at least {node.min_length}", node.min_length, unit, value)
    if node.max_length is not None and len(value) > node.max_length:
        return _must_have(f"at most {node.max_length}", node.max_length, unit, value)
    return ""


def _must_have(words: str, count: int, unit: str, value: object) -> str:
    return f"must have {words} {unit}{'' if count == 1 else 's'}, not {reprlib.repr(value)}"


def _wrong_list(value: Sequence[Any], node: inspect.Type, place: Place) -> Refusal | None:
    """The first thing that is wrong with a list."""
    match node:
        case inspect.TupleType(item_types=inner):
            if (count := len(inner)) != len(value):
                return Refusal(place, None, _must_have(str(count), count, "value", value))
        case inspect.ListType() | inspect.VarTupleType():
            if what := _wrong_length(value, node, "value"):
                return Refusal(place, None, what)
            inner = (node.item_type,) * len(value)
        case _:
            return None
    each = enumerate(zip(value, inner, strict=True))
    return next(filter(None, (_wrong(one, kind, (*place, k)) for k, (one, kind) in each)), None)


def _wrong_table(value: dict[str, Any], node: inspect.Type, place: Place) -> Refusal | None:
    """The first thing that is wrong with a table."""
    if isinstance(node, inspect.DictType):
        if what := _wrong_length(value, node, "value"):
            return Refusal(place, None, what)
        for key, one in value.items():
            for part, kind in ((key, node.key_type), (one, node.value_type)):
                if found := _wrong(part, kind, (*place, key)):
                    return found
        return None
    kinds = node.types if isinstance(node, inspect.UnionType) else (node,)
    structs = [one for one in kinds if isinstance(one, inspect.StructType)]
    tags = {one.tag_field: [other.tag for other in structs] for one in structs if one.tag_field is not None}
    for key, allowed in tags.items():  # of structs, and no kind has the tag that stands there
        if key in value and value[key] not in allowed:
            return _wrong(value[key], inspect.LiteralType(tuple(allowed)), (*place, key))
        if key not in value and len(structs) > 1:
            return _missing(key, place)
    if len(structs) != 1:
        return None
    fields = {one.encode_name: one for one in structs[0].fields}
    for key, one in value.items():
        if key in fields:
            if found := _wrong(one, fields[key].type, (*place, key)):
                return found
        elif structs[0].forbid_unknown_fields and key not in tags:
            return Refusal(place, key, f"unknown key {key!r}; mistyped?")
    absent = [key for key, one in fields.items() if one.required and key not in value]
    return _missing(absent[0], place) if absent else None


def _missing(key: str, place: Place) -> Refusal:
    return Refusal(place, key, f"the key {key!r} is missing")


def must_be(choices: Sequence[object]) -> str:
    """What may stand where only some values may: "must be one of 'a', 'b'"."""
    allowed = ", ".join(repr(choice) for choice in choices)
    return f"must be {'one of ' if len(choices) > 1 else ''}{allowed}"


def range_words(node: inspect.FloatType | inspect.IntType) -> str:
    """Which numbers are allowed: "0 … 100", "more than 0"."""
    if node.ge is not None and node.le is not None:
        return f"{node.ge:.15g} … {node.le:.15g}"
    bounds = (("at least", node.ge), ("more than", node.gt), ("at most", node.le), ("less than", node.lt))
    return " and ".join(f"{word} {bound:.15g}" for word, bound in bounds if bound is not None)


def _one_type(node: inspect.Type, value: object) -> inspect.Type:
    """A type that may also be None or several kinds of structs: the one that the value is of."""
    if not isinstance(node, inspect.UnionType):
        return node
    fits = set(_KIND_WORDS if isinstance(value, str) else _TAKEN_AS.get(type(value), ()))
    kinds = [one for one in node.types if not isinstance(one, inspect.NoneType) and _kinds(one) & fits]
    tags = cast("dict[object, object]", value) if isinstance(value, dict) else {}
    for one in kinds:
        if isinstance(one, inspect.StructType) and one.tag is not None and tags.get(one.tag_field) == one.tag:
            return one
    return kinds[0] if len(kinds) == 1 else node


# On which line of a TOML text something stands.

_NAME = r"""(?:[A-Za-z0-9_-]+|"(?:\\.|[^"\\\n])*"|'[^'\n]*')"""
_NAMES = rf"{_NAME}(?:[ \t]*\.[ \t]*{_NAME})*"
_HEADER = re.compile(rf"(?P<open>\[\[?)[ \t]*(?P<table>{_NAMES})[ \t]*\]\]?")
_KEY = re.compile(rf"(?P<key>{_NAMES})[ \t]*=[ \t]*")
_SPACE = re.compile(r"(?:[ \t\n]+|#[^\n]*)*")
_SCALAR = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}'  # a string may hold what looks like a header or a key
    r"|'{3}.*?'{3,5}"
    r'|"(?:\\.|[^"\\\n])*"'
    r"|'[^'\n]*'"
    r"|[^,\]}\n#]+",
    re.DOTALL,
)


def line_of(text: str, place: Place) -> int | None:
    """Line of valid TOML, from 1, of a key or an entry of a list, or of the table that it is missing in."""
    offsets = _offsets(text)
    while place and place not in offsets:
        place = place[:-1]
    return text.count("\n", 0, offsets[place]) + 1 if place else None


@lru_cache(maxsize=1)
def _offsets(text: str) -> dict[Place, int]:
    """Where everything in valid TOML begins."""
    found: dict[Place, int] = {}
    entries: dict[Place, int] = {}
    table: Place = ()
    at = _after_space(text, 0)
    while at < len(text):
        if match := _HEADER.match(text, at):
            table = _opened(_names(match["table"]), entries, new=match["open"] == "[[")
            for length in range(1, len(table) + 1):
                found.setdefault(table[:length], at)
            at = match.end()
        else:
            at = _entry(text, at, table, found)
        at = _after_space(text, at)
    return found


def _entry(text: str, at: int, table: Place, found: dict[Place, int]) -> int:
    """Note ``key = value`` at an offset, and what is in the value; where it ends."""
    match = _KEY.match(text, at)
    if match is None:
        raise ValueError(f"no TOML at offset {at}")
    here = table
    for name in _names(match["key"]):
        here = (*here, name)
        found.setdefault(here, at)
    return _value(text, match.end(), here, found)


def _value(text: str, at: int, here: Place, found: dict[Place, int]) -> int:
    """Note what is in a value at an offset; where it ends."""
    opening = text[at]
    if opening not in "[{":
        match = _SCALAR.match(text, at)
        return at + 1 if match is None else match.end()
    at, count = _after_space(text, at + 1), 0
    while text[at] not in "]}":
        if opening == "{":
            at = _entry(text, at, here, found)
        else:
            found.setdefault((*here, count), at)
            at = _value(text, at, (*here, count), found)
        count += 1
        at = _after_space(text, at)
        if text[at] == ",":
            at = _after_space(text, at + 1)
    return at + 1


def _after_space(text: str, at: int) -> int:
    match = _SPACE.match(text, at)
    return at if match is None else match.end()


def _names(text: str) -> list[str]:
    return [name.strip("\"'") for name in re.findall(_NAME, text)]


def _opened(names: Sequence[str], entries: dict[Place, int], *, new: bool) -> Place:
    """Where a header leads: the last entry of each array of tables, or a new one of its own array."""
    table: Place = ()
    for index, name in enumerate(names):
        table = (*table, name)
        if new and index == len(names) - 1:
            entries[table] = entries.get(table, -1) + 1
        if table in entries:
            table = (*table, entries[table])
    return table
