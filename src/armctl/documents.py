"""Files that people write (programs, robot files, calibrations): read strictly, refused in plain words.

Every kind of file has a largest size, and only a regular file is opened: the one place for both. A document
is TOML. It is parsed with ``tomllib``, which lets other threads run meanwhile, and decoded with msgspec.
A refusal names the line, the key, its value and what is allowed.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import math
import os
import re
import stat
import tempfile
import tomllib
from collections.abc import Callable, Generator, Mapping
from dataclasses import field
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from armctl.decoding import Decoder, Place, line_of
from armctl.errors import ArmctlError, Errors, InputError
from armctl.lazy_dataclass import dataclass
from armctl.system import whose

T = TypeVar("T")


LFS_POINTER = "is a Git LFS pointer, not the file itself; run git lfs pull where it was cloned"
_LFS_MARK = b"version https://git-lfs.github.com/spec/"


def is_lfs_pointer(path: Path) -> bool:
    """Whether a regular file only says where Git keeps what it should hold."""
    try:
        require_regular(os.stat(path))
        with open(path, "rb", opener=open_at_once) as stream:
            return stream.read(len(_LFS_MARK)) == _LFS_MARK
    except OSError:
        return False


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
    """key of a list, or ``table.key``, to what an entry is called: messages count these from 1"""

    def load(self, path: Path, decode: Callable[[bytes], T]) -> T:
        """Decode a file; refuses by its name what ``read`` or ``decode`` refuses."""
        try:
            return decode(self.read(path))
        except self.error as cause:
            raise cause.about(str(path)) from cause

    def read(self, path: Path) -> bytes:
        """The bytes of a regular file that is not too large; refuses others, and never waits for one."""
        try:
            # Asked before it is opened: opening a serial port restarts an Arduino.
            require_regular(os.stat(path))
            with open(path, "rb", opener=open_at_once) as stream:
                found = os.fstat(stream.fileno())
                require_regular(found)
                self._check_size(found.st_size)
                content = stream.read(self.most_bytes + 1) or b""  # None: a file that has nothing yet
        except (OSError, ValueError) as cause:  # ValueError: a name that no file has
            why = cause.strerror if isinstance(cause, OSError) else str(cause)
            raise self.error(f"cannot be read: {why}") from cause
        self._check_size(len(content))  # the files of /proc have no size, and others may grow
        if content.startswith(_LFS_MARK):
            raise self.error(LFS_POINTER)
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
        return self.parse(content).convert(model)


@dataclass(frozen=True, slots=True)
class Document:
    """The tables of a document, and the text that they come from."""

    kind: DocumentKind
    record: Mapping[str, Any]
    text: str | None = None
    """None: made in Python; a refusal then names no line"""

    def convert(self, model: type[T], place: Place = ()) -> T:
        """What stands at ``place`` as a struct; refuses every unknown or missing key, wrong type or value.

        Numbers that are not finite (TOML knows nan and inf) are refused, and those that are too large.
        """
        errors = Errors()
        found = self.decoded(model, errors, place)
        errors.raise_all()
        return found

    def decoded(self, model: type[T], errors: Errors, place: Place = ()) -> T:
        """As ``convert``, but ``errors`` takes the refusals; what was refused is ``REFUSED`` there."""
        value: Any = self.record
        for key in place:
            value = value[key]
        decoder = Decoder(self.kind.largest)
        try:
            found = decoder.decoded(value, model, place)
        except RecursionError as cause:
            raise self.kind.error("arrays or tables are nested too deep") from cause
        errors.found += (self.refusal(one.what, one.place, one.key) for one in decoder.refusals)
        return found

    def refusal(self, what: str, place: Place, key: str | None = None) -> ArmctlError:
        """The error that says what is wrong at a place; ``key`` is unknown or missing there."""
        words: list[str] = []
        shown = place
        match place:
            case (str() as name, int() as index, *rest) if name in self.kind.entries:
                words.append(f"{self.kind.entries[name]} {index + 1}")
                shown = tuple(rest)
            case (str() as table, str() as name, int() as index, *rest) if (
                f"{table}.{name}" in self.kind.entries
            ):
                words.append(f"{self.kind.entries[f'{table}.{name}']} {index + 1}")
                shown = tuple(rest)
            case _:
                pass
        if shown:
            text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in shown)
            words.append(f"key {text.removeprefix('.')}")
        what = f"{', '.join(words)}: {what}" if words else what
        return self.error(what, place if key is None else (*place, key), ", " if words else ": ")

    @contextlib.contextmanager
    def at(self, place: Place) -> Generator[None]:
        """What is refused inside names the line of a place."""
        try:
            yield
        except self.kind.error as cause:
            raise self.error(str(cause), place) from cause

    def error(self, what: str, place: Place, between: str = ": ") -> ArmctlError:
        """``what``, with the line of a place before it."""
        line = None if self.text is None else line_of(self.text, place)
        error = self.kind.error(what if line is None else f"line {line}{between}{what}")
        error.line = line
        return error


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


def open_at_once(path: str, flags: int) -> int:
    """An ``opener`` for ``open`` that does not wait for ever where a named pipe has no writer."""
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


# Files that are shipped.


def shipped_folder(name: str) -> Path:
    """A folder that armctl is shipped with: inside an installed package, or beside ``src`` in a checkout."""
    package = Path(str(files("armctl")))
    installed = package / name
    return installed if installed.is_dir() else package.parent.parent / name


# Writing: a reader, a crash or another save at the same time meets one whole version.


_SAVE_AGAIN = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), "free some space on that disk, then save again"),
    errno.EROFS: "that disk may only be read: allow writing, then save again",
    **dict.fromkeys((errno.EACCES, errno.EPERM), "you may not write there: allow it, then save again"),
}


_UNSAFE = re.compile(r"[^A-Za-z0-9_-]+")
_LONGEST_NAME = 40


def safe_name(text: str) -> str:
    """A file name for any text: readable where it can be, its own for each text on every file system."""
    readable = _UNSAFE.sub("_", text)[:_LONGEST_NAME]
    return f"{readable}-{hashlib.sha256(text.encode(errors='surrogatepass')).hexdigest()[:12]}"


def not_written(path: Path, cause: OSError) -> str:
    """Text for a file or folder that cannot be written: why, and what to do where that is known."""
    advice = _SAVE_AGAIN.get(cause.errno or 0)
    return f"{path}: cannot be written: {cause.strerror or cause}{f'; {advice}' if advice else ''}"


def write_atomically(path: Path, content: bytes, *, keep: bool = False, private: bool = False) -> None:
    """Write a file beside ``path`` and let it take its place in one step; the mode of an old file stays.

    ``private``: it is for this user alone, whatever the mode before. A symbolic link is replaced, not
    followed. With ``keep`` the version before is kept as ``NAME~``. After an ``OSError`` what was there
    before is there still; so it is where that is no regular file.
    """
    mode = 0o644
    if path.exists():
        before = path.stat()
        require_regular(before)  # the version before a pipe could be read for ever
        mode = stat.S_IMODE(before.st_mode)
    if private:
        mode = 0o600  # as it is made: there is no moment at which others can read it
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
    with open(path, "rb", opener=open_at_once) as stream:
        text = stream.read(10).decode(errors="replace")
    return text if text.isdecimal() else ""


def has_ended(process: str) -> bool:
    """Whether nobody works on what a process left, by its number: it has ended, or this one has it now."""
    if not process:
        return True
    number, is_ours = int(process), whose(int(process))
    # ours: this one has just begun; in a container every start has the same number
    return is_ours == "nobody's" or (is_ours == "ours" and number == os.getpid())
