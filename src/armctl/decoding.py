"""Decoding what people wrote into structs, and refusing it in plain words.

msgspec ends at the first thing that is wrong. A ``Decoder`` goes on and tells them all. ``line_of`` finds the
line of TOML text that a refusal is about.
"""

from __future__ import annotations

import math
import re
import reprlib
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
                inner = refusal_of(refusal, value, model)
                refusal = inner._replace(place=(*place, *inner.place))
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
                self.refusals.append(Refusal(place, key, f"the key {key!r} is missing"))
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


# A refusal of msgspec in plain words.

_UNKNOWN = re.compile(r"Object contains unknown field `(.+)`", re.DOTALL)
_MISSING = re.compile(r"Object missing required field `(.+)`", re.DOTALL)
_CHOICE = re.compile(r"Invalid (?:enum )?value (.+)", re.DOTALL)
_BOUND = re.compile(r"Expected `(?:float|int)` (?:>=|<=|>|<) \S+")
_LENGTH = re.compile(r"Expected `(array|str)` of length (?:(>=|<=) )?(\d+)(?:, got \d+)?")
_PATTERN = re.compile(r"Expected `str` matching regex '(.*)'", re.DOTALL)
_TYPE = re.compile(r"Expected `([a-z| ]+)`, got `\w+`")
_TYPE_WORDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "array": "a list",
    "object": "a table",
    "null": "left out",
    "bool": "true or false",
}
_LENGTH_WORDS = {None: "", ">=": "at least ", "<=": "at most "}
_STEP = re.compile(r"\[(\d+|\.\.\.)\]|([^.\[]+)")


class Refusal(NamedTuple):
    """What a record was refused for."""

    place: Place
    key: str | None
    """the key that is unknown or missing there"""
    what: str


def refusal_of(error: msgspec.ValidationError, record: object, model: Any) -> Refusal:
    """What the decoder raised on decoding ``record`` as a ``model``, in plain words."""
    what, _, where = str(error).rpartition(" - at `")
    if not what:
        what, where = str(error), "$`"
    where = where.removeprefix("key` in `").removesuffix("`").removeprefix("$")
    steps = _STEP.findall(where)
    place = tuple(int(index) if index.isdigit() else key or "*" for index, key in steps)
    if match := _UNKNOWN.fullmatch(what):
        return Refusal(place, match[1], f"unknown key {match[1]!r}; mistyped?")
    if match := _MISSING.fullmatch(what):
        return Refusal(place, match[1], f"the key {match[1]!r} is missing")
    return Refusal(place, None, _plain_words(what, *_found(record, inspect.type_info(model), place)))


def _plain_words(what: str, value: Any, node: inspect.Type) -> str:
    """What is wrong with a value that should be of the type ``node``."""
    got = "" if value is _LOST else f", not {reprlib.repr(value)}"
    if _BOUND.fullmatch(what) and isinstance(node, inspect.FloatType | inspect.IntType):
        return f"must be {range_words(node)}{got}"
    if match := _CHOICE.fullmatch(what):
        kinds = node.types if isinstance(node, inspect.UnionType) else (node,)
        for kind in kinds:
            if isinstance(kind, inspect.LiteralType):
                other = " or a list" if len(kinds) > 1 else ""
                return f"{must_be(kind.values)}{other}, not {match[1]}{did_you_mean(value, kind.values)}"
    if match := _TYPE.fullmatch(what):
        allowed = " or ".join(_TYPE_WORDS.get(name, name) for name in match[1].split(" | "))
        return f"must be {allowed}{got}"
    if match := _LENGTH.fullmatch(what):
        count, unit = int(match[3]), "character" if match[1] == "str" else "value"
        return f"must have {_LENGTH_WORDS[match[2]]}{count} {unit}{'' if count == 1 else 's'}{got}"
    if match := _PATTERN.fullmatch(what):
        return f"a name must match {match[1]}{got if isinstance(value, str) else ''}"
    what = what.replace("`", "")
    return f"{what[:1].lower()}{what[1:]}"


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


_LOST = object()
"""a value below a key that the decoder does not name"""


def _found(value: Any, node: inspect.Type, place: Place) -> tuple[Any, inspect.Type]:
    """The value at a place of a record, and its type there."""
    for part in place:
        match _one_type(node, value):
            case inspect.StructType(fields=fields):
                node = next(one.type for one in fields if one.encode_name == part)
            case inspect.UnionType(types=kinds):  # of structs, and no kind has the tag that stands there
                node = inspect.LiteralType(
                    tuple(one.tag for one in kinds if isinstance(one, inspect.StructType))
                )
            case (
                inspect.DictType(value_type=inner)
                | inspect.ListType(item_type=inner)
                | inspect.VarTupleType(item_type=inner)
            ):
                node = inner
            case inspect.TupleType(item_types=inners) if isinstance(part, int):
                node = inners[part]
            case _:
                pass
        try:
            value = value[part]
        except (KeyError, TypeError):
            value = _LOST
    return value, _one_type(node, value)


def _one_type(node: inspect.Type, value: Any) -> inspect.Type:
    """A type that may also be None or several kinds of structs: the one that the value is of."""
    if not isinstance(node, inspect.UnionType):
        return node
    kinds = [one for one in node.types if not isinstance(one, inspect.NoneType)]
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
