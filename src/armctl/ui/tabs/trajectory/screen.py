"""Trajectory: a motion over time before it is run, and how well its path is met."""

from __future__ import annotations

import asyncio

import numpy as np
import viser

from armctl.errors import ArmctlError, InputError, MotionRefusedError
from armctl.motion import not_checked
from armctl.runtime import Follow, MoveJoints, RunProgram, Snapshot
from armctl.ui.newest import Newest
from armctl.ui.scene.ghost import Preview
from armctl.ui.session import Session
from armctl.ui.tabs.trajectory.error_report import ReportView, finished
from armctl.ui.tabs.trajectory.form import MotionForm
from armctl.ui.tabs.trajectory.graphs import GraphView
from armctl.ui.tabs.trajectory.plan import PlannedMotion, plan_motion
from armctl.ui.tabs.trajectory.study import StudyView
from armctl.ui.widgets.html import LiveHtml, refused, warned
from armctl.ui.widgets.verdict_list import verdict_html

_NOTE = "Choose a motion and press <b>Show</b> to see it over time; <b>Run</b> executes what is shown."
_PLANNING = "<b>Planning …</b>"
_CHANGED = "The settings have changed since"
_MOVED = 1e-6


class TrajectoryScreen:
    """Choice, verdict, graphs, run, error report."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._preview = Preview(session.ghost)
        self._planned: PlannedMotion | None = None
        self._from_present = True
        self._settings: dict[bool, tuple[object, ...]] = {}
        """of what is shown: a study, a motion"""
        self._newest = Newest()
        self._planning = 0
        self._judged = False
        gui = session.gui
        LiveHtml(gui, _NOTE)
        self._form = MotionForm(session)
        show = gui.add_button("Show", icon=viser.Icon.CHART_LINE)
        self._stale = LiveHtml(gui, visible=False)
        self._run = gui.add_button("Run", icon=viser.Icon.PLAYER_PLAY)
        self._verdict = LiveHtml(gui, visible=False)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Graphs"):
            self._study = StudyView(session)
            self._motion_box = gui.add_folder(None)
            with self._motion_box:
                self._graphs = GraphView(session, self._preview)
        with tabs.add_tab("Error report"):
            self._report = ReportView(session, self._preview)
        session.on(show.on_click, self._on_show)
        session.on(self._run.on_click, self._on_run)

    def refresh(self, snapshot: Snapshot) -> None:
        """Tell when what is shown no longer belongs to the settings or to where the arm is."""
        study = self._form.is_study
        self._form.refresh()
        self._study.box.visible = study
        self._motion_box.visible = self._run.visible = not study
        self._verdict.visible = not study and self._judged
        stale = self._out_of_date(snapshot)
        self._stale.visible = bool(stale) or self._planning > 0
        self._stale.show(_PLANNING if self._planning else warned(f"{stale}: press Show."))
        self._preview.refresh(snapshot.q_command)
        self._graphs.cursor.refresh()

    def _out_of_date(self, snapshot: Snapshot) -> str:
        """Why what is shown has to be planned anew; empty where it need not be."""
        study, planned, settings = self._form.is_study, self._planned, self._form.settings
        if self._settings.get(study, settings) != settings:
            return _CHANGED
        if study or planned is None or planned.program is not None or not self._from_present:
            return ""
        away = float(np.abs(planned.trajectory.start - snapshot.q_command).max())
        return "The arm has moved since" if away > _MOVED else ""

    async def _on_show(self) -> None:
        """Plan off the event loop; of several presses the last one counts."""
        self._form.watch.require_settled()
        settings, is_newest = self._form.settings, self._newest.begin()
        if self._form.is_study:
            shown = await asyncio.to_thread(self._form.study())
            if is_newest():
                self._settings[True] = settings
                self._study.take(shown)
                self._preview.hide()
            return
        request, from_present = self._form.request(self._session.snapshot.q_command), self._form.from_present
        self._planning += 1
        try:
            planned = await asyncio.to_thread(plan_motion, self._robot, request)
        except ArmctlError as refusal:
            if is_newest():
                self._judged = True
                self._verdict.show(refused(f"Not drawn: {refusal}"))
            raise
        finally:
            self._planning -= 1
        if is_newest():
            self._settings[False], self._from_present = settings, from_present
            self._planned, self._judged = planned, True
            self._verdict.show(verdict_html(planned.findings, not_checked(self._robot)))
            self._graphs.take(planned)
            self._report.take(planned)

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
        if planned.refusal is not None:
            raise MotionRefusedError(f"the pre-flight refuses it: {planned.refusal}")
        if planned.program is not None:
            await self._session.submit(RunProgram(planned.program))
        elif await self._go_to_start(planned):
            ticket = await self._session.submit(Follow(planned.trajectory))
            self._preview.hide()
            if planned.points is not None:
                await self._report.record(planned, ticket)

    async def _go_to_start(self, planned: PlannedMotion) -> bool:
        """Bring the arm to the first point; whether it has come there."""
        start = planned.trajectory.start
        if float(np.abs(start - self._session.snapshot.q_command).max()) <= _MOVED:
            return True
        return await finished(await self._session.submit(MoveJoints(start)))
