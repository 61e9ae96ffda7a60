"""Leafing through a long list: page buttons, and a row number to select."""

from __future__ import annotations

from collections.abc import Callable

from armctl.ui.session import Session

FIRST, PREVIOUS, NEXT, LAST = "First", "Prev", "Next", "Last"


def turned(page: int, pages: int, button: str) -> int:
    """The page that a page button leads to."""
    wanted = {FIRST: 0, PREVIOUS: page - 1, NEXT: page + 1, LAST: pages - 1}[button]
    return min(max(wanted, 0), pages - 1)


class Pager:
    """Page buttons and a row field. ``changed`` is called when the user turned a page or chose a row."""

    def __init__(self, session: Session, page_rows: int, changed: Callable[[], None]) -> None:
        self._page_rows = page_rows
        self._changed = changed
        self._rows = 0
        self.page = 0
        self.row: int | None = None
        gui = session.gui
        self._buttons = gui.add_button_group("Page", (FIRST, PREVIOUS, NEXT, LAST))
        self._field = gui.add_number("Row", initial_value=1, step=1, hint="Type a row's number to select it.")
        self.attach_row_edit = self._field.on_update
        session.on(self._buttons.on_click, self._on_button)
        session.on(self._field.on_update, self._on_row)

    @property
    def pages(self) -> int:
        """Number of pages, at least 1."""
        return max(1, -(-self._rows // self._page_rows))

    def reset(self, rows: int, row: int | None) -> None:
        """Another list of ``rows`` rows, with ``row`` (from 1) selected and in view."""
        self._rows = rows
        self.page = 0
        self.select(row)

    def select(self, row: int | None) -> None:
        """Select a row, counted from 1, and turn to its page."""
        self.row = row
        if row is not None:
            self.page = (row - 1) // self._page_rows
            self._field.value = row

    async def _on_button(self) -> None:
        self.page = turned(self.page, self.pages, self._buttons.value)
        self._changed()

    async def _on_row(self) -> None:
        """A number outside the list selects nothing, so that nothing can be sent by it."""
        row = self._field.value
        if 1 <= row <= self._rows:
            self.row = int(row)
            self.page = (self.row - 1) // self._page_rows
        else:
            self.row = None
        self._changed()
