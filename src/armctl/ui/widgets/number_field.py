"""Fields for numbers that move an arm: what the field shows is what is used, or nothing is.

They are text fields: viser's number field keeps an emptied or half-typed value to itself.
"""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from html import escape
from typing import Any

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import InputError, out_of_range
from armctl.facts.angles import to_degrees
from armctl.ui.events import Action, On

_DIGITS = 3
_LARGEST = 1e6
_NUMBER = re.compile(
    r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?|[+-]?(inf|infinity|nan)", re.ASCII | re.IGNORECASE
)
"""as people write one: of what Python takes, ``1_0`` and other scripts' digits are left out"""
_MOST_CHARACTERS = 40
_BETWEEN = re.compile(r"[,;\s]|(?<=[\d.\s])[×xX](?=[\d.\s])")


def parse_number(text: str, what: str, *, comma: bool = False) -> float:
    """The number in a field; an ``InputError`` where it is none, not finite, or too large.

    ``comma``: it may stand for the decimal point, as no other number can follow in the field: "12,5".
    """
    plain = text.strip().replace("−", "-")
    if comma and "." not in plain:
        plain = plain.replace(",", ".", 1)
    if not plain:
        raise InputError(f"{what} is empty; type a number")
    if len(plain) > _MOST_CHARACTERS or _NUMBER.fullmatch(plain) is None:
        hint = " (write 1.5, with a point)" if "," in plain else ""
        raise InputError(f"{what}: {plain[:40]!r} is not a number{hint}")
    value = float(plain)
    if not math.isfinite(value) or abs(value) > _LARGEST:
        raise InputError(
            f"{what}: {plain[:40]!r} is not a number that can be used; "
            f"it must be within -{_LARGEST:,.0f} … {_LARGEST:,.0f}"
        )
    return value


def number_texts(text: str) -> list[str]:
    """What stands for a number each in a field: between commas, spaces, or × as in ``20 × 30 × 40``."""
    return [part for part in _BETWEEN.split(text.strip().strip("()[]")) if part]


def parse_numbers(text: str, what: str, names: Sequence[str]) -> list[float]:
    """The numbers that a field shows, one for each name; errors as ``parse_number``, or another count."""
    parts = number_texts(text)
    if len(parts) != len(names):
        raise InputError(
            f"{what}: {len(names)} numbers are needed ({', '.join(names)}), got {len(parts)}; "
            "put commas or spaces between them"
        )
    return [parse_number(part, f"{what}: {name}") for part, name in zip(parts, names, strict=True)]


def format_number(value: float, digits: int = _DIGITS) -> str:
    """``value`` as a field shows it: rounded, without trailing or negative zeros."""
    text = f"{round(value, digits) + 0.0:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


class TextEntry:
    """A text field: whatever it shows arrives at the server, character by character."""

    def __init__(self, handle: viser.GuiInputHandle[str]) -> None:
        self.handle = handle

    @property
    def text(self) -> str:
        """What the field shows."""
        return self.handle.value

    @property
    def visible(self) -> bool:
        """Whether the field is shown."""
        return self.handle.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self.handle.visible = visible


class NumberField(TextEntry):
    """One number. What the program filled in keeps all its digits until the page edits it."""

    def __init__(
        self,
        gui: viser.GuiApi,
        label: str,
        value: float | None,
        *,
        hint: str | None = None,
        visible: bool = True,
        disabled: bool = False,
    ) -> None:
        self.label = label
        self._exact = value
        self._filled = "" if value is None else format_number(value)
        super().__init__(gui.add_text(label, self._filled, hint=hint, visible=visible, disabled=disabled))

    @property
    def value(self) -> float:
        """The number in the field; errors as ``parse_number``."""
        if self._exact is not None and self.text == self._filled:
            return self._exact
        return parse_number(self.text, self.label)

    @property
    def edited(self) -> bool:
        """Whether it shows something else than what was filled in."""
        return self.text != self._filled

    def within(self, low: float, high: float) -> float:
        """The number; errors as ``parse_number``, and outside ``low`` … ``high``."""
        value = self.value
        if not low <= value <= high:
            raise InputError(f"{self.label}: {out_of_range(value, low, high)}")
        return value

    def whole(self, low: int, high: int) -> int:
        """The same for a whole number."""
        value = self.within(low, high)
        if value != int(value):
            raise InputError(f"{self.label}: {value:g} is no whole number")
        return int(value)

    def positive(self, name: str, unit: str, zero: str) -> float | None:
        """The number, None for an empty field or 0 (``zero``); errors as ``parse_number``, and below 0."""
        value = self.value if self.text.strip() else 0.0
        if value < 0:
            raise InputError(f"{name}: {value:g} {unit} is negative; 0 is {zero}")
        return value or None

    def fill(self, value: float) -> None:
        """Put a number into the field."""
        self._exact, self._filled = value, format_number(value)
        self.handle.value = self._filled


