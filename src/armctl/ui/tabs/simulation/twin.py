"""The orange twin, which rehearses a motion without the arm; and the live target, for the twin or the arm."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from html import escape

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, StateError
from armctl.kinematics import Target
from armctl.motion.preflight import preflight
from armctl.process.heavy_work import check_program_apart
from armctl.program import Program
from armctl.program.rehearsal import Rehearsal, rehearse, rehearse_pose
from armctl.robot import Robot
from armctl.runtime import FollowTarget, Snapshot, State
from armctl.runtime.joint_servo import KeepClear
from armctl.runtime.live_target import FOLLOW_EXPIRY_S, Follower
from armctl.ui.newest import Newest
from armctl.ui.scene.arm_figure import HALF_OPEN, ArmFigure
from armctl.ui.scene.ghost import THICKER, Lines, played, segments
from armctl.ui.session import Session
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.twin_file import LONGEST_S, MOST_STEPS, planned_for_file, program_file, twin_file
from armctl.ui.widgets.html import WARNING, LiveHtml, muted
from armctl.ui.widgets.number_field import DraggedPoint, EditWatch

_FRAME_S = 1 / 30
_LINGER_S = 2.0
_COLOR = (240, 140, 0)
_PROGRAM = "the program of Serial motion"
_EXPORT = muted("Export: one file that plays this in any browser, without armctl and without a network.")
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
        poses = tuple(f"go to {name}" for name in self._robot.poses)
        self._what = gui.add_dropdown("Rehearse", (_PROGRAM, *poses), initial_value=_PROGRAM)
        start = gui.add_button("Run on the twin only", icon=viser.Icon.PLAYER_PLAY)
        stop = gui.add_button("Stop twin", color="gray", icon=viser.Icon.PLAYER_STOP)
        self._text = LiveHtml(gui, _IDLE)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        session.needs(None, start, also=lambda _: self._no_steps(), anyone=True)
        session.needs(None, stop, also=lambda _: None if self._playing else _NO_TWIN, anyone=True)
        self._export = gui.add_button("Export", icon=viser.Icon.DOWNLOAD, color="gray")
        self._export_text = LiveHtml(gui, _EXPORT)
        self._share: float | None = None
        """how much of an export is done; None: none is made"""
        session.needs(None, self._export, also=lambda _: self._no_file(), told=False, anyone=True)
        session.on(self._export.on_click, self._on_export)
        session.on(start.on_click, self._on_start)
        session.on(stop.on_click, self._on_stop)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show how far the twin is, and an export."""
        self._export_text.show(
            _EXPORT if self._share is None else muted(f"Making the file: {100 * self._share:.0f} %")
        )
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
        loop = asyncio.get_running_loop()
        executor = ThreadPoolExecutor(1, thread_name_prefix="armctl-export")  # it may take minutes
        try:
            name, page = await loop.run_in_executor(executor, self._exported, *chosen)
        finally:
            self._share = None
            executor.shutdown(wait=False, cancel_futures=True)
        self._session.download(f"{name}.html", page)

    def _exported(
        self, held: Robot, chosen: Program | str, q: FloatArray, opening: float | None
    ) -> tuple[str, str]:
        """Name and page of a program, or of the way to a named pose."""
        robot = self._robot

        def progress(share: float) -> None:
            self._share = share
            if self._session.closed:
                raise StateError("the page is gone")

        if isinstance(chosen, str):
            plan = rehearse_pose(held, q, robot.pose(chosen), HALF_OPEN if opening is None else opening)
            title, findings = f"go to {chosen}", preflight(held, plan.trajectory)
            return f"go-to-{chosen}", twin_file(robot, title, plan, findings, progress=progress)
        plan = planned_for_file(held, chosen, q, opening)
        findings = check_program_apart(
            chosen, held, start=q, progress=lambda done, count: progress(0.5 * done / count)
        )
        page = program_file(robot, chosen, plan, findings, lambda share: progress(0.5 + 0.5 * share))
        return chosen.name, page

    def _no_steps(self) -> str | None:
        """Why what is chosen cannot be rehearsed."""
        if self._what.value != _PROGRAM or self._session.console.shared(SharedProgram).program.steps:
            return None
        return "the program of Serial motion has no steps yet; record some, or choose a pose"

    def _no_file(self) -> str | None:
        """Why there can be no export now."""
        return self._no_steps() if self._share is None else "a file is being made; wait until it is there"

    def _chosen(self) -> tuple[Robot, Program | str, FloatArray, float | None]:
        """The arm as it is, what is to be rehearsed, from where, and how far the gripper is open."""
        snapshot, program = self._session.snapshot, self._session.console.shared(SharedProgram).program
        chosen = program if self._what.value == _PROGRAM else self._what.value.removeprefix("go to ")
        if (why := self._no_steps()) is not None:
            raise StateError(why)
        return self._session.held, chosen, snapshot.q_command, snapshot.gripper

    async def _planned(self) -> tuple[Rehearsal, tuple[str, ...]]:
        held, chosen, q, opening = self._chosen()
        if isinstance(chosen, str):
            pose = self._robot.pose(chosen)
            return await asyncio.to_thread(rehearse_pose, held, q, pose, opening), ()
        steps = tuple(f"{step.title or step.kind} {step.describe()}" for step in chosen.steps)
        plan = partial(rehearse, longest_s=LONGEST_S, most_steps=MOST_STEPS)
        return await asyncio.to_thread(plan, held, chosen, q, opening), steps

    async def _play(self, plan: Rehearsal, is_newest: Callable[[], bool]) -> None:
        async for time in played(0.0, plan.duration, lambda: self._session.snapshot.speed, _FRAME_S):
            if not is_newest():
                return
            self._elapsed_s = time
            self._pose(plan)
        await asyncio.sleep(_LINGER_S)
        if is_newest():
            more = "; there is more of the program" if plan.cut else ""
            self._finish(f"The twin has finished after <b>{plan.duration:.1f} s</b>{more}.")

    def _pose(self, plan: Rehearsal) -> None:
        if self._figure is None:
            self._figure = twin_figure(self._session, "/twin")
        state = plan.sample(self._elapsed_s)
        with self._session.client.atomic():
            self._figure.pose(state.q, state.opening)
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


