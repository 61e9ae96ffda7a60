"""Serial motion: a list of recorded steps, edited and run once, several times or for ever."""

from __future__ import annotations

from html import escape

from armctl.errors import InputError
from armctl.runtime import Snapshot
from armctl.ui.session import Session
from armctl.ui.tabs.program.editor import EDIT_WAITS, ProgramEditor, ProgramStepForm
from armctl.ui.tabs.program.files import ProgramFiles
from armctl.ui.tabs.program.record import ProgramExtras, ProgramRecord
from armctl.ui.tabs.program.run import ProgramRun
from armctl.ui.tabs.program.shared_program import SharedProgram
from armctl.ui.tabs.program.step_list import page_count, page_of, step_table
from armctl.ui.widgets.html import WARNING, LiveHtml


class SerialMotion:
    """The list of the program, and around it what changes and runs it."""

    def __init__(self, session: Session) -> None:
        self._shared = session.shared(SharedProgram)
        self._editor = ProgramEditor(session)
        self._running: int | None = None
        self._drawn: tuple[object, ...] = ()
        gui = session.gui
        self._head = LiveHtml(gui)
        self._list = LiveHtml(gui)
        self._pages = gui.add_button_group("Page", ("◀ Previous", "Next ▶"), visible=False)
        verdict = LiveHtml(gui)
        self._row = gui.add_number("Selected row", initial_value=1, min=1, step=1)
        with gui.add_folder("Run"):
            self._run = ProgramRun(session, self._editor, verdict)
        with gui.add_folder("Record and edit"):
            record = ProgramRecord(session, self._editor)
        with gui.add_folder("Selected step", expand_by_default=False):
            self._form = ProgramStepForm(session, self._editor)
        with gui.add_folder("Speed, comment, repeat", expand_by_default=False):
            ProgramExtras(session, self._editor, record)
        with gui.add_folder("Files", expand_by_default=False):
            self._files = ProgramFiles(session, self._run.check)
        session.on(self._pages.on_click, self._on_page)
        session.on(self._row.on_update, self._on_row)

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw the list where it, the selection or the running step has changed."""
        self._files.refresh()
        self._run.refresh()
        self._follow(self._running_step(snapshot))
        self._head.show(self._headline(snapshot))
        if self._state != self._drawn:
            self._draw()
        self._form.refresh()

    @property
    def _state(self) -> tuple[object, ...]:
        """All that decides about what the list shows."""
        return (self._shared.version, self._editor.page, self._editor.selected, self._running)

    def _running_step(self, snapshot: Snapshot) -> int | None:
        """Index of the running step, where the list shows the program that runs."""
        progress = snapshot.program
        return (
            progress.step if progress is not None and self._shared.relation(progress) == "running" else None
        )

    def _follow(self, running: int | None) -> None:
        """The page turns to the running step when that changes."""
        if running is not None and running != self._running:
            self._editor.page = page_of(running)
        self._running = running

    def _headline(self, snapshot: Snapshot) -> str:
        program, progress = self._shared.program, snapshot.program
        count = len(program.steps)
        line = f"<b>{escape(program.name)}</b> · {count} step{'' if count == 1 else 's'}"
        if progress is None:
            return line
        loops = "∞" if progress.loops is None else progress.loops
        of = f"step {progress.step + 1} of {progress.steps}, pass {progress.loop + 1} of {loops}"
        if self._running is not None:
            return f"{line} · <span style='color:#2b8a3e'>runs {of}</span>"
        if self._shared.relation(progress) == "coming":
            return f"{line} · <span style='color:#2b8a3e'>runs {of}</span>; <b>{EDIT_WAITS}</b>"
        return f"{line}<br><span style='color:{WARNING}'>Runs another version: {of}</span>"

    def _draw(self) -> None:
        steps, editor = self._shared.program.steps, self._editor
        pages = page_count(len(steps))
        editor.selected = min(editor.selected, max(len(steps) - 1, 0))
        editor.page = min(editor.page, pages - 1)
        text = step_table(steps, editor.page, editor.selected, self._running)
        if pages > 1:
            text += f"<div style='text-align:right;opacity:.75'>page {editor.page + 1} of {pages}</div>"
        self._list.show(text)
        self._pages.visible = pages > 1
        self._row.value = editor.selected + 1
        self._drawn = self._state

    async def _on_page(self) -> None:
        pages = page_count(len(self._shared.program.steps))
        turned = self._editor.page + (1 if self._pages.value.startswith("Next") else -1)
        self._editor.page = min(max(turned, 0), pages - 1)

    async def _on_row(self) -> None:
        row, count = int(self._row.value), len(self._shared.program.steps)
        if not 1 <= row <= max(count, 1):
            raise InputError(f"there is no row {row}; the program has {count}")
        self._editor.select(row - 1)
