"""The twin: a second, drawn arm that rehearses a motion while the arm stands still."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from html import escape

import viser

from armctl.errors import StateError
from armctl.program import Rehearsal, rehearse, rehearse_pose
from armctl.runtime import Snapshot
from armctl.ui.newest import Newest
from armctl.ui.scene.arm_figure import ArmFigure
from armctl.ui.scene.ghost import Lines, segments, thicker
from armctl.ui.session import Session
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.widgets.html import LiveHtml

_FRAME_S = 1 / 30
_LINGER_S = 2.0
_LONGEST_S, _MOST_STEPS = 1800.0, 2000
"""a rehearsal ends after this much of a program"""
_COLOR = (240, 140, 0)
_PROGRAM = "the program of Serial motion"
_IDLE = "The orange twin rehearses <b>without the arm</b>."


def twin_figure(session: Session, name: str) -> ArmFigure:
    """An orange arm in the page's view."""
    robot = thicker(session.console.robot)
    return ArmFigure(session.client.scene, robot, name, color=_COLOR, opacity=0.55)


@dataclass
class _Run:
    """One rehearsal that is played."""

    plan: Rehearsal
    steps: tuple[str, ...]
    """each step in words; empty for a plain motion"""
    elapsed_s: float = 0.0


class TwinControl:
    """Plans off the event loop and plays the plan in this page's view at the speed override."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._figure: ArmFigure | None = None
        self._path = Lines(session.client.scene, "/twin_path", _COLOR)
        self._run: _Run | None = None
        self._newest = Newest()
        gui = session.gui
        poses = tuple(f"go to {name}" for name in self._robot.poses)
        self._what = gui.add_dropdown("Rehearse", (_PROGRAM, *poses), initial_value=_PROGRAM)
        start = gui.add_button("Run on the twin only", icon=viser.Icon.PLAYER_PLAY)
        stop = gui.add_button("Stop twin", color="gray", icon=viser.Icon.PLAYER_STOP)
        self._text = LiveHtml(gui, _IDLE)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        session.on(start.on_click, self._on_start)
        session.on(stop.on_click, self._on_stop)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show how far the twin is."""
        run = self._run
        self._bar.visible = run is not None
        if run is None:
            return
        total = run.plan.duration
        self._bar.value = 100.0 if total == 0 else round(100 * run.elapsed_s / total, 1)
        line = f"<b>{run.elapsed_s:.1f} / {total:.1f} s</b>"
        if snapshot.speed < 1:
            line += f" of the plan, played at {100 * snapshot.speed:.0f} %"
        if run.steps:
            step = run.plan.sample(run.elapsed_s).index
            line += f" · step {step + 1} of {len(run.steps)}: {escape(run.steps[step])}"
        self._text.show(line)

    async def _on_start(self) -> None:
        is_newest = self._newest.begin()
        self._finish("Planning …")
        try:
            run = await self._planned()
        except BaseException:
            if is_newest():
                self._finish(_IDLE)
            raise
        if is_newest():  # neither stopped nor started anew while it was planned
            self._path.show(segments(run.plan.tool_path(self._robot)))
            self._run = run
            self._session.spawn(self._play(run, is_newest))

    async def _planned(self) -> _Run:
        snapshot, program = self._session.snapshot, self._session.shared(SharedProgram).program
        q, opening = snapshot.q_command, snapshot.gripper
        if self._what.value != _PROGRAM:
            pose = self._robot.pose(self._what.value.removeprefix("go to "))
            return _Run(await asyncio.to_thread(rehearse_pose, self._robot, q, pose, opening), ())
        if not program.steps:
            raise StateError("the program of Serial motion has no steps yet; record some, or choose a pose")
        steps = tuple(f"{step.title} {step.describe()}" for step in program.steps)
        plan = partial(rehearse, longest_s=_LONGEST_S, most_steps=_MOST_STEPS)
        return _Run(await asyncio.to_thread(plan, self._robot, program, q, opening), steps)

    async def _play(self, run: _Run, is_newest: Callable[[], bool]) -> None:
        clock = asyncio.get_running_loop().time
        before = clock()
        self._pose(run)
        while run.elapsed_s < run.plan.duration:
            await asyncio.sleep(_FRAME_S)
            if not is_newest():
                return
            now = clock()
            played = (now - before) * self._session.snapshot.speed
            run.elapsed_s = min(run.elapsed_s + played, run.plan.duration)
            before = now
            self._pose(run)
        await asyncio.sleep(_LINGER_S)
        if is_newest():
            more = "; there is more of the program" if run.plan.cut else ""
            self._finish(f"The twin has finished after <b>{run.plan.duration:.1f} s</b>{more}.")

    def _pose(self, run: _Run) -> None:
        if self._figure is None:
            self._figure = twin_figure(self._session, "/twin")
        state = run.plan.sample(run.elapsed_s)
        with self._session.client.atomic():
            self._figure.pose(state.q, state.opening)
            self._figure.visible = True

    def _finish(self, text: str) -> None:
        """Take the twin out of the view."""
        self._run = None
        if self._figure is not None:
            self._figure.visible = False
        self._path.hide()
        self._text.show(text)

    def _on_stop(self) -> None:
        self._newest.drop()
        self._finish(_IDLE)