# Live target: what is dragged in the 3D view is followed at once, by the twin or by the arm.

_LONGEST_FRAME_S = 0.1
OFF, TWIN, ARM = "off", "the twin follows", "THE ARM follows"
_REPEAT_S = 0.1
_SIGN_OF_LIFE_S, _PATIENCE_S = 0.3, 1.5
"""While the arm follows, the page is asked for a sign of life this often, and given up after this long."""
_TARGET_HINT = "Drag the arrows of the target in the 3D view. It begins where the tool is, so nothing jumps."
_TEXT = {
    OFF: "Off. Nothing follows.",
    TWIN: "Drag the target: <b>the orange twin</b> follows, the arm does not move.",
    ARM: "<b style='color:#c92a2a'>Drag the target: THE ARM follows at once</b>, at Speed %. STOP ends it.",
}


class LiveTarget:
    """The switch, the target and its fields; the arm brakes half a second after the last target it got."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._twin: tuple[Follower, ArmFigure] | None = None
        self._mode = OFF
        self._newest = Newest()
        self._moved = asyncio.Event()
        gui, scene = session.gui, session.client.scene
        self._switch = gui.add_dropdown("Live target", (OFF, TWIN, ARM), initial_value=OFF, hint=_TARGET_HINT)
        self._text = LiveHtml(gui, _TEXT[OFF])
        point = self._robot.forward(session.snapshot.q_command)[:3, 3]
        self._box = gui.add_folder(None, visible=False)
        with self._box:
            moved = self._moved.set
            self._point = DraggedPoint(gui, scene, session.on, "/live_target", point, moved, "Target ")
            put = gui.add_button("Put target there")
        self._note = LiveHtml(gui, visible=False)
        self._watch = EditWatch(self._point.xyz.fields)
        session.on(self._switch.on_update, self._on_switch)
        session.on(put.on_click, self._on_put)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what follows, and what holds it back."""
        note = None if self._twin is None else self._twin[0].notice
        if self._mode == ARM:
            note = None if snapshot.doing is None else snapshot.doing.notice
        self._text.show(_TEXT[self._mode])
        self._note.visible = note is not None
        self._note.show(f"<div style='color:{WARNING}'>⚠ {escape(note or '')}</div>")

    async def _on_switch(self) -> None:
        wanted = self._switch.value
        await self._end()
        if wanted == OFF:
            return
        try:
            self._begin(wanted)
        except ArmctlError:
            self._switch.value = OFF
            raise

    def _begin(self, mode: str) -> None:
        """Set the target to where the tool is, and follow it; the arm only for the operator, and at rest."""
        session, snapshot = self._session, self._session.snapshot
        if mode == ARM:
            session.require_operator()
            if snapshot.state is not State.HOLDING:
                state = snapshot.state.value
                raise StateError(
                    f"a live target needs the arm holding, it is {state}; enable it, or let it come to rest"
                )
        self._mode = mode
        is_newest = self._newest.begin()
        self._point.put(self._robot.forward(snapshot.q_command)[:3, 3])
        self._point.target.visible = self._box.visible = True
        if mode == TWIN:
            session.spawn(self._lead_twin(is_newest))
        else:
            session.spawn(self._lead_arm(is_newest))
            session.spawn(self._require_life(is_newest))

    async def _end(self) -> None:
        before, self._mode = self._mode, OFF
        self._newest.drop()
        self._point.target.visible = self._box.visible = False
        if self._twin is not None:
            self._twin[1].root.remove()
            self._twin = None
        if before == ARM and self._session.operates:
            await self._session.submit(FollowTarget(None))

    @property
    def _target(self) -> Target:
        return Target.of(np.array(self._point.target.position))

    async def _lead_twin(self, is_newest: Callable[[], bool]) -> None:
        if not is_newest():  # switched off before this began
            return
        session, robot = self._session, self._robot
        clear = await asyncio.to_thread(KeepClear, session.held)
        executor = ThreadPoolExecutor(1, thread_name_prefix="armctl-twin")
        clock = asyncio.get_running_loop().time
        before = clock()
        try:
            snapshot = session.snapshot
            follower = Follower(robot, clear, snapshot.q_command, snapshot.speed, executor.submit)
            self._twin = follower, (figure := twin_figure(session, "/live_twin"))
            while is_newest():
                now = clock()
                follower.set_speed(session.snapshot.speed)
                follower.aim(self._target, now + FOLLOW_EXPIRY_S)
                if now > before:
                    follower.advance(now, min(now - before, _LONGEST_FRAME_S))
                before = now
                with session.client.atomic():
                    figure.pose(follower.q, session.snapshot.gripper)
                await asyncio.sleep(_FRAME_S)
        except ArmctlError as refusal:
            await self._give_up(is_newest, str(refusal))
        finally:
            executor.shutdown(wait=False, cancel_futures=True)

    async def _lead_arm(self, is_newest: Callable[[], bool]) -> None:
        while is_newest():
            try:
                await self._session.submit(FollowTarget(self._target))
            except ArmctlError as refusal:
                await self._give_up(is_newest, str(refusal))
                return
            try:
                await asyncio.wait_for(self._moved.wait(), _REPEAT_S)
            except TimeoutError:
                continue
            self._moved.clear()

    async def _require_life(self, is_newest: Callable[[], bool]) -> None:
        """End it when the page gives no sign of life: what hangs can see neither the arm nor STOP."""
        while is_newest():
            if not await self._session.answers(_PATIENCE_S):
                await self._give_up(is_newest, "the page did not answer for a while")
                return
            await asyncio.sleep(_SIGN_OF_LIFE_S)

    async def _give_up(self, is_newest: Callable[[], bool], why: str) -> None:
        if not is_newest():
            return
        self._session.notify("Live target is off", why, "yellow")
        self._switch.value = OFF
        await self._session.attempt(self._end)

    def _on_put(self) -> None:
        self._watch.require_settled()
        self._point.put(Target.of(self._point.xyz.array).position)
        self._moved.set()
