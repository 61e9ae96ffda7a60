"""Serial motion: a list of recorded steps, edited and run once, several times or for ever."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING

from armctl.errors import InputError, StateError
from armctl.motion import GripperStep, MoveStep, Program, Step, WaitStep
from armctl.runtime import Pause, Resume, RunProgram, Snapshot
from armctl.ui.screens.program_files import ProgramFiles
from armctl.ui.widgets import step_edit
from armctl.ui.widgets.joint_step import checked_seconds, present_pose_deg
from armctl.ui.widgets.step_list import page_count, page_of, step_table
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

_MOST_LOOPS = 100_000


class SerialMotion:
    """The list of the program on the desk, and the buttons that change and run it."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._desk = session.console.programs
        self._selected = 0
        self._page = 0
        self._running: int | None = None
        self._drawn: tuple[object, ...] = ()
        gui = session.gui
        self._head = LiveHtml(gui)
        self._list = LiveHtml(gui)
        self._pages = gui.add_button_group("Page", ("◀ Previous", "Next ▶"), visible=False)
        self._row = gui.add_number("Selected row", initial_value=1, min=1, step=1)
        with gui.add_folder("Record and edit"):
            self._add_edit()
        with gui.add_folder("Run"):
            self._add_run()
        with gui.add_folder("Files", expand_by_default=False):
            self._files = ProgramFiles(session)
        session.on(self._pages.on_click, self._on_page)
        session.on(self._row.on_update, self._on_row)

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw the list where it, the selection or the running step has changed."""
        self._files.refresh()
        self._follow(self._running_step(snapshot))
        self._head.show(self._headline(snapshot))
        drawn = (self._desk.version, self._page, self._selected, self._running)
        if drawn != self._drawn:
            self._drawn = drawn
            self._draw()

    def _add_run(self) -> None:
        gui, session = self._session.gui, self._session
        self._times = gui.add_number("Times N", initial_value=3, min=1, max=_MOST_LOOPS, step=1)
        self._from_row = gui.add_checkbox(
            "From selected step", initial_value=False, hint="The first pass begins with the selected row."
        )
        self._run = gui.add_button_group("Run", ("Run once", "Run N times", "Loop"))
        self._hold = gui.add_button_group("While it runs", ("Pause", "Resume"))
        session.on(self._run.on_click, self._on_run)
        session.on(self._hold.on_click, self._on_hold)

    def _add_edit(self) -> None:
        gui, session = self._session.gui, self._session
        self._where = gui.add_dropdown("New steps go", step_edit.PLACES, initial_value=step_edit.PLACES[0])
        gripper = ("Record gripper",) if session.console.robot.gripper is not None else ()
        self._record = gui.add_button_group("Add step", ("Record pose", *gripper, "Add wait"))
        self._seconds = gui.add_number("Wait s", initial_value=1.0, min=0.0, max=86_400.0, step=0.1)
        self._edit = gui.add_button_group("Edit", ("Up", "Down", "Duplicate", "Delete", "Undo"))
        session.on(self._record.on_click, self._on_record)
        session.on(self._edit.on_click, self._on_edit)

    def _running_step(self, snapshot: Snapshot) -> int | None:
        """Index of the running step, where the list shows the program that runs."""
        return snapshot.program.step if snapshot.program is not None and self._desk.as_started else None

    def _follow(self, running: int | None) -> None:
        """The page turns to the running step when that changes."""
        if running is not None and running != self._running:
            self._page = page_of(running)
        self._running = running

    def _headline(self, snapshot: Snapshot) -> str:
        program, progress = self._desk.program, snapshot.program
        count = len(program.steps)
        line = f"<b>{escape(program.name)}</b> · {count} step{'' if count == 1 else 's'}"
        if progress is None:
            return line
        loops = "∞" if progress.loops is None else progress.loops
        of = f"step {progress.step + 1} of {progress.steps}, pass {progress.loop + 1} of {loops}"
        if self._running is None:
            return f"{line}<br><span style='color:#e67700'>Runs another version: {of}</span>"
        return f"{line} · <span style='color:#2b8a3e'>runs {of}</span>"

    def _draw(self) -> None:
        steps = self._desk.program.steps
        pages = page_count(len(steps))
        self._selected = min(self._selected, max(len(steps) - 1, 0))
        self._page = min(self._page, pages - 1)
        text = step_table(steps, self._page, self._selected, self._running)
        if pages > 1:
            text += f"<div style='text-align:right;opacity:.75'>page {self._page + 1} of {pages}</div>"
        self._list.show(text)
        if self._pages.visible != (pages > 1):
            self._pages.visible = pages > 1
        if self._row.value != self._selected + 1:
            self._row.value = self._selected + 1
        self._drawn = (self._desk.version, self._page, self._selected, self._running)

    def _select(self, row: int) -> None:
        self._selected, self._page = row, page_of(row)

    def _change(self, change: Callable[[Program], step_edit.Change]) -> None:
        """Change the list and the selection; only the operator may."""
        self._session.require_operator()
        changed, selected = change(self._desk.program)
        self._desk.edit(lambda _: changed)
        self._select(selected)

    def _add(self, step: Step) -> None:
        self._change(lambda program: step_edit.add(program, step, self._where.value, self._selected))

    async def _on_page(self) -> None:
        pages = page_count(len(self._desk.program.steps))
        turned = self._page + (1 if self._pages.value.startswith("Next") else -1)
        self._page = min(max(turned, 0), pages - 1)

    async def _on_row(self) -> None:
        row, count = int(self._row.value), len(self._desk.program.steps)
        if not 1 <= row <= max(count, 1):
            raise InputError(f"there is no row {row}; the program has {count}")
        self._select(row - 1)

    async def _on_record(self) -> None:
        robot, snapshot = self._session.console.robot, self._session.snapshot
        match self._record.value:
            case "Record pose":
                self._add(MoveStep(joints_deg=present_pose_deg(robot, snapshot)))
            case "Record gripper":
                if snapshot.gripper is None:
                    raise StateError("the gripper has not been told to move yet; press 'Set gripper' first")
                self._add(GripperStep(open_percent=round(100 * snapshot.gripper, 1)))
            case _:
                self._add(WaitStep(seconds=checked_seconds(self._seconds.value)))

    async def _on_edit(self) -> None:
        row = self._selected
        match self._edit.value:
            case "Up":
                self._change(lambda program: step_edit.shift(program, row, -1))
            case "Down":
                self._change(lambda program: step_edit.shift(program, row, 1))
            case "Duplicate":
                self._change(lambda program: step_edit.duplicate(program, row))
            case "Delete":
                self._change(lambda program: step_edit.remove(program, row))
            case _:
                self._session.require_operator()
                self._desk.undo()

    async def _on_run(self) -> None:
        first = self._selected if self._from_row.value else 0
        loops: int | None = 1
        if self._run.value == "Loop":
            loops = None
        elif self._run.value == "Run N times":
            loops = int(self._times.value)
            if not 1 <= loops <= _MOST_LOOPS:
                raise InputError(f"N = {loops} is outside 1 … {_MOST_LOOPS}")
        program = self._desk.program
        if not program.steps:
            raise StateError("the list is empty; record a pose first")
        await self._session.submit(RunProgram(program, loops, first))
        self._desk.start(program)

    async def _on_hold(self) -> None:
        await self._session.submit(Pause() if self._hold.value == "Pause" else Resume())
