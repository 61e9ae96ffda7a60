"""Text that is sent only when it changes."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import viser

_STYLE = "padding:2px 12px;font-size:12.5px;line-height:1.5;overflow-x:auto;overflow-wrap:anywhere"
_CELL = "padding:0 6px;text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap"
_HEAD = ";white-space:normal;overflow-wrap:normal;vertical-align:bottom"
"""Long heads, such as a joint's name, go over several lines, never broken within a word."""
_NAME = ";white-space:normal;overflow-wrap:anywhere"
"""A long name leaves the figures beside it in view."""


class LiveHtml:
    """A block of HTML. The caller escapes what is not its own."""

    def __init__(self, gui: viser.GuiApi, content: str = "") -> None:
        self._shown = content
        self._handle = gui.add_html(self._wrap(content))

    @property
    def visible(self) -> bool:
        """Whether the block is shown."""
        return self._handle.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        if self._handle.visible != visible:
            self._handle.visible = visible

    def show(self, content: str) -> None:
        """Replace the content, if it is another."""
        if content != self._shown:
            self._shown = content
            self._handle.content = self._wrap(content)

    @staticmethod
    def _wrap(content: str) -> str:
        return f"<div style='{_STYLE}'>{content}</div>"


def table(
    head: Sequence[str], rows: Sequence[Sequence[str]], *, marked: int | None = None, names: bool = True
) -> str:
    """An HTML table; all cells are escaped.

    Args:
        head: column heads; empty for none.
        rows: cells, as text.
        marked: index of a row to highlight.
        names: the first column holds names, set to the left.
    """
    left = _CELL.replace("right", "left") + _NAME if names else _CELL
    parts = ["<table style='border-collapse:collapse;width:100%'>"]
    if head:
        cells = "".join(
            f"<th style='{left if i == 0 else _CELL}{_HEAD}'>{escape(text)}</th>"
            for i, text in enumerate(head)
        )
        parts.append(f"<tr style='opacity:.7'>{cells}</tr>")
    for index, row in enumerate(rows):
        mark = ";background:rgba(34,139,230,.22)" if index == marked else ""
        cells = "".join(
            f"<td style='{left if i == 0 else _CELL}'>{escape(text)}</td>" for i, text in enumerate(row)
        )
        parts.append(f"<tr style='border-top:1px solid rgba(128,128,128,.2){mark}'>{cells}</tr>")
    return "".join([*parts, "</table>"])
