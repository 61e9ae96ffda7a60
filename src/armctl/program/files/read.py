"""A program from any file that a program can be written to: TOML, CSV, Python."""

from __future__ import annotations

from pathlib import Path, PurePath

from armctl.errors import ProgramError
from armctl.program.files.csv import read_csv
from armctl.program.files.script import read_script
from armctl.program.files.toml import decode_program
from armctl.program.program import Program
from armctl.robot import Robot

PROGRAM_SUFFIXES = (".toml", ".csv", ".py")


def open_program(path: str | Path, robot: Robot | None = None) -> Program:
    """Read a program file; its suffix tells the form.

    Args:
        path: the file.
        robot: the arm that it is for; only a CSV, which names none, needs it.

    Raises:
        ProgramError: cannot be read, and what ``read_program`` refuses.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as cause:
        raise ProgramError(f"{path}: cannot be read: {cause.strerror}") from cause
    return read_program(str(path), content, robot)


def read_program(filename: str, content: bytes, robot: Robot | None) -> Program:
    """A program from the content of a file of any form.

    Raises:
        ProgramError: another kind of file, a CSV without a robot, or what its reader refuses; names the
            file and the line.
    """
    name = PurePath(filename)
    try:
        match name.suffix.lower():
            case ".toml":
                return decode_program(content)
            case ".py":
                return read_script(content)
            case ".csv":
                if robot is None:
                    raise ProgramError("a CSV names no robot; say which one it is for, e.g. --robot uzuner")
                return read_csv(content, robot, name.stem)
            case _:
                raise ProgramError(f"is none of {', '.join(PROGRAM_SUFFIXES)}")
    except ProgramError as cause:
        raise ProgramError(f"{filename}: {cause}") from cause
