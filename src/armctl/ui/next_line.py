"""The line under the scene, as HTML: the next pose and its *Go*, or the program that runs."""

from __future__ import annotations

from html import escape
from typing import NamedTuple

from armctl.ui.widgets.html import button, sentence

FORGET = button("forget", "", title="Forget the next pose", kind="bare", icon="cross")


class Told(NamedTuple):
    """Something that the line tells in place of a next pose."""

    what: str
    how: str
    bad: bool = False
    """it was refused"""

    def html(self, buttons: str, kind: str = "") -> str:
        """The line that says it."""
        how = escape(sentence(self.how) if self.bad else self.how)
        bad = " class='bad'" * self.bad
        what = f"<b{bad}>{escape(self.what)}</b>"
        return line(what, f"<span title='{how}'>{how}</span>", buttons, kind or " bad" * self.bad)


NOTHING = Told("No next pose", "Move a slider, or type a point.")
WATCHED = Told("No next pose", "Watching: a slider or a point plans one.")


def line(place: str, what: str, buttons: str, state: str = "") -> str:
    """``place`` in bold, below it ``what``, at the end the buttons; ``state``: of the mark at its begin."""
    return f"<i class='swatch{state}'></i><p>{place}<span>{what}</span></p>{buttons}"


def refusal(why: str, kind: str = "") -> str:
    """Why the arm cannot go there."""
    told = escape(sentence(why)) if kind else escape(why)
    return f"<em class='{kind}' title='{told}'>{told}</em>" if kind else f"<em title='{told}'>{told}</em>"


def go(why: str | None = None, number: str = "") -> str:
    """*Go*; with ``why`` it cannot be pressed."""
    return button("go", "Go", key=number, why=why, kind="go", icon="play")


def record(what: str, number: str, why: str | None) -> str:
    """*Record*: ``what`` becomes a step of the program."""
    title = f"Put {what} on the list of Serial motion"
    return button("record", "Record", key=number, why=why, title=title, kind="record", icon="record")


def graph(is_open: bool | None) -> str:
    """What opens and folds the graph; None: there is none here."""
    if is_open is None:
        return ""
    title = f"{'Hide' if is_open else 'Show'} the motion over time"
    kind = "chip graph on" if is_open else "chip graph"
    return button("timeline", "Graph", title=title, kind=kind, icon="graph")
