"""The selected step of the program as fields in its row, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import field
from html import escape
from pathlib import PurePath

import msgspec

from armctl.decoding import refusal_of
from armctl.errors import ArmctlError, InputError
from armctl.kinematics import CRITERIA
from armctl.lazy_dataclass import dataclass
from armctl.program import Step
from armctl.program.base_steps import Key, keys_of
from armctl.program.conditions import COUNTER, GRIPPER, MEASURED
from armctl.program.frames import BASE
from armctl.robot import Robot
from armctl.ui.guard.parts import MOST_TYPED
from armctl.ui.widgets import html
from armctl.ui.widgets.html import sentence, with_minus
from armctl.ui.widgets.number_field import format_number, number_texts, parse_number


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
        if _belongs(step, keys[0], keeps) or any(getattr(step, key.name) != key.default for key in keys)
    }


def _belongs(step: Step, key: Key, keeps: str) -> bool:
    """The step has a use for the key's field; else it is shown only where something stands in it."""
    of_watched = key.field.of_watched
    return key.field.turn in ("", keeps) and (not of_watched or getattr(step, "watch", "") in of_watched)


def _shown(step: Step, keys: Sequence[Key]) -> str:
    values = [getattr(step, key.name) for key in keys]
    if all(value is None for value in values):
        return keys[0].field.left_open
    if keys[0].form in ("text", "choice"):
        return str(values[0])
    if keys[0].form == "numbers":
        values = values[0]
    return ", ".join("" if value is None else format_number(value) for value in values)


@dataclass(frozen=True, slots=True)
class NumberBox:
    """One of the numbers of a field that has a box for each."""

    name: str
    """which of the step's keys, or of the numbers of its key"""
    label: str
    value: float


def parts_of(step: Step, keys: Sequence[Key], robot: Robot) -> Sequence[NumberBox]:
    """The numbers of a place, or of the joints; nothing: the field is one text."""
    if keys[0].field.touched:
        named = zip(keys, _AXES, strict=True)
        return [NumberBox(key.name, f"{axis} mm", getattr(step, key.name)) for key, axis in named]
    values: Sequence[float] = getattr(step, keys[0].name) if keys[0].field.a_joint else ()
    if len(values) != len(robot.joints):
        return ()
    named = zip(robot.joints, values, strict=True)
    return [NumberBox(str(k), f"{joint.title} {joint.unit}", value) for k, (joint, value) in enumerate(named)]


def _with_part(step: Step, key: Key, name: str, value: float) -> Step:
    """The step with another number in one of them; the rest keeps all digits."""
    if key.form != "numbers":
        return msgspec.structs.replace(step, **{name: value})
    numbers = list(getattr(step, key.name))
    numbers[int(name)] = value
    return msgspec.structs.replace(step, **{key.name: tuple(numbers)})


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
    value = parse_number(text, key.field.label, comma=True)
    if key.form == "integer":
        if not value.is_integer():
            raise InputError(f"{key.field.label}: {text.strip()} is not a whole number")
        return int(value)
    return value


@dataclass(frozen=True, slots=True)
class KnownNames:
    """What a step may be about, as far as the program and its folder tell."""

    saved: Sequence[str] = ()
    """programs that it may call"""
    frames: Sequence[str] = ()
    drawings: Sequence[str] = ()
    """files"""


