"""Small pieces of HTML: numbers, headings, notes, refusals, findings; everything is escaped here."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import datetime
from html import escape

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.facts import Reason
from armctl.facts.words import opening
from armctl.motion.preflight import Finding, Unchecked
from armctl.robot import Robot
from armctl.ui.events import On

_LINE_EM = 1.5
"""height of a line in a block of HTML"""
WARNING = "var(--armctl-warning,#a65b00)"
"""colour of what is not as it should be"""
ERROR = "var(--armctl-error,#c92a2a)"
"""colour of what is refused or broken"""
GOOD = "var(--armctl-good,#237032)"
"""colour of what is as it should be; these three can be read in both themes (``viser_console.css``)"""
_MINUS = re.compile(r"(= *\[[^\]]*\])|(?<![\w.)-])-(?=\d)")
"""a hyphen before a number that is no part of a word, a range or a date; or a list as in a file: kept"""


def fixed(value: float, digits: int) -> str:
    """A number with a real minus sign and no negative zero; a dash where it is not finite."""
    if not math.isfinite(value):
        return "–"
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def numbers(values: Iterable[float], digits: int) -> str:
    """Several numbers in a row."""
    return ", ".join(fixed(value, digits) for value in values)


def heading(text: str) -> str:
    """A heading inside a block."""
    return f"<div style='font-weight:600;margin-top:6px'>{escape(text)}</div>"


def step_heading(nth: int, title: str, *, done: bool = False) -> str:
    """The heading of one of several steps that are done in turn; one that is done has a tick."""
    kind = " class='done'" if done else ""
    return f"<h3 class='armctl-nth'><i{kind}>{'✓' if done else nth}</i> {escape(title)}</h3>"


def steps_html(about: str, steps: Mapping[str, str]) -> str:
    """What something is for, and how it goes, for who sees it first: a number, a word and a line each."""
    lines = "".join(f"<li><b>{escape(one)}</b>: {escape(text)}.</li>" for one, text in steps.items())
    return f"<p class=armctl-about>{escape(about)}</p><ol class=armctl-ahead>{lines}</ol>"


EMPTY_LINE = "\u00a0"
"""what keeps the place of a line that says nothing: what lies below it does not move"""


def muted(text: str) -> str:
    """An explanation that may be overlooked."""
    return f"<div style='font-size:11.5px;opacity:.75'>{escape(with_minus(text))}</div>"


def folded(title: str, texts: Iterable[str]) -> str:
    """A list under a title, shown once the title is clicked."""
    rows = "".join(f"<li>{escape(with_minus(text))}</li>" for text in texts)
    return (
        "<details style='font-size:11.5px;opacity:.75'>"
        f"<summary style='cursor:pointer'>{escape(title)}</summary>"
        f"<ul style='margin:2px 0;padding-left:16px'>{rows}</ul></details>"
    )


def with_minus(text: str) -> str:
    """Words with real minus signs before their numbers, as ``fixed`` writes them."""
    return _MINUS.sub(lambda found: found[1] or "−", text)


def sentence(said: str | Reason) -> str:
    """A message, or a reason in words, as a sentence of its own."""
    text = with_minus(said if isinstance(said, str) else opening(said))
    return text if text.endswith(".") else f"{text[:1].upper()}{text[1:]}."


def refused(text: str) -> str:
    """Why something cannot be done."""
    return f"<div style='color:{ERROR}'>{escape(with_minus(text))}</div>"


def warned(text: str) -> str:
    """What to know before a button is pressed."""
    return f"<b style='color:{WARNING}'>{escape(with_minus(text))}</b>"


def simulated_only_html(robot: Robot) -> str:
    """That only a simulated board may drive an arm, and why; empty where a real one may."""
    why = robot.simulated_only
    return "" if why is None else f"<div>{warned('Simulated only')}: {escape(why)}.</div>"


def limited(text: str, lines: int, style: str = "") -> str:
    """A text that takes no more than so many lines; what is longer scrolls, and is shown under the mouse."""
    told = escape(text)
    return f"<div style='max-height:{_LINE_EM * lines}em;overflow-y:auto;{style}' title='{told}'>{told}</div>"


def beside(label: str, content: str) -> str:
    """What stands where fields do, ``content``, with its label where theirs are."""
    return (
        f"<div class=armctl-beside><span class=armctl-label>{escape(label)}</span><div>{content}</div></div>"
    )


def strong(text: str) -> str:
    """A result, in bold."""
    return f"<div><b>{escape(text)}</b></div>"


_ICONS = {
    "play": "M5 3l9 5-9 5z",
    "pause": "M5.5 3.5v9M10.5 3.5v9",
    "cross": "M4 4l8 8M12 4l-8 8",
    "record": "M8 4a4 4 0 1 0 .01 0z",
    "theme": "M8 2.5a5.5 5.5 0 1 0 .01 0zM8 2.5v11",
    "graph": "M2.5 2.5v11h11M5 10.5l3-4 2.5 2 3-5",
    "in": "M7 2.5a4.5 4.5 0 1 0 .01 0zM10.2 10.2l3.3 3.3M7 5v4M5 7h4",
    "out": "M7 2.5a4.5 4.5 0 1 0 .01 0zM10.2 10.2l3.3 3.3M5 7h4",
    "all": "M2.5 6V2.5H6M10 2.5h3.5V6M13.5 10v3.5H10M6 13.5H2.5V10",
    "download": "M8 2.5v7.5M4.5 7L8 10.5 11.5 7M3 13.5h10",
    "undo": "M6 3L3 6l3 3M3 6h6.5a3.5 3.5 0 0 1 0 7H6",
    "here": "M8 4.5a3.5 3.5 0 1 0 .01 0zM8 1.5v4M8 10.5v4M1.5 8h4M10.5 8h4",
    "down": "M4 6l4 4 4-4",
    "up": "M4 10l4-4 4 4",
    "redo": "M10 3l3 3-3 3M13 6H6.5a3.5 3.5 0 0 0 0 7H10",
}
"""paths in a square of 16"""


def icon_html(name: str) -> str:
    """One of the pictures of buttons."""
    return f"<svg viewBox='0 0 16 16' aria-hidden='true'><path d='{_ICONS[name]}'/></svg>"


def button(
    do: str,
    label: str,
    *,
    key: str = "",
    why: str | None = None,
    title: str = "",
    kind: str = "",
    icon: str = "",
    drawn: str = "",
    asks: str = "",
) -> str:
    """A button of a part of the page (``guard/parts.py``); with ``why`` it cannot be pressed, and says so.

    Without a label its title is its name. ``asks``: shown in place of the label, which stays its name.
    """
    said = f" aria-disabled='true' title='{escape(with_minus(why))}'" if why else ""
    if not why and title:
        said = f" title='{escape(title)}'"
    name = f" aria-label='{escape(label or title)}'" if asks or not label else ""
    name += f" aria-description='{escape(asks)}'" if asks else ""
    drawn = icon_html(icon) if icon else drawn
    key = f" data-key='{escape(key)}'" if key else ""
    more = f" data-do='{do}'{key}{name}{said}"
    return f"<button type='button' class='{kind}'{more}>{drawn}{escape(asks or label)}</button>"


def hint(text: str) -> str:
    """A ? in a part of the page that tells more under the mouse, or once it is pressed."""
    told = escape(with_minus(text))
    return f"<button type='button' class='hint' aria-disabled='true' title='{told}' data-do='hint'>?</button>"


# Times as people read them.


def time_of_day(stamp: float) -> str:
    """Local time of day of seconds since the epoch."""
    return datetime.fromtimestamp(stamp).astimezone().strftime("%H:%M:%S")


def date_and_time(stamp: str) -> str:
    """Local day and time of an ISO stamp."""
    return datetime.fromisoformat(stamp).astimezone().strftime("%Y-%m-%d %H:%M")


_STYLE = "padding:2px 9px 6px;font-size:12.5px;line-height:1.5;overflow-x:auto;overflow-wrap:anywhere"
_CELL = "padding:0 4px;text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap"
_HEAD = ";white-space:normal;overflow-wrap:normal;vertical-align:bottom"
"""Long heads, such as a joint's name, go over several lines, never broken within a word."""
_NAME = ";white-space:normal;overflow-wrap:break-word;text-align:left"
"""A long name goes over several lines, which leaves the figures beside it in view."""


