"""The program being edited: shared by all pages, so that reloading a page loses nothing."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from pathlib import Path
from typing import Literal, Self

import msgspec

from armctl.errors import ProgramError
from armctl.program import Blocks, Program, load_program, save_program
from armctl.runtime import ProgramProgress
from armctl.ui.console import Console

_NAME = re.compile(r"\w[\w .+-]{0,60}")
_UNDO_STEPS = 100
Relation = Literal["running", "coming", "other"]


class SharedProgram:
    """The program on the desk and the folder of saved ones. Used on the web server's event loop only."""

    def __init__(self, robot: str, folder: Path) -> None:
        self._program = Program(robot=robot, name="untitled")
        self._folder = folder
        self._version = 0
        self._undo: list[Program] = []
        self._redo: list[Program] = []

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Go on with the program of the same arm when it is opened anew."""
        folder = console.files / "programs" / console.robot.name
        return cls(console.robot.name, folder) if before is None or before.folder != folder else before

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

    def relation(self, progress: ProgramProgress | None) -> Relation | None:
        """How the program on the desk stands to the one that the arm runs; None: the arm runs none.

        "running": it is that; "coming": the arm goes on with it at its next pass; "other": another one.
        """
        if progress is None:
            return None
        steps = self._program.steps
        if progress.running.steps == steps:
            return "running"
        return "coming" if progress.coming.steps == steps else "other"

    def edit(self, change: Callable[[Program], Program]) -> None:
        """Replace the program by ``change(program)``; what that raises changes nothing.

        Raises:
            ProgramError: the blocks of the new one do not match; names the step.
        """
        changed = change(self._program)
        if changed != self._program:
            Blocks.matched(changed.steps)
            self._undo = [*self._undo[1 - _UNDO_STEPS :], self._program]
            self._redo.clear()
            self._program = changed
            self._version += 1

    def undo(self) -> None:
        """Take the last change back.

        Raises:
            ProgramError: there is nothing to take back.
        """
        if not self._undo:
            raise ProgramError("there is nothing to undo")
        self._redo.append(self._program)
        self._program = self._undo.pop()
        self._version += 1

    def redo(self) -> None:
        """Make the change again that was taken back last.

        Raises:
            ProgramError: none was taken back since the last edit.
        """
        if not self._redo:
            raise ProgramError("there is nothing to redo")
        self._undo.append(self._program)
        self._program = self._redo.pop()
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
        self.put(await asyncio.to_thread(load_program, self._path(name)))

    def put(self, program: Program) -> None:
        """Put a program on the desk that comes from elsewhere.

        Raises:
            ProgramError: it is another robot's, or its blocks do not match; the desk stays as it is.
        """
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
