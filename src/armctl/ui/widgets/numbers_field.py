"""One field for several numbers, such as the angles of all joints: to type, to copy and to paste."""

from __future__ import annotations

import re
from collections.abc import Sequence

import viser

from armctl.errors import InputError
from armctl.ui.widgets.number_field import format_number, parse_number
from armctl.ui.widgets.text_entry import TextEntry

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
