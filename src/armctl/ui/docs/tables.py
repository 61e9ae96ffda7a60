"""Tables of the references, made from armctl itself: what files, steps and facts hold.

They stand in a page for a line that ends with ``<!-- generated: NAME -->``, on the published site and in what
the console serves.
"""

from __future__ import annotations

import ast
import dataclasses
import pkgutil
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from inspect import Parameter, Signature, getdoc, getsource, isfunction, signature
from itertools import pairwise
from textwrap import indent
from types import ModuleType
from typing import cast

import msgspec
from msgspec import inspect

from armctl.facts import Reason
from armctl.facts.words import KINDS as FACTS
from armctl.hardware.boards import SHIPPED
from armctl.hardware.bus import BusEntries
from armctl.hardware.encoder.axes import EncoderBoardEntry, EncoderEntry, GripperEncoderEntry
from armctl.hardware.pca9685 import Pca9685Options
from armctl.program.base_steps import keys_of
from armctl.program.steps import KINDS, Step
from armctl.robot.board_entries import ServoEntries
from armctl.robot.file import RobotFile
from armctl.robot.look.rows import Row
from armctl.robot.urdf.side_file import SideFile

# Tables of structs: keys, types, ranges, defaults, and the docstrings of the fields.

UNITS = {
    "_mm": "mm", "_mm_s": "mm/s", "_deg": "°", "_deg_s": "°/s", "_deg_s2": "°/s²", "_deg_s3": "°/s³",
    "_kg": "kg", "_nm": "N·m", "_s": "s", "seconds": "s", "_us": "µs", "us_per_deg": "µs/°",
    "steps_per_deg": "steps/°", "_steps": "steps", "percent": "%",
    "_percent_s": "%/s", "counts_per_deg": "counts/°", "_counts": "counts", "_counts_s": "counts/s",
}  # fmt: skip
"""the unit that a key ends in"""
_HEAD = "| key | value | if left out | meaning |\n|---|---|---|---|"
_TEXTS = {r"^#[0-9a-fA-F]{6}$": "colour, `#rrggbb`", r"^[a-z][a-z0-9_]*$": "name in `a-z 0-9 _`"}


def unit(key: str) -> str:
    """The unit that a key names, to stand behind what its value must be; empty for none."""
    return next((f" [{UNITS[end]}]" for end in sorted(UNITS, key=len, reverse=True) if key.endswith(end)), "")


def bounds(kind: inspect.FloatType | inspect.IntType) -> str:
    """The range of a number."""
    low = kind.ge if kind.ge is not None else kind.gt
    high = kind.le if kind.le is not None else kind.lt
    if low is None or high is None:
        one = [("≥", kind.ge), (">", kind.gt), ("≤", kind.le), ("<", kind.lt)]
        return " ".join(f"{sign} {value:g}" for sign, value in one if value is not None)
    more = "more than " if kind.gt is not None else ""
    return f"{more}{low:g} … {high:g}"


def words(kind: inspect.Type) -> str:
    """What a value must be."""
    match kind:
        case inspect.FloatType() | inspect.IntType():
            whole = "whole number" if isinstance(kind, inspect.IntType) else "number"
            return " ".join(filter(None, (whole, bounds(kind))))
        case inspect.BoolType():
            return "`true` or `false`"
        case inspect.StrType():
            return _TEXTS.get(kind.pattern or "", "text")
        case inspect.LiteralType():
            return " or ".join(f"`{msgspec.json.encode(value).decode()}`" for value in kind.values)
        case inspect.TupleType():
            return f"{len(kind.item_types)} values, each: {words(kind.item_types[0])}"
        case inspect.VarTupleType() | inspect.ListType():
            return f"list of: {words(kind.item_type)}"
        case inspect.DictType():
            return f"table, each value: {words(kind.value_type)}"
        case inspect.StructType():
            return "table, see below"
        case inspect.UnionType():
            known = [words(one) for one in kind.types if not isinstance(one, inspect.NoneType)]
            return " or ".join(dict.fromkeys(known))
        case _:
            raise TypeError(f"no words for {kind}")


def default(field: inspect.Field) -> str:
    """What counts where the key is left out."""
    if field.required:
        return "**needed**"
    plain = field.default
    if plain is msgspec.NODEFAULT or isinstance(plain, msgspec.Struct) or not (plain or plain == 0):
        return "–"
    return f"`{msgspec.json.encode(plain).decode()}`"


