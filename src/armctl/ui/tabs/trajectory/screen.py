"""Trajectory: a motion over time before it is run, and how well its path is met."""

from __future__ import annotations

import asyncio
from functools import partial
from itertools import count

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, InputError, MotionRefusedError
from armctl.facts import Need
from armctl.hardware import Source
from armctl.motion import not_checked
from armctl.motion.analysis import (
    TICK_S,
    ErrorReport,
    PathError,
    as_printed,
    closest_on_path,
    distances,
    path_error,
    report_csv,
)
from armctl.protocol import Follow, MoveJoints, RunProgram, Snapshot, Ticket
from armctl.ui.events import Newest, came_to_end
from armctl.ui.next_line import Told
from armctl.ui.scene.ghost import Preview
from armctl.ui.session import Session
from armctl.ui.tabs.trajectory.graphs import GraphView, named_html
from armctl.ui.tabs.trajectory.motion_form import MotionForm
from armctl.ui.tabs.trajectory.plan import (
    PlannedMotion,
    plan_motion,
)
from armctl.ui.tabs.trajectory.study import StudyView
from armctl.ui.widgets.html import (
    EMPTY_LINE,
    LiveHtml,
    Pager,
    fixed,
    heading,
    muted,
    refused,
    sentence,
    table,
    verdict_html,
    warned,
)
from armctl.ui.widgets.number_field import button_pairs

_MOVED = 1e-6
_LOOKS = count(1)


