"""The selected step of the program as fields to edit, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import viser

from armctl.decoding import refusal_of
from armctl.errors import InputError, StateError
from armctl.kinematics import CRITERIA
from armctl.program import Program, Step
from armctl.program.base_steps import Key, keys_of
from armctl.program.program import Change, replace
from armctl.program.steps import all_keys
from armctl.robot import Robot
from armctl.ui.session import Session
from armctl.ui.tabs.manual.program_editor import EDIT_WAITS, EMPTY, ProgramEditor
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.widgets.html import LiveHtml, muted
from armctl.ui.widgets.number_field import EditWatch, format_number, number_texts, parse_number


def by_label(keys: Sequence[Key]) -> dict[str, list[Key]]:
    """The label of each field of the form, and the keys that share the field."""
    fields: dict[str, list[Key]] = {}
    for key in keys:
        fields.setdefault(key.field.label, []).append(key)
    return fields


def texts_of(step: Step, robot: Robot | None = None) -> dict[str, str]:
    """The label of each field that a step has, and what the field shows.

    Of the tool's pitch and its orientation, what ``robot`` keeps, and what the step says (None: the pitch).
    """
    keeps = "orientation" if robot is not None and robot.orients_tool else "pitch"
    return {
        label: _shown(step, keys)
        for label, keys in by_label(keys_of(type(step))).items()
        if keys[0].field.turn in ("", keeps) or any(getattr(step, key.name) is not None for key in keys)
    }


def _shown(step: Step, keys: Sequence[Key]) -> str:
    values = [getattr(step, key.name) for key in keys]
    if all(value is None for value in values):
        return keys[0].field.left_open
    if keys[0].form in ("text", "choice"):
        return str(values[0])
    if keys[0].form == "numbers":
        values = values[0]
    return ", ".join("" if value is None else format_number(value) for value in values)


def edited(step: Step, texts: Mapping[str, str]) -> Step:
    """The step with ``texts`` by label; unedited ones keep all digits. An ``InputError`` names the field."""
    record: dict[str, object] = msgspec.to_builtins(step)
    fields = by_label(keys_of(type(step)))
    typed: dict[str, object] = {}
    for label, keys in fields.items():
        if label in texts and texts[label] != _shown(step, keys):
            typed |= _values(step, label, keys, texts[label])
    # a step says something of the tool's pitch or of its orientation: what is typed counts
    turns = {key.name: key.field.turn for keys in fields.values() for key in keys if key.field.turn}
    kinds = {turns[name] for name, value in typed.items() if name in turns and value is not None}
    record |= {name: None for name, turn in turns.items() if kinds and turn not in kinds} | typed
    try:
        return msgspec.convert(record, type(step))
    except msgspec.ValidationError as cause:
        refusal = refusal_of(cause, record, type(step))
        name = refusal.place[0] if refusal.place else None
        labels = (label for label, keys in fields.items() if name in {key.name for key in keys})
        raise InputError(f"{next(labels, step.kind)}: {refusal.what}") from cause


def _values(step: Step, label: str, keys: Sequence[Key], text: str) -> dict[str, object]:
    first, several = keys[0], keys[0].form == "numbers"
    if first.form in ("text", "choice"):
        return {first.name: text}
    if not several and len(keys) == 1:
        return {first.name: _number(first, text)}
    if first.optional and not text.strip():
        return {key.name: None for key in keys}
    count = len(getattr(step, first.name)) if several else len(keys)
    parts = number_texts(text)
    if len(parts) != count:
        raise InputError(f"{label}: {count} numbers are needed, separated by commas; there are {len(parts)}")
    numbers = [parse_number(part, label) for part in parts]
    return {first.name: numbers} if several else dict(zip((key.name for key in keys), numbers, strict=True))


def _number(key: Key, text: str) -> float | int | None:
    if key.optional and not text.strip():
        return None
    value = parse_number(text, key.field.label)
    if key.form == "integer":
        if not value.is_integer():
            raise InputError(f"{key.field.label}: {text.strip()} is not a whole number")
        return int(value)
    return value


class StepForm:
    """One field for everything that any step has; those of the selected step's kind are shown."""

    def __init__(self, session: Session, editor: ProgramEditor) -> None:
        self._session, self._editor = session, editor
        self._filled: tuple[int, Step] | None = None
        gui = session.gui
        self._head = LiveHtml(gui)
        self._keys = {label: keys[0] for label, keys in by_label(all_keys()).items()}
        criteria = session.console.robot.energy.criteria
        self._choices = {
            label: criteria if key.choices == CRITERIA else key.choices for label, key in self._keys.items()
        }
        self._handles = {label: _add(gui, key, self._choices[label]) for label, key in self._keys.items()}
        self._apply = gui.add_button("Apply to step", visible=False)
        self._watch = EditWatch([])
        for handle in self._handles.values():
            self._watch.watch(handle.on_update)
        session.needs(None, self._apply, told=False)
        session.on(self._apply.on_click, self._on_apply)

    def refresh(self) -> None:
        """Fill the fields anew when another step is selected, or when it has changed."""
        step, row = self._editor.step, self._editor.selected
        self._head.show(muted("Nothing to edit: the list is empty." if step is None else self._heading(step)))
        filled = None if step is None else (row, step)
        if filled == self._filled:
            return
        self._filled = filled
        texts = {} if step is None else texts_of(step, self._session.console.robot)
        for label, handle in self._handles.items():
            if label in texts:
                _fill(handle, self._choices[label], texts[label])
            handle.visible = label in texts
        self._apply.visible = bool(texts)

    def _heading(self, step: Step) -> str:
        session = self._session
        waits = session.console.shared(SharedProgram).relation(session.snapshot.program) == "coming"
        row = f"Row {self._editor.selected + 1}: {step.title or step.kind}"
        return f"{row}; {EDIT_WAITS}" if waits else row

    async def _on_apply(self) -> None:
        self._session.require_operator()
        self._watch.require_settled()
        if self._filled is None:
            raise StateError(EMPTY)
        row, before = self._filled
        labels = texts_of(before, self._session.console.robot)
        step = edited(before, {label: self._handles[label].value for label in labels})

        def put(program: Program) -> Change:
            if self._editor.step != before:  # another page was faster
                raise StateError(f"row {row + 1} was changed meanwhile; look at it and edit again")
            return replace(program, row, step)

        await self._editor.change(put)


Handle = viser.GuiTextHandle | viser.GuiDropdownHandle[str]


def _add(gui: viser.GuiApi, key: Key, choices: tuple[str, ...]) -> Handle:
    label, hint = key.field.label, key.field.hint or None
    if choices:
        return gui.add_dropdown(label, choices, hint=hint, visible=False)
    return gui.add_text(label, "", hint=hint, visible=False)


def _fill(handle: Handle, choices: tuple[str, ...], text: str) -> None:
    if isinstance(handle, viser.GuiDropdownHandle) and text not in handle.options:
        handle.options = (*choices, text)  # a file may name what this version does not offer
    handle.value = text
