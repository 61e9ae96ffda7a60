"""The program being edited: shared by all pages, so that reloading a page loses nothing."""

from __future__ import annotations

import asyncio
import re
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
    """The program and the folder of saved ones. Used on the web server's event loop only."""

    def __init__(self, robot: str, folder: Path) -> None:
        self.program = Program(robot=robot, name="untitled")
        self.folder = folder
        """where programs are saved"""
        self.version = 0
        """rises with every change and every save, so that a page knows when to draw anew"""
        self._undo: list[Program] = []
        self._redo: list[Program] = []

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Go on with the program of the same arm when it is opened anew."""
        folder = console.files / "programs" / console.robot.name
        return cls(console.robot.name, folder) if before is None or before.folder != folder else before

    def relation(self, progress: ProgramProgress | None) -> Relation | None:
        """None: the arm runs none; "running": this; "coming": this at its next pass; "other": another one."""
        if progress is None:
            return None
        steps = self.program.steps
        if progress.running.steps == steps:
            return "running"
        return "coming" if progress.coming.steps == steps else "other"

    def edit(self, changed: Program) -> None:
        """Replace the program; a ``ProgramError`` names the step where its blocks do not match."""
        if changed != self.program:
            Blocks.matched(changed.steps)
            self._undo = [*self._undo[1 - _UNDO_STEPS :], self.program]
            self._redo.clear()
            self._show(changed)

    def undo(self, *, redo: bool = False) -> None:
        """Take the last change back; ``redo``: make it again. Refused if there is none."""
        source, other = (self._redo, self._undo) if redo else (self._undo, self._redo)
        if not source:
            raise ProgramError(f"there is nothing to {'redo' if redo else 'undo'}")
        other.append(self.program)
        self._show(source.pop())

    def _show(self, program: Program) -> None:
        self.program = program
        self.version += 1

    def saved(self) -> list[str]:
        """Names of the saved programs, sorted."""
        return sorted(path.stem for path in self.folder.glob("*.toml"))

    async def save(self, name: str) -> Path:
        """Save under a name, the earlier version as ``NAME.toml~``; refused where that cannot be written."""
        path, program = self._path(name), msgspec.structs.replace(self.program, name=name)

        def write() -> None:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
            except OSError as cause:
                raise ProgramError(f"{self.folder}: cannot be made: {cause.strerror}") from cause
            save_program(program, path)

        await asyncio.to_thread(write)
        self.edit(msgspec.structs.replace(self.program, name=name))
        self.version += 1
        return path

    async def load(self, name: str) -> None:
        """Edit a saved program; refused if it is not there or cannot be read, or as ``put``."""
        self.put(await asyncio.to_thread(load_program, self._path(name)))

    def put(self, program: Program) -> None:
        """Edit a program that comes from elsewhere; refused if it is another robot's, or as ``edit``."""
        if program.robot != self.program.robot:
            ours = self.program.robot
            raise ProgramError(f"the program is for the robot {program.robot!r}, this one is {ours!r}")
        self.edit(program)

    def _path(self, name: str) -> Path:
        if not _NAME.fullmatch(name):
            raise ProgramError(
                f"{name!r} is no program name: up to 61 letters, digits, spaces, '.', '+', '-' and '_', "
                "beginning with a letter or a digit"
            )
        return self.folder / f"{name}.toml"
