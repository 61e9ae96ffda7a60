"""The selected row, and changes of the program by the page that operates."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import viser

from armctl.errors import StateError
from armctl.program import Program, Step, replace
from armctl.program.check import check_program
from armctl.runtime import UpdateProgram
from armctl.ui.session import Session
from armctl.ui.tabs.program.editing import Change, StepField, edited, fields_of, form_fields, shown
from armctl.ui.tabs.program.shared_program import SharedProgram
from armctl.ui.tabs.program.step_list import page_of
from armctl.ui.widgets.html import LiveHtml, muted
from armctl.ui.widgets.number_field import EditWatch

EDIT_WAITS = "the edit takes effect at the next pass"


class ProgramEditor:
    """What the parts of the serial motion share on one page."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._shared = session.shared(SharedProgram)
        self.selected = 0
        """index of the selected row"""
        self.page = 0
        """of the list, from 0"""

    @property
    def step(self) -> Step | None:
        """The selected step; None where the list is empty."""
        steps = self._shared.program.steps
        return steps[self.selected] if self.selected < len(steps) else None

    def select(self, row: int) -> None:
        """Select a row, from 0, and turn to its page."""
        self.selected, self.page = row, page_of(row)

    async def change(self, change: Callable[[Program], Change]) -> None:
        """Change the list and the selection; a program that runs goes on with the change at its next pass.

        Raises:
            ArmctlError: this page does not operate, the change cannot be made, or the arm cannot go on
                with it.
        """
        self._session.require_operator()
        changed, selected = change(self._shared.program)
        runs = await self._take_over(lambda: self._shared.edit(lambda _: changed))
        self.select(selected)
        if runs:
            await self._warn(changed)

    async def undo(self, *, redo: bool = False) -> None:
        """Take the last change back, or make the change again that was taken back last.

        Raises:
            ArmctlError: as ``change``; also where there is none.
        """
        self._session.require_operator()
        await self._take_over(self._shared.redo if redo else self._shared.undo)

    async def _take_over(self, edit: Callable[[], None]) -> bool:
        """Edit; if the arm runs what is edited, it is given the new version, too, and this is true."""
        shared = self._shared
        runs = shared.relation(self._session.snapshot.program) in ("running", "coming")
        edit()
        if not runs:
            return False
        try:
            await self._session.submit(UpdateProgram(shared.program))
        except StateError:
            if self._session.snapshot.program is None:  # it has ended meanwhile
                return False
            raise
        return True

    async def _warn(self, program: Program) -> None:
        """Say before the next pass that the arm would stop in it; nobody has checked an edit as Run does."""
        findings = await asyncio.to_thread(check_program, program, self._session.console.robot)
        errors = [finding for finding in findings if finding.severity == "error"]
        if errors and self._shared.program is program:
            self._session.notify("The next pass would stop there", f"{errors[0]}; edit it, or Undo", "yellow")


# The numbers of the selected step, to be edited.

Handle = viser.GuiTextHandle | viser.GuiDropdownHandle[str]
_NOTHING = "Nothing to edit: the list is empty."


class ProgramStepForm:
    """One field for everything that any step has; those of the selected step's kind are shown."""

    def __init__(self, session: Session, editor: ProgramEditor) -> None:
        self._session = session
        self._editor = editor
        self._filled: tuple[int, Step] | None = None
        gui = session.gui
        self._head = LiveHtml(gui, muted(_NOTHING))
        self._handles = {field.label: _add(gui, field) for field in form_fields()}
        self._apply = gui.add_button("Apply to step", visible=False)
        self._watch = EditWatch([])
        for handle in self._handles.values():
            self._watch.watch(handle.on_update)
        session.on(self._apply.on_click, self._on_apply)

    def refresh(self) -> None:
        """Fill the fields anew when another step is selected, or when it has changed."""
        step = self._editor.step
        self._head.show(self._heading(step))
        filled = None if step is None else (self._editor.selected, step)
        if filled == self._filled:
            return
        self._filled = filled
        fields = {} if step is None else {field.label: field for field in fields_of(step)}
        for label, handle in self._handles.items():
            field = fields.get(label)
            if step is not None and field is not None:
                _fill(handle, field, shown(step, field))
            handle.visible = field is not None
        self._apply.visible = bool(fields)

    def _heading(self, step: Step | None) -> str:
        if step is None:
            return muted(_NOTHING)
        session = self._session
        relation = session.shared(SharedProgram).relation(session.snapshot.program)
        waits = f"; {EDIT_WAITS}" if relation == "coming" else ""
        return muted(f"Row {self._editor.selected + 1}: {step.title}{waits}")

    async def _on_apply(self) -> None:
        self._session.require_operator()
        self._watch.require_settled()
        if self._filled is None:
            raise StateError("the list is empty; record a pose first")
        row, before = self._filled
        texts = {field.label: self._handles[field.label].value for field in fields_of(before)}
        step = edited(before, texts)

        def put(program: Program) -> Change:
            if self._editor.step != before:  # another page was faster
                raise StateError(f"row {row + 1} was changed meanwhile; look at it and edit again")
            return replace(program, row, step), row

        await self._editor.change(put)


def _add(gui: viser.GuiApi, field: StepField) -> Handle:
    hint = field.hint or None
    if field.choices:
        return gui.add_dropdown(field.label, field.choices, hint=hint, visible=False)
    return gui.add_text(field.label, "", hint=hint, visible=False)


def _fill(handle: Handle, field: StepField, text: str) -> None:
    if isinstance(handle, viser.GuiDropdownHandle) and text not in handle.options:
        handle.options = (*field.choices, text)  # a file may name what this version does not offer
    handle.value = text
