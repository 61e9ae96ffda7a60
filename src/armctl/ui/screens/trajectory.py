"""Trajectory: a motion over time before it is run, and how well the two test paths are met."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.motion.analysis import MotionAnalysis, analyse, analysis_csv
from armctl.robot import Robot
from armctl.runtime import Follow, MoveJoints, RunProgram, Snapshot
from armctl.ui.screens.motion_form import MotionForm
from armctl.ui.screens.trajectory_graphs import OF, QUANTITIES, cursor_html, graph, peaks_html
from armctl.ui.screens.trajectory_motion import MotionRequest, PlannedMotion, plan_motion
from armctl.ui.screens.trajectory_report import ReportView, finished
from armctl.ui.screens.trajectory_study import StudyView, make_study
from armctl.ui.widgets.html_bits import muted
from armctl.ui.widgets.plots import LinePlot
from armctl.ui.widgets.preview import Preview
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

FloatArray = NDArray[np.float64]
_NOTE = "Choose a motion and press <b>Show</b> to see it over time; <b>Run</b> executes what is shown."
_STALE = "<b style='color:#e67700'>{}: press Show.</b>"
_CHANGED = "The settings have changed since"
_PLOT_SAMPLES = 1500
_MOVED = 1e-6


class TrajectoryScreen:
    """Choice, graphs, cursor, run, export, error report."""

    label: ClassVar[str] = "Trajectory"
    icon: ClassVar[viser.IconName | None] = None

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._preview = Preview(session.ghost)
        self._planned: PlannedMotion | None = None
        self._motion: MotionAnalysis | None = None
        self._settings: tuple[object, ...] = ()
        self._studied: tuple[object, ...] = ()
        self._asked = 0
        self._build()

    def _build(self) -> None:
        session, gui = self._session, self._session.gui
        LiveHtml(gui, _NOTE)
        self._form = MotionForm(session)
        self._show = gui.add_button("Show", icon=viser.Icon.CHART_LINE)
        self._stale = LiveHtml(gui)
        self._stale.visible = False
        self._run = gui.add_button("Run", icon=viser.Icon.PLAYER_PLAY)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Graphs"):
            self._study = StudyView(session)
            self._motion_box = gui.add_folder(None)
            with self._motion_box:
                self._build_graphs()
        with tabs.add_tab("Error report"):
            self._report = ReportView(session, self._preview)
        session.on(self._show.on_click, self._on_show)
        session.on(self._run.on_click, self._on_run)

    def _build_graphs(self) -> None:
        session, gui = self._session, self._session.gui
        self._which = gui.add_button_group("Graph of", OF)
        self._what = gui.add_button_group("Quantity", QUANTITIES)
        self._plot_note = LiveHtml(gui, muted("Nothing is shown yet: press Show."))
        self._plot = LinePlot(gui)
        self._cursor = gui.add_slider("Time s", min=0.0, max=1.0, step=0.01, initial_value=0.0, visible=False)
        self._where = LiveHtml(gui)
        self._peaks = LiveHtml(gui)
        self._export = gui.add_button("Export motion (CSV)", icon=viser.Icon.DOWNLOAD, color="gray")
        session.on(self._which.on_click, self._on_graph)
        session.on(self._what.on_click, self._on_graph)
        session.on(self._cursor.on_update, self._on_cursor)
        session.on(self._export.on_click, self._on_export)

    def refresh(self, snapshot: Snapshot) -> None:
        """Tell when what is shown no longer belongs to the settings or to where the arm is."""
        study = self._form.is_study
        self._form.refresh()
        self._study.show(study)
        if self._motion_box.visible == study:
            self._motion_box.visible = self._run.visible = not study
        stale = self._out_of_date(snapshot)
        self._stale.visible = bool(stale)
        self._stale.show(_STALE.format(stale))
        self._preview.refresh(snapshot)

    def _out_of_date(self, snapshot: Snapshot) -> str:
        if self._form.is_study:
            return _CHANGED if self._study.shown and self._form.settings != self._studied else ""
        planned = self._planned
        if planned is None:
            return ""
        if self._form.settings != self._settings:
            return _CHANGED
        away = float(np.abs(planned.trajectory.start - snapshot.q_command).max())
        if planned.points is None and planned.program is None and away > _MOVED:
            return "The arm has moved since"
        return ""

    async def _on_show(self) -> None:
        """Plan off the event loop; of several presses the last one counts."""
        self._form.watch.require_settled()
        settings = self._form.settings
        self._asked += 1
        asked = self._asked
        if self._form.is_study:
            shown = await asyncio.to_thread(make_study, self._robot, self._form.study.request())
            if asked == self._asked:
                self._studied = settings
                self._study.take(shown)
                self._preview.hide()
            return
        request = self._form.request(self._session.snapshot.q_command)
        planned, motion = await asyncio.to_thread(_plan, self._robot, request)
        if asked == self._asked:
            self._settings = settings
            self._take(planned, motion)

    def _take(self, planned: PlannedMotion, motion: MotionAnalysis) -> None:
        self._planned, self._motion = planned, motion
        self._cursor.value = 0.0
        self._cursor.max = max(round(planned.trajectory.duration, 2), 0.01)
        self._cursor.visible = True
        self._plot_note.show(muted("Drag across the plot to zoom, double-click to see all of it."))
        self._peaks.show(peaks_html(self._robot, planned, motion))
        self._where.show(cursor_html(self._robot, planned, 0.0))
        self._report.take(planned)
        self._draw_graph()
        self._preview.show(planned.trajectory.end, self._session.snapshot.q_command)

    def _draw_graph(self) -> None:
        if self._motion is not None:
            self._plot.show(graph(self._robot, self._motion, self._which.value, self._what.value))

    async def _on_graph(self) -> None:
        self._draw_graph()

    async def _on_cursor(self) -> None:
        planned = self._planned
        if planned is not None:
            time = min(self._cursor.value, planned.trajectory.duration)
            self._where.show(cursor_html(self._robot, planned, time))
            self._preview.show(planned.trajectory.sample(time).q, self._session.snapshot.q_command)

    async def _on_export(self) -> None:
        planned, motion = self._planned, self._motion
        if planned is None or motion is None:
            raise InputError("there is no motion to export: press Show first")
        text = await asyncio.to_thread(analysis_csv, self._robot, motion)
        name = f"{self._robot.name}-motion.csv"
        self._session.client.send_file_download(name, text.encode(), save_immediately=True)

    async def _on_run(self) -> None:
        self._form.watch.require_settled()
        if self._form.is_study:
            raise InputError("Joint by joint is a study: there is nothing to run")
        planned = self._planned
        if planned is None:
            raise InputError("there is nothing to run: press Show first")
        stale = self._out_of_date(self._session.snapshot)
        if stale:
            raise InputError(f"{stale[:1].lower()}{stale[1:]}: press Show and look at it before it runs")
        if planned.program is not None:
            await self._session.submit(RunProgram(planned.program))
        elif planned.points is None:
            await self._session.submit(Follow(planned.trajectory))
        elif await self._go_to_start(planned):
            ticket = await self._session.submit(Follow(planned.trajectory))
            self._preview.hide()
            await self._report.record(planned, ticket)

    async def _go_to_start(self, planned: PlannedMotion) -> bool:
        """Bring the arm to the first point; whether it has come there."""
        start = planned.trajectory.start
        if float(np.abs(start - self._session.snapshot.q_command).max()) <= _MOVED:
            return True
        return await finished(await self._session.submit(MoveJoints(start)))


def _plan(robot: Robot, request: MotionRequest) -> tuple[PlannedMotion, MotionAnalysis]:
    planned = plan_motion(robot, request)
    return planned, analyse(robot, planned.trajectory, _PLOT_SAMPLES)
