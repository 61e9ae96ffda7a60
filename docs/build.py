"""Builds the docs site: ``python docs/build.py [--serve]``, or ``make docs``.

The pages of ``docs/`` and some other Markdown files are staged into ``build/docs``. On the way the tables of
the references are made from armctl itself, and links are led to where their pages are on the site.
"""

from __future__ import annotations

import ast
import dataclasses
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from inspect import cleandoc, getsource
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any, cast

import click
import msgspec
import yaml
from msgspec import inspect

from armctl.cli.main import cli
from armctl.facts import Reason
from armctl.facts.words import KINDS as FACTS
from armctl.hardware.encoder.axes import EncoderBoardEntry, EncoderEntry, GripperEncoderEntry
from armctl.program.base_steps import keys_of
from armctl.program.steps import KINDS, Step
from armctl.robot.board_entries import ServoEntries
from armctl.robot.file import RobotFile
from armctl.robot.look.rows import Row
from armctl.robot.urdf.side_file import SideFile

ROOT = Path(__file__).resolve().parents[1]
FROM_ELSEWHERE = {
    "README.md": "index.md",
    "ARCHITECTURE.md": "architecture.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "CODE_OF_CONDUCT.md": "code-of-conduct.md",
    "SECURITY.md": "security.md",
    "examples/README.md": "examples.md",
    "firmware/README.md": "boards/encoder-firmware.md",
}
"""pages of the site that stand outside of docs/"""


class PagesError(Exception):
    """Something in the pages that has to be mended before the site is built."""


# Tables of structs: keys, types, ranges, defaults, and the docstrings of the fields.

