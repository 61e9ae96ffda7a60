"""The program being edited: shared by all pages, so that reloading a page loses nothing.

While it is not saved it is kept in a file of the console's own, so that a crash loses two seconds at most.
"""

from __future__ import annotations

import asyncio
import os
import re
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from itertools import count
from operator import is_not
from pathlib import Path
from typing import Literal, Self

import msgspec

from armctl.documents import has_ended, not_written, write_atomically
from armctl.drawing import DRAWING_SUFFIXES
from armctl.errors import ProgramError
from armctl.lazy_dataclass import dataclass
from armctl.program import (
    Blocks,
    CalledProgram,
    Program,
    SavedPrograms,
    Step,
    encode_program,
    load_program,
    save_program,
)
from armctl.protocol import Party, ProgramProgress, Snapshot, wall_time
from armctl.system import private_folder
from armctl.ui.console import Console

_UNDO_STEPS = 100
Relation = Literal["running", "coming", "other"]


@dataclass(frozen=True, slots=True)
class Edit:
    """The last change of the program, and who made it."""

    by: Party
    row: int
    """the first that is another one than before, from 0"""


class SharedProgram:
    """The program and the folder of saved ones. Used on the web server's event loop only."""

    def __init__(self, robot: str, folder: Path, kept: Unsaved | None = None) -> None:
        """``kept``: where the program is kept while it is not saved; None: nowhere."""
        self.program = Program(robot=robot, name="untitled")
        self.blocks = Blocks.of(())
        """of the program"""
        self.keys: Sequence[str] = ()
        """of each step: the same as long as the step is on the list, wherever that is; none is used again"""
        self.last_edit: Edit | None = None
        """None: nobody has edited what is on the list now"""
        self._key_rows: dict[str, int] = {}
        self._new_keys = map(str, count(1))
        self.kept = kept
        self.library = SavedPrograms(folder)
        """those that are saved; they call each other by their names"""
        self.version = 0
        """rises with every change and every save, so that a page knows when to draw anew"""
        self._undo: list[Program] = []
        self._redo: list[Program] = []
        self._filed: Program | None = None
        """as it was saved or loaded last, from a file or as a sample"""
        self._callable: tuple[int, Sequence[str]] | None = None
        """of a version of the program"""
        self._drawings: tuple[int, Sequence[str]] | None = None
        """of a version of the program"""
        self._relation: tuple[tuple[Program, Program, Program], Relation] | None = None
        """the last answer, and what it is about: to compare 20,000 steps takes 5 ms"""

    @property
    def folder(self) -> Path:
        """Where programs are saved."""
        return self.library.folder

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Go on with the program of the same arm when it is opened anew."""
        robot, folder = console.robot.name, console.files / "programs" / console.robot.name
        if before is not None and before.library.folder == folder:
            shared = before
        else:
            if before is not None and before.kept is not None:
                before.kept.keep(before.program, unsaved=before.unsaved, now=True)
            kept = None if console.state is None else Unsaved(console.state / "unsaved", robot)
            shared = cls(robot, folder, kept)
        if shared.kept is not None:
            console.frame_listeners.append(shared.keep)
        console.unsaved.append(shared.unsaved_words)
        console.savers.append(shared.save_as_it_is)
        return shared

    def relation(self, progress: ProgramProgress | None) -> Relation | None:
        """None: the arm runs none; "running": this; "coming": this at its next pass; "other": another one."""
        if progress is None:
            return None
        compared = (self.program, progress.running, progress.coming)
        if self._relation is None or any(map(is_not, compared, self._relation[0])):
            content = self.program.content
            coming: Relation = "coming" if progress.coming.content == content else "other"
            self._relation = (compared, "running" if progress.running.content == content else coming)
        return self._relation[1]

    def row(self, key: str) -> int | None:
        """Index of the step with this key; None: it is on the list no more."""
        return self._key_rows.get(key)

    def edit(self, changed: Program, by: Party | None = None) -> None:
        """Replace the program; a ``ProgramError`` names the step where its blocks do not match.

        ``by``: who has edited it, and may have moved a step past one that is equal.
        """
        moved = by is not None and any(map(is_not, changed.steps, self.program.steps))
        if moved or changed != self.program:
            blocks = Blocks.matched(changed.steps)
            self._undo = [*self._undo[1 - _UNDO_STEPS :], self.program]
            self._redo.clear()
            self._show(changed, blocks, by)

    def no_undo(self, *, redo: bool = False) -> str | None:
        """Why there is no change to take back (``redo``: to make again); None: there is one."""
        if self._redo if redo else self._undo:
            return None
        return f"there is nothing to {'redo' if redo else 'undo'}"

    def undo(self, by: Party | None = None, *, redo: bool = False) -> None:
        """Take the last change back; ``redo``: make it again. Refused if there is none."""
        source, other = (self._redo, self._undo) if redo else (self._undo, self._redo)
        if (why := self.no_undo(redo=redo)) is not None:
            raise ProgramError(why)
        other.append(self.program)
        program = source.pop()
        self._show(program, Blocks.of(program.steps), by)

    def _show(self, program: Program, blocks: Blocks, by: Party | None) -> None:
        before, after = self.program.steps, program.steps
        self.last_edit = None if by is None else Edit(by, same_from_the_first(before, after))
        self.keys = keys_after(before, self.keys, after, self._new_keys, edited=by is not None)
        self._key_rows = {key: row for row, key in enumerate(self.keys)}
        self.program, self.blocks = program, blocks
        self.version += 1

    def saved(self) -> list[str]:
        """Names of the saved programs, sorted."""
        return self.library.names()

    @property
    def callable(self) -> Sequence[str]:
        """Names of the saved programs that a step may call: all but this one. Read when one is saved."""
        if self._callable is None or self._callable[0] != self.version:
            names = [name for name in self.saved() if name != self.program.name]
            self._callable = self.version, names
        return self._callable[1]

    @property
    def drawings(self) -> Sequence[str]:
        """Files beside the saved programs that can be drawn, the newest first. Read when it is edited."""
        if self._drawings is None or self._drawings[0] != self.version:
            found = [path for path in self.folder.glob("*") if path.suffix.lower() in DRAWING_SUFFIXES]
            found.sort(key=lambda path: path.stat().st_mtime, reverse=True)
            self._drawings = self.version, [str(path) for path in found]
        return self._drawings[1]

    @property
    def counters(self) -> Sequence[str]:
        """Names that steps of the program count by, in their order."""
        named = (step.effect.counts for step in self.program.steps)
        return [*dict.fromkeys(one.counter for one in named if one is not None)]

    def file_came(self) -> None:
        """A file was put beside the saved programs, which a step may be about."""
        self.version += 1

    async def linked(self, known: Iterable[CalledProgram] = ()) -> Program:
        """The program with the saved ones that it calls, each read once; those of ``known`` are not again."""
        if not any(step.calls for step in self.program.steps):
            return self.program
        return await asyncio.to_thread(self.library.link, self.program, known)

    async def save(self, name: str) -> Path:
        """Save under a name, the earlier version as ``NAME.toml~``; refused where that cannot be written."""
        path, program = self.library.path(name), msgspec.structs.replace(self.program, name=name)

        def write() -> None:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
            except OSError as cause:
                raise ProgramError(not_written(self.folder, cause)) from cause
            save_program(program, path)

        await asyncio.to_thread(write)
        self._filed = program
        self.edit(msgspec.structs.replace(self.program, name=name))
        self.version += 1
        return path

    async def save_as_it_is(self) -> Path | None:
        """Save under its own name, or a free one where that is another program's; None: it is saved."""
        if not self.unsaved:
            return None
        name, saved = self.program.name, self.saved()
        if self._filed is None or self._filed.name != name:
            names = (name, *(f"{name} {number}" for number in range(2, len(saved) + 3)))
            name = next(one for one in names if one not in saved)
        return await self.save(name)

    async def load(self, name: str) -> None:
        """Edit a saved program; refused if it is not there or cannot be read, or as ``put``."""
        program = await asyncio.to_thread(load_program, self.library.path(name))
        self.put(program, kept=True)

    def put(self, program: Program, *, kept: bool = False) -> None:
        """Edit a program that comes from elsewhere; refused if it is another robot's, or as ``edit``.

        ``kept``: it can be had again, as a sample can: as it is it need not be saved.
        """
        if program.robot != self.program.robot:
            ours = self.program.robot
            raise ProgramError(f"the program is for the robot {program.robot!r}, this one is {ours!r}")
        program = msgspec.structs.replace(program, called=())
        self.edit(program)
        if kept:
            self._filed = program

    # What is kept of it while it is not saved.

    @property
    def unsaved(self) -> bool:
        """Whether a crash would lose the program, were it not kept."""
        return bool(self.program.steps) and self.program != self._filed

    def unsaved_words(self) -> str | None:
        """What would be lost with the program."""
        count = len(self.program.steps)
        steps = f"{count} step{'' if count == 1 else 's'}"
        return f"The program {self.program.name!r} ({steps}) is not saved." if self.unsaved else None

    def keep(self, _: Snapshot) -> None:
        """Keep the program as it is now, if it has changed; called with every frame."""
        if self.kept is not None and self.program is not self.kept.program:
            self.kept.keep(self.program, unsaved=self.unsaved)

    @property
    def left(self) -> LeftProgram | None:
        """The newest program that a console of this robot left unsaved; None: there is none."""
        return self.kept.left[0] if self.kept is not None and self.kept.left else None

    async def answer(self, left: LeftProgram, *, restore: bool) -> None:
        """Restore what was left, or delete it; refused if it cannot be read, or as ``put``."""
        if self.kept is None or left is not self.left:
            return  # another page was faster
        if restore:
            self.put(await asyncio.to_thread(load_program, left.path))
            await self.kept.write(self.program)
        await asyncio.to_thread(_delete, left.path)
        self.kept.left.remove(left)
        self.version += 1