def fields_of(struct: type) -> tuple[inspect.Field, ...]:
    """The fields of a struct."""
    return cast("inspect.StructType", inspect.type_info(struct)).fields


def said_of(struct: type) -> dict[str, str]:
    """The docstrings of the fields of a class and of those that it is made from."""
    said: dict[str, str] = {}
    for one in reversed(struct.__mro__):
        if not one.__module__.startswith("armctl"):
            continue
        try:
            body = cast("ast.ClassDef", ast.parse(getsource(one)).body[0]).body
        except OSError:  # made while the program runs: there is no source
            continue
        for field, text in pairwise(body):
            if not isinstance(field, ast.AnnAssign) or not isinstance(field.target, ast.Name):
                continue
            if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
                said[field.target.id] = " ".join(str(text.value.value).split())
    return said


def table(struct: type) -> str:
    """The keys of one table of a file."""
    said = said_of(struct)
    rows = [_HEAD]
    shared: set[str] = set() if struct is Row else {field.name for field in fields_of(Row)}
    for field in fields_of(struct):
        if not (issubclass(struct, Row) and field.name in shared):  # they have a table of their own
            value, meaning = words(field.type), said.get(field.name) or _about(field.type)
            rows.append(row((f"`{field.encode_name}`", value + unit(field.name), default(field), meaning)))
    return "\n".join(rows)


def _about(kind: inspect.Type) -> str:
    """What a table says of itself, for a key without a docstring."""
    kinds = kind.types if isinstance(kind, inspect.UnionType) else (kind,)
    found = next((one.cls for one in kinds if isinstance(one, inspect.StructType)), None)
    return " ".join((found.__doc__ or "").split()) if found else ""


def row(cells: tuple[str, ...]) -> str:
    """A line of a Markdown table; a bar inside of code stands for itself."""
    return "| " + " | ".join(re.sub(r"(`[^`]*`)|\|", lambda f: f[1] or "\\|", cell) for cell in cells) + " |"


def tables_within(struct: type, path: str = "") -> Iterator[tuple[str, type]]:
    """All tables of a file with their place in it, from the top."""
    yield path, struct
    for field in fields_of(struct):
        kinds = field.type.types if isinstance(field.type, inspect.UnionType) else (field.type,)
        for kind in kinds:
            many = isinstance(kind, inspect.VarTupleType)
            inner = kind.item_type if isinstance(kind, inspect.VarTupleType) else kind
            place = f"{path.strip('[]')}.{field.name}".lstrip(".")
            if isinstance(inner, inspect.UnionType):  # the solids of a look
                solids = [one.cls for one in inner.types if isinstance(one, inspect.StructType)]
                yield f"[[{place}]]", Row
                yield from ((f'{place}, solid = "{one.__struct_config__.tag}"', one) for one in solids)
            elif isinstance(inner, inspect.StructType):
                yield from tables_within(inner.cls, f"[[{place}]]" if many else f"[{place}]")


def robot_file() -> str:
    """Every table of a robot file."""
    return _sections(tables_within(RobotFile))


def side_file() -> str:
    """Every table of a side file that a robot file has not."""
    shared = {struct for _, struct in tables_within(RobotFile)}
    return _sections((place, struct) for place, struct in tables_within(SideFile) if struct not in shared)


def _sections(tables: Iterable[tuple[str, type]]) -> str:
    parts: list[str] = []
    for place, struct in tables:
        head = f"### `{place}`" if place else "### Top of the file"
        parts += [head, " ".join((struct.__doc__ or "").split()), table(struct)]
    return "\n\n".join(parts)


def board_entries() -> str:
    """The tables that boards read."""
    servo, gripper = ServoEntries().models
    buses: dict[BusEntries, list[str]] = {}
    for board in SHIPPED:
        if isinstance(board.entries, BusEntries):
            buses.setdefault(board.entries, []).append(f"`{board.kind}`")
    of_buses = {
        f"`servo` of {part} ({', '.join(kinds)}: the channel is the servo's id)": model
        for entries, kinds in buses.items()
        for part, model in zip(("a joint", "the gripper"), entries.models, strict=True)
    }
    tables = {
        "`servo` of a joint (Maestro, Firmata, PCA9685)": servo,
        "`servo` of the gripper (Maestro, Firmata, PCA9685)": gripper,
        **of_buses,
        "`encoder` of a joint (encoder board)": EncoderEntry,
        "`encoder` of the gripper (encoder board)": GripperEncoderEntry,
        "`[board]` of an encoder board, beside `kind`": EncoderBoardEntry,
        "`[board]` of a PCA9685, beside `kind`": Pca9685Options,
    }
    return "\n\n".join(f"### {head}\n\n{table(struct)}" for head, struct in tables.items())


