"""Program files: TOML, decoded strictly, written so that a crash leaves the old file or the new one."""

from __future__ import annotations

import contextlib
import math
import os
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import msgspec
import numpy as np
import tomli
import tomli_w

from armctl.errors import ProgramError
from armctl.program.files.document import Refusal, line_of, plain_text, refusal_of
from armctl.program.program import Program, block_findings

_WRITABLE = (int, float, str, list, tuple, np.generic, np.ndarray)
_STEP = re.compile(r"steps\[(\d+)\]\.?")
_SYNTAX = re.compile(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", re.DOTALL)


def load_program(path: str | Path) -> Program:
    """Read a program file.

    Raises:
        ProgramError: unreadable, not TOML, an unknown key, a wrong type, an impossible value, or blocks
            that do not match; names the file, the line, the step and the key.
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
    # Lines as editors count them; the parser takes no carriage return.
    plain = plain_text(text).replace("\r\n", "\n")
    try:
        record = tomli.loads(plain)
    except tomli.TOMLDecodeError as cause:
        raise ProgramError(_syntax(str(cause))) from cause
    except RecursionError as cause:
        raise ProgramError("arrays or tables are nested too deep") from cause
    return _checked(record, plain)


def encode_program(program: Program) -> str:
    """The text of the program's file (TOML; what is not set is left out).

    Raises:
        ProgramError: a value that no file can hold; names step and key.
    """
    record = _record(program)
    record["steps"] = [
        {key: value for key, value in step.items() if value is not None and (key, value) != ("note", "")}
        for step in record["steps"]
    ]
    if not record["steps"]:
        del record["steps"]
    return tomli_w.dumps(record)


def checked_program(program: Program) -> Program:
    """The program as it would be read from its file, for one that was built in Python.

    numpy's numbers and arrays become plain ones.

    Raises:
        ProgramError: as ``load_program``; names the program, the step and the key.
    """
    try:
        return _checked(_record(program), None)
    except ProgramError as cause:
        raise ProgramError(f"{program.name}: {cause}") from cause


def save_program(program: Program, path: str | Path) -> None:
    """Write a program file; the version that was there before is kept as ``NAME.toml~``.

    The new text goes to a file beside it and takes its place in one step, so that a reader, a crash or
    another save at the same time meets one whole version. A symbolic link is followed, not replaced.

    Raises:
        ProgramError: cannot be written, or holds a value that could not be read again.
    """
    path = Path(path)
    try:
        _checked(_record(program), None)
        text = encode_program(program).encode()
    except (ProgramError, UnicodeError) as cause:
        raise ProgramError(f"{path}: not saved, it could not be read again: {cause}") from cause
    try:
        _replace(path.resolve(), text)
    except (OSError, RuntimeError) as cause:  # RuntimeError: links in a circle
        why = cause.strerror if isinstance(cause, OSError) else str(cause)
        raise ProgramError(f"{path}: cannot be written: {why}") from cause


def _record(program: Program) -> dict[str, Any]:
    """What a file says of a program, numpy's numbers and arrays as plain ones.

    Raises:
        ProgramError: a value that no file can hold, such as a set, which has no order.
    """
    steps = cast("object", program.steps)
    if not isinstance(steps, list | tuple):
        raise ProgramError(f"steps must be a list, not {steps!r}")
    for index, step in enumerate(cast("Sequence[object]", steps)):
        for key in step.__struct_fields__ if isinstance(step, msgspec.Struct) else ():
            value: object = getattr(step, key)
            if value is not None and not isinstance(value, _WRITABLE):
                raise ProgramError(
                    f"step {index + 1}, key {key}: {value!r} is neither a number, nor text, nor a list"
                )
    return cast("dict[str, Any]", msgspec.to_builtins(program, enc_hook=_plain))


def _plain(value: object) -> object:
    if isinstance(value, np.generic | np.ndarray):
        return cast("object", value.tolist())
    return repr(value)  # somewhere in a list of numbers: refused as the text that it is now


def _replace(path: Path, text: bytes) -> None:
    written = _beside(path, text)
    try:
        if path.exists():
            written.chmod(path.stat().st_mode & 0o7777)
            _keep(path)
        else:
            written.chmod(0o644)
        written.replace(path)
    except BaseException:
        written.unlink(missing_ok=True)
        raise
    _flush_folder(path.parent)


def _beside(path: Path, text: bytes) -> Path:
    """A new file in the same folder that holds ``text``, on the disk."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".new", dir=path.parent)
    written = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
    except BaseException:
        written.unlink(missing_ok=True)
        raise
    return written


def _keep(path: Path) -> None:
    """The earlier version under another name, without either ever being half there or gone."""
    # Never written through ``NAME~`` itself: that may be a hard link to the present file.
    kept = _beside(path, path.read_bytes())
    try:
        kept.chmod(path.stat().st_mode & 0o7777)
        kept.replace(path.with_name(f"{path.name}~"))
    except BaseException:
        kept.unlink(missing_ok=True)
        raise


def _flush_folder(folder: Path) -> None:
    """Have the new name on the disk, too, where the file system can (network ones and FAT may not)."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _syntax(message: str) -> str:
    """The parser's message with the place first."""
    match = _SYNTAX.fullmatch(message)
    if match is None:
        return message
    what, line, column = match.groups()
    what = f"{what[:1].lower()}{what[1:]}"
    return f"{what} at the end of the file" if line is None else f"line {line}, column {column}: {what}"


def _placed(text: str | None, refusal: Refusal) -> str:
    """Line, step, key and what is wrong."""
    match = _STEP.match(refusal.where)
    step = None if match is None else int(match.group(1))
    path = refusal.where if match is None else refusal.where[match.end() :]
    key = path or refusal.key
    first = None if key is None else re.split(r"[.\[]", key)[0]
    line = None if text is None else line_of(text, step, first)
    place = [] if line is None else [f"line {line}"]
    if step is not None:
        place.append(f"step {step + 1}")
    if path:
        place.append(f"key {path}")
    return f"{', '.join(place)}: {refusal.what}" if place else refusal.what


def _checked(record: object, text: str | None) -> Program:
    """A program from its record; ``text`` is what it was written as, to tell the lines.

    Raises:
        ProgramError: as ``decode_program``.
    """
    try:
        program = msgspec.convert(record, Program)
    except msgspec.ValidationError as cause:
        raise ProgramError(_placed(text, refusal_of(cause, record))) from cause
    for index, step in enumerate(program.steps):
        for key in step.__struct_fields__:
            value: object = getattr(step, key)
            numbers = cast("tuple[object, ...]", value) if isinstance(value, tuple) else (value,)
            for number in numbers:
                if isinstance(number, float) and not math.isfinite(number):  # TOML knows nan and inf
                    what = f"{number} is no number to use"
                    raise ProgramError(_placed(text, Refusal(f"steps[{index}].{key}", None, what)))
    for index, what in block_findings(program):
        raise ProgramError(_placed(text, Refusal(f"steps[{index}]", None, what)))
    return program
