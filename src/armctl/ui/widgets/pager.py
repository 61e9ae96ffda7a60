"""Page buttons of a long list, and a field for the number of the row to select."""

from __future__ import annotations

from collections.abc import Callable

import viser

from armctl.ui.widgets.events import On

_BUTTONS = ("First", "Prev", "Next", "Last")


class Pager:
    """``changed`` is called when the user has turned a page or chosen a row."""

    def __init__(self, gui: viser.GuiApi, on: On, page_rows: int, changed: Callable[[], None]) -> None:
        """Add buttons and field to the present container."""
        self._page_rows = page_rows
        self._changed = changed
        self._rows = 0
        self.page = 0
        self.row: int | None = None
        self._buttons = gui.add_button_group("Page", _BUTTONS)
        self._field = gui.add_number("Row", initial_value=1, step=1, hint="Type a row's number to select it.")
        self.attach_row_edit = self._field.on_update
        on(self._buttons.on_click, self._on_button)
        on(self._field.on_update, self._on_row)

    @property
    def pages(self) -> int:
        """Number of pages, at least 1."""
        return max(1, -(-self._rows // self._page_rows))

    def reset(self, rows: int, row: int | None) -> None:
        """Page through another list of ``rows`` rows, with ``row`` (from 1) selected and in view."""
        self._rows, self.row, self.page = rows, row, 0
        if row is not None:
            self.page = (row - 1) // self._page_rows
            self._field.value = row

    async def _on_button(self) -> None:
        last = self.pages - 1
        wanted = {"First": 0, "Prev": self.page - 1, "Next": self.page + 1, "Last": last}
        self.page = min(max(wanted[self._buttons.value], 0), last)
        self._changed()

    async def _on_row(self) -> None:
        """A number outside the list selects nothing, so that nothing can be sent by it."""
        row = self._field.value
        self.row = int(row) if 1 <= row <= self._rows else None
        if self.row is not None:
            self.page = (self.row - 1) // self._page_rows
        self._changed()