def steps() -> str:
    """Every kind of step of a program."""
    return "\n\n".join(_step(kind) for kind in KINDS)


def _step(kind: type[Step]) -> str:
    fields = {field.name: field for field in fields_of(kind)}
    rows = [_HEAD]
    for key in keys_of(kind):
        field = fields[key.name]
        value = " or ".join(f"`{choice}`" for choice in key.choices) or words(field.type)
        column = "" if key.head == key.name else f"CSV column: `{key.head}`."
        told = " ".join(filter(None, (key.field.hint, column)))
        left_out = f"`{key.field.left_open}`" if key.field.left_open else default(field)
        rows.append(row((f"`{key.name}`", value + unit(key.name), left_out, told)))
    call = f"In Python: `arm.{kind.call[0]}(…)`." if kind.call else ""
    button = f"In the page: **{kind.button[1]}**." if kind.button else ""
    text = " ".join(filter(None, (" ".join((kind.__doc__ or "").split()), button, call)))
    return f"### `{kind.__struct_config__.tag}`\n\n{text}\n\n" + "\n".join(rows)


# Facts.


def facts() -> str:
    """Every kind of reason, as clients get it: its name, its fields and what it means."""
    lines = ["| fact | fields | meaning |", "|---|---|---|"]
    for name, kind in sorted(FACTS.items()):
        if kind is not Reason:
            fields = "<br>".join(_fact_fields(kind))
            lines.append(row((f"`{name}`", fields, " ".join((kind.__doc__ or "").split()))))
    return "\n".join(lines)


def _fact_fields(kind: type[Reason]) -> Iterator[str]:
    said = said_of(kind)
    for field in dataclasses.fields(kind):
        yield f"`{field.name}`" + (f": {said[field.name]}" if field.name in said else "")


TABLES: Mapping[str, Callable[[], str]] = {
    "robot-file": robot_file,
    "side-file": side_file,
    "board-entries": board_entries,
    "steps": steps,
    "facts": facts,
}
"""Markdown by the name that a page calls it"""


# Docstrings.

_BLOCK = re.compile(r"(?m)^::: (?P<name>[\w.]+)\n(?P<options>(?: +.*\n)*)")
_MEMBERS = re.compile(r"members: *\[(?P<names>[^]]*)\]")


def with_docstrings(text: str) -> str:
    """A page in which ``::: name`` becomes what the object of this name says of itself."""
    return _BLOCK.sub(lambda found: _docstring(found["name"], found["options"]), text)


def _docstring(name: str, options: str) -> str:
    shown: object = pkgutil.resolve_name(name)
    last = name.rpartition(".")[2]
    wanted = _MEMBERS.search(options)
    names = re.findall(r"\w+", wanted["names"]) if wanted else _members(shown, "inherited_members" in options)
    parts = [f"### `{last}`", _fenced(f"{last}{_arguments(shown)}", getdoc(shown))]
    for key in names:
        member: object = getattr(shown, key, None)  # what only its instances have says nothing
        if said := getdoc(member) if callable(member) or isinstance(member, property) else None:
            parts.append(_fenced(f"{last}.{key}{_arguments(member)}", said))
    return "\n\n".join(parts) + "\n"


def _members(shown: object, inherited: bool) -> list[str]:
    """The public names in a module or a class; of a module those of its own classes."""
    if isinstance(shown, ModuleType):
        kinds = [one for one in vars(shown).values() if isinstance(one, type)]
        return [one.__name__ for one in kinds if one.__module__ == shown.__name__]
    if not isinstance(shown, type):
        return []
    classes = shown.__mro__[:-1] if inherited else (shown,)
    return list(dict.fromkeys(key for one in classes for key in vars(one) if key[0] != "_"))


def _fenced(head: str, said: str | None) -> str:
    return f"~~~text\n{head}\n\n{indent(said or '', '    ')}\n~~~"


def _arguments(shown: object) -> str:
    """The arguments of a function with their defaults; empty for what is not called."""
    if not isfunction(shown):
        return ""
    found = signature(shown)
    given = [one for one in found.parameters.values() if one.name != "self"]
    bare = [one.replace(annotation=Parameter.empty) for one in given]
    return str(found.replace(parameters=bare, return_annotation=Signature.empty))
