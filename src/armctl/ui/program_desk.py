"""The program being edited: shared by all pages, so that reloading a page loses nothing."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from armctl.errors import ProgramError
from armctl.motion import Program, load_program, save_program

_NAME = re.compile(r"^[\w][\w .+-]{0,60}$")


class ProgramDesk:
    """The program on the desk and the folder of saved ones. Used on the web server's event loop only."""

    def __init__(self, robot: str, folder: Path) -> None:
        self._program = Program(robot=robot, name="untitled")
        self._folder = folder
        self._version = 0
        self._undo: list[Program] = []

    @property
    def program(self) -> Program:
        """The program being edited."""
        return self._program

    @property
    def version(self) -> int:
        """Rises with every change, so that a page knows when to draw the list anew."""
        return self._version

    @property
    def folder(self) -> Path:
        """Where programs are saved."""
        return self._folder

    def edit(self, change: Callable[[Program], Program]) -> None:
        """Replace the program by ``change(program)``; what that raises changes nothing."""
        changed = change(self._program)
        if changed != self._program:
            self._undo = [*self._undo[-99:], self._program]
            self._program = changed
            self._version += 1

    def undo(self) -> None:
        """Take the last change back.

        Raises:
            ProgramError: there is nothing to take back.
        """
        if not self._undo:
            raise ProgramError("there is nothing to undo")
        self._program = self._undo.pop()
        self._version += 1

    def saved(self) -> list[str]:
        """Names of the saved programs, sorted."""
        return sorted(path.stem for path in self._folder.glob("*.toml"))

    def save(self, name: str) -> Path:
        """Save under a name; the earlier version is kept as ``NAME.toml~``.

        Raises:
            ProgramError: a name that is no file name, or the file cannot be written.
        """
        path = self._path(name)
        self._folder.mkdir(parents=True, exist_ok=True)
        named = Program(robot=self._program.robot, name=name, steps=self._program.steps)
        save_program(named, path)
        self.edit(lambda _: named)
        return path

    def load(self, name: str) -> None:
        """Put a saved program on the desk.

        Raises:
            ProgramError: there is none of that name, or it cannot be read; the desk stays as it is.
        """
        loaded = load_program(self._path(name))
        self.edit(lambda _: loaded)

    def _path(self, name: str) -> Path:
        if not _NAME.match(name):
            raise ProgramError(
                f"{name!r} is no program name: letters, digits, space, '.', '+', '-' and '_' are allowed"
            )
        return self._folder / f"{name}.toml"
