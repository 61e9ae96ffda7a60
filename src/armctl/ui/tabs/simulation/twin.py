"""The orange twin, which rehearses a motion without the arm."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from html import escape

import viser

from armctl.apart import is_given_up
from armctl.arrays import FloatArray
from armctl.errors import StateError
from armctl.motion.preflight import preflight
from armctl.process.heavy_work import check_program_apart
from armctl.program import Program
from armctl.program.rehearsal import Rehearsal, rehearse, rehearse_pose
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.events import Newest
from armctl.ui.scene.arm_model import HALF_OPEN, ArmFigure
from armctl.ui.scene.ghost import THICKER, Lines, played, segments
from armctl.ui.session import Session
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.twin_file import LONGEST_S, MOST_STEPS, planned_for_file, program_file, twin_file
from armctl.ui.widgets.html import LiveHtml, muted
from armctl.ui.widgets.number_field import button_pairs, in_row

FRAME_S = 1 / 30
_LINGER_S = 2.0
_COLOR = (240, 140, 0)
_PROGRAM = "the program of Serial motion"
_NO_TWIN = "no twin moves"
_IDLE = "The orange twin rehearses <b>without the arm</b>."


def twin_figure(session: Session, name: str) -> ArmFigure:
    """An orange arm in the page's view."""
    scene, robot = session.client.scene, session.console.robot
    return ArmFigure(scene, robot, name, color=_COLOR, opacity=0.55, thicker=THICKER)


