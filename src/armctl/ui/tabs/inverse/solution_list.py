"""The list of all solutions: a row is chosen by a click, by its number, or by what it is the least of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape

import numpy as np

from armctl.ui.session import Session
from armctl.ui.tabs.inverse.answer import RankedSolutions, counted
from armctl.ui.tabs.inverse.answer_html import comparison, list_head, list_row, selected_html
from armctl.ui.widgets.html import LiveHtml, Pager

_COMPARED, _LISTED = "compared-solutions", "solutions"


class SolutionList:
    """The rows of the newest answer; ``changed`` is called once another one is selected."""

    def __init__(self, session: Session, changed: Callable[[], None]) -> None:
        """Add it to the present container."""
        self._session, self._changed = session, changed
        self._found: RankedSolutions | None = None
        self._by: int | None = None
        gui = session.gui
        session.parts.add(gui, _COMPARED)
        session.parts.add(gui, _LISTED)
        self.pager = Pager(gui, session.on, changed)
        self._selected = LiveHtml(gui)
        session.on_part("solution", self._on_row)
        session.on_part("sort-solutions", self._on_sort)

    def reset(self, found: RankedSolutions | None) -> None:
        """Show the rows of another answer, least energy first; None: of none."""
        self._found, self._by = found, None
        if found is None or not found.solutions.success:
            self.pager.reset(0, None)
        else:
            self.pager.reset(len(found.solutions), found.instead or 1)

    def draw(self) -> None:
        """Show the page that the selected row is on."""
        found, row = self._found, self.pager.row
        if found is None or not found.solutions.success:
            return
        text, heads, rows, marked = comparison(found)
        self._session.parts.show(
            _COMPARED, rows_table("Rows that stand out", heads, rows, row, marked) + text if rows else ""
        )
        heads = list_head(found)
        sort = "least energy first" if not self._by else f"by {heads[self._by].removesuffix(' °')}"
        where = (
            f"<p>page {self.pager.page} of {self.pager.pages} · {counted(len(found.solutions))}, {sort}</p>"
        )
        shown = [(number, list_row(found, number)) for number in self.pager.in_view]
        words = (heads.index("branch"),)
        html = rows_table("Solutions", heads, shown, row, words, sorts="sort-solutions", by=self._by or 0)
        self._session.parts.show(_LISTED, where + html)
        self._selected.show(selected_html(found, row))

    def _on_row(self, key: str) -> None:
        if self._found is not None and key.isdecimal() and 1 <= int(key) <= len(self._found.solutions):
            self.pager.select(int(key))
            self._changed()

    def _on_sort(self, key: str) -> None:
        """By a joint's angle; by anything else as they are numbered, by energy."""
        found = self._found
        if found is None or not found.solutions.success or not key.isdecimal():
            return
        joint = int(key) - 1
        by_joint = 0 <= joint < found.robot.n
        self._by = joint + 1 if by_joint else None
        angles = found.q(np.arange(1, len(found.solutions) + 1))[:, joint] if by_joint else None
        self.pager.arrange(None if angles is None else np.argsort(angles, kind="stable") + 1)
        self.draw()


def rows_table(
    name: str,
    heads: Sequence[str],
    rows: Sequence[tuple[int, Sequence[str]]],
    selected: int | None,
    words: Sequence[int],
    *,
    sorts: str = "",
    by: int = 0,
) -> str:
    """A table whose rows, each with its number, are chosen by a click; ``words``: the columns of text.

    ``sorts``: what a click on a head does, but for those of ``words``; ``by``: the sorted column.
    """

    def head(i: int, text: str) -> str:
        told = escape(text).replace(" °", "&nbsp;°")
        if not sorts or i in words:
            return told
        mark = "&nbsp;▾" * (i == by)
        return f"<button type=button data-do={sorts} data-key={i}>{told}{mark}</button>"

    kind = [" class=word" * (i in words) for i in range(len(heads))]
    first = next((number for number, _ in rows if number == selected), rows[0][0] if rows else 0)
    top = "".join(f"<th{kind[i]}>{head(i, text)}</th>" for i, text in enumerate(heads))
    body = "".join(
        f"<tr role=option data-do=solution data-key={number} tabindex={0 if number == first else -1} "
        f"aria-selected={'true' if number == selected else 'false'}>"
        + "".join(f"<td{kind[i]}>{escape(cell)}</td>" for i, cell in enumerate(cells))
        + "</tr>"
        for number, cells in rows
    )
    return (
        f"<div class=armctl-rows><table role=presentation><thead><tr>{top}</tr></thead>"
        f"<tbody role=listbox aria-label='{escape(name)}'>{body}</tbody></table></div>"
    )