UNITS = {
    "_mm": "mm", "_mm_s": "mm/s", "_deg": "°", "_deg_s": "°/s", "_deg_s2": "°/s²", "_deg_s3": "°/s³",
    "_kg": "kg", "_nm": "N·m", "_s": "s", "seconds": "s", "_us": "µs", "us_per_deg": "µs/°", "percent": "%",
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
            raise PagesError(f"no words for {kind}")


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
            named = isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
            if named and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
                said[field.target.id] = " ".join(str(text.value.value).split())
    return said


def table(struct: type) -> str:
    """The keys of one table of a file."""
    said = said_of(struct)
    rows = [_HEAD]
    shared = set() if struct is Row else {field.name for field in fields_of(Row)}
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
    tables = {
        "`servo` of a joint (Maestro, Firmata)": servo,
        "`servo` of the gripper (Maestro, Firmata)": gripper,
        "`encoder` of a joint (encoder board)": EncoderEntry,
        "`encoder` of the gripper (encoder board)": GripperEncoderEntry,
        "`[board]` of an encoder board, beside `kind`": EncoderBoardEntry,
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


# The command line.


def commands() -> str:
    """Every command with its options."""
    with click.Context(cli, info_name="armctl") as context:
        return "\n\n".join(_command(cli, context))


def _command(command: click.Command, context: click.Context) -> Iterator[str]:
    if isinstance(command, click.Group):
        yield f"## {context.command_path}\n\n{_help(command.help or '')}\n\n{_help(command.epilog or '')}"
        for name in command.list_commands(context):
            inner = cast("click.Command", command.get_command(context, name))
            with click.Context(inner, info_name=name, parent=context) as below:
                yield from _command(inner, below)
        return
    usage = " ".join((context.command_path, *command.collect_usage_pieces(context)))
    yield f"## {context.command_path}\n\n    {usage}\n\n{_help(command.help or '')}"
    records = [one.get_help_record(context) for one in command.get_params(context)]
    if options := [record for record in records if record and record[1] and "--help" not in record[0]]:
        yield "| option | meaning |\n|---|---|\n" + "\n".join(row((f"`{a}`", _line(b))) for a, b in options)


def _help(text: str) -> str:
    """Help as Markdown: what keeps its lines (after a backspace) is a block of code."""
    parts = []
    for part in cleandoc(text).split("\n\n"):
        kept = part.startswith("\b")
        parts.append(re.sub("^", "    ", part.removeprefix("\b\n"), flags=re.MULTILINE) if kept else part)
    return "\n\n".join(parts)


def _line(text: str) -> str:
    return " ".join(text.split()).replace("<", "&lt;").replace("[", "\\[")


GENERATED: Mapping[str, Callable[[], str]] = {
    "robot-file": robot_file,
    "side-file": side_file,
    "board-entries": board_entries,
    "steps": steps,
    "commands": commands,
    "facts": facts,
    "docstrings": str,
}
"""what stands in a page for a line that ends with ``<!-- generated: NAME -->``

The line itself tells those who read the file alone where to see it. Docstrings come out of ``:::``.
"""


# Staging.

_LINK = re.compile(r"(?P<code>^ *```.*?^ *```|`[^`\n]*`)|\]\((?P<to>[^)\s]+)\)", re.M | re.S)


def links_of(text: str, source: str, page: str, placed: dict[str, str], wrong: list[str]) -> str:
    """A page's text with its links as they are on the site.

    ``source`` is the page's path in the repository, ``page`` the one on the site. ``placed`` gives the second
    for the first; other files that are linked are added. A link that leads nowhere is ``wrong``.
    """

    def led(found: re.Match[str]) -> str:
        if found["code"] or re.match(r"[a-z]+:|#", found["to"]):
            return found[0]
        to, mark, anchor = found["to"].partition("#")
        target = os.path.normpath(PurePosixPath(source).parent / to)
        if target.startswith("..") or not (target in placed or (ROOT / target).is_file()):
            wrong.append(f"{source}: the link {found['to']} leads to no file")
        there = placed.setdefault(target, f"source/{target}")
        return f"]({os.path.relpath(there, PurePosixPath(page).parent)}{mark}{anchor})"

    return _LINK.sub(led, text)


def stage(folder: Path) -> None:
    """Write all pages into a folder; raises ``PagesError`` with everything that has to be mended."""
    docs = ROOT / "docs"
    files = [path for path in docs.rglob("*") if path.is_file() and path.suffix not in (".py", ".pyc")]
    placed = {str(path.relative_to(ROOT)): str(path.relative_to(docs)) for path in files}
    placed |= {source: page for source, page in FROM_ELSEWHERE.items() if (ROOT / source).exists()}
    pages = {source: page for source, page in placed.items() if page.endswith(".md")}
    texts: dict[str, str] = {}
    wrong: list[str] = []
    for source, page in pages.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        text = re.sub(r"(?m)^.*<!-- generated: ([\w-]+) -->$", lambda found: GENERATED[found[1]](), text)
        texts[page] = links_of(text, source, page, placed, wrong)
    shown = set(_pages(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]))
    wrong += [f"mkdocs.yml: nav does not name {page}" for page in sorted(texts.keys() - shown)]
    wrong += [f"mkdocs.yml: nav names {page}, which is not there" for page in sorted(shown - texts.keys())]
    if wrong:
        raise PagesError("\n".join(wrong))
    shutil.rmtree(folder, ignore_errors=True)
    for source, page in placed.items():
        target = folder / page
        target.parent.mkdir(parents=True, exist_ok=True)
        if page in texts:
            target.write_text(texts[page], encoding="utf-8")
        else:
            shutil.copy(ROOT / source, target)


def _pages(nav: Any) -> Iterator[str]:
    if isinstance(nav, str):
        yield nav
    else:
        for one in nav.values() if isinstance(nav, dict) else nav:
            yield from _pages(one)


def main(arguments: list[str]) -> int:
    """Stage the pages, and build or serve the site; the exit status."""
    try:
        stage(ROOT / "build" / "docs")
    except PagesError as wrong:
        print(wrong, file=sys.stderr)
        return 1
    program = Path(sys.executable).with_name("zensical")
    os.chdir(ROOT)
    if "--serve" in arguments:
        os.execv(program, [program, "serve"])
    return subprocess.run([program, "build", "--strict", "--clean"], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
