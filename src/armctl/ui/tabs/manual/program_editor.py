"""Recording steps, and changing the list of the program, by the page that operates."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial

import viser

from armctl.errors import ArmctlError, StateError
from armctl.process.heavy_work import check_program_apart
from armctl.program import CalledProgram, MoveStep, Program, Step
from armctl.program.base_steps import BlockStep
from armctl.program.edit import PLACES, Change, add, delete, duplicate, grid_around, move, surround
from armctl.program.rehearsal import pose_after
from armctl.protocol import Party, UpdateProgram
from armctl.ui.console import present_pose
from armctl.ui.events import OneAtATime
from armctl.ui.next_line import Told
from armctl.ui.next_pose import PoseWriter
from armctl.ui.offers import refused_by
from armctl.ui.session import Session
from armctl.ui.tabs.manual.new_step import (
    ARC,
    SET_VIA,
    Point,
    in_each_cell,
    present_pose_deg,
    quick_kinds,
    step_here,
    tool_point_mm,
)
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.widgets.angle_fields import slider_degrees
from armctl.ui.widgets.html import LiveHtml, muted, numbers

EMPTY = "the list is empty; record a pose first"
EDIT_WAITS = "the edit takes effect at the next pass"


class ProgramEditor:
    """The selected row, and changes of the program: what the parts of the serial motion share on one page."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._shared = session.console.shared(SharedProgram)
        self._key, self._row = "", 0
        """of the selected row, and where it was last"""
        self.leads_nowhere = ""
        """why the step that was chosen leads to no next pose"""
        self._writer = PoseWriter(session, "", kept_words="step of a program, as it was")
        self.asked = self._shown = ""
        """keys of the step whose end is to be the next pose, and of the one whose end was made it last"""
        self._showing = OneAtATime(self._show_end)
        self.where = PLACES[2]
        """where new steps go"""
        self.rows_inside = ""
        """rows that go into the next block that is added, e.g. 2-5; empty: none"""

    @property
    def selected(self) -> int:
        """Index of the selected row; where it has gone, of the one that has taken its place."""
        row = self._shared.row(self._key)
        return max(min(self._row, len(self._shared.keys) - 1), 0) if row is None else row

    @property
    def step(self) -> Step | None:
        """The selected step; None where the list is empty."""
        steps = self._shared.program.steps
        return steps[self.selected] if steps else None

    def select(self, row: int) -> None:
        """Select a row, from 0: it stays selected wherever it goes."""
        keys = self._shared.keys
        self._row, self._key = row, keys[row] if row < len(keys) else ""

    def choose(self, row: int) -> None:
        """Select a row, from 0, and make the pose to which it leads the next one; a page may watch."""
        self.select(row)
        self._ask(self._key)

    def follow(self) -> None:
        """The program was changed: what a step leads to may be another pose.

        Where the step is gone whose pose is the next one, it is that of the row that is selected now.
        """
        self.leads_nowhere = ""
        if self._writer.shown:
            gone = self._shared.row(self._shown) is None
            self.select(self.selected)
            self._ask(self._key if gone else self._shown)

    def _ask(self, key: str) -> None:
        self.leads_nowhere, self.asked = "", key
        self._writer.begin()
        self._session.spawn(self._showing.run())

    async def _show_end(self) -> None:
        """Planning the way there may take tenths of a second."""
        session, program, key = self._session, self._shared.program, self.asked
        row, start = self._shared.row(key), session.console.last_known.standing(session.snapshot)
        q, refused = None, ""
        if row is not None:
            try:
                linked = await self._shared.linked()
                q = await asyncio.to_thread(pose_after, session.held, linked, row, start)
            except ArmctlError as refusal:
                refused = str(refusal)
        if self._shared.program is not program or self.asked != key or self._writer.overtaken:
            return
        if q is not None and row is not None:
            self._shown, self._writer.words = key, f"step {row + 1}"
            self._writer.show(q)
        elif refused or self._shared.row(self._shown) is None:
            self.leads_nowhere = refused
            what = f"Step {'' if row is None else row + 1} cannot run"
            self._writer.hide(Told(what, refused, bad=True) if refused else None)

    async def change(self, change: Callable[[Program], Change]) -> None:
        """Change list and selection, from the next pass on; refused if impossible, or on a watching page."""
        self._session.require_operator()
        changed, selected = change(self._shared.program)
        runs = await self._take_over(lambda: self._shared.edit(changed, self._me))
        self.select(selected)
        if runs:  # beside what else is done on the page
            self._session.spawn(self._session.attempt(partial(self._tell_next_pass, changed)))

    async def _tell_next_pass(self, changed: Program) -> None:
        """Say before the next pass that the arm would stop in it: only Run checks a program."""

        def progress(_: int, __: int) -> None:
            if self._shared.program is not changed or self._session.closed:
                raise StateError("the program was edited again")

        robot = self._session.console.robot
        try:
            linked = await self._shared.linked(self._running_called())
            found = await asyncio.to_thread(check_program_apart, linked, robot, progress=progress)
        except StateError:  # that edit is checked, too
            return
        error = next((finding for finding in found if finding.severity == "error"), None)
        if error is not None and self._shared.program is changed:
            text = f"{error}; edit it, or Undo"
            self._session.notify("The next pass would stop there", text, "yellow")

    async def add(self, step: Step) -> None:
        """Put a step on the list where new steps go; a block round the rows that are to be inside."""
        rows, where, at = self.rows_inside, self.where, self.selected
        if rows.strip() and isinstance(step, BlockStep):
            await self.change(lambda program: surround(program, step, rows, at))
        else:
            await self.change(lambda program: add(program, step, where, at))

    @property
    def adds_in_grid(self) -> bool:
        """A new step goes into a grid."""
        program, row = self._shared.program, self.selected
        at = {PLACES[0]: len(program.steps), PLACES[2]: row + 1}.get(self.where, row)
        return grid_around(program, at) is not None

    async def add_kind(self, kind: type[Step], *, cell: bool = False) -> None:
        """Put a step of a kind on the list, made where the arm is; refused where something is not known.

        ``cell``: at the cell of the grid around it.
        """
        self._session.require_operator()
        shared = self._shared
        names = {
            "program": shared.callable,
            "file": shared.drawings,
            "frame": tuple(shared.program.frames),
            "counter": shared.counters,
        }
        first = {key: known[0] for key, known in names.items() if known}
        step = step_here(kind, self._session.arm, self._session.snapshot, names=first)
        await self.add(in_each_cell(step) if cell else step)

    def _running_called(self) -> tuple[CalledProgram, ...]:
        """What the program that runs calls was read when it began: that runs, whatever its files say now."""
        progress = self._session.snapshot.program
        return () if progress is None else progress.coming.called

    @property
    def _me(self) -> Party:
        return Party(self._session.me, self._session.name)

    async def undo(self, *, redo: bool = False) -> None:
        """Take the last change back, or make it again; refused as ``change``."""
        self._session.require_operator()
        await self._take_over(lambda: self._shared.undo(self._me, redo=redo))

    async def _take_over(self, edit: Callable[[], None]) -> bool:
        """Edit; if the arm runs what is edited, it is given the new version, too, and this is true."""
        shared, session = self._shared, self._session
        runs = shared.relation(session.snapshot.program) in ("running", "coming")
        edit()
        if runs:
            try:
                await session.submit(UpdateProgram(await shared.linked(self._running_called())))
            except StateError:
                if session.snapshot.program is not None:
                    raise
                return False  # it has ended meanwhile
        return runs