class LiveHtml:
    """A block of HTML. The caller escapes what is not its own."""

    def __init__(self, gui: viser.GuiApi, content: str = "", *, visible: bool = True) -> None:
        self._content, self._handle = content, gui.add_html(_block(content), visible=visible)

    @property
    def visible(self) -> bool:
        """Whether the block is shown."""
        return self._handle.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._handle.visible = visible

    def show(self, content: str) -> None:
        """Replace the content, if it is another."""
        if content != self._content:
            self._content, self._handle.content = content, _block(content)


def _block(content: str) -> str:
    return f"<div style='{_STYLE}'>{content}</div>" if content else ""  # no gap where nothing is said


def table(
    head: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    marked: int | None = None,
    words: Sequence[int] = (0,),
    small: bool = False,
) -> str:
    """An HTML table, all cells escaped; ``marked``: a row's index; ``words``: the columns that are text."""

    def cells(tag: str, texts: Sequence[str], more: str = "") -> str:
        styles = (_CELL + _NAME * (i in words) for i in range(len(texts)))
        parts = zip(styles, texts, strict=True)
        return "".join(f"<{tag} style='{style}{more}'>{escape(text)}</{tag}>" for style, text in parts)

    html = f"<tr style='opacity:.7'>{cells('th', head, _HEAD)}</tr>" if head else ""
    for index, row in enumerate(rows):
        mark = ";background:rgba(34,139,230,.22)" if index == marked else ""
        html += f"<tr style='border-top:1px solid rgba(128,128,128,.2){mark}'>{cells('td', row)}</tr>"
    html = f"<table style='border-collapse:collapse;width:100%'>{html}</table>"
    return f"<div style='font-size:11px'>{html}</div>" if small else html


