"""A program's steps as people read them: table rows and pages."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from armctl.program import Blocks, Step

PAGE_ROWS = 15
_CELL = "padding:0 6px;white-space:nowrap;overflow:hidden;text-overflow:ellipsis;max-width:290px"
_SELECTED = "background:rgba(34,139,230,.20);box-shadow:inset 3px 0 #228be6"
_RUNNING = "background:rgba(64,192,87,.28);font-weight:600"
_DEEPEST_SHOWN = 8
_INDENT_PX = 12


def page_of(row: int) -> int:
    """The page (from 0) that shows a row (from 0)."""
    return max(row, 0) // PAGE_ROWS


def page_count(rows: int) -> int:
    """How many pages there are; an empty list has one."""
    return max(1, -(-rows // PAGE_ROWS))


def step_table(steps: Sequence[Step], page: int, selected: int | None, running: int | None) -> str:
    """One page of the list as HTML; what is inside a repeat is set in.

    Args:
        steps: all of them.
        page: which page, from 0.
        selected: index of the selected row.
        running: index of the step that the arm does now.
    """
    if not steps:
        return (
            "<div style='opacity:.75'>No steps yet. Bring the arm somewhere (Joints, Jog), then press "
            "<b>Record pose</b>; repeat; press <b>Run once</b>.</div>"
        )
    depths = Blocks.of(steps).depths
    parts = ["<table style='border-collapse:collapse;width:100%;line-height:1.35'>"]
    first = page * PAGE_ROWS
    for index, step in enumerate(steps[first : first + PAGE_ROWS], first):
        marks = [text for here, text in ((selected, _SELECTED), (running, _RUNNING)) if here == index]
        content = " · ".join(text for text in (step.describe(), step.note) if text)
        inset = 6 + _INDENT_PX * min(depths[index], _DEEPEST_SHOWN)
        parts.append(
            f"<tr style='border-top:1px solid rgba(128,128,128,.2);{';'.join(marks)}'>"
            f"<td style='{_CELL};text-align:right'>{'▶ ' if index == running else ''}{index + 1}</td>"
            f"<td style='{_CELL};padding-left:{inset}px'>{step.title}</td>"
            f"<td style='{_CELL};width:100%' title='{escape(content)}'>{escape(content)}</td></tr>"
        )
    return "".join([*parts, "</table>"])