class NumbersField(TextEntry):
    """Several numbers in one field, with commas between them: to type, to copy and to paste."""

    def __init__(
        self,
        gui: viser.GuiApi,
        label: str,
        names: Sequence[str],
        array: FloatArray,
        scale: float,
        hint: str,
        *,
        digits: int = 2,
        visible: bool = True,
    ) -> None:
        """Show an array, one number for each name, ``scale`` times as large."""
        self._label, self._names, self._scale, self._digits = label, tuple(names), scale, digits
        self._exact, self._filled = array, ""
        super().__init__(gui.add_text(label, self._format(array), hint=hint, visible=visible))

    @property
    def array(self) -> FloatArray:
        """The array, as exact as it was filled in; errors as ``parse_numbers``."""
        if self._filled and self.text == self._filled:
            return self._exact.copy()
        return np.array(parse_numbers(self.text, self._label, self._names)) / self._scale

    def fill(self, array: FloatArray) -> None:
        """Put an array into the field."""
        self._exact, self._filled = array.copy(), self._format(array)
        self.handle.value = self._filled

    def _format(self, array: FloatArray) -> str:
        return ", ".join(format_number(value, self._digits) for value in (self._scale * array).tolist())


def _arranged(gui: viser.GuiApi, how: str) -> viser.GuiFormHandle:
    """A container whose parts ``viser_console.css`` arranges."""
    container = gui.add_form(None)
    with container:
        gui.add_html(f"<i hidden data-armctl-{how}></i>")
    return container


MOST_IN_A_ROW = 6
"""number fields"""


def field_grid(gui: viser.GuiApi, columns: int = 3) -> viser.GuiFormHandle:
    """A container in which number fields stand so many in a row, with their labels above.

    Enter in a field is its ``on_submit``.
    """
    return _arranged(gui, f"grid={columns}")


def button_pairs(gui: viser.GuiApi, *, wide: bool = False) -> viser.GuiFormHandle:
    """A container in which buttons stand two in a row, such as those of − and + of an axis.

    ``wide``: their words are long; on a phone there is one a row.
    """
    return _arranged(gui, "pairs=wide" if wide else "pairs")


def choices_in_row(gui: viser.GuiApi) -> viser.GuiFormHandle:
    """A container in which three lists stand in a row, with their labels above."""
    return _arranged(gui, "choices")


def slider_rows(gui: viser.GuiApi) -> viser.GuiFormHandle:
    """A container for sliders, each with a group of two small buttons at the end of its row."""
    return _arranged(gui, "sliders")


def in_row(gui: viser.GuiApi, label: str = "") -> viser.GuiFormHandle:
    """A container in which buttons stand beside each other, each as wide as its words; a field at the end.

    ``label``: what stands where the labels of fields do.
    """
    row = _arranged(gui, "row")
    if label:
        with row:
            gui.add_html(f"<span class='armctl-label'>{escape(label)}</span>")
    return row


DEGREES, MILLIMETRES = to_degrees(1.0), 1000.0
"""what a field shows for 1 rad and 1 m"""


class FieldArray:
    """Fields that show an array ``scale`` times as large."""

    def __init__(self, fields: Sequence[NumberField], scale: float) -> None:
        self.fields, self._scale = tuple(fields), scale

    @property
    def texts(self) -> tuple[str, ...]:
        """What the fields show."""
        return tuple(field.text for field in self.fields)

    @property
    def array(self) -> FloatArray:
        """The array; errors as ``parse_number``, by the field's label."""
        return np.array([field.value for field in self.fields]) / self._scale

    def fill(self, array: FloatArray, digits: int | None = None) -> None:
        """Put an array into the fields, rounded to ``digits`` of their unit, if given."""
        for field, value in zip(self.fields, (self._scale * array).tolist(), strict=True):
            field.fill(value if digits is None else round(value, digits))


_GIZMO_SCALE = 0.12