# A long table, a page at a time; page buttons, and a field for the number of the row to select.

PAGE_ROWS = 15


_ROW_HINT = "Type a row's number to select it."
_MOST_DIGITS = 9


class Pager:
    """``changed`` is called when the user has turned a page or chosen a row."""

    def __init__(self, gui: viser.GuiApi, on: On, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._rows = self._page = 0
        self._order: NDArray[np.int64] | None = None
        self.row: int | None = None
        """selected, from 1; None: none"""
        self._buttons = gui.add_button_group("Page", ("First", "Prev", "Next", "Last"), visible=False)
        self._field = gui.add_text("Row", "1", hint=_ROW_HINT, visible=False)
        self.attach_row_edit = self._field.on_update
        on(self._buttons.on_click, self._on_button)
        on(self._field.on_update, self._on_row)

    def reset(self, rows: int, row: int | None) -> None:
        """Page through another list of ``rows`` rows, with ``row`` (from 1) selected and in view."""
        self._rows, self.row, self._page, self._order = rows, row, 0, None
        self._field.visible, self._buttons.visible = rows > 0, rows > PAGE_ROWS
        if row is not None:
            self.select(row)

    def select(self, row: int) -> None:
        """Select a row (from 1) and turn to its page."""
        self._field.value, self.row = str(row), row
        self._turn_to(row)

    def arrange(self, order: NDArray[np.int64] | None) -> None:
        """Show the rows in this order, (k,) from 1, from the first page on; None: as they are numbered."""
        self._order, self._page = order, 0

    @property
    def page(self) -> int:
        """The page in view, from 1."""
        return self._page + 1

    @property
    def pages(self) -> int:
        """How many there are."""
        return self._last + 1

    @property
    def in_view(self) -> list[int]:
        """The rows of the page in view, from 1."""
        first = self._page * PAGE_ROWS
        places = range(first, min(first + PAGE_ROWS, self._rows))
        return [place + 1 for place in places] if self._order is None else self._order[places].tolist()

    def html(
        self, about: str, head: Sequence[str], row: Callable[[int], list[str]], words: Sequence[int] = ()
    ) -> str:
        """The page as a table, above it what the list is ``about``; ``row``: the cells of a row, from 1."""
        shown = self.in_view
        marked = shown.index(self.row) if self.row in shown else None
        where = muted(f"page {self.page} of {self.pages} · {about}")
        return where + table(head, [row(one) for one in shown], marked=marked, words=words, small=True)

    @property
    def _last(self) -> int:
        return max(0, (self._rows - 1) // PAGE_ROWS)

    def _on_button(self) -> None:
        wanted = {"First": 0, "Prev": self._page - 1, "Next": self._page + 1, "Last": self._last}
        self._page = min(max(wanted[self._buttons.value], 0), self._last)
        self._changed()

    def _on_row(self) -> None:
        """What is no row of the list selects nothing, so that nothing can be sent by it."""
        typed = self._field.value.strip()
        row = int(typed) if typed.isascii() and typed.isdecimal() and len(typed) < _MOST_DIGITS else 0
        self.row = row if 1 <= row <= self._rows else None
        if self.row is not None:
            self._turn_to(self.row)
        self._changed()

    def _turn_to(self, row: int) -> None:
        place = row - 1 if self._order is None else int(np.flatnonzero(self._order == row)[0])
        self._page = place // PAGE_ROWS


# What the pre-flight found, as a list: when, where, what, and how to mend it.


_MOST_FINDINGS = 12
_CHECKED = ("limits", "speeds", "floor", "self-collision", "singularity", "torque")
_MARK = {"error": ("✕ refused", ERROR), "warning": ("! warning", WARNING)}
_EDGE = "margin:4px 0;padding:2px 0 2px 8px;border-left:3px solid "


def verdict_html(
    findings: Sequence[Finding], unknown: Sequence[Unchecked] = (), *, at_rows: bool = False
) -> str:
    """Findings as HTML, errors first, one block each; below them what is ``unknown`` (``not_checked``).

    ``at_rows``: the first of each step is told whole at the row of its step; here it is only named.
    """
    if not findings:
        # What is not checked at all must not be told as checked in the line above it.
        left_out = {one.kind for one in unknown if one.kind == "torque"}
        checked = ", ".join(kind for kind in _CHECKED if kind not in left_out)
        summary = f"<summary style='cursor:pointer;color:{GOOD};font-weight:600'>Pre-flight: clear</summary>"
        verdict = f"<details>{summary}<span style='opacity:.75'>Checked: {checked}.</span></details>"
    else:
        shown = sorted(findings, key=lambda finding: finding.severity != "error")
        by_step = {one.step: one for one in reversed(shown) if at_rows and one.step is not None}
        first = [*by_step.values()]
        blocks = (_finding_block(one, at_row=one in first) for one in shown[:_MOST_FINDINGS])
        verdict = _headline(findings) + "".join(blocks)
        if len(shown) > _MOST_FINDINGS:
            verdict += f"<div style='opacity:.75'>and {len(shown) - _MOST_FINDINGS} more</div>"
    notes = "".join(f"<div style='opacity:.75'>Not checked: {escape(one.text)}.</div>" for one in unknown)
    return verdict + notes


def first_error(findings: Sequence[Finding]) -> str | None:
    """What keeps a program from being run, in one line: step and reason; None: nothing."""
    errors = [finding for finding in findings if finding.severity == "error"]
    if not errors:
        return None
    more = f" (and {len(errors) - 1} more, see the list)" if len(errors) > 1 else ""
    return f"{errors[0]}{more}"


def _headline(findings: Sequence[Finding]) -> str:
    errors = sum(finding.severity == "error" for finding in findings)
    words = (("error", errors), ("warning", len(findings) - errors))
    counts = " and ".join(f"{count} {word}{'s' if count > 1 else ''}" for word, count in words if count)
    verdict = "refused" if errors else "may be run"
    color = ERROR if errors else WARNING
    return f"<div style='font-weight:600;color:{color}'>Pre-flight: {verdict}, {counts}</div>"


def _finding_block(finding: Finding, *, at_row: bool) -> str:
    mark, color = _MARK[finding.severity]
    place: list[str] = []
    if finding.step is not None:
        place.append(f"step {finding.step + 1}")
    if finding.time is not None:
        place.append(f"{finding.time:.2f} s")
    if finding.part:
        place.append(finding.part)
    head = f"<b style='color:{color}'>{mark}</b> {escape(' · '.join(place))}"
    if at_row:
        return f"<div style='{_EDGE}{color}'>{head}: its row says why</div>"
    mend = f"<div style='opacity:.8'>→ {escape(finding.mend)}</div>" if finding.mend else ""
    what = escape(with_minus(finding.what))
    return f"<div style='{_EDGE}{color}'><div>{head}</div><div>{what}</div>{mend}</div>"