def same_from_the_first(before: Sequence[Step], after: Sequence[Step]) -> int:
    """How many steps at the beginning are the same ones as before."""
    both = min(len(before), len(after))
    return next((i for i in range(both) if before[i] is not after[i]), both)


def keys_after(
    before: Sequence[Step], keys: Sequence[str], after: Sequence[Step], new: Iterator[str], *, edited: bool
) -> list[str]:
    """The key of each step of a program that was changed; ``keys``: of the steps ``before``.

    A step keeps its key wherever it goes. ``edited``: one step alone in the place of another one is that one.
    """
    first = same_from_the_first(before, after)
    last = same_from_the_first(before[first:][::-1], after[first:][::-1])
    free: dict[int, deque[str]] = {}
    for row in range(first, len(before) - last):
        free.setdefault(id(before[row]), deque()).append(keys[row])
    changed = after[first : len(after) - last]
    found = [waiting.popleft() if (waiting := free.get(id(step))) else "" for step in changed]
    left = [key for waiting in free.values() for key in waiting]
    if edited and len(left) == found.count("") == 1:
        found[found.index("")] = left[0]
    middle = [key or next(new) for key in found]
    return [*keys[:first], *middle, *keys[len(before) - last :]]


_FRAMES = 60
"""from one write to the next: two seconds"""
_KEPT = re.compile(r"(?P<robot>.+)-(?P<pid>\d{1,9})-\d+\.toml")


