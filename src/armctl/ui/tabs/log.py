"""Log: what happened, the newest first, as a file, and the report to send with a question."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from datetime import date, datetime
from html import escape
from itertools import groupby

import viser

from armctl.errors import ArmctlError
from armctl.protocol import TIMING, Event, Snapshot
from armctl.report import report
from armctl.ui.session import Session
from armctl.ui.widgets.html import ERROR, WARNING, LiveHtml, heading, muted, time_of_day, with_minus
from armctl.ui.widgets.number_field import button_pairs

_MOST_LINES = 60
_USUAL, _ALL, _WARNINGS = "what happened", "everything", "warnings and errors"
_SHOWN: dict[str, Callable[[Event], bool]] = {
    _USUAL: lambda event: event.about != TIMING,
    _WARNINGS: lambda event: event.level != "info",
    _ALL: lambda _: True,
}
_SHOW_HINT = "What happened: without the warnings that this computer was late. They are in “everything”."
_MARKS = {"info": ("", "inherit"), "warning": ("!", WARNING), "error": ("✕", ERROR)}
_REPORT_NOTE = "A report for whoever helps you: log, versions, robot file, and the last minute of the arm."


class LogScreen:
    """The newest lines of the log."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._drawn: tuple[object, ...] = ()
        gui = session.gui
        self._which = gui.add_dropdown("Show", tuple(_SHOWN), initial_value=_USUAL, hint=_SHOW_HINT)
        with button_pairs(gui):
            save = gui.add_button("Download report", icon=viser.Icon.FILE_ZIP, color="gray")
            table = gui.add_button("Download log", icon=viser.Icon.DOWNLOAD, color="gray")
        LiveHtml(gui, muted(_REPORT_NOTE))
        self._lines = LiveHtml(gui)
        session.on(save.on_click, self._on_report)
        session.on(table.on_click, lambda: session.download("log.csv", as_csv(self._events())))

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the lines, if there are others than before."""
        drawn = snapshot.events, self._which.value
        if self._drawn == drawn:
            return
        self._drawn = drawn
        every = self._events()
        shown = [event for event in every if _SHOWN[self._which.value](event)]
        self._lines.show(lines_html(shown[-_MOST_LINES:], hidden=len(every) - len(shown)))

    def _events(self) -> tuple[Event, ...]:
        return (*self._session.console.earlier, *self._session.snapshot.events)

    async def _on_report(self) -> None:
        session, console = self._session, self._session.console
        robot, calibration = session.robots.present.name, console.calibration.calibration
        folder = console.files / "programs" / console.robot.name

        def made() -> bytes:
            try:
                recording = console.controller.black_box()
            except ArmctlError as cause:
                recording = cause
            names = sorted(path.name for path in folder.glob("*.toml"))
            return report(robot, calibration, recording, names)

        session.download("report.zip", await session.work_out(made))


def lines_html(events: Sequence[Event], *, hidden: int = 0) -> str:
    """Lines of the log, the newest first, by day; ``hidden``: how many others are not shown."""
    said = "".join(
        heading(f"{day:%A, %d %B}") + "".join(map(_line, same))
        for day, same in groupby(reversed(events), lambda event: date.fromtimestamp(event.stamp))
    )
    lines = f"{hidden} line{'' if hidden == 1 else 's'}"
    return (said or muted("Nothing yet.")) + (muted(f"{lines} not shown.") if hidden else "")


def _line(event: Event) -> str:
    mark, color = _MARKS[event.level]
    named = f" role='img' aria-label='{event.level}'" if mark else ""
    quiet = "" if mark else "color:var(--armctl-quiet);"
    when = f"<span style='{quiet}font-variant-numeric:tabular-nums'>{time_of_day(event.stamp)}</span>"
    return (
        "<div style='display:grid;grid-template-columns:auto 1em 1fr;gap:0 6px;padding:3px 0;"
        f"border-bottom:1px solid var(--armctl-line);color:{color}'>"
        f"{when}<b{named} style='text-align:center'>{mark}</b>"
        f"<span>{escape(with_minus(event.text))}</span></div>"
    )


def as_csv(events: Sequence[Event]) -> str:
    """The log as a table, the oldest first."""
    rows = io.StringIO()
    table = csv.writer(rows)
    table.writerow(("time", "level", "about", "text"))
    for event in events:
        stamp = datetime.fromtimestamp(event.stamp).astimezone().isoformat(timespec="milliseconds")
        table.writerow((stamp, event.level, event.about, event.text))
    return rows.getvalue()
