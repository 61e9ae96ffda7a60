"""Log: what happened, the newest first, and the report to send with a question."""

from __future__ import annotations

from html import escape

import viser

from armctl.errors import ArmctlError
from armctl.protocol import Event, Snapshot
from armctl.report import report
from armctl.ui.session import Session
from armctl.ui.widgets.html import ERROR, WARNING, LiveHtml, muted, time_of_day

_MOST_LINES = 60
_ALL, _WARNINGS = "everything", "warnings and errors"
_COLOR = {"warning": WARNING, "error": ERROR}
_REPORT_NOTE = (
    "The report holds versions, robot file, log, and the last minute of the arm: send it with a question."
)


class LogScreen:
    """The newest lines of the log."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._drawn: tuple[object, ...] = ()
        gui = session.gui
        self._which = gui.add_dropdown("Show", (_ALL, _WARNINGS), initial_value=_ALL)
        save = gui.add_button("Download report", icon=viser.Icon.DOWNLOAD, color="gray")
        LiveHtml(gui, muted(_REPORT_NOTE))
        self._lines = LiveHtml(gui)
        session.on(save.on_click, self._on_report)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the lines, if there are others than before."""
        if self._drawn == (snapshot.events, self._which.value):
            return
        self._drawn = (snapshot.events, self._which.value)
        events = (*self._session.console.earlier, *snapshot.events)
        shown = [event for event in events if self._which.value == _ALL or event.level in _COLOR]
        lines = [_line(event) for event in reversed(shown[-_MOST_LINES:])]
        self._lines.show("".join(lines) or muted("Nothing yet."))

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


def _line(event: Event) -> str:
    color = _COLOR.get(event.level, "inherit")
    when = f"<span style='opacity:.75;font-variant-numeric:tabular-nums'>{time_of_day(event.stamp)}</span>"
    return (
        "<div style='display:grid;grid-template-columns:auto 1fr;gap:0 8px;padding:2px 0;"
        f"border-bottom:1px solid var(--armctl-line);color:{color}'>"
        f"{when} <span>{escape(event.text)}</span></div>"
    )
