"""The numbers of a step as fields to edit, and back."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, cast, get_args

import msgspec

from armctl.errors import InputError
from armctl.kinematics import CRITERIA
from armctl.motion import PitchMode, ProfileName
from armctl.motion.program import MoveStep, Step, kind_of
from armctl.motion.program.program import defaults_of
from armctl.motion.program.wording import refusal_of
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
