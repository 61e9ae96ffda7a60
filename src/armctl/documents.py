"""Files that people write (programs, robot files, calibrations): read strictly, refused in plain words.

Every kind of file has a largest size, and only a regular file is opened: the one place for both. A document
is TOML. It is parsed with ``tomllib``, which lets other threads run meanwhile, and decoded with msgspec.
A refusal names the line, the key, its value and what is allowed.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import re
import reprlib
import stat
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import msgspec
from msgspec import inspect

from armctl.errors import ArmctlError, InputError

T = TypeVar("T")
Place = tuple[str | int, ...]
"""Where a value stands: keys and indices from the top, e.g. ("steps", 2, "x_mm")"""


def as_path(value: str | Path, what: str) -> Path:
    """``value`` as a path; ``InputError`` says ``what`` it has to be."""
    if not isinstance(value, str | os.PathLike):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"{what}, not {value!r}")
    return Path(value)


@dataclass(frozen=True, slots=True)
class DocumentKind:
    """What all documents of one kind share; its methods refuse with ``error``."""

    error: type[ArmctlError]
    most_bytes: int
    """no file is larger"""
    largest: float = math.inf
    """no number is larger"""
    entries: Mapping[str, str] = field(default_factory=dict[str, str])
    """key of a list to what one of its entries is called: the message counts these from 1"""

    def load(self, path: Path, decode: Callable[[bytes], T]) -> T:
        """Decode a file; refuses by its name what ``read`` or ``decode`` refuses."""
        try:
            return decode(self.read(path))
        except self.error as cause:
            raise self.error(f"{path}: {cause}") from cause

    def read(self, path: Path) -> bytes:
        """The bytes of a regular file that is not too large; refuses others, and never waits for one."""
        try:
            # Asked before it is opened: opening a serial port restarts an Arduino.
            require_regular(os.stat(path))
            with open(path, "rb", opener=_open_at_once) as stream:
                found = os.fstat(stream.fileno())
                require_regular(found)
                self._check_size(found.st_size)
                content = stream.read(self.most_bytes + 1) or b""  # None: a file that has nothing yet
        except (OSError, ValueError) as cause:  # ValueError: a name that no file has
            why = cause.strerror if isinstance(cause, OSError) else str(cause)
            raise self.error(f"cannot be read: {why}") from cause
        self._check_size(len(content))  # the files of /proc have no size, and others may grow
        return content

    def _check_size(self, size: int) -> None:
        if size > self.most_bytes:
            raise self.error(f"is larger than {self.most_bytes // 1024} KiB; no such file is")

    def text(self, content: bytes | str) -> str:
        """The text of a file: UTF-8, without a byte order mark, lines ended as they are; refuses others."""
        self._check_size(len(content))
        if isinstance(content, bytes):
            if content.startswith(_UTF16):
                raise self.error("is not a text file in UTF-8 but in UTF-16; save it as UTF-8")
            try:
                content = content.decode()
            except UnicodeDecodeError as cause:
                raise self.error(
                    f"is not a text file in UTF-8: byte {cause.start + 1} cannot be read; save it as UTF-8"
                ) from cause
        return content.removeprefix("\ufeff")

    def parse(self, content: bytes | str) -> Document:
        """The document from the content of its file; refuses what is no text or not TOML."""
        text = self.text(content).replace("\r\n", "\n")  # lines as editors count them
        for number, line in enumerate(text.split("\n"), 1):
            if line.count(".") >= MOST_KEY_PARTS and _LONG_KEY.search(line):
                raise self.error(f"line {number}: a key of more than {MOST_KEY_PARTS} parts")
            if len(line) > MOST_DIGITS and _LONG_NUMBER.search(line):
                raise self.error(f"line {number}: a whole number of more than {MOST_DIGITS} digits")
        try:
            return Document(self, tomllib.loads(text), text)
        except tomllib.TOMLDecodeError as cause:
            raise self.error(_syntax(str(cause))) from cause
        except RecursionError as cause:
            raise self.error("arrays or tables are nested too deep") from cause

    def decode(self, content: bytes | str, model: type[T]) -> T:
        """A struct from the content of its file; refuses as the three methods that it calls."""
        document = self.parse(content)
        found = document.convert(model)
        document.require_numbers()
        return found


@dataclass(frozen=True, slots=True)
class Document:
    """The tables of a document, and the text that they come from."""

    kind: DocumentKind
    record: Mapping[str, Any]
    text: str | None = None
    """None: made in Python; a refusal then names no line"""

    def convert(self, model: type[T], place: Place = ()) -> T:
        """What stands at ``place`` as a struct; refuses an unknown or missing key, a wrong type or value."""
        value: Any = self.record
        for key in place:
            value = value[key]
        try:
            return msgspec.convert(value, model)
        except msgspec.ValidationError as cause:
            refusal = refusal_of(cause, value, model)
            raise self.refusal(refusal.what, (*place, *refusal.place), refusal.key) from cause
        except RecursionError as cause:
            raise self.kind.error("arrays or tables are nested too deep") from cause

    def require_numbers(self) -> None:
        """Refuse numbers that are not finite (TOML knows nan and inf), or too large."""
        for place, number in _numbers(self.record, ()):
            if isinstance(number, float) and not math.isfinite(number):
                raise self.refusal(f"{number} is no number to use", place)
            if abs(number) > self.kind.largest:
                allowed = f"must be within ±{self.kind.largest:.0e}"
                raise self.refusal(f"{allowed}, not {reprlib.repr(number)}", place)

    def refusal(self, what: str, place: Place, key: str | None = None) -> ArmctlError:
        """The error that says what is wrong at a place; ``key`` is unknown or missing there."""
        line = None if self.text is None else line_of(self.text, place if key is None else (*place, key))
        words = [] if line is None else [f"line {line}"]
        match place:
            case (str() as name, int() as index, *rest) if name in self.kind.entries:
                words.append(f"{self.kind.entries[name]} {index + 1}")
                place = tuple(rest)
            case _:
                pass
        if place:
            text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place)
            words.append(f"key {text.removeprefix('.')}")
        return self.kind.error(f"{', '.join(words)}: {what}" if words else what)


MOST_KEY_PARTS = 16
"""of a dotted key: the parser's time grows with their square"""
MOST_DIGITS = 400
"""of a whole number: Python refuses to print one of thousands"""
_LONG_KEY = re.compile(
    r"""(?<![\w-])(?:(?:[\w-]{1,200}+|"(?:\\.|[^"\\]){0,200}+"|'[^']{0,200}+')[ \t]*+\.[ \t]*+)"""
    rf"{{{MOST_KEY_PARTS}}}"
)
_LONG_NUMBER = re.compile(rf"(?<![\w.])\d[\dA-Fa-f_xob]{{{MOST_DIGITS}}}")
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def require_regular(found: os.stat_result) -> None:
    """Refuse (``OSError``) what is no regular file."""
    if not stat.S_ISREG(found.st_mode):
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "of another kind")
        raise OSError(errno.EINVAL, f"it is {kind}, no regular file")


