"""The numbers of a step as fields to edit, and back."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, cast, get_args

import msgspec

from armctl.errors import InputError, ProgramError
from armctl.kinematics import CRITERIA
from armctl.motion import PitchMode, ProfileName
from armctl.program import (
    EndStep,
    MoveStep,
    Program,
    Step,
    delete,
    duplicate,
    insert,
    kind_of,
    move,
    repeat,
    replace,
)
from armctl.program.files.document import refusal_of
from armctl.program.program import defaults_of
from armctl.ui.widgets.number_field import format_number, parse_number

FieldKind = Literal["number", "numbers", "text", "choice"]
_POINT = ("x_mm", "y_mm", "z_mm")
_VIA = ("via_x_mm", "via_y_mm", "via_z_mm")


@dataclass(frozen=True, slots=True)
class StepField:
    """One field of the form."""

    label: str
    keys: tuple[str, ...]
    """of the step"""
    kind: FieldKind = "number"
    choices: tuple[str, ...] = ()
    hint: str = ""


_FASTEST = "Empty: as fast as the limits allow."
FIELDS: tuple[StepField, ...] = (
    StepField("Angles °", ("joints_deg",), "numbers", hint="One angle a joint, separated by commas."),
    StepField("Point mm", _POINT, "numbers", hint="X, Y, Z of the tool at the end."),
    StepField("Via mm", _VIA, "numbers", hint="X, Y, Z of a point on the arc."),
    StepField("Tool pitch", ("pitch",), "choice", get_args(PitchMode), "Tool pitch on the way."),
    StepField(
        "Pitch °",
        ("pitch_deg",),
        hint="Tool pitch at the end; of a line or an arc with 'interpolated' only.",
    ),
    StepField("Roll °", ("roll_deg",), hint="Tool roll at the end. Empty: as it comes."),
    StepField("Choose by", ("choose",), "choice", CRITERIA, "Which of the solutions is taken."),
    StepField("Profile", ("profile",), "choice", get_args(ProfileName), "Law of the motion over time."),
    StepField("Tool speed mm/s", ("speed_mm_s",), hint=_FASTEST),
    StepField("Duration s", ("duration_s",), hint=_FASTEST),
    StepField("Blend mm", ("blend_mm",), hint="How far from its end the tool may turn off to the next step."),
    StepField("Wait time s", ("seconds",)),
    StepField("Open %", ("open_percent",), hint="0 closed, 100 open."),
    StepField("Percent", ("percent",), hint="Speed of the steps after this one."),
    StepField("Times", ("times",)),
    StepField("Note", ("note",), "text"),
)
"""of all kinds of steps, in order"""


def fields_of(step: Step) -> tuple[StepField, ...]:
    """The fields that a step's kind has."""
    keys = set(step.__struct_fields__)
    return tuple(field for field in FIELDS if keys.issuperset(field.keys))


def shown(step: Step, field: StepField) -> str:
    """What a field shows of a step."""
    values = [getattr(step, key) for key in field.keys]
    if field.kind in ("text", "choice"):
        return str(values[0])
    numbers = cast("tuple[float, ...]", values[0]) if field.keys == ("joints_deg",) else values
    return ", ".join("" if value is None else format_number(value) for value in numbers)


def edited(step: Step, texts: Mapping[str, str]) -> Step:
    """The step with what its fields hold; a field that was not edited keeps all digits of its value.

    Args:
        step: the one that the fields were filled from.
        texts: label of each of its fields to what it holds.

    Raises:
        InputError: no number, too few or too many, or a value that is not allowed; names the field.
    """
    record: dict[str, object] = msgspec.to_builtins(step)
    for field in fields_of(step):
        text = texts[field.label]
        if text != shown(step, field):
            record |= _values(step, field, text)
    try:
        return msgspec.convert(record, type(step))
    except msgspec.ValidationError as cause:
        refusal = refusal_of(cause, record)
        key = refusal.where.partition("[")[0]
        label = next((field.label for field in FIELDS if key in field.keys), kind_of(step))
        raise InputError(f"{label}: {refusal.what}") from cause


def _values(step: Step, field: StepField, text: str) -> dict[str, object]:
    if field.kind in ("text", "choice"):
        return {field.keys[0]: text}
    if field.kind == "number":
        return {field.keys[0]: _number(step, field, text)}
    joints = isinstance(step, MoveStep)
    count = len(step.joints_deg) if joints else len(field.keys)
    parts = [part for part in re.split(r"[,;\s]+", text.strip().strip("()[]")) if part]
    if len(parts) != count:
        raise InputError(
            f"{field.label}: {count} numbers are needed, separated by commas; there are {len(parts)}"
        )
    numbers = [parse_number(part, field.label) for part in parts]
    return {"joints_deg": numbers} if joints else dict(zip(field.keys, numbers, strict=True))


def _number(step: Step, field: StepField, text: str) -> float | int | None:
    key = field.keys[0]
    if not text.strip() and defaults_of(step)[key] is None:
        return None
    value = parse_number(text, field.label)
    if key == "times":
        if not value.is_integer():
            raise InputError(f"{field.label}: {text.strip()} is not a whole number")
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
