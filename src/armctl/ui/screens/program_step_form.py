"""The numbers of the selected step, to be edited."""

from __future__ import annotations

from typing import TYPE_CHECKING

import viser

from armctl.errors import StateError
from armctl.motion.program import Program, Step, replace
from armctl.ui.screens.program_editor import EDIT_WAITS, ProgramEditor
from armctl.ui.widgets.html_bits import muted
from armctl.ui.widgets.number_field import EditWatch
from armctl.ui.widgets.step_edit import Change
from armctl.ui.widgets.step_fields import FIELDS, StepField, edited, fields_of, shown
from armctl.ui.widgets.step_list import describe
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

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
        self._handles = {field.label: _add(gui, field) for field in FIELDS}
        self._apply = gui.add_button("Apply to step", visible=False)
        self._watch = EditWatch([])
        for handle in self._handles.values():
            self._watch.watch(handle.on_update)
        session.on(self._apply.on_click, self._on_apply)

    def refresh(self) -> None:
        """Fill the fields anew when another step is selected, or when it has changed."""
        step = self._editor.step
        self._show_head(step)
        filled = None if step is None else (self._editor.selected, step)
        if filled == self._filled:
            return
        self._filled = filled
        fields = () if step is None else fields_of(step)
        for field in FIELDS:
            handle = self._handles[field.label]
            if field in fields and step is not None:
                _fill(handle, field, shown(step, field))
            if handle.visible != (field in fields):
                handle.visible = field in fields
        self._apply.visible = bool(fields)

    def _show_head(self, step: Step | None) -> None:
        if step is None:
            self._head.show(muted(_NOTHING))
            return
        session = self._session
        relation = session.console.programs.relation(session.snapshot.program)
        waits = f"; {EDIT_WAITS}" if relation == "coming" else ""
        self._head.show(muted(f"Row {self._editor.selected + 1}: {describe(step)[0]}{waits}"))

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
    if field.kind == "choice":
        return gui.add_dropdown(field.label, field.choices, hint=hint, visible=False)
    return gui.add_text(field.label, "", hint=hint, visible=False)


def _fill(handle: Handle, field: StepField, text: str) -> None:
    if isinstance(handle, viser.GuiDropdownHandle) and text not in handle.options:
        handle.options = (*field.choices, text)  # a file may name what this version does not offer
    if handle.value != text:
        handle.value = text
