"""Fields for numbers that move an arm: what the field shows is what is used, or nothing is.

viser's own number field keeps an emptied or half-typed value to itself, so the server would go on with
the number before it. These are text fields: whatever they show arrives, and what is no number is refused.
"""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Callable, Sequence

import viser

from armctl.errors import InputError


class TextEntry:
    """Whatever the field shows arrives at the server, character by character."""

    def __init__(self, handle: viser.GuiInputHandle[str]) -> None:
        self.handle = handle

    @property
    def text(self) -> str:
        """What the field shows."""
        return self.handle.value

    @property
    def is_empty(self) -> bool:
        """Nothing is in it."""
        return not self.text.strip()

    def send_again(self) -> None:
        """Make the page show what the server has."""
        text = self.handle.value
        self.handle.value = f"{text} "  # viser sends nothing when the value is the same
        self.handle.value = text

    @property
    def visible(self) -> bool:
        """Whether the field is shown."""
        return self.handle.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self.handle.visible = visible


_DIGITS = 3
_LARGEST = 1e6
_NUMBER = re.compile(
    r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?|[+-]?(inf|infinity|nan)", re.ASCII | re.IGNORECASE
)
"""as people write one: of what Python takes, ``1_0`` and other scripts' digits are left out"""
_MOST_CHARACTERS = 40
_SETTLE_S = 0.08
"""A page keeps only the last of the messages of 50 ms: a digit and a click that come closer than that
lose the digit, and the click arrives 50 ms behind the digit before it, or a frame later."""
_SHOW_HELD_S = 1.0
"""After an edit this young the page is told what the server used: a busy page can be later still."""


def parse_number(text: str, what: str) -> float:
    """The number that a field shows.

    Raises:
        InputError: empty, no number, not finite, or too large to mean anything.
    """
    plain = text.strip().replace("−", "-")
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


def format_number(value: float, digits: int = _DIGITS) -> str:
    """``value`` as a field shows it: rounded, without trailing or negative zeros."""
    text = f"{round(value, digits) + 0.0:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


class NumberField(TextEntry):
    """One field. A number that the program filled in keeps all its digits until somebody types."""

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
        """Add the field to the present container; ``value`` None: empty."""
        self.label = label
        self._exact = value
        self._filled = "" if value is None else format_number(value)
        super().__init__(gui.add_text(label, self._filled, hint=hint, visible=visible, disabled=disabled))

    @property
    def value(self) -> float:
        """The number in the field.

        Raises:
            InputError: as ``parse_number``.
        """
        if self._exact is not None and self.text == self._filled:
            return self._exact
        return parse_number(self.text, self.label)

    def positive(self, name: str, unit: str, zero: str) -> float | None:
        """The number in the field; None where the field is empty or 0, which means ``zero``.

        Raises:
            InputError: as ``parse_number``, or it is negative.
        """
        value = 0.0 if self.is_empty else self.value
        if value < 0:
            raise InputError(f"{name}: {value:g} {unit} is negative; 0 is {zero}")
        return value or None

    def fill(self, value: float) -> None:
        """Put a number into the field."""
        self._exact, self._filled = value, format_number(value)
        self.handle.value = self._filled


class EditWatch:
    """Knows when the page last edited one of some fields, so that a click cannot overtake a digit.

    ``require_settled`` belongs at the start of everything that uses the fields to move the arm.
    """

    def __init__(self, fields: Sequence[TextEntry], now: Callable[[], float] | None = None) -> None:
        self._fields = tuple(fields)
        self._now = now
        self._edited_at = -math.inf
        for field in self._fields:
            self.watch(field.handle.on_update)

    def watch(self, attach: Callable[..., object]) -> None:
        """Count this handle's updates as edits, too; ``attach`` is its ``on_update``."""

        async def note(event: viser.GuiEvent[viser.GuiTextHandle]) -> None:
            if event.client is not None:
                self._edited_at = self._time()

        attach(note)

    @property
    def settled(self) -> bool:
        """Nobody was typing when this click was made."""
        return self._time() - self._edited_at >= _SETTLE_S

    def show_held(self) -> None:
        """Make the page show what the server has, if a digit may have been lost."""
        if self._time() - self._edited_at < _SHOW_HELD_S:
            for field in self._fields:
                field.send_again()

    def require_settled(self) -> None:
        """Refuse a click that came with an edit; after a young edit the page is sent what the server has.

        Raises:
            InputError: a field was edited a moment ago.
        """
        self.show_held()
        if not self.settled:
            raise InputError(
                "a field was still being edited when the button was pressed; nothing was done: "
                "look at the fields and press again"
            )

    def _time(self) -> float:
        return asyncio.get_running_loop().time() if self._now is None else self._now()


# One field for several numbers, such as the angles of all joints: to type, to copy and to paste.

_BETWEEN = re.compile(r"[,;\s]+")


def parse_numbers(text: str, what: str, names: Sequence[str]) -> list[float]:
    """The numbers that a field shows, one for each name.

    Raises:
        InputError: another count, or one of them is no number that can be used.
    """
    parts = [part for part in _BETWEEN.split(text.strip().strip("()[]")) if part]
    if len(parts) != len(names):
        raise InputError(
            f"{what}: {len(names)} numbers are needed ({', '.join(names)}), got {len(parts)}; "
            "put commas or spaces between them"
        )
    return [parse_number(part, f"{what}: {name}") for part, name in zip(parts, names, strict=True)]


class NumbersField(TextEntry):
    """A text field that shows ``names`` numbers with commas between them."""

    def __init__(
        self,
        gui: viser.GuiApi,
        label: str,
        names: Sequence[str],
        values: Sequence[float],
        *,
        hint: str | None = None,
        visible: bool = True,
    ) -> None:
        """Add the field to the present container."""
        self._label, self._names = label, tuple(names)
        text = ", ".join(format_number(value, 2) for value in values)
        super().__init__(gui.add_text(label, text, hint=hint, visible=visible))

    @property
    def values(self) -> list[float]:
        """The numbers in the field.

        Raises:
            InputError: as ``parse_numbers``.
        """
        return parse_numbers(self.text, self._label, self._names)
