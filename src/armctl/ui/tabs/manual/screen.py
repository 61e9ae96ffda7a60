"""Manual: each joint alone, jog, gripper, and serial motion."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from armctl.errors import InputError
from armctl.program import Blocks, Step
from armctl.protocol import Snapshot
from armctl.ui.session import Session
from armctl.ui.tabs.manual.jog import JogControl
from armctl.ui.tabs.manual.joints import JointControl, LiveReadout
from armctl.ui.tabs.manual.program_editor import EDIT_WAITS, PAGE_ROWS, ProgramEditor, ProgramRecord
from armctl.ui.tabs.manual.program_run import ProgramFiles, ProgramRun
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.manual.step_form import StepForm
from armctl.ui.widgets.html import GOOD, WARNING, LiveHtml, muted, strong

# Serial motion: a list of recorded steps, edited and run once, several times or for ever.


_CELL = "padding:0 6px;white-space:nowrap;overflow:hidden;text-overflow:ellipsis;max-width:290px"
_SELECTED = "background:rgba(34,139,230,.20);box-shadow:inset 3px 0 #228be6"
_RUNNING = "background:rgba(64,192,87,.28);font-weight:600"
_DEEPEST_SHOWN = 8
_INDENT_PX = 12
RESTORE, DELETE = "Yes, restore it", "No, delete it"
_EMPTY = (
    "<div style='opacity:.75'>No steps yet. Bring the arm somewhere (Joints, Jog), then press "
    "<b>Record pose</b>; repeat; press <b>Run once</b>.</div>"
)


class SerialMotion:
    """The list of the program, and around it what changes and runs it."""

    def __init__(self, session: Session) -> None:
        self._shared = session.console.shared(SharedProgram)
        self._editor = ProgramEditor(session)
        self._running: int | None = None
        self._drawn: tuple[object, ...] = ()
        gui = session.gui
        self._offer = LiveHtml(gui)
        self._answer = gui.add_button_group("Unsaved program", (RESTORE, DELETE), visible=False)
        self._head = LiveHtml(gui)
        self._list = LiveHtml(gui)
        self._turn = gui.add_button_group("Page", ("◀ Previous", "Next ▶"), visible=False)
        verdict = LiveHtml(gui)
        self._row = gui.add_number("Selected row", initial_value=1, min=1, step=1)
        with gui.add_folder("Run"):
            self._run = ProgramRun(session, self._editor, verdict)
        with gui.add_folder("Record and edit"):
            record = ProgramRecord(session, self._editor)
        with gui.add_folder("Selected step", expand_by_default=False):
            self._form = StepForm(session, self._editor)
        with gui.add_folder("Speed, comment, repeat", expand_by_default=False):
            record.add_extras()
        with gui.add_folder("Files", expand_by_default=False):
            self._files = ProgramFiles(session, self._run.check)
        self._session = session
        session.on(self._answer.on_click, self._on_answer)
        session.on(self._turn.on_click, self._on_turn)
        session.on(self._row.on_update, self._on_row)

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw the list where it, the selection or the running step has changed."""
        self._files.refresh()
        self._run.refresh(snapshot)
        self._show_kept()
        progress, editor = snapshot.program, self._editor
        runs_this = progress is not None and self._shared.relation(progress) == "running"
        running = progress.step if progress is not None and runs_this else None
        if running is not None and running != self._running:
            editor.page = running // PAGE_ROWS  # the page turns to the running step when that changes
        self._running = running
        self._head.show(self._headline(snapshot))
        if self._drawn != (self._shared.version, editor.page, editor.selected, running):
            self._draw()
        self._form.refresh()

    def _show_kept(self) -> None:
        """Offer what a console left unsaved; say where the present program is not kept."""
        left, kept = self._shared.left, self._shared.kept
        problem = "" if kept is None else kept.problem or ""
        self._answer.visible = left is not None
        self._offer.visible = bool(left or problem)
        if left is not None:
            self._offer.show(
                strong(f"Restore the unsaved program from {left.time}?")
                + muted("armctl ended before it was saved. Undo brings back what is on the list now.")
            )
        elif problem:
            self._offer.show(muted(f"A crash would lose what is not saved: {problem}"))

    async def _on_answer(self) -> None:
        self._session.require_operator()
        left = self._shared.left
        if left is not None:
            await self._shared.answer(left, restore=self._answer.value == RESTORE)

    def _headline(self, snapshot: Snapshot) -> str:
        program, progress = self._shared.program, snapshot.program
        count = len(program.steps)
        line = f"<b>{escape(program.name)}</b> · {count} step{'' if count == 1 else 's'}"
        if progress is None:
            return line
        loops = "∞" if progress.loops is None else progress.loops
        of = f"step {progress.step + 1} of {progress.steps}, pass {progress.loop + 1} of {loops}"
        if self._running is not None:
            return f"{line} · <span style='color:{GOOD}'>runs {of}</span>"
        if self._shared.relation(progress) == "coming":
            return f"{line} · <span style='color:{GOOD}'>runs {of}</span>; <b>{EDIT_WAITS}</b>"
        return f"{line}<br><span style='color:{WARNING}'>Runs another version: {of}</span>"

    def _draw(self) -> None:
        steps, editor = self._shared.program.steps, self._editor
        editor.selected = min(editor.selected, max(len(steps) - 1, 0))
        editor.page = min(editor.page, self._pages - 1)
        depths = self._shared.blocks.depths
        text = step_table(steps, editor.page, editor.selected, self._running, depths)
        if self._pages > 1:
            text += f"<div style='text-align:right;opacity:.75'>page {editor.page + 1} of {self._pages}</div>"
        self._list.show(text)
        self._turn.visible = self._pages > 1
        self._row.value = editor.selected + 1
        self._row.visible = bool(steps)
        self._drawn = (self._shared.version, editor.page, editor.selected, self._running)

    @property
    def _pages(self) -> int:
        return max(1, -(-len(self._shared.program.steps) // PAGE_ROWS))

    def _on_turn(self) -> None:
        turned = self._editor.page + (1 if self._turn.value.startswith("Next") else -1)
        self._editor.page = min(max(turned, 0), self._pages - 1)

    def _on_row(self) -> None:
        row, count = int(self._row.value), len(self._shared.program.steps)
        if not 1 <= row <= max(count, 1):
            raise InputError(f"there is no row {row}; the program has {count}")
        self._editor.select(row - 1)


def step_table(
    steps: Sequence[Step],
    page: int,
    selected: int | None,
    running: int | None,
    depths: Sequence[int] | None = None,
) -> str:
    """One page (from 0) of the list as HTML; ``selected`` and ``running`` are indices of rows to mark.

    ``depths``: how many blocks are around each step; None: looked up.
    """
    if not steps:
        return _EMPTY
    depths = Blocks.of(steps).depths if depths is None else depths
    parts = ["<table style='border-collapse:collapse;width:100%;line-height:1.35'>"]
    first = page * PAGE_ROWS
    for index, step in enumerate(steps[first : first + PAGE_ROWS], first):
        marks = [text for here, text in ((selected, _SELECTED), (running, _RUNNING)) if here == index]
        content = " · ".join(text for text in (step.describe(), step.note) if text)
        indent = 6 + _INDENT_PX * min(depths[index], _DEEPEST_SHOWN)
        parts.append(
            f"<tr style='border-top:1px solid rgba(128,128,128,.2);{';'.join(marks)}'>"
            f"<td style='{_CELL};text-align:right'>{'▶ ' if index == running else ''}{index + 1}</td>"
            f"<td style='{_CELL};padding-left:{indent}px'>{step.title or step.kind}</td>"
            f"<td style='{_CELL};width:100%' title='{escape(content)}'>{escape(content)}</td></tr>"
        )
    return "".join([*parts, "</table>"])


class ManualScreen:
    """Three inner tabs, so that each fits a laptop's screen."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._readout = LiveReadout(session.console.robot)
        tabs = session.gui.add_tab_group()
        with tabs.add_tab("Joints"):
            self._readout.add_to(session.gui)
            self._joints = JointControl(session)
        with tabs.add_tab("Jog" if session.console.robot.gripper is None else "Jog & gripper"):
            self._readout.add_to(session.gui)
            self._jog = JogControl(session)
        with tabs.add_tab("Serial motion"):
            self._serial = SerialMotion(session)

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
        if self._session.sees("Manual"):
            self._readout.refresh(snapshot)
        self._joints.refresh(snapshot)
        self._jog.refresh(snapshot)
        self._serial.refresh(snapshot)
