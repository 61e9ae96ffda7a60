"""The numbers of a step as fields to edit, and back."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import msgspec

from armctl.documents import refusal_of
from armctl.errors import InputError, ProgramError
from armctl.program import EndStep, Program, Step, delete, duplicate, insert, move, repeat, replace
from armctl.program.keys import Key, keys_of
from armctl.program.steps import all_keys
from armctl.ui.widgets.number_field import format_number, parse_number


@dataclass(frozen=True, slots=True)
class StepField:
    """One field of the form, for the keys that share its label."""

    keys: tuple[Key, ...]

    @property
    def label(self) -> str:
        """Its label."""
        return self.keys[0].field.label

    @property
    def hint(self) -> str:
        """Its hint."""
        return self.keys[0].field.hint

    @property
    def choices(self) -> tuple[str, ...]:
        """What is offered; empty: a text field."""
        return self.keys[0].choices


def form_fields() -> tuple[StepField, ...]:
    """The fields of all kinds of steps, in order."""
    return _grouped(all_keys())


def fields_of(step: Step) -> tuple[StepField, ...]:
    """The fields that a step's kind has."""
    return _grouped(keys_of(type(step)))


def _grouped(keys: Sequence[Key]) -> tuple[StepField, ...]:
    return tuple(StepField(tuple(same)) for _, same in groupby(keys, lambda key: key.field.label))


def shown(step: Step, field: StepField) -> str:
    """What a field shows of a step."""
    values = [getattr(step, key.name) for key in field.keys]
    match field.keys[0].form:
        case "text" | "choice":
            return str(values[0])
        case "numbers":
            values = values[0]
        case _:
            pass
    return ", ".join("" if value is None else format_number(value) for value in values)


def edited(step: Step, texts: Mapping[str, str]) -> Step:
    """The step with what its fields hold; a field that was not edited keeps all digits of its value.

    Args:
        step: the one that the fields were filled from.
        texts: label of each of its fields to what it holds.

    Raises:
        InputError: no number, too few or too many, or a value that is not allowed; names the field.
    """
    record: dict[str, object] = msgspec.to_builtins(step)
    fields = fields_of(step)
    for field in fields:
        text = texts[field.label]
        if text != shown(step, field):
            record |= _values(step, field, text)
    try:
        return msgspec.convert(record, type(step))
    except msgspec.ValidationError as cause:
        refusal = refusal_of(cause, record, type(step))
        name = refusal.place[0] if refusal.place else None
        labels = (field.label for field in fields if name in {key.name for key in field.keys})
        raise InputError(f"{next(labels, step.kind)}: {refusal.what}") from cause


def _values(step: Step, field: StepField, text: str) -> dict[str, object]:
    first = field.keys[0]
    if first.form in ("text", "choice"):
        return {first.name: text}
    if first.form != "numbers" and len(field.keys) == 1:
        return {first.name: _number(first, text)}
    count = len(getattr(step, first.name)) if first.form == "numbers" else len(field.keys)
    parts = [part for part in re.split(r"[,;\s]+", text.strip().strip("()[]")) if part]
    if len(parts) != count:
        raise InputError(
            f"{field.label}: {count} numbers are needed, separated by commas; there are {len(parts)}"
        )
    numbers = [parse_number(part, field.label) for part in parts]
    if first.form == "numbers":
        return {first.name: numbers}
    return {key.name: number for key, number in zip(field.keys, numbers, strict=True)}


def _number(key: Key, text: str) -> float | int | None:
    if key.optional and not text.strip():
        return None
    value = parse_number(text, key.field.label)
    if key.form == "integer":
        if not value.is_integer():
            raise InputError(f"{key.field.label}: {text.strip()} is not a whole number")
        return int(value)
    return value


# What the serial motion's buttons do to the list, and which row is selected afterwards.

PLACES = (
    "at the end",
    "before the selected row",
    "after the selected row",
    "in place of the selected row",
)
Change = tuple[Program, int]
"""the new program, and the index of the row that is selected in it"""
_RANGE = re.compile(r"\s*(\d{1,6})\s*(?:(?:-|–|…|to)\s*(\d{1,6})\s*)?")


def add(program: Program, step: Step, where: str, selected: int) -> Change:
    """A recorded step goes to its place.

    A step put before the selected row leaves that row selected, one put after it is selected itself, so
    that several come out in the order in which they were recorded.
    """
    if where == PLACES[0] or not program.steps:
        return insert(program, len(program.steps), step), len(program.steps)
    if where == PLACES[1]:
        return insert(program, selected, step), selected + 1
    if where == PLACES[2]:
        return insert(program, selected + 1, step), selected + 1
    return replace(program, selected, step), selected


def remove(program: Program, selected: int) -> Change:
    """Without the selected row (a block's marker goes with the other); the next is selected, or the last."""
    _there(program, selected)
    shorter = delete(program, selected)
    removed = len(program.steps) - len(shorter.steps)
    ended_block = removed == 2 and isinstance(program.steps[selected], EndStep)
    row = selected - 1 if ended_block else selected
    return shorter, max(min(row, len(shorter.steps) - 1), 0)


def shift(program: Program, selected: int, by: int) -> Change:
    """The selected row up (-1) or down (+1).

    Raises:
        ProgramError: it is the first or the last already.
    """
    _there(program, selected)
    if not 0 <= selected + by < len(program.steps):
        raise ProgramError(f"row {selected + 1} is the {'first' if by < 0 else 'last'} one already")
    return move(program, selected, selected + by), selected + by


def double(program: Program, selected: int) -> Change:
    """A copy of the selected row, or of the block that it begins or ends, which is selected then."""
    _there(program, selected)
    longer = duplicate(program, selected)
    return longer, selected + len(longer.steps) - len(program.steps)


def wrap(program: Program, rows: str, selected: int, times: int) -> Change:
    """The rows of a range, e.g. ``2-5``, in a block; empty: the selected row.

    Raises:
        InputError: the range cannot be read.
        ProgramError: as ``repeat``.
    """
    _there(program, selected)
    first = last = selected
    if rows.strip():
        match = _RANGE.fullmatch(rows)
        if match is None:
            raise InputError(f"rows to repeat: {rows.strip()[:40]!r} is no range of rows; write e.g. 2-5")
        first = int(match.group(1)) - 1
        last = first if match.group(2) is None else int(match.group(2)) - 1
        for row in (first, last):
            _there(program, row)
    return repeat(program, first, last, times), first


def _there(program: Program, selected: int) -> None:
    count = len(program.steps)
    if not count:
        raise ProgramError("the list is empty; record a pose first")
    if not 0 <= selected < count:
        raise ProgramError(f"there is no row {selected + 1}; the program has {count}")
