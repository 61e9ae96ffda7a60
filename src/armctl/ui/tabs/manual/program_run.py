"""Running the program: once, N times, for ever, step by step; checked before."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import partial
from typing import NamedTuple

import msgspec
import viser

from armctl.arrays import FloatArray
from armctl.errors import ProgramError, StateError
from armctl.facts import Need
from armctl.lazy_dataclass import dataclass
from armctl.motion.preflight import Finding, not_checked
from armctl.process.heavy_work import check_program_apart, read_program_apart
from armctl.program import (
    PROGRAM_SUFFIXES,
    Cursor,
    Program,
    Senses,
    Step,
    encode_program,
    write_csv,
    write_script,
)
from armctl.program.base_steps import keys_of
from armctl.program.calls import WholeProgram
from armctl.program.files import SAMPLES, sample_program
from armctl.protocol import RunProgram, Snapshot
from armctl.robot import Robot
from armctl.ui.events import Newest
from armctl.ui.session import Session
from armctl.ui.tabs.manual.program_editor import EMPTY, ProgramEditor
from armctl.ui.tabs.manual.program_list import SAMPLE
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.widgets.html import LiveHtml, first_error, muted, verdict_html
from armctl.ui.widgets.number_field import NumberField, field_grid

# Programs as files: saved ones, downloads and uploads.


_UPLOAD_NOTE = "Upload takes .toml, or .csv with units in its head (base_deg, … or x_mm, y_mm, z_mm)."
_WRITERS: dict[str, tuple[str, Callable[[Program, Robot], str]]] = {
    "Download": (".toml", lambda program, _: encode_program(program)),
    "CSV": (".csv", write_csv),
    "CSV X-Y-Z": ("-xyz.csv", lambda program, robot: write_csv(program, robot, "points")),
    "Python": (".py", lambda program, _: write_script(program)),
}
_LOAD_HINT = "The chosen one takes the place of what is on the list. Undo brings that back."
_EXPORT_HINT = "CSV X-Y-Z: poses become points of the tool. Python: a script for the armctl library."


class ProgramFiles:
    """Names and files of the program."""

    def __init__(self, session: Session, check: Callable[[], Awaitable[list[Finding]]]) -> None:
        """Add the controls; ``check`` checks the program and shows the verdict."""
        self._session = session
        self._check = check
        self._shared = session.console.shared(SharedProgram)
        self._uploads, self._version = Newest(), -1
        self._named = self._shared.program.name
        gui = session.gui
        self._name = gui.add_text("Name", initial_value=self._named)
        save = gui.add_button("Save", icon=viser.Icon.DEVICE_FLOPPY)
        session.needs(None, save)
        self._saved = gui.add_dropdown("Saved programs", self._choices())
        load = gui.add_button_group("Chosen one", ("Load",), hint=_LOAD_HINT)
        suffixes = ",".join(PROGRAM_SUFFIXES)
        self._upload = gui.add_upload_button(
            "Upload", icon=viser.Icon.UPLOAD, mime_type=suffixes, color="gray"
        )
        export = gui.add_button_group("Download as", tuple(_WRITERS), hint=_EXPORT_HINT)
        LiveHtml(gui, muted(_UPLOAD_NOTE))
        session.on(save.on_click, self._on_save)
        session.on(export.on_click, lambda: self._download(export.value))
        session.needs(None, load, self._upload)
        session.on(load.on_click, self._on_load)
        session.on_press("step-sample", SAMPLE, lambda _: self._on_sample())
        session.on(self._upload.on_upload, self._on_upload)

    def refresh(self) -> None:
        """Show the program's name and the saved programs, if they have changed."""
        if self._version == self._shared.version:
            return
        self._version = self._shared.version
        if self._named != self._shared.program.name:
            self._named = self._name.value = self._shared.program.name
        choices = self._choices()
        if self._saved.options != choices:
            self._saved.options = choices

    def _choices(self) -> tuple[str, ...]:
        saved = self._shared.saved()
        return (*saved, *(name for name in SAMPLES if name not in saved))

    async def _on_save(self) -> None:
        self._session.require_operator()
        path = await self._shared.save(self._name.value.strip())
        self.refresh()
        self._saved.value = path.stem  # so that Load brings back this one, not another
        self._session.notify("Saved", str(path))

    async def _download(self, button: str) -> None:
        robot = self._session.console.robot
        suffix, write = _WRITERS[button]
        text = await asyncio.to_thread(write, await self._shared.linked(), robot)
        name = f"{self._shared.program.name}{suffix}"
        self._session.client.send_file_download(name, text.encode(), save_immediately=True)

    async def _on_sample(self) -> None:
        """Put the first sample that fits the arm on the empty list."""
        self._session.require_operator()
        refusal: ProgramError | None = None
        for name in reversed(SAMPLES):
            try:
                sample = await asyncio.to_thread(sample_program, name, self._session.console.robot)
            except ProgramError as cause:
                refusal = refusal or cause
                continue
            self._session.require_operator()
            if not self._shared.program.steps:  # else somebody was faster
                self._shared.put(sample, kept=True)
            return
        if refusal is not None:
            raise refusal

    async def _on_load(self) -> None:
        self._session.require_operator()
        name, robot = self._saved.value, self._session.console.robot
        if name in SAMPLES and name not in self._shared.saved():
            sample = await asyncio.to_thread(sample_program, name, robot)
            self._session.require_operator()
            self._shared.put(sample, kept=True)
        else:
            await self._shared.load(name)
        await self._tell_findings(name)

    async def _on_upload(self) -> None:
        self._session.require_operator()
        file, robot = self._upload.value, self._session.console.robot
        is_newest = self._uploads.begin()

        def progress(*_: int) -> None:
            if self._session.closed or not is_newest():
                raise StateError(f"{file.name} was not taken: another file was chosen while it was read")

        read = partial(read_program_apart, file.name, file.content, robot, progress)
        program = await asyncio.get_running_loop().run_in_executor(_READING, read)
        progress()
        self._session.require_operator()
        try:
            self._shared.put(program)
        except ProgramError as cause:
            raise ProgramError(f"{file.name}: {cause}") from cause
        count = len(program.steps)
        steps = "1 step is" if count == 1 else f"{count} steps are"
        self._session.notify("Uploaded", f"{file.name}: {steps} on the list")
        await self._tell_findings(file.name)

    async def _tell_findings(self, name: str) -> None:
        if not self._shared.program.steps:
            return
        error = first_error(await self._check())
        if error is not None and not self._session.closed:
            self._session.notify("Cannot run yet", f"{name}: {error}", "yellow")


