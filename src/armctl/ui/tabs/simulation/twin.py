"""The twin: a second, drawn arm that rehearses a motion while the arm stands still."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from functools import partial
from html import escape

import numpy as np
import viser

from armctl.errors import StateError
from armctl.program import Rehearsal, rehearse, rehearse_pose
from armctl.runtime import Snapshot
from armctl.ui.scene.arm_figure import ArmFigure
from armctl.ui.scene.ghost import thicker
from armctl.ui.session import Session
from armctl.ui.tabs.program.shared_program import SharedProgram
from armctl.ui.widgets.html import LiveHtml

_FRAME_S = 1 / 30
_LINGER_S = 2.0
_LONGEST_S, _MOST_STEPS = 1800.0, 2000
"""A rehearsal ends after this much of a program."""
_COLOR = (240, 140, 0)
_PROGRAM = "the program of Serial motion"
_IDLE = "The orange twin rehearses <b>without the arm</b>."


@dataclass
class _Run:
    """One rehearsal on its way."""

    plan: Rehearsal
    steps: tuple[str, ...]
    """what each step is, in words; empty for a plain motion"""
    elapsed_s: float = 0.0


class TwinControl:
    """Plans off the event loop and plays the plan in this page's view at the speed override."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._figure: ArmFigure | None = None
        self._path: viser.LineSegmentsHandle | None = None
        self._run: _Run | None = None
        self._turn = 0
        gui = session.gui
        poses = tuple(f"go to {name}" for name in self._robot.poses)
        self._what = gui.add_dropdown("Rehearse", (_PROGRAM, *poses), initial_value=_PROGRAM)
        self._start = gui.add_button("Run on the twin only", icon=viser.Icon.PLAYER_PLAY)
        self._stop = gui.add_button("Stop twin", color="gray", icon=viser.Icon.PLAYER_STOP)
        self._text = LiveHtml(gui, _IDLE)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        session.on(self._start.on_click, self._on_start)
        session.on(self._stop.on_click, self._on_stop)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show how far the twin is."""
        run = self._run
        if self._bar.visible != (run is not None):
            self._bar.visible = run is not None
        if run is None:
            return
        total = run.plan.duration
        percent = 100.0 if total == 0 else round(100 * run.elapsed_s / total, 1)
        if self._bar.value != percent:
            self._bar.value = percent
        line = f"<b>{run.elapsed_s:.1f} / {total:.1f} s</b>"
        if snapshot.speed < 1:
            line += f" of the plan, played at {100 * snapshot.speed:.0f} %"
        if run.steps:
            step = run.plan.sample(run.elapsed_s).index
            line += f" · step {step + 1} of {len(run.steps)}: {escape(run.steps[step])}"
        self._text.show(line)

    async def _on_start(self) -> None:
        self._turn += 1
        turn = self._turn
        self._finish("Planning …")
        try:
            plan, steps = await self._planned()
        except BaseException:
            if turn == self._turn:
                self._finish(_IDLE)
            raise
        if turn != self._turn:  # stopped or started anew while it was planned
            return
        self._draw_path(plan)
        self._run = _Run(plan, steps)
        self._session.spawn(self._play(self._run, turn))

    async def _planned(self) -> tuple[Rehearsal, tuple[str, ...]]:
        """The plan, and its steps in words."""
        snapshot, program = self._session.snapshot, self._session.shared(SharedProgram).program
        if self._what.value == _PROGRAM:
            if not program.steps:
                raise StateError(
                    "the program of Serial motion has no steps yet; record some, or choose a pose"
                )
            steps = tuple(f"{step.title} {step.describe()}" for step in program.steps)
            plan = partial(rehearse, longest_s=_LONGEST_S, most_steps=_MOST_STEPS)
            return await asyncio.to_thread(
                plan, self._robot, program, snapshot.q_command, snapshot.gripper
            ), steps
        pose = self._robot.pose(self._what.value.removeprefix("go to "))
        plan = await asyncio.to_thread(rehearse_pose, self._robot, snapshot.q_command, pose, snapshot.gripper)
        return plan, ()

    async def _play(self, run: _Run, turn: int) -> None:
        clock = asyncio.get_running_loop().time
        before = clock()
        self._pose(run)
        while run.elapsed_s < run.plan.duration:
            await asyncio.sleep(_FRAME_S)
            if turn != self._turn:
                return
            now = clock()
            run.elapsed_s = min(
                run.elapsed_s + (now - before) * self._session.snapshot.speed, run.plan.duration
            )
            before = now
            self._pose(run)
        await asyncio.sleep(_LINGER_S)
        if turn == self._turn:
            more = "; there is more of the program" if run.plan.cut else ""
            self._finish(f"The twin has finished after <b>{run.plan.duration:.1f} s</b>{more}.")

    def _pose(self, run: _Run) -> None:
        if self._figure is None:
            self._figure = ArmFigure(
                self._session.client.scene, thicker(self._robot), "/twin", color=_COLOR, opacity=0.55
            )
        state = run.plan.sample(run.elapsed_s)
        with self._session.client.atomic():
            self._figure.pose(state.q, state.opening)
            self._figure.visible = True

    def _draw_path(self, plan: Rehearsal) -> None:
        points = plan.tool_path(self._robot)
        self._path = self._session.client.scene.add_line_segments(
            "/twin_path", np.stack([points[:-1], points[1:]], axis=1), _COLOR, thickness=2.0,
            thickness_units="screen",
        )  # fmt: skip

    def _finish(self, text: str) -> None:
        """Nothing is played any more."""
        self._run = None
        if self._figure is not None:
            self._figure.visible = False
        if self._path is not None:
            self._path.remove()
            self._path = None
        self._text.show(text)

    async def _on_stop(self) -> None:
        self._turn += 1
        self._finish(_IDLE)
