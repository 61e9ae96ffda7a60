"""Program files: TOML, decoded strictly, written so that a crash leaves the old file or the new one."""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path

import msgspec
import tomli_w

from armctl.errors import ProgramError
from armctl.motion.program.program import Program

_STEP = re.compile(r"\$\.steps\[(\d+)\]")


def load_program(path: str | Path) -> Program:
    """Read a program file.

    Raises:
        ProgramError: unreadable, not TOML, an unknown key, a wrong type or an impossible value; names the
            file, the step and the key.
    """
    path = Path(path)
    try:
        text = path.read_bytes()
    except OSError as cause:
        raise ProgramError(f"{path}: cannot be read: {cause.strerror}") from cause
    try:
        return decode_program(text)
    except ProgramError as cause:
        raise ProgramError(f"{path}: {cause}") from cause


def decode_program(text: bytes | str) -> Program:
    """A program from the text of its file.

    Raises:
        ProgramError: as ``load_program``, without the file's name.
    """
    try:
        return msgspec.toml.decode(text, type=Program)
    except msgspec.DecodeError as cause:
        raise ProgramError(_in_words(str(cause))) from cause
    except ValueError as cause:  # not UTF-8
        raise ProgramError(f"is not a text file: {cause}") from cause


def encode_program(program: Program) -> str:
    """The text of the program's file (TOML; what is not set is left out)."""
    record = msgspec.to_builtins(program)
    record["steps"] = [
        {key: value for key, value in step.items() if value is not None and (key, value) != ("note", "")}
        for step in record["steps"]
    ]
    if not record["steps"]:
        del record["steps"]
    return tomli_w.dumps(record)


def save_program(program: Program, path: str | Path) -> None:
    """Write a program file; the version that was there before is kept as ``NAME.toml~``.

    The new text goes to a file beside it and takes its place in one step.

    Raises:
        ProgramError: cannot be written, or holds a value that could not be read again.
    """
    path = Path(path)
    text = encode_program(program)
    try:
        decode_program(text)
    except ProgramError as cause:
        raise ProgramError(f"{path}: not saved, it could not be read again: {cause}") from cause
    try:
        _replace(path, text)
    except OSError as cause:
        raise ProgramError(f"{path}: cannot be written: {cause.strerror}") from cause


def _replace(path: Path, text: str) -> None:
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".new", dir=path.parent)
    written = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        if path.exists():
            written.chmod(path.stat().st_mode & 0o7777)
            _keep(path)
        else:
            written.chmod(0o644)
        written.replace(path)
    except BaseException:
        written.unlink(missing_ok=True)
        raise


def _keep(path: Path) -> None:
    """The earlier version under another name, without ever being gone under its own."""
    kept = path.with_name(f"{path.name}~")
    kept.unlink(missing_ok=True)
    try:
        kept.hardlink_to(path)
    except OSError:  # a file system without hard links
        kept.write_bytes(path.read_bytes())


def _in_words(message: str) -> str:
    """The decoder's message with the step's number as people count and the place first."""
    what, _, where = message.rpartition(" - at `")
    if not what:
        return message
    where = where.rstrip("`")
    step = _STEP.match(where)
    key = where[step.end() :] if step else where.removeprefix("$")
    place = [f"step {int(step.group(1)) + 1}"] if step else []
    if key.strip("."):
        place.append(f"key {key.strip('.')}")
    return f"{', '.join(place)}: {what}" if place else what