_MOST_LOOPS = 100_000
_LOOKING, _RUNNING, _READING = (ThreadPoolExecutor(2, f"armctl-{what}") for what in ("check", "run", "read"))
"""Wait for checks of pages that only want to know, for the check of who runs a program, and for uploads.

None of them queues behind the others, or behind what any page solves or exports.
"""
_RUN_HINT = "N times, and the step to begin with, are under More. Pause is in the bar."
_TIMES_HINT = "As often as Times N says."
_FROM_HINT = "The first pass begins with the selected row."
_STEP_HINT = "Run the selected step alone, then select the next."
_CHECK_HINT = "Look for what would be refused, without moving the arm."


@dataclass(frozen=True, eq=False)
class _Check:
    program: Program
    begin: tuple[float, ...] | None
    hand: tuple[object, ...]
    to_run: bool
    """it waits for no check of others"""
    findings: asyncio.Task[list[Finding]]
    cancelled: threading.Event


def _same(one: Program, other: Program) -> bool:
    return one.steps is other.steps and (one.frames, one.called) == (other.frames, other.called)


def _hand(snapshot: Snapshot) -> tuple[object, ...]:
    """What a check depends on beside program and pose."""
    return snapshot.tool, snapshot.gripper, snapshot.part_mm


def _reads_files(step: Step) -> bool:
    return bool(step.calls) or any(key.field.offers == "drawings" for key in keys_of(type(step)))


class _Stepping(NamedTuple):
    """Where single steps are in a program."""

    program: Program
    cursor: Cursor
    row: int
    """the step that comes next"""
    edges: dict[str, int]
    """of each input, how many count as seen; without one that was just waited for: of that all so far do"""


class _OutdatedError(StateError):
    """What was being checked is no longer the program."""