def _open_at_once(path: str, flags: int) -> int:
    # A named pipe without a writer is opened, too, instead of waiting for ever.
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_SYNTAX = re.compile(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", re.DOTALL)


def _syntax(message: str) -> str:
    """The parser's message with the place first."""
    match = _SYNTAX.fullmatch(message)
    if match is None:
        return message
    what, line, column = match.groups()
    what = f"{what[:1].lower()}{what[1:]}"
    return f"{what} at the end of the file" if line is None else f"line {line}, column {column}: {what}"


def _numbers(value: object, place: Place) -> Iterator[tuple[Place, float]]:
    """Every number in a value that was parsed, and where it stands."""
    if isinstance(value, dict):
        for key, one in cast("dict[str, object]", value).items():
            yield from _numbers(one, (*place, key))
    elif isinstance(value, list | tuple):
        for index, one in enumerate(cast("Sequence[object]", value)):
            yield from _numbers(one, (*place, index))
    elif isinstance(value, float | int):
        yield place, value


# A decoder's refusal in plain words.

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
    if (match := _CHOICE.fullmatch(what)) and isinstance(node, inspect.LiteralType):
        return f"{must_be(node.values)}, not {match[1]}"
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
_SKIPPED = (
    r'"""(?:\\.|[^\\])*?"""'  # strings may hold what looks like a header or a key
    r"|'''.*?'''"
    r'|"(?:\\.|[^"\\\n])*"'
    r"|'[^'\n]*'"
    r"|#[^\n]*"
)
_LINES = re.compile(
    rf"^[ \t]*(?P<open>\[\[?)[ \t]*(?P<table>{_NAMES})[ \t]*\]\]?[ \t]*(?=[\n#]|\Z)"
    rf"|^[ \t]*(?P<key>{_NAMES})[ \t]*="
    rf"|{_SKIPPED}",
    re.MULTILINE | re.DOTALL,
)


def line_of(text: str, place: Place) -> int | None:
    """Line of valid TOML, from 1, of a key, or of the table that it is missing in.

    None where it cannot be told: the entries of an array of inline tables have no line.
    """
    entries: dict[Place, int] = {}
    table: Place = ()
    best: Place = ()
    found: int | None = None
    for match in _LINES.finditer(text):
        if match["table"]:
            table = _opened(_names(match["table"]), entries, new=match["open"] == "[[")
            here = table
        elif match["key"]:
            here = (*table, *_names(match["key"]))
        else:
            continue
        if len(here) > len(best) and place[: len(here)] == here:
            best, found = here, match.start()
    rest = place[len(best) :]
    if found is None or (len(rest) > 1 and isinstance(rest[0], int)):
        return None
    return text.count("\n", 0, found) + 1


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


# Writing: a reader, a crash or another save at the same time meets one whole version.


def write_atomically(path: Path, content: bytes, *, keep: bool = False) -> None:
    """Write a file beside ``path`` and let it take its place in one step; the mode of an old file stays.

    A symbolic link is replaced, not followed. With ``keep`` the version before is kept as ``NAME~``. After
    an ``OSError`` what was there before is there still; so it is where that is no regular file.
    """
    mode = 0o644
    if path.exists():
        before = path.stat()
        require_regular(before)  # the version before a pipe could be read for ever
        mode = stat.S_IMODE(before.st_mode)
    written = _beside(path, content, mode)
    try:
        if keep and path.exists():
            # Never written through ``NAME~`` itself: that may be a hard link to the present file.
            _beside(path, path.read_bytes(), mode).replace(path.with_name(f"{path.name}~"))
        written.replace(path)
    except BaseException:
        written.unlink(missing_ok=True)
        raise
    with contextlib.suppress(OSError):  # network file systems and FAT may have no folder to flush
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _beside(path: Path, content: bytes, mode: int) -> Path:
    """A new file in the same folder that holds ``content``, on the disk."""
    handle, name = tempfile.mkstemp(prefix=f".armctl-{os.getpid()}-", suffix=".new", dir=path.parent)
    written = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        written.chmod(mode)
    except BaseException:
        written.unlink(missing_ok=True)
        raise
    return written


def claim(path: Path) -> bool:
    """Make a file that says which process holds it; False where it is there already."""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
    except FileExistsError:
        return False
    with os.fdopen(handle, "w") as stream:
        stream.write(str(os.getpid()))
    return True


_LITTER = re.compile(r"\.armctl-(?P<pid>\d{1,9})-\w+\.new|\..+\.\w{8}\.new|\.\d+\.claim")
LITTER_AGE_S = 60.0
"""A save takes milliseconds."""


def sweep_litter(folder: Path, now: float) -> list[Path]:
    """Remove what killed saves left in a folder of armctl's own and below it; for the start of a program.

    That is a half-written file or a claim older than ``LITTER_AGE_S`` at ``now`` (seconds of the epoch) whose
    process has ended. What cannot be removed stays.
    """
    swept: list[Path] = []
    for place, _, names in os.walk(folder):
        for name in names:
            match, path = _LITTER.fullmatch(name), Path(place) / name
            if match is None:
                continue
            with contextlib.suppress(OSError):  # another program sweeps, too, or the folder is not writeable
                if now - path.lstat().st_mtime > LITTER_AGE_S and has_ended(match["pid"] or _claimant(path)):
                    path.unlink()
                    swept.append(path)
    return swept


def _claimant(path: Path) -> str:
    """The process that a claim names; empty: it was killed before it could write that."""
    with open(path, "rb", opener=_open_at_once) as stream:
        text = stream.read(10).decode(errors="replace")
    return text if text.isdecimal() else ""


def has_ended(process: str) -> bool:
    """Whether nobody works on what a process left, by its number: it has ended, or this one has it now."""
    if not process:
        return True
    if os.name != "posix":  # there, asking would end it
        return False
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return True
    except PermissionError:  # another user's
        return False
    return int(process) == os.getpid()  # it has just begun: in a container every start has the same number