class TwinControl:
    """Plans off the event loop and plays the plan in this page's view at the speed override."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._shared = session.console.shared(SharedProgram)
        self._figure: ArmFigure | None = None
        self._path = Lines(session.client.scene, "/twin_path", _COLOR)
        self._plan: Rehearsal | None = None
        self._steps: tuple[str, ...] = ()
        """each step in words; empty for a plain motion"""
        self._elapsed_s = 0.0
        self._playing = False
        """a twin moves, or is about to: its motion is being planned"""
        self._newest = Newest()
        gui = session.gui
        self._poses = {f"go to {name}": name for name in self._robot.poses}
        self._what = gui.add_dropdown("Rehearse", (_PROGRAM, *self._poses), initial_value=_PROGRAM)
        with button_pairs(gui):
            start = gui.add_button("Run on the twin only", icon=viser.Icon.PLAYER_PLAY)
            stop = gui.add_button("Stop twin", color="gray", icon=viser.Icon.PLAYER_STOP)
        self._text = LiveHtml(gui, _IDLE)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        session.needs(None, start, also=lambda _: self._no_steps(), anyone=True)
        session.needs(None, stop, also=lambda _: None if self._playing else _NO_TWIN, told=False, anyone=True)
        with in_row(gui, "As a web page"):
            self._export = gui.add_button("Export", icon=viser.Icon.DOWNLOAD, color="gray")
        self._export_text = LiveHtml(gui, visible=False)
        self._share: float | None = None
        """how much of an export is done; None: none is made"""
        session.needs(None, self._export, also=lambda _: self._no_file(), told=False, anyone=True)
        session.on(self._export.on_click, self._on_export)
        session.on(start.on_click, self._on_start)
        session.on(stop.on_click, self._on_stop)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show how far the twin is, and an export."""
        self._export_text.visible = self._share is not None
        if self._share is not None:
            self._export_text.show(muted(f"Making the file: {100 * self._share:.0f} %"))
        plan, elapsed = self._plan, self._elapsed_s
        self._bar.visible = plan is not None
        if plan is None:
            return
        total = plan.duration
        self._bar.value = 100.0 if total == 0 else round(100 * elapsed / total, 1)
        line = f"<b>{elapsed:.1f} / {total:.1f} s</b>"
        if snapshot.speed < 1:
            line += f" of the plan, played at {100 * snapshot.speed:.0f} %"
        if self._steps:
            step = plan.sample(elapsed).index
            line += f" · step {step + 1} of {len(self._steps)}: {escape(self._steps[step])}"
        self._text.show(line)

    async def _on_start(self) -> None:
        is_newest = self._newest.begin()
        self._finish("Planning …")
        self._playing = True
        try:
            plan, steps = await self._planned()
        except BaseException:
            if is_newest():
                self._finish(_IDLE)
            raise
        if is_newest():  # neither stopped nor started anew while it was planned
            self._path.show(segments(plan.tool_path(self._robot)))
            self._plan, self._steps, self._elapsed_s = plan, steps, 0.0
            self._session.spawn(self._play(plan, is_newest))

    async def _on_export(self) -> None:
        """Send the page a file that plays what is chosen; it is made beside the event loop."""
        if (why := self._no_file()) is not None:
            raise StateError(why)
        chosen, self._share = self._chosen(), 0.0
        try:
            name, page = await self._session.work_out(self._exported, *chosen)
        finally:
            self._share = None
        self._session.download(f"{name}.html", page)

    def _exported(
        self, held: Robot, chosen: Program | str, q: FloatArray, opening: float | None
    ) -> tuple[str, str]:
        robot = self._robot

        def progress(share: float) -> None:
            self._share = share
            if self._session.closed or is_given_up():
                raise StateError("nobody waits for it")

        if isinstance(chosen, str):
            plan = rehearse_pose(held, q, robot.pose(chosen), HALF_OPEN if opening is None else opening)
            title, findings = f"go to {chosen}", preflight(held, plan.trajectory)
            return f"go-to-{chosen}", twin_file(robot, title, plan, findings, progress=progress)
        chosen = self._shared.library.link(chosen)
        plan = planned_for_file(held, chosen, q, opening)
        findings = check_program_apart(
            chosen, held, start=q, progress=lambda done, count: progress(0.5 * done / count)
        )
        page = program_file(robot, chosen, plan, findings, lambda share: progress(0.5 + 0.5 * share))
        return chosen.name, page

    def _no_steps(self) -> str | None:
        if self._what.value != _PROGRAM or self._shared.program.steps:
            return None
        return "the program of Serial motion has no steps yet; record some, or choose a pose"

    def _no_file(self) -> str | None:
        return self._no_steps() if self._share is None else "a file is being made; wait until it is there"

    def _chosen(self) -> tuple[Robot, Program | str, FloatArray, float | None]:
        """The arm as it is, what is to be rehearsed, from where, and how far the gripper is open."""
        snapshot, program = self._session.snapshot, self._shared.program
        chosen = self._poses.get(self._what.value, program)
        if (why := self._no_steps()) is not None:
            raise StateError(why)
        return self._session.held, chosen, snapshot.q_command, snapshot.gripper

    async def _planned(self) -> tuple[Rehearsal, tuple[str, ...]]:
        held, chosen, q, opening = self._chosen()
        if isinstance(chosen, str):
            pose = self._robot.pose(chosen)
            return await self._session.work_out(rehearse_pose, held, q, pose, opening), ()
        steps = tuple(f"{step.title or step.kind} {step.describe()}" for step in chosen.steps)
        return await self._session.work_out(self._rehearsed, held, chosen, q, opening), steps

    def _rehearsed(self, held: Robot, program: Program, q: FloatArray, opening: float | None) -> Rehearsal:
        whole = self._shared.library.link(program)
        return rehearse(held, whole, q, opening, longest_s=LONGEST_S, most_steps=MOST_STEPS)

    async def _play(self, plan: Rehearsal, is_newest: Callable[[], bool]) -> None:
        async for time in played(0.0, plan.duration, lambda: self._session.snapshot.speed, FRAME_S):
            if not is_newest():
                return
            self._elapsed_s = time
            self._pose(plan)
        await asyncio.sleep(_LINGER_S)
        if is_newest():
            more = "; there is more of the program" if plan.cut else ""
            self._finish(f"The twin has finished after <b>{plan.duration:.1f} s</b>{more}.")

    def _pose(self, plan: Rehearsal) -> None:
        state = plan.sample(self._elapsed_s)
        with self._session.client.atomic():
            figure = self._figure or twin_figure(self._session, "/twin")
            self._figure = figure.wearing(self._robot.with_tool(state.tool))
            self._figure.pose(state.q, state.opening)
            self._figure.carry(state.part)
            self._figure.root.visible = True

    def _finish(self, text: str) -> None:
        self._plan, self._playing = None, False
        if self._figure is not None:
            self._figure.root.visible = False
        self._path.hide()
        self._text.show(text)

    def _on_stop(self) -> None:
        self._newest.drop()
        self._finish(_IDLE)
