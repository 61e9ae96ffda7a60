"""The program being edited: shared by all pages, so that reloading a page loses nothing."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from pathlib import Path

import msgspec

from armctl.errors import ProgramError
from armctl.motion import Program, decode_program, load_program, save_program

_NAME = re.compile(r"\w[\w .+-]{0,60}")
_UNDO_STEPS = 100


class ProgramDesk:
    """The program on the desk and the folder of saved ones. Used on the web server's event loop only."""

    def __init__(self, robot: str, folder: Path) -> None:
        self._program = Program(robot=robot, name="untitled")
        self._folder = folder
        self._version = 0
        self._undo: list[Program] = []
        self._started: Program | None = None

    @property
    def program(self) -> Program:
        """The program being edited."""
        return self._program

    @property
    def version(self) -> int:
        """Rises with every change and every save, so that a page knows when to draw anew."""
        return self._version

    @property
    def folder(self) -> Path:
        """Where programs are saved."""
        return self._folder

    @property
    def can_undo(self) -> bool:
        """Whether there is a change to take back."""
        return bool(self._undo)

    @property
    def as_started(self) -> bool:
        """Whether the steps are still those that were last given to the arm."""
        return self._started is not None and self._started.steps == self._program.steps

    def start(self, program: Program) -> None:
        """Note that the arm was given this program."""
        self._started = program

    def edit(self, change: Callable[[Program], Program]) -> None:
        """Replace the program by ``change(program)``; what that raises changes nothing."""
        changed = change(self._program)
        if changed != self._program:
            self._undo = [*self._undo[1 - _UNDO_STEPS :], self._program]
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

    async def save(self, name: str) -> Path:
        """Save under a name; the earlier version is kept as ``NAME.toml~``.

        Raises:
            ProgramError: a name that is no file name, or the file cannot be written.
        """
        path = self._path(name)
        program = msgspec.structs.replace(self._program, name=name)
        await asyncio.to_thread(self._write, program, path)
        self.edit(lambda present: msgspec.structs.replace(present, name=name))
        self._version += 1
        return path

    async def load(self, name: str) -> None:
        """Put a saved program on the desk.

        Raises:
            ProgramError: there is none of that name, it cannot be read, or it is another robot's; the desk
                stays as it is.
        """
        self._put(await asyncio.to_thread(load_program, self._path(name)))

    def take_in(self, text: bytes) -> None:
        """Put a program on the desk that comes as the text of its file.

        Raises:
            ProgramError: names the step and the key, or the robot it is for; the desk stays as it is.
        """
        self._put(decode_program(text))

    def _put(self, program: Program) -> None:
        robot = self._program.robot
        if program.robot != robot:
            raise ProgramError(f"the program is for the robot {program.robot!r}, this one is {robot!r}")
        self.edit(lambda _: program)

    def _write(self, program: Program, path: Path) -> None:
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as cause:
            raise ProgramError(f"{self._folder}: cannot be made: {cause.strerror}") from cause
        save_program(program, path)

    def _path(self, name: str) -> Path:
        if not _NAME.fullmatch(name):
            raise ProgramError(
                f"{name!r} is no program name: up to 61 letters, digits, spaces, '.', '+', '-' and '_', "
                "beginning with a letter or a digit"
            )
        return self._folder / f"{name}.toml"