@dataclass
class StepEdit:
    """A step that is being edited in its row: what is typed and refused stays there until it is mended."""

    key: str
    """of the row"""
    typed: dict[str, str] = field(default_factory=dict[str, str])
    """by label, what was refused"""
    refusals: dict[str, str] = field(default_factory=dict[str, str])
    """by label, why"""
    _names: KnownNames = field(default_factory=lambda: KnownNames())
    more: bool | None = None
    """what is seldom needed is unfolded; None: nobody has said"""
    answers: int = 0
    """how often something was typed: each time the fields show what counts now"""

    def take(self, step: Step, label: str, text: str) -> Step:
        """The step with what is typed into one field; the same one where that is refused."""
        self.answers += 1
        self.typed[label] = text
        for texts in (self.typed, {label: text}):  # one field may be right by another one
            with suppress(InputError):
                taken = edited(step, texts)
                for done in tuple(texts):
                    self.typed.pop(done, None)
                    self.refusals.pop(done, None)
                return taken
        try:
            edited(step, {label: text})
        except InputError as refusal:
            self.refusals[label] = str(refusal)
        return step

    def take_part(self, step: Step, label: str, name: str, text: str, robot: Robot) -> Step:
        """As ``take``, of one of the numbers of a field."""
        self.answers += 1
        keys = by_label(keys_of(type(step)))[label]
        part = next((one for one in parts_of(step, keys, robot) if one.name == name), None)
        if part is None:
            return step  # of another version of the page
        place = f"{label}:{name}"
        self.typed.pop(place, None)
        self.refusals.pop(place, None)
        try:
            value = parse_number(text, part.label, comma=True)
        except InputError as refusal:
            self.typed[place], self.refusals[place] = text, str(refusal)
            return step
        return step if text == _part_text(part.value) else _with_part(step, keys[0], name, value)

    def unfolded(self, step: Step) -> bool:
        """What is seldom needed is shown: it is wanted, or something there has the arm move otherwise."""
        folded = [key for key in keys_of(type(step)) if key.field.more]
        if any(place.partition(":")[0] == key.field.label for key in folded for place in self.refusals):
            return True
        if self.more is None:
            return any(key.default != getattr(step, key.name) for key in folded if not _chooses(key))
        return self.more

    def html(self, step: Step, robot: Robot, names: KnownNames | None = None) -> str:
        """The fields of the step, each with its label, its hint, and why it is refused.

        Below them what is wrong with the step, as far as that is known without planning.
        """
        self._names = names or KnownNames()
        texts = texts_of(step, robot) | self.typed
        fields = by_label(keys_of(type(step)))
        shown, folded, several = "", "", sum(keys[0].field.touched for keys in fields.values()) > 1
        for number, (label, keys) in enumerate((label, fields[label]) for label in texts if label in fields):
            parts = () if label in self.typed else parts_of(step, keys, robot)
            if parts:
                field = self._place(number, label, keys[0], parts, titled=several)
            else:
                field = self._field(number, label, keys[0], texts[label], robot)
            if keys[0].field.more:
                folded += field
            else:
                shown += field
        do, name = ("step-discard", "Discard") if self.refusals else ("step-done", "Done")
        end = html.button(do, name, key=self.key)
        if not shown:
            shown, folded = folded, ""
        if folded:
            opened = self.unfolded(step)
            shown += folded if opened else ""
            end = (
                html.button(
                    "step-more",
                    "Fewer fields" if opened else "More fields",
                    key=self.key,
                    kind="link",
                    icon="up" if opened else "down",
                )
                + end
            )
        return f"{shown}{'' if self.refusals else _wrong(step, robot)}<div class=armctl-end>{end}</div>"

    def _place(self, number: int, label: str, key: Key, parts: Sequence[NumberBox], *, titled: bool) -> str:
        """The boxes of a place, or of the joints, each with its label."""
        boxes, refusals = "", ""
        for part in parts:
            place = f"armctl-step-{self.key}-{number}-{part.name}"
            why, text = (kept.get(f"{label}:{part.name}", "") for kept in (self.refusals, self.typed))
            does = f"data-set=step-set data-key='{self.key}.{number}:{part.name}' data-said={self.answers}"
            does += " data-focus" * (number == 0 and part is parts[0])
            does += f" aria-invalid=true aria-describedby={place}-why" if why else ""
            refusals += f"<em id={place}-why>{escape(with_minus(why))}</em>" if why else ""
            boxes += (
                f"<div><label for={place}>{escape(part.label)}</label><input id={place} {does} "
                f"data-enter=step-done value='{escape(text or _part_text(part.value))}' autocomplete=off "
                f"spellcheck=false maxlength={MOST_TYPED}></div>"
            )
        here = _touch_button(self.key, number, label) if key.field.touched else ""
        title = f"<small>{escape(label)}</small>" if titled else ""
        place = " place" * key.field.touched
        return (
            f"<div class='wide numbers{place}' role=group aria-label='{escape(label)}' "
            f"title='{escape(key.field.hint)}'>{title}<div>{boxes}{here}</div>{refusals}</div>"
        )

    def _field(self, number: int, label: str, key: Key, text: str, robot: Robot) -> str:
        why, place = self.refusals.get(label, ""), f"armctl-step-{self.key}-{number}"
        does = f"data-set=step-set data-key={self.key}.{number} data-said={self.answers}"
        if number == 0:
            does += " data-focus"
        if why:
            does += f" aria-invalid=true aria-describedby={place}-why"
        choices = self._offered(key, robot)
        if choices:
            offered = choices if text in choices else (*choices, text)  # a file may name what is not offered
            shown = {one: PurePath(one).name if key.field.offers == "drawings" else one for one in offered}
            options = "".join(
                f"<option value='{escape(one)}'{' selected' * (one == text)}>{escape(name) or '–'}</option>"
                for one, name in shown.items()
            )
            box = f"<select id={place} {does}>{options}</select>"
        else:
            hollow = " placeholder=auto" * (label == _DURATION)
            box = (
                f"<input id={place} {does} data-enter=step-done value='{escape(text)}' autocomplete=off "
                f"spellcheck=false maxlength={MOST_TYPED}{hollow}>"
            )
        half = _chooses(key) or label == "Note"
        wide = " class=half" * half or " class=wide" * (key.form in ("numbers", "text") or len(text) > _WIDE)
        said = f"<em id={place}-why>{escape(with_minus(why))}</em>" if why else ""
        named = f"<label for={place}>{escape(label)}</label>"
        return f"<div{wide} title='{escape(key.field.hint)}'>{named}{box}{said}</div>"

    def _offered(self, key: Key, robot: Robot) -> Sequence[str]:
        """What may be chosen; nothing: it is typed."""
        own = "" if robot.gripper is None else robot.gripper.output
        inputs = [one.name for one in robot.signals.inputs]
        names = {
            "programs": self._names.saved,
            "drawings": self._names.drawings,
            "inputs": inputs,
            "outputs": [one.name for one in robot.signals.outputs if one.name != own],
            "watched": [*inputs, *MEASURED, COUNTER],
            "joints": [*robot.joint_names, *([GRIPPER] if robot.gripper is not None else [])],
            "tools": [one.name for one in robot.tools],
        }.get(key.field.offers, ())
        if key.choices == (BASE,):
            return (BASE, *self._names.frames)
        if names:
            return ("", *names) if key.default == "" else names
        return robot.energy.criteria if key.choices == CRITERIA else key.choices


def _chooses(key: Key) -> bool:
    """It says which of the ways to a place is taken: each leads there."""
    return key.choices == tuple(CRITERIA)


def _touch_button(key: str, number: int, label: str) -> str:
    """It puts the place of the tool into a field."""
    name = f"{escape(label)}: where the tool is now"
    return (
        f"<button type=button class=bare data-do=step-touch data-key={key}.{number} aria-label='{name}' "
        f"title='{name}'>{html.icon_html('here')}</button>"
    )


def _wrong(step: Step, robot: Robot) -> str:
    """What the step itself says is wrong with it. One about a file is not asked: that takes long."""
    if any(key.field.offers == "drawings" for key in keys_of(type(step))):
        return ""
    try:
        step.check(robot)
    except ArmctlError as refusal:
        return f"<em class=wide role=status>{escape(with_minus(sentence(str(refusal))))}</em>"
    return ""


def _part_text(value: float) -> str:
    """A number as it stands in its box: one decimal, or those that it has, and a true minus."""
    text = format_number(value)
    return with_minus(text if "." in text else f"{text}.0")


_AXES = "XYZ"
_WIDE = 12
"""characters that a narrow field shows"""
_DURATION = "Duration s"
"""empty: as short as it can be"""