_EDITS: dict[str, Callable[[Program, int], Change]] = {
    "Up": lambda program, row: move(program, row, -1),
    "Down": lambda program, row: move(program, row, 1),
    "Duplicate": duplicate,
    "Delete": delete,
}
_ROWS_HINT = "A block that you add goes around these rows, e.g. 2-5. Empty: a new block is empty."
_TOOL_HINT = "Where the tool is: as a point, or as the end of a straight line or of an arc through 'via'."


class ProgramRecord:
    """Buttons that put steps on the list and move them about."""

    def __init__(self, session: Session, editor: ProgramEditor, more: viser.GuiFolderHandle) -> None:
        """``more``: where what is needed now and then stands."""
        self._session, self._editor = session, editor
        self._via_mm: Point | None = None
        self._kinds: dict[str, type[Step]] = {}
        gui = session.gui
        with more:
            where = gui.add_dropdown("New steps go", PLACES, initial_value=editor.where)
            rows = gui.add_text("Wrap rows", "", hint=_ROWS_HINT)
            self._edits = edits = gui.add_button_group("Edit", tuple(_EDITS), visible=False)
        session.on(where.on_update, partial(self._on_where, where))
        session.on(rows.on_update, partial(self._on_rows, rows))
        groups: list[viser.GuiButtonGroupHandle] = []
        for row, kinds in quick_kinds(session.console.robot).items():
            self._kinds |= kinds
            labels = [*kinds]
            if ARC in labels:
                labels.insert(labels.index(ARC), SET_VIA)
            group = gui.add_button_group(row, labels, hint=_TOOL_HINT if ARC in labels else None)
            session.on(group.on_click, partial(self._on_group, group))
            groups.append(group)
        session.needs(None, *groups, also=refused_by(present_pose), told=False)
        pose = partial(self._record, next(iter(self._kinds)))
        command = session.command("Record pose", pose, "Add the present pose to the program")
        session.needs(None, command, also=refused_by(present_pose), told=False)
        session.on_press("record", "Record", self._on_record_next)
        self._via = LiveHtml(gui)
        self._via.visible = False
        self._shared = session.console.shared(SharedProgram)
        session.needs(None, edits, told=False)
        session.on(edits.on_click, lambda: self._edit(_EDITS[edits.value]))

    def refresh(self) -> None:
        """What changes rows is there where there are rows."""
        self._edits.visible = bool(self._shared.program.steps)

    def _on_where(self, where: viser.GuiDropdownHandle[str]) -> None:
        self._editor.where = where.value

    def _on_rows(self, rows: viser.GuiInputHandle[str]) -> None:
        self._editor.rows_inside = rows.value

    async def _edit(self, edit: Callable[[Program, int], Change]) -> None:
        row = self._editor.selected
        await self._editor.change(lambda program: edit(program, row))

    async def _on_record_next(self, key: str) -> None:
        """*Record* beside *Go*: the next pose is put on the list, or where the arm is."""
        self._session.next.require_seen(key)
        q = self._session.next.q
        if q is None:
            await self._record(next(iter(self._kinds)))
        else:
            await self._editor.add(MoveStep(joints_deg=tuple(slider_degrees(self._session.console.robot, q))))

    async def _on_group(self, group: viser.GuiButtonGroupHandle) -> None:
        await self._record(group.value)

    async def _record(self, label: str) -> None:
        robot, snapshot = self._session.arm, self._session.snapshot
        if label == SET_VIA:
            self._session.require_operator()
            self._via_mm = tool_point_mm(robot, present_pose_deg(robot, snapshot))
            where = numbers(self._via_mm, 1)
            self._via.show(muted(f"Arc via ({where}) mm. Bring the tool to the arc's end, then press Arc."))
        else:
            await self._editor.add(step_here(self._kinds[label], robot, snapshot, self._via_mm))
            if label == ARC:
                self._via_mm = None
        self._via.visible = self._via_mm is not None