@dataclass(frozen=True, slots=True)
class LeftProgram:
    """A program that a console had not saved when it ended."""

    path: Path
    when: datetime
    """of its last change, local time"""

    @property
    def time(self) -> str:
        """When that was: "14:03", with the date where it was not today."""
        today = datetime.fromtimestamp(wall_time()).date()
        return f"{self.when:%H:%M}" if self.when.date() == today else f"{self.when:%Y-%m-%d, %H:%M}"


class Unsaved:
    """Keeps a program in a file of this process as long as it is not saved. Event loop only."""

    def __init__(self, folder: Path, robot: str) -> None:
        """``folder``: made when there is something to keep."""
        paths = (folder / f"{robot}-{os.getpid()}-{number}.toml" for number in count(1))
        self._path = next(path for path in paths if not path.exists())
        self.left = _left_programs(folder, robot)
        """by consoles that have ended, the newest first"""
        self.program: Program | None = None
        """the newest that was seen"""
        self.problem: str | None = None
        """why it cannot be kept"""
        self._frames = _FRAMES
        self._writing: asyncio.Task[None] | None = None

    def keep(self, program: Program, *, unsaved: bool, now: bool = False) -> None:
        """Write another program beside the event loop, or delete one that is saved; not all the time."""
        self._frames += 1
        busy = self._writing is not None and not self._writing.done()
        if now or (self._frames >= _FRAMES and not busy):
            self._frames, self.program = 0, program
            self._writing = asyncio.create_task(self.write(program if unsaved else None))

    async def write(self, program: Program | None) -> None:
        """Keep a program, or none."""
        try:
            await asyncio.to_thread(_write, self._path, program)
            self.problem = None
        except ProgramError as refusal:
            self.problem = str(refusal)


def _write(path: Path, program: Program | None) -> None:
    if program is None:
        _delete(path)
        return
    try:
        private_folder(path.parent)
        write_atomically(path, encode_program(program).encode(), private=True)
    except OSError as cause:
        raise ProgramError(not_written(path, cause)) from cause


def _delete(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as cause:
        raise ProgramError(f"{path}: cannot be deleted: {cause.strerror}") from cause


def _left_programs(folder: Path, robot: str) -> list[LeftProgram]:
    found: list[LeftProgram] = []
    for path in folder.glob("*.toml"):
        match = _KEPT.fullmatch(path.name)
        if match is not None and match["robot"] == robot and has_ended(match["pid"]):
            found.append(LeftProgram(path, datetime.fromtimestamp(path.lstat().st_mtime)))
    return sorted(found, key=lambda one: one.when, reverse=True)
