"""The Graphs tab of a motion: plot, cursor, peaks, and what can be taken away as a file."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import viser

from armctl.errors import InputError
from armctl.motion.analysis import analysis_csv
from armctl.motion.figure import FigureForm, TitledMotion, figure_bytes
from armctl.ui.screens.trajectory_compare import CompareView
from armctl.ui.screens.trajectory_cursor import CursorView
from armctl.ui.screens.trajectory_graphs import LIMITS, OF, QUANTITIES, GraphChoice, graph, peaks_html
from armctl.ui.screens.trajectory_motion import ShownMotion
from armctl.ui.widgets.html_bits import muted
from armctl.ui.widgets.plots import LinePlot
from armctl.ui.widgets.preview import Preview
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

_LIMITS_HINT = "Dashed lines. near: those that the motion comes near to."
_JERK_NOTE = "Where the acceleration jumps (cubic at its ends, trapezoid), the jerk there has no bound."
_ZOOM_NOTE = "Drag across the plot to zoom, double-click to see all of it."
_FIGURE_FORMS: dict[str, FigureForm] = {"Figure (SVG)": "svg", "Figure (PNG)": "png"}


class GraphView:
    """Draws the shown motion."""

    def __init__(self, session: Session, preview: Preview) -> None:
        """Add the widgets to the present container."""
        self._session = session
        self._robot = session.console.robot
        self._shown: ShownMotion | None = None
        gui = session.gui
        self._which = gui.add_button_group("Graph of", OF)
        self._what = gui.add_button_group("Quantity", QUANTITIES)
        self._limits = gui.add_button_group("Limits", LIMITS, hint=_LIMITS_HINT)
        self._note = LiveHtml(gui, muted("Nothing is shown yet: press Show."))
        self._plot = LinePlot(gui)
        self._cursor = CursorView(session, preview, self._on_moved)
        self._peaks = LiveHtml(gui)
        with gui.add_folder("Compare"):
            self.compare = CompareView(session, self._draw)
        self._csv = gui.add_button("Export motion (CSV)", icon=viser.Icon.DOWNLOAD, color="gray")
        self._figure = gui.add_button_group("Export", tuple(_FIGURE_FORMS))
        for group in (self._which, self._what, self._limits):
            session.on(group.on_click, self._on_graph)
        session.on(self._csv.on_click, self._on_csv)
        session.on(self._figure.on_click, self._on_figure)

    def refresh(self) -> None:
        """Keep the view in order with the other screens."""
        self._cursor.refresh()

    def take(self, shown: ShownMotion) -> None:
        """Show another motion."""
        self._shown = shown
        self.compare.take(shown)
        self._peaks.show(peaks_html(self._robot, shown))
        self._cursor.take(shown.planned)
        self._draw()

    def _draw(self) -> None:
        shown = self._shown
        if shown is None:
            return
        self._note.show(muted(_JERK_NOTE if self._what.value == "Jerk" else _ZOOM_NOTE))
        choice = GraphChoice(self._which.value, self._what.value, self._limits.value)
        self._plot.show(graph(self._robot, shown, choice, self._cursor.time, self.compare.beside))

    def _on_moved(self, time: float) -> None:
        del time  # the cursor has it
        self._draw()

    async def _on_graph(self) -> None:
        self._draw()

    async def _on_csv(self) -> None:
        shown = self._require_shown()
        text = await asyncio.to_thread(analysis_csv, self._robot, shown.motion)
        self._send("motion.csv", text.encode())

    async def _on_figure(self) -> None:
        shown, form = self._require_shown(), _FIGURE_FORMS[self._figure.value]
        beside = self.compare.beside
        content = await asyncio.to_thread(
            figure_bytes, self._robot, form, _titled(shown), None if beside is None else _titled(beside)
        )
        if not self._session.closed:
            self._send(f"motion.{form}", content)

    def _send(self, name: str, content: bytes) -> None:
        self._session.client.send_file_download(f"{self._robot.name}-{name}", content, save_immediately=True)

    def _require_shown(self) -> ShownMotion:
        if self._shown is None:
            raise InputError("there is no motion to export: press Show first")
        return self._shown


def _titled(shown: ShownMotion) -> TitledMotion:
    return TitledMotion(shown.planned.title, shown.motion)