class TrajectoryScreen:
    """Choice, verdict, graphs, run, error report."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._preview = Preview(session.ghost, "Trajectory")
        self._planned: PlannedMotion | None = None
        self._from_present = True
        self._settings: dict[bool, tuple[object, ...]] = {}
        """of what is shown: a study, a motion"""
        self._newest = Newest()
        self._planning = 0
        self._judged = False
        gui = session.gui
        with gui.add_form(None) as entered:  # Enter in a field is Show
            self._form = MotionForm(session)
        with button_pairs(gui):
            self._asked = LiveHtml(gui)
            """tells the page that there is something to look at below"""
            self._show = gui.add_button("Show", icon=viser.Icon.CHART_LINE)
            self._run = gui.add_button("Run", icon=viser.Icon.PLAYER_PLAY)
            self._offer = session.needs(Need.HOLDING, self._run, also=self._not_run, told=False)
        self._told = LiveHtml(gui)
        """that it plans, or why *Run* is off; its line stays, so the buttons do not move"""
        self._verdict = LiveHtml(gui, visible=False)
        self._freer = gui.add_button("Plan it freer", icon=viser.Icon.ROUTE, color="orange", visible=False)
        self._tabs = tabs = gui.add_tab_group()
        with tabs.add_tab("Graphs"):
            self._study = StudyView(session)
            self._motion_box = gui.add_folder(None)
            with self._motion_box:
                self._graphs = GraphView(session, self._preview)
        with tabs.add_tab("Error report"):
            self._report = ReportView(session, self._preview)
        session.next.instead = self._instead
        session.on(self._show.on_click, self._on_show)
        session.on(entered.on_submit, self._on_show)
        session.on(self._freer.on_click, self._on_freer)
        session.on(self._run.on_click, self._on_run)

    def refresh(self, snapshot: Snapshot) -> None:
        """Tell when what is shown no longer belongs to the settings or to where the arm is."""
        study = self._form.is_study
        self._study.box.visible = study
        self._run.visible = not study
        self._motion_box.visible = not study and self._planned is not None
        self._tabs.visible = study or self._planned is not None  # nothing to look at before
        self._verdict.visible = not study and self._judged
        stale = self._out_of_date(snapshot)
        self._told.show(self._status(stale))
        planned = self._planned is not None and not (study or stale)
        self._show.color = "gray" if planned else None  # then Run is the thing to do
        freer = None if stale or self._planned is None else self._planned.freer
        self._freer.visible = freer is not None and not study
        if freer is not None:
            self._freer.label = f"Plan it with {self._form.freer_words(freer)}"
        self._preview.refresh(snapshot.q_command)
        self._graphs.refresh()

    def _instead(self, snapshot: Snapshot) -> Told | None:
        """What the line under the scene tells while the motion that is shown here is looked at."""
        planned, is_open = self._planned, self._session.ghost.is_open("Trajectory")
        if planned is None or not is_open or self._form.is_study or self._preview.taken:
            return None
        if self._out_of_date(snapshot):
            return None
        seconds = fixed(planned.trajectory.duration / snapshot.speed, 2)
        return Told(planned.title, f"{seconds} s · Run in Trajectory starts it")

    def _status(self, stale: str) -> str:
        if self._planning:
            return "<b>Planning …</b>"
        if stale:
            return warned(f"{stale}: press Show.")
        if self._form.is_study:
            return EMPTY_LINE
        if self._offer.why is not None:
            return muted(sentence(self._offer.why))
        return EMPTY_LINE if self._planned is None else named_html(self._planned)

    def _out_of_date(self, snapshot: Snapshot) -> str:
        """Why what is shown has to be planned anew; empty where it need not be."""
        study, planned, settings = self._form.is_study, self._planned, self._form.settings
        if self._settings.get(study, settings) != settings:
            return "The settings have changed since"
        if study or planned is None or planned.program is not None or not self._from_present:
            return ""
        away = float(np.abs(planned.trajectory.start - snapshot.q_command).max())
        return "The arm has moved since" if away > _MOVED else ""

    def _not_run(self, snapshot: Snapshot) -> str | None:
        """Why what is shown cannot be run, apart from the state of the arm; None: it can."""
        if self._form.is_study:
            return None  # there is no button then
        if self._planned is None:
            return "nothing is shown yet; press Show first"
        stale = self._out_of_date(snapshot)
        if stale:
            return f"{stale[:1].lower()}{stale[1:]}; press Show and look at it before it runs"
        refusal = self._planned.refusal
        return None if refusal is None else "the pre-flight refuses it; see why below"

    async def _on_freer(self) -> None:
        if self._planned is not None and self._planned.freer is not None:
            self._form.ask_freer(self._planned.freer)
            await self._on_show()

    async def _on_show(self) -> None:
        """Plan off the event loop; of several presses the last one counts."""
        self._form.watch.require_settled()
        settings, is_newest = self._form.settings, self._newest.begin()
        self._asked.show(f"<i hidden data-armctl-look={next(_LOOKS)}></i>")
        if self._form.is_study:
            shown = await self._session.work_out(self._form.study())
            if is_newest():
                self._settings[True] = settings
                self._study.take(shown)
                self._preview.hide()
            return
        request, from_present = self._form.request(self._session.snapshot.q_command), self._form.from_present
        self._planning += 1
        try:
            planned = await self._session.work_out(plan_motion, self._robot, request)
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
            note = muted(planned.note) if planned.note else ""
            self._verdict.show(note + verdict_html(planned.findings, not_checked(self._robot)))
            self._graphs.take(planned)
            self._report.take(planned)

    async def _on_run(self) -> None:
        self._form.watch.require_settled()
        if self._form.is_study:
            raise InputError("Joint by joint is a study: there is nothing to run")
        planned, why = self._planned, self._not_run(self._session.snapshot)
        if planned is None or why is not None:
            raise MotionRefusedError(why or "nothing is shown yet")
        if planned.program is not None:
            await self._session.submit(RunProgram(planned.program))
            return
        start = planned.trajectory.start
        if float(np.abs(start - self._session.snapshot.q_command).max()) > _MOVED:
            came_there = await came_to_end(await self._session.submit(MoveJoints(start)))
            if not came_there:
                return
        ticket = await self._session.submit(Follow(planned.trajectory))
        self._preview.hide()
        if planned.points is not None:
            await self._report.record(planned, ticket)


# The Error report tab: asked for, reached by the solver, and read back while the path ran.


_RECORD_S = 0.02
_AFTER = 6
"""readings that are still taken when the motion is over: a board answers a little late"""
_PATH_SAMPLES = 2001
_MOST_READINGS = 20_000
_NONE = "Choose a line or an arc and press Show; Run records the applied path."
_THEORY = "The tool points that forward kinematics gives for the solutions of inverse kinematics."
_PRINTED = (
    "The same with the angles rounded to 0.001°, as the paper prints them: its RMSE is at most 0.005 mm."
)
_LED = "Where the planned tool path comes closest to points evenly spread along the curve."
_APPLIED = "Where the path that was read back comes closest to each point:"
MEANING = {
    Source.COMMANDED: "commanded by this computer, not measured",
    Source.TRANSMITTED: "transmitted by the board, not measured",
    Source.MEASURED: "measured by the arm's encoders",
}


class ReportView:
    """Theoretical errors as soon as a path is shown, applied ones once it has run."""

    def __init__(self, session: Session, preview: Preview) -> None:
        self._session, self._preview = session, preview
        self._planned: PlannedMotion | None = None
        self._theory: ErrorReport | None = None
        self._applied: ErrorReport | None = None
        gui = session.gui
        self._summary = LiveHtml(gui, muted(_NONE))
        self._applied_summary = LiveHtml(gui)
        self._points = LiveHtml(gui)
        self._pager = Pager(gui, session.on, self._on_row)
        export = gui.add_button("Export error report (CSV)", icon=viser.Icon.DOWNLOAD, color="gray")
        # the reason stands above already
        session.needs(None, export, also=lambda _: None if self._theory else _NONE, told=False, anyone=True)
        session.on(export.on_click, self._on_export)

    def take(self, planned: PlannedMotion) -> None:
        """Another motion is shown."""
        self._planned, self._theory, self._applied = planned, None, None
        summary, applied = muted(_NONE), ""
        if planned.points is not None:
            self._theory, summary = theoretical(planned)
            applied = muted("Applied: not run yet. Press Run to record it.")
        self._summary.show(summary)
        self._applied_summary.show(applied)
        self._pager.reset(0 if planned.points is None else len(planned.points), None)
        self._draw()

    async def record(self, planned: PlannedMotion, ticket: Ticket) -> None:
        """Keep what the board reads back until the motion is over, then report."""
        if self._planned is planned:
            self._applied_summary.show(muted("Applied: recording …"))
        readings, source = await self._read_back(ticket)
        ended = await came_to_end(ticket)
        if self._session.closed or self._planned is not planned or planned.points is None:
            return
        if not ended or len(readings) == 0:
            stopped = "the path did not come to its end, so there is no report"
            why = "the board read nothing back" if ended else stopped
            self._applied_summary.show(muted(f"Applied: {why}."))
            return
        path = planned.robot.forward(readings)[:, :3, 3]
        reached = await self._session.work_out(closest_on_path, planned.points, path)
        self._applied = ErrorReport(planned.points, reached)
        count = f"{len(path)} readings"
        html = summary_html("Applied", f"{_APPLIED} {MEANING[source]}. {count}.", self._applied)
        if planned.ideal is not None:
            strays = PathError(np.arange(float(len(path))), distances(planned.ideal, path))
            html += between_html(strays, f"of {count}")
        self._applied_summary.show(html)
        self._draw()

    async def _read_back(self, ticket: Ticket) -> tuple[FloatArray, Source]:
        """Every position (m, n) [rad] that is read back until a motion is over, and its source."""
        seen: list[FloatArray] = []
        source, tick, left = Source.COMMANDED, -1, _AFTER
        while left > 0:
            left -= ticket.finished.done()
            snapshot = self._session.snapshot
            if snapshot.tick != tick and len(seen) < _MOST_READINGS and bool(np.isfinite(snapshot.q).all()):
                seen.append(snapshot.q)
                source, tick = snapshot.source, snapshot.tick
            await asyncio.sleep(_RECORD_S)
        return np.array(seen).reshape(len(seen), -1), source

    def _draw(self) -> None:
        report = self._applied or self._theory
        if report is None:
            self._points.show("")
            return
        about = f"asked for, and {'applied' if self._applied else 'theoretical'}, mm"
        head = ["#", "x", "y", "z", "x got", "y got", "z got", "error"]
        self._points.show(self._pager.html(about, head, partial(point_row, report)))

    def _on_row(self) -> None:
        self._draw()
        planned, row = self._planned, self._pager.row
        if planned is not None and planned.solved is not None and row is not None:
            self._preview.show(planned.solved[row - 1], self._session.snapshot.q_command)

    def _on_export(self) -> None:
        if self._theory is None:
            raise InputError("there is no error report: choose a line or an arc and press Show")
        self._session.download("errors.csv", report_csv(self._theory, self._applied))


def theoretical(planned: PlannedMotion) -> tuple[ErrorReport, str]:
    """The report of a motion through points as it is planned, and its figures as HTML."""
    robot, points, solved = planned.robot, planned.points, planned.solved
    if points is None:
        raise InputError(f"{planned.title} prescribes no points")
    if solved is not None:
        report = ErrorReport(points, robot.forward(solved)[:, :3, 3])
        printed = ErrorReport(points, robot.forward(as_printed(solved))[:, :3, 3])
        text = summary_html("Theoretical", _THEORY, report) + summary_html("As printed", _PRINTED, printed)
    else:
        time = np.linspace(0.0, planned.trajectory.duration, _PATH_SAMPLES)
        path = robot.forward(planned.trajectory.sample(time).q)[:, :3, 3]
        report = ErrorReport(points, closest_on_path(points, path))
        text = summary_html("Theoretical", _LED, report)
    if planned.ideal is not None:
        strays = path_error(robot, planned.trajectory, planned.ideal)
        text += between_html(strays, f"at {round(1 / TICK_S)} Hz, planned, at {strays.when:.2f} s")
    return report, text


def summary_html(name: str, meaning: str, report: ErrorReport) -> str:
    """MSE, RMSE and largest error of each coordinate."""
    largest = [*report.largest.tolist(), float(report.distance.max())]
    rows = [
        ["MSE mm²", *(_figure(1e6 * value) for value in report.mse.tolist()), ""],
        ["RMSE mm", *(_figure(1e3 * value) for value in report.rmse.tolist()), ""],
        ["largest mm", *(_figure(1e3 * value) for value in largest)],
    ]
    title = heading(f"{name}: {len(report.desired)} points")
    return title + muted(meaning) + table(["", "x", "y", "z", "3D"], rows)


def between_html(error: PathError, when: str) -> str:
    """How far the tool strays from the ideal line or arc between the points as well."""
    figures = [["largest mm", _figure(1e3 * error.largest)], ["RMS mm", _figure(1e3 * error.rms)]]
    title = heading("Off the ideal line or arc")
    return title + muted(f"Between the points, too: {when}.") + table([], figures)


def point_row(report: ErrorReport, number: int) -> list[str]:
    """One point, from 1: desired, reached, distance."""
    both = 1000 * np.hstack([report.desired[number - 1], report.reached[number - 1]])
    figures = (fixed(value, 2) for value in both.tolist())
    return [str(number), *figures, _figure(1000 * report.distance[number - 1])]


def _figure(value_mm: float) -> str:
    """Millimetres with three decimals, or in powers of ten where those would all be zero."""
    if value_mm == 0 or abs(value_mm) >= 0.001:
        return fixed(value_mm, 3)
    return f"{value_mm:.1e}".replace("-", "−")
