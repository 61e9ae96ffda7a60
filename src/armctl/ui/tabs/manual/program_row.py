"""A step of the program as a row of its list."""

from __future__ import annotations

import re
from html import escape

from armctl.lazy_dataclass import dataclass
from armctl.program import Step
from armctl.ui.widgets.html import with_minus

PARTS = 50
"""how finely the progress of a step is shown"""
_DEEPEST_SHOWN = 8
_PLACE = re.compile(r"(\d, \S*\d, \S*\d) mm\b")
"""X, Y, Z: a row has no room for their unit"""
_MARK = {"error": "✕", "warning": "!"}
_ICONS = {
    "step": "M8 5.5a2.5 2.5 0 1 0 .01 0z",
    "joints": "M3 13.5h4M5 13.5V9l5.5-4.5M5 7.5a1.5 1.5 0 1 0 .01 0zM11 2.5a1.5 1.5 0 1 0 .01 0z",
    "point": "M8 4a4 4 0 1 0 .01 0zM8 1.5v13M1.5 8h13",
    "line": "M3 13L13 3M7 3h6v6",
    "arc": "M2.5 12.5C3 5.5 8 3 13 4M9.5 1.5L13 4l-2.5 3.5",
    "draw": "M3 13l1-3.5L10.5 3 13 5.5 6.5 12z",
    "gripper": "M8 14.5V11M4 11h8M4 11V6.5L6 3M12 11V6.5L10 3",
    "pick": "M8 13V4M4.5 7.5L8 4l3.5 3.5M3 14.5h10",
    "place": "M8 2v9M4.5 7.5L8 11l3.5-3.5M3 14.5h10",
    "wait": "M8 2a6 6 0 1 0 .01 0zM8 4.5V8l2.5 1.5",
    "input": "M2 8h7M6.5 5.5L9 8l-2.5 2.5M8 2.5h5.5v11H8",
    "output": "M7 8h7M11.5 5.5L14 8l-2.5 2.5M8 2.5H2.5v11H8",
    "message": "M2.5 3h11v8H8l-3 2.5V11H2.5z",
    "loop": "M3 8a5 5 0 0 1 9-3M12.5 2v3.5H9M13 8a5 5 0 0 1-9 3M3.5 14v-3.5H7",
    "branch": "M4.5 2v12M4.5 9c0-3 6-2 6-5M8 5.5L10.5 3 13 5.5",
    "end": "M4 8V2.5h8M4 8v4h8",
    "count": "M6 2.5L5 13.5M11 2.5l-1 11M3 6h10.5M2.5 10H13",
    "call": "M3 2.5h7l3 3v8H3zM6 7l3 2-3 2z",
    "speed": "M2.5 12a6 6 0 1 1 11 0M8 10l3-4",
    "tool": "M10.5 2.5a3.5 3.5 0 0 0-3 5l-5 5 1.5 1.5 5-5a3.5 3.5 0 0 0 4.5-4.5L11.5 6.5l-2-2z",
    "frame": "M4 2v10h10M4 12l4-4",
    "grid": "M2.5 2.5h11v11h-11zM2.5 8h11M8 2.5v11",
    "comment": "M3 4h10M3 8h10M3 12h6",
}
"""paths in a square of 16, by the ``icon`` of a step"""


@dataclass(frozen=True, slots=True)
class RowState:
    """What a row shows beside its step."""

    selected: bool = False
    tools: bool = False
    """with its buttons"""
    done: int | None = None
    """it runs; so many parts of it are over"""
    severity: str = ""
    finding: str = ""
    fields: str = ""
    """HTML of the fields in which it is edited"""
    inside: str = ""
    """where inside it the program is, of one that is made of others"""


PLAIN = RowState()


def icon_of(kind: type[Step]) -> str:
    """The picture of a kind of step."""
    drawn = _ICONS.get(kind.icon, _ICONS["step"])
    return f"<svg viewBox='0 0 16 16' aria-hidden=true><path d='{drawn}'/></svg>"


def row_html(
    key: str, row: int, step: Step, depth: int, state: RowState = PLAIN, of: str = "", lasts: str = ""
) -> str:
    """A step as a row of the list; ``depth``: how many blocks are around it. The script writes its number.

    ``of``: the block that it ends or divides, in words. ``lasts``: how long it takes.

    It is no ``div``: styles of the page ask of each of those what is in it. In a list of 2,000 that made a
    change five times as slow.
    """
    said = with_minus(of or step.describe())
    words = escape(_PLACE.sub(r"\1", said))
    note = ""
    if step.note and not state.fields:  # one of them holds it
        note = f"<small role=gridcell class=note>{escape(step.note)}</small>"
    note += f"<small role=gridcell class=note>▸ {escape(state.inside)}</small>" if state.inside else ""
    mark, title = "", escape(" · ".join(text for text in (said, step.note) if text))
    style = f"--in:{min(depth, _DEEPEST_SHOWN)};" if depth else ""
    if state.done is not None:
        style += f"--done:{100 * state.done // PARTS}%"
        mark = " aria-current=step"
    if style:
        mark += f" style='{style}'"
    finding = ""
    if state.finding:
        what = f"{_MARK[state.severity]} {with_minus(state.finding)}"
        finding = (
            f"<em role=gridcell class=armctl-{state.severity} title='{escape(what)}'>{escape(what)}</em>"
        )
    selected = state.selected
    more, kinds = _tools(key, row) if state.tools else "", " tools" * state.tools
    if state.fields:
        kinds += " edits"
        more += f"<div role=gridcell class=armctl-fields data-key={key}>{state.fields}</div>"
    return (
        f"<armctl-row role=row class='armctl-step{kinds}' data-key={key} data-do=step "
        f"tabindex={0 if selected else -1} aria-selected={'true' if selected else 'false'}{mark}>"
        f"<i data-grip></i><span role=gridcell class=nth data-nth></span>{icon_of(type(step))}"
        f"<b role=gridcell>{escape(step.title.capitalize())}</b>"
        f"<span role=gridcell class=does title='{title}'>{words}</span>{note}"
        f"<span role=gridcell class=lasts>{lasts}</span>{finding}{more}</armctl-row>"
    )


_BUTTONS = {
    "step-edit": ("Edit row {}", "Enter, double click", "M4 20l1-5L16 4l4 4L9 19z"),
    "step-up": ("Move row {} up", "Alt+↑", "M12 19V5M6 11l6-6 6 6"),
    "step-down": ("Move row {} down", "Alt+↓", "M12 5v14M6 13l6 6 6-6"),
    "step-copy": ("Duplicate row {}", "Ctrl+D", "M9 9h11v11H9zM5 15H4V4h11v1"),
    "step-delete": ("Delete row {}", "Delete", "M5 7h14M10 7V4h4v3M7 7l1 13h8l1-13"),
}
"""what each does, its key, and the lines of its icon"""


def _tools(key: str, row: int) -> str:
    """What can be done with a row, as buttons: for those who have no keys."""
    buttons = ""
    for do, (words, chord, lines) in _BUTTONS.items():
        name = words.format(row + 1)
        buttons += (
            f"<button type=button tabindex=-1 data-do={do} data-key={key} aria-label='{name}' "
            f"title='{name} ({chord})'><svg viewBox='0 0 24 24' aria-hidden=true><path d='{lines}'/></svg>"
            "</button>"
        )
    return f"<span role=gridcell class=armctl-tools>{buttons}</span>"
