"""The programs that are saved in one folder, and call each other by their names."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import msgspec

from armctl.errors import ProgramError
from armctl.program.calls import called_name, link
from armctl.program.files import read_called
from armctl.program.program import CalledProgram, Program

_NAME = re.compile(r"\w[\w .+-]{0,60}")


class SavedPrograms:
    """A folder of them. Its calls block: they read files."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def names(self) -> list[str]:
        """Sorted."""
        return sorted(path.stem for path in self.folder.glob("*.toml"))

    def path(self, name: str) -> Path:
        """The file of a name; ``ProgramError``: it is none."""
        if not _NAME.fullmatch(name):
            raise ProgramError(
                f"{name!r} is no program name: up to 61 letters, digits, spaces, '.', '+', '-' and '_', "
                "beginning with a letter or a digit"
            )
        return self.folder / f"{name}.toml"

    def link(self, program: Program, known: Iterable[CalledProgram] = ()) -> Program:
        """A program with those that it calls, each read once; those of ``known`` are not read again."""
        return link(program, self._read, known)

    def _read(self, file: str) -> CalledProgram:
        """No file of another folder: whoever may edit the program may not read all that the computer has."""
        if not _NAME.fullmatch(called_name(file)):
            return CalledProgram(file=file, missing="saved")
        found = read_called(self.folder, file)
        return msgspec.structs.replace(found, missing="saved") if found.missing else found
