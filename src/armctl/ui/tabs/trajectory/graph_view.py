"""The Graphs tab of a motion: plot, cursor, peaks, comparison, and exports."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import numpy as np
import viser

from armctl.errors import InputError
from armctl.motion.analysis import analysis_csv
from armctl.motion.figure import FigureForm, TitledMotion, figure_bytes
from armctl.ui.newest import Newest
from armctl.ui.scene.ghost import Preview
from armctl.ui.scene.lines import Lines, segments
from armctl.ui.session import Session
from armctl.ui.tabs.trajectory.graphs import (
    LIMITS,
    OF,
    QUANTITIES,
    GraphChoice,
    compare_html,
    cursor_html,
    graph,
    peaks_html,
)
from armctl.ui.tabs.trajectory.plan import PlannedMotion, ShownMotion
from armctl.ui.widgets.html import LiveHtml, muted
from armctl.ui.widgets.plots import LinePlot

_LIMITS_HINT = "Dashed lines. near: those that the motion comes near to."
_JERK_NOTE = "Where the acceleration jumps (cubic at its ends, trapezoid), the jerk there has no bound."
_ZOOM_NOTE = "Drag across the plot to zoom, double-click to see all of it."
_COMPARE_NOTE = "Keep the shown motion as A, then show another: A is drawn thin and dashed beside it."
_FIGURE_FORMS: dict[str, FigureForm] = {"Figure (SVG)": "svg", "Figure (PNG)": "png"}


class GraphView:
    """Draws the shown motion, and another one (A) beside it that was kept before."""

    def __init__(self, session: Session, preview: Preview) -> None:
        """Add the widgets to the present container."""
        self._session = session
        self._robot = session.console.robot
        self._shown: ShownMotion | None = None
        self._a: ShownMotion | None = None
        gui = session.gui
        self._which = gui.add_button_group("Graph of", OF)
        self._what = gui.add_button_group("Quantity", QUANTITIES)
        self._limits = gui.add_button_group("Limits", LIMITS, hint=_LIMITS_HINT)
        self._note = LiveHtml(gui, muted("Nothing is shown yet: press Show."))
        self._plot = LinePlot(gui)
        self._cursor = CursorView(session, preview, self._draw)
        self._peaks = LiveHtml(gui)
        with gui.add_folder("Compare"):
            self._compared = LiveHtml(gui, muted(_COMPARE_NOTE))
            keep = gui.add_button("Keep as A", icon=viser.Icon.PIN, color="gray")
            self._drop = gui.add_button("Drop A", icon=viser.Icon.PINNED_OFF, color="gray", visible=False)
        csv = gui.add_button("Export motion (CSV)", icon=viser.Icon.DOWNLOAD, color="gray")
        self._figure = gui.add_button_group("Export", tuple(_FIGURE_FORMS))
        for group in (self._which, self._what, self._limits):
            session.on(group.on_click, self._on_graph)
        session.on(keep.on_click, self._on_keep)
        session.on(self._drop.on_click, self._on_drop)
        session.on(csv.on_click, self._on_csv)
        session.on(self._figure.on_click, self._on_figure)

    def refresh(self) -> None:
        """Keep the view in order with the other screens."""
        self._cursor.refresh()

    def take(self, shown: ShownMotion) -> None:
        """Show another motion."""
        self._shown = shown
        self._peaks.show(peaks_html(self._robot, shown))
        self._compare()
        self._cursor.take(shown.planned)

    @property
    def _beside(self) -> ShownMotion | None:
        """A, where it is another motion than the one that is shown."""
        return None if self._a is self._shown else self._a

    def _draw(self) -> None:
        shown = self._shown
        if shown is None:
            return
        self._note.show(muted(_JERK_NOTE if self._what.value == "Jerk" else _ZOOM_NOTE))
        choice = GraphChoice(self._which.value, self._what.value, self._limits.value)
        self._plot.show(graph(self._robot, shown, choice, self._cursor.time, self._beside))

    def _compare(self) -> None:
        if self._drop.visible != (self._a is not None):
            self._drop.visible = self._a is not None
        if self._a is None or self._shown is None:
            self._compared.show(muted(_COMPARE_NOTE))
        elif self._a is self._shown:
            title = self._a.planned.title
            self._compared.show(muted(f"A is {title}. Choose another motion and press Show."))
        else:
            self._compared.show(compare_html(self._robot, self._a, self._shown))

    async def _on_graph(self) -> None:
        self._draw()

    async def _on_keep(self) -> None:
        self._a = self._require_shown("keep")
        self._compare()
        self._draw()

    async def _on_drop(self) -> None:
        self._a = None
        self._compare()
        self._draw()

    async def _on_csv(self) -> None:
        shown = self._require_shown("export")
        text = await asyncio.to_thread(analysis_csv, self._robot, shown.motion)
        self._send("motion.csv", text.encode())

    async def _on_figure(self) -> None:
        shown, beside = self._require_shown("export"), self._beside
        form = _FIGURE_FORMS[self._figure.value]
        content = await asyncio.to_thread(
            figure_bytes, self._robot, form, _titled(shown), None if beside is None else _titled(beside)
        )
        if not self._session.closed:
            self._send(f"motion.{form}", content)

    def _send(self, name: str, content: bytes) -> None:
        self._session.client.send_file_download(f"{self._robot.name}-{name}", content, save_immediately=True)

    def _require_shown(self, what: str) -> ShownMotion:
        if self._shown is None:
            raise InputError(f"there is no motion to {what}: press Show first")
        return self._shown


def _titled(shown: ShownMotion) -> TitledMotion:
    return TitledMotion(shown.planned.title, shown.motion)


# The cursor: a slider over the motion's time, or played, with the ghost and the numbers there.

_FRAME_S = 1 / 25
_SLIDER_S = 0.15
"""a slider and a plot that are written more often make a page slow"""
_SLOWEST, _FASTEST = 5, 400
_PATH_POINTS, _PATH_COLOR = 400, (0, 140, 170)
_PLAY, _PAUSE = "Play", "Pause"


class CursorView:
    """Moves the ghost along the shown motion; the arm does not move."""

    def __init__(self, session: Session, preview: Preview, moved: Callable[[], None]) -> None:
        """Add the widgets to the present container; ``moved`` is called when the cursor has moved."""
        self._session, self._preview, self._moved = session, preview, moved
        self._robot = session.console.robot
        self._planned: PlannedMotion | None = None
        self._path = Lines(session.client.scene, "/shown_path", _PATH_COLOR)
        self._newest = Newest()
        self._playing = False
        gui = session.gui
        self._box = gui.add_folder(None, visible=False)
        with self._box:
            self._slider = gui.add_slider("Time s", min=0.0, max=1.0, step=0.01, initial_value=0.0)
            self._play = gui.add_button(_PLAY, icon=viser.Icon.PLAYER_PLAY, color="gray")
            self._speed = gui.add_slider(
                "Play speed %", min=_SLOWEST, max=_FASTEST, step=5, initial_value=100,
                hint="Of the ghost; the arm does not move.",
            )  # fmt: skip
            self._where = LiveHtml(gui)
        session.on(self._slider.on_update, self._on_slider)
        session.on(self._play.on_click, self._on_play)

    @property
    def time(self) -> float:
        """Where the cursor is [s]."""
        return self._slider.value

    def refresh(self) -> None:
        """Draw the tool's path for as long as no other screen shows something of its own."""
        self._path.set_visible(not self._preview.taken)

    def take(self, planned: PlannedMotion) -> None:
        """Another motion is shown: cursor and ghost stand at its end, the arm at its beginning."""
        self._halt()
        self._planned = planned
        time = np.linspace(0.0, planned.trajectory.duration, _PATH_POINTS)
        self._path.show(segments(self._robot.forward(planned.trajectory.sample(time).q)[:, :3, 3]))
        self._slider.value = 0.0
        self._slider.max = self._slider.value = max(round(planned.trajectory.duration, 2), 0.01)
        self._box.visible = True
        self._go(planned, self._slider.value)

    def _go(self, planned: PlannedMotion, time: float, *, draw: bool = True) -> None:
        time = min(time, planned.trajectory.duration)
        self._preview.show(planned.trajectory.sample(time).q, self._session.snapshot.q_command)
        if draw:
            self._where.show(cursor_html(self._robot, planned, time))
            self._moved()

    async def _on_slider(self) -> None:
        self._halt()
        if self._planned is not None:
            self._go(self._planned, self._slider.value)

    async def _on_play(self) -> None:
        if self._playing:
            self._halt()
            return
        if self._planned is None:
            raise InputError("there is no motion to play: press Show first")
        self._playing = True
        self._play.label, self._play.icon = _PAUSE, viser.Icon.PLAYER_PAUSE
        self._session.spawn(self._run(self._planned, self._newest.begin()))

    async def _run(self, planned: PlannedMotion, is_newest: Callable[[], bool]) -> None:
        clock = asyncio.get_running_loop().time
        end = planned.trajectory.duration
        time = self._slider.value if self._slider.value < end - _FRAME_S else 0.0
        before, drawn = clock(), -1.0
        while is_newest():
            now = clock()
            time = min(time + (now - before) * self._speed.value / 100, end)
            before = now
            draw = now - drawn >= _SLIDER_S or time >= end
            with self._session.client.atomic():
                if draw:
                    drawn = now
                    self._slider.value = min(round(time, 2), self._slider.max)
                self._go(planned, time, draw=draw)
            if time >= end:
                break
            await asyncio.sleep(_FRAME_S)
            if self._preview.taken:
                break
        if is_newest():
            self._halt()

    def _halt(self) -> None:
        self._newest.drop()
        if self._playing:
            self._playing = False
            self._play.label, self._play.icon = _PLAY, viser.Icon.PLAYER_PLAY