class DraggedPoint:
    """X, Y and Z in mm, and a target in the scene that can be dragged: both show the same point."""

    def __init__(
        self, gui: viser.GuiApi, scene: viser.SceneApi, on: On, name: str, point: FloatArray, dragged: Action,
        prefix: str = "",
    ) -> None:  # fmt: skip
        """Begin at ``point`` (3,) [m], the target hidden; ``dragged`` runs once the fields are filled."""
        self._dragged = dragged
        self.xyz = FieldArray([NumberField(gui, f"{prefix}{axis} mm", None) for axis in "XYZ"], MILLIMETRES)
        self.target = scene.add_transform_controls(
            name, scale=_GIZMO_SCALE, disable_rotations=True, depth_test=False, visible=False
        )
        self.put(point)
        on(self.target.on_update, self._on_drag)

    def put(self, point: FloatArray) -> None:
        """Move both to ``point`` (3,) [m]."""
        self.xyz.fill(point)
        self.target.position = point

    def _on_drag(self) -> Awaitable[object] | None:
        point = np.array(self.target.position)
        if not np.isfinite(point).all():  # no page drags it there
            return None
        self.xyz.fill(point, digits=1)
        return self._dragged()


_SETTLE_S = 0.08
"""a page sends only the last message of 50 ms: a click that follows a digit sooner loses the digit"""
_QUIET_S = 0.3
"""nobody types any more"""
_SHOW_HELD_S = 1.0
"""after an edit this young the page is sent what the server used"""


class EditWatch:
    """Knows when the page last edited one of some fields, so that a click cannot overtake a digit."""

    def __init__(self, fields: Sequence[TextEntry], now: Callable[[], float] | None = None) -> None:
        self._fields = tuple(fields)
        self._now = now or (lambda: asyncio.get_running_loop().time())
        self._edited_at = -math.inf
        for field in self._fields:
            self.watch(field.handle.on_update)

    def watch(self, attach: Callable[..., object]) -> None:
        """Count this handle's updates as edits, too; ``attach`` is its ``on_update``."""

        async def note(event: viser.GuiEvent[viser.GuiTextHandle]) -> None:
            if event.client is not None:
                self._edited_at = self._now()

        attach(note)

    def show_held(self) -> None:
        """Make the page show what the server has, if a digit may have been lost."""
        if self._now() - self._edited_at < _SHOW_HELD_S:
            for field in self._fields:
                text = field.text
                field.handle.value = f"{text} "  # viser sends nothing when the value is the same
                field.handle.value = text

    def require_settled(self) -> None:
        """Refuse a click that came with an edit; for the start of everything that moves the arm by fields."""
        self.show_held()
        if self._now() - self._edited_at < _SETTLE_S:
            raise InputError(
                "a field was still being edited when the button was pressed; nothing was done: "
                "look at the fields and press again"
            )

    async def settle(self) -> None:
        """Wait until nobody types any more, and make the page show what the server has."""
        shown = math.nan
        while shown != self._edited_at:
            edited_at = self._edited_at
            await asyncio.sleep(_QUIET_S)
            if edited_at == self._edited_at:
                self.show_held()
                shown = edited_at


class Following:
    """Fields that hold where the arm stands, until somebody edits them."""

    def __init__(
        self,
        watch: EditWatch,
        fill: Callable[[FloatArray], None],
        spawn: Callable[[Coroutine[Any, Any, None]], None],
        q: FloatArray,
    ) -> None:
        """``fill`` puts a pose into the fields of ``watch``, which hold that at ``q`` (n,) [rad] now."""
        self._watch, self._fill, self._spawn, self._q = watch, fill, spawn, q.copy()
        self._moved = False
        self.edited = False
        """whether the fields are somebody's own and stay as they are"""

    def follow(self, q: FloatArray) -> None:
        """The arm stands at ``q`` (n,) [rad]."""
        if not self.edited and not np.array_equal(q, self._q):
            self._q, self._moved = q.copy(), True
            self._fill(q)

    def edit(self) -> None:
        """Somebody has edited a field, or uses what they hold: they stay as they are from now on."""
        if not self.edited and self._moved:
            # a pose of the arm may have come to the page after the first key, in place of what is held here
            self._spawn(self._watch.settle())
        self.edited = True

    def resume(self) -> None:
        """The fields follow the arm again."""
        self.edited, self._q = False, np.full_like(self._q, np.nan)