class ProgramRun:
    """The buttons that run the program, and the verdict of the pre-flight."""

    def __init__(
        self,
        session: Session,
        editor: ProgramEditor,
        verdict: LiveHtml,
        more: AbstractContextManager[object],
    ) -> None:
        """``verdict`` is where the findings are shown, ``more`` where what is needed now and then stands."""
        self._session, self._editor, self._verdict = session, editor, verdict
        self._shared = session.console.shared(SharedProgram)
        verdict.visible = False
        self._newest: _Check | None = None
        """what the verdict is about"""
        self._progress: tuple[int, int] | None = None
        """how many steps of a long check are done, and how many there are"""
        self._stepping: _Stepping | None = None
        gui = session.gui
        with more, field_grid(gui):
            self._times = NumberField(gui, "Times N", 3)
            self._from_row = gui.add_checkbox("From selected step", initial_value=False, hint=_FROM_HINT)
            self._often = gui.add_button_group("Several times", ("Run N times",), hint=_TIMES_HINT)
        self._run = gui.add_button_group("Run", ("Run once", "Loop"), hint=_RUN_HINT)
        step = gui.add_button_group("One step", ("Step",), hint=_STEP_HINT)
        check = gui.add_button_group("Before it runs", ("Check",), hint=_CHECK_HINT)
        session.needs(None, check, also=self._empty, told=False, anyone=True)
        session.needs(Need.HOLDING, self._run, also=self._no_run)
        session.needs(Need.HOLDING, step, also=self._empty, told=False)
        session.needs(Need.HOLDING, self._often, also=self._no_run, told=False)
        self._cancel = gui.add_button("Cancel check", color="gray", visible=False)
        session.on(self._cancel.on_click, self._on_cancel)
        session.on(self._run.on_click, lambda: self._on_run(None if self._run.value == "Loop" else 1))
        session.on(self._often.on_click, lambda: self._on_run(self._times.whole(1, _MOST_LOOPS)))
        session.on(step.on_click, self._step)
        session.on(check.on_click, self.check)

    def refresh(self) -> None:
        """Show how far a check is; a verdict goes with the program that it is about."""
        self._cancel.visible = self._progress is not None
        if self._progress is not None:
            done, steps = self._progress
            self._verdict.show(muted(f"Checking … {done} of {steps} step{'' if steps == 1 else 's'}"))
        present, newest = self._shared.program.content, self._newest
        if newest is not None and newest.findings.done() and newest.program.content != present:
            self._newest = None
            self._verdict.visible = False

    @property
    def findings(self) -> Sequence[Finding]:
        """What the newest check has found, if it is about the program that is on the list."""
        newest, present = self._newest, self._shared.program
        if newest is None or not newest.findings.done() or newest.findings.cancelled():
            return ()
        if newest.findings.exception() is not None:
            return ()
        same = newest.program is present or newest.program.content == present.content
        return newest.findings.result() if same else ()

    async def check(self) -> list[Finding]:
        """Check the program from where the arm stands, and show the verdict; refused without steps."""
        try:
            return await self._check(await self._program(), self._session.snapshot.q_command, to_run=False)
        except _OutdatedError:
            return []  # who has edited it knows

    async def _on_run(self, often: int | None) -> None:
        """``often``: None: for ever."""
        first = self._editor.selected if self._from_row.value else 0
        self._session.require_operator()
        program = await self._program()  # what it calls is read now: what is checked is what runs
        # Where another step comes first, it is not known where the arm would have come from.
        start = self._session.snapshot.q_command if first == 0 else None
        with self._session.console.precedence.going():
            findings = await self._check(program, start, to_run=True)
        error = first_error(findings)
        if error is not None:
            if self._no_run(self._session.snapshot) is not None:
                return  # the row and the line below the buttons say it
            raise ProgramError(f"{program.name}: {error}")
        await self._session.submit(RunProgram(program, often, first))

    async def _on_cancel(self) -> None:
        if self._newest is not None:
            self._newest.cancelled.set()

    def _empty(self, _: Snapshot) -> str | None:
        return None if self._shared.program.steps else EMPTY

    def _no_run(self, snapshot: Snapshot) -> str | None:
        """Why a run would be refused: surely, as it would be by the check that there was from the same pose.

        What is called, or drawn, stands in files of its own: that may have changed.
        """
        if (why := self._empty(snapshot)) is not None:
            return why
        newest, present = self._newest, self._shared.program
        if newest is None or newest.begin is None or (self._from_row.value and self._editor.selected):
            return None
        same = newest.program.steps is present.steps and newest.program.frames == present.frames
        same = same and newest.hand == _hand(snapshot)
        if not same or newest.begin != tuple(snapshot.q_command.tolist()):
            return None
        rows = [one.step for one in self.findings if one.severity == "error" and one.step is not None]
        if not rows or any(_reads_files(step) for step in present.steps):
            return None
        return f"step {min(rows) + 1} cannot run: its row says why"

    async def _program(self) -> Program:
        if not self._shared.program.steps:
            raise StateError(EMPTY)
        return await self._shared.linked()

    async def _check(self, program: Program, start: FloatArray | None, *, to_run: bool) -> list[Finding]:
        """Find and show what would be refused; the same program from the same place is not checked twice.

        ``to_run``: it begins at once, and not behind checks of other pages.
        """
        begin, hand = None if start is None else tuple(start.tolist()), _hand(self._session.snapshot)
        newest = self._newest
        other = newest is None or (newest.begin, newest.hand) != (begin, hand)
        other = other or newest is None or not _same(newest.program, program)
        if newest is None or other or (to_run and not (newest.to_run or newest.findings.done())):
            self._verdict.show(muted("Checking …"))
            self._verdict.visible = True
            if newest is not None and other:
                newest.cancelled.set()
            cancelled = threading.Event()
            finding = asyncio.create_task(self._find(program, start, cancelled, to_run=to_run))
            newest = self._newest = _Check(program, begin, hand, to_run, finding, cancelled)
        try:
            return await newest.findings
        except BaseException:
            if self._newest is newest:
                self._newest = None
            raise

    async def _find(
        self, program: Program, start: FloatArray | None, cancelled: threading.Event, *, to_run: bool
    ) -> list[Finding]:
        robot = self._session.held

        def progress(done: int, steps: int) -> None:
            """Called by the worker thread."""
            if cancelled.is_set() or self._session.closed:
                raise StateError("the check was cancelled")
            present = self._shared.program
            if present.steps is not program.steps or present.frames != program.frames:
                raise _OutdatedError(f"{program.name} was edited while it was checked; check it again")
            self._progress = (done, steps)

        try:
            check = partial(check_program_apart, program, robot, start=start, progress=progress)
            findings = await asyncio.get_running_loop().run_in_executor(
                _RUNNING if to_run else _LOOKING, check
            )
        except BaseException:
            self._verdict.visible = False
            raise
        finally:
            self._progress = None
        if program.content == self._shared.program.content:  # else a later check shows the newer one
            self._verdict.show(verdict_html(findings, not_checked(robot), at_rows=True))
            self._verdict.visible = True
        elif self._newest is None or _same(self._newest.program, program):
            self._verdict.visible = False
        return findings

    def _answer(self, step: Step, seen: dict[str, int]) -> bool:
        """What a step that asks is told now; ``StateError`` where single steps do not know it.

        ``seen``: edges that no longer count, of each input; those that the answer uses are added.
        """
        question, snapshot = step.effect.asks, self._session.snapshot
        if question is None or not question.uses:
            raise StateError("single steps can ask for inputs only; run the program from this row instead")
        robot = self._session.console.robot
        edges = {name: count - seen.get(name, 0) for name, count in snapshot.edges.items()}
        holds = question.holds(Senses.of(robot, snapshot.quantities, snapshot.inputs, edges))
        if holds:
            seen[question.uses] = snapshot.edges.get(question.uses, 0)
        return holds

    async def _step(self) -> None:
        """Run one step; going on from there, repeats and edges are counted as in a whole run."""
        program, row = await self._program(), self._editor.selected
        cursor, seen = Cursor(program, row), dict(self._session.snapshot.edges)
        before = self._stepping
        if before is not None and _same(before.program, program) and before.row == row:
            cursor, seen = before.cursor.copy(), seen | before.edges
        present = cursor.next()
        if present is None:
            raise StateError(f"behind row {row + 1} there is no step to run")
        index, step = present
        whole = WholeProgram.of(program)
        if step.calls and any(whole.flat.steps[k].in_cell for k in whole.span(index)):
            raise StateError(
                f"{step.describe()!r} moves in the frame of a cell, which single steps do not know; run the "
                "program from this row instead"
            )
        here = program
        if step is not program.steps[index]:  # the cell is that of the pass that the stepping is in
            placed = (*program.steps[:index], step, *program.steps[index + 1 :])
            here = msgspec.structs.replace(program, steps=placed)
        await self._session.submit(RunProgram(here, 1, index, 1))
        if cursor.asked is not None:
            cursor.decide(self._answer(step, seen))
        for until in (whole.flat.steps[k].effect.until for k in whole.span(index)):
            if until is not None:
                seen.pop(until.uses, None)
        following = cursor.copy().next()
        self._stepping = None if following is None else _Stepping(program, cursor, following[0], seen)
        self._editor.select(0 if following is None else following[0])
        if following is None:
            self._session.notify("Last step", "The program is over after this step; row 1 is selected again.")
