"""Simulation: the motion drawn while it runs, and rehearsed without the arm."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from html import escape
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, StateError
from armctl.facts import State
from armctl.kinematics import Target
from armctl.protocol import FollowTarget, Snapshot
from armctl.protocol.commands import FOLLOW_EXPIRY_S
from armctl.runtime.joint_servo import KeepClear
from armctl.runtime.live_target import Follower
from armctl.ui.console import Console, known
from armctl.ui.events import Newest
from armctl.ui.scene.arm_model import ArmFigure
from armctl.ui.scene.camera import VIEWS
from armctl.ui.scene.ghost import BodyView, Lines, segments
from armctl.ui.scene.stage import Marks
from armctl.ui.session import Session
from armctl.ui.tabs.simulation.joint_graph import JointGraph
from armctl.ui.tabs.simulation.twin import FRAME_S, TwinControl, twin_figure
from armctl.ui.tabs.simulation.workspace import WorkspaceView
from armctl.ui.widgets.html import ERROR, WARNING, LiveHtml, muted
from armctl.ui.widgets.number_field import DraggedPoint, EditWatch, field_grid


class SimulationScreen:
    """Live target, twin, tool trail, joint graphs and workspace cloud; each page has its own."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui = session.gui
        with gui.add_folder("In the 3D view"), field_grid(gui):
            camera = gui.add_button_group("Camera", tuple(VIEWS))
            session.on(camera.on_click, lambda: session.view.look(camera.value))
            self._names = gui.add_checkbox("Joint names", initial_value=False)
            self._frames = gui.add_checkbox("Frames", initial_value=False, hint=_FRAMES_HINT)
            self._with_body = gui.add_checkbox("Body", initial_value=False, hint=_BODY_HINT)
            self._body = BodyView(session.client.scene, session.spawn)
            self._marks = Marks(session.client.scene, session.console.robot)
            self._workspace = WorkspaceView(session)
            self._with_trail = gui.add_checkbox("Tool trail", initial_value=True)
            clear = gui.add_button_group("Trail so far", ("Clear trail",))
            self._trail = session.console.shared(Trail)
            self._cleared = self._drawn = 0
            self._line = Lines(session.client.scene, "/trail", _TRAIL_COLOR, 2.5)
        with gui.add_folder("Drag a target"):
            self._live = LiveTarget(session)
        with gui.add_folder("Twin"):
            self._twin = TwinControl(session)
        with gui.add_folder("Joint graph"):
            self._graph = JointGraph(session)
        session.on(clear.on_click, self._on_clear)

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
        self._live.refresh(snapshot)
        self._twin.refresh(snapshot)
        self._graph.refresh(snapshot, seen=self._session.sees("Simulation"))
        self._line.set_visible(self._with_trail.value)
        if self._with_trail.value and self._drawn != self._trail.count:
            self._draw_trail()
        self._workspace.refresh(snapshot)
        drawn = self._session.console.last_known.drawn(snapshot)
        self._body.show(self._session.held if self._with_body.value else None)
        self._marks.show(drawn, names=self._names.value, frames=self._frames.value)

    def _draw_trail(self) -> None:
        self._drawn = self._trail.count
        lines = segments(self._trail.since(self._cleared))
        self._line.show(lines[~np.isnan(lines).any(axis=(1, 2))])

    def _on_clear(self) -> None:
        self._cleared = self._trail.count
        self._draw_trail()


_BODY_HINT = "What the checks of a motion keep apart from each other and from the floor, over the arm."
_FRAMES_HINT = "Axes of the tool, and names of both frames. Red is x, green y, blue z."

# The path of the tool point: kept once for all pages.

_TRAIL_POINTS = 600
_TRAIL_SPACING_M = 0.002
_TRAIL_COLOR = (134, 142, 150)


class Trail:
    """The newest tool points, at least 2 mm apart; no line spans a time when the place was not known."""

    def __init__(self) -> None:
        self._points: deque[FloatArray] = deque(maxlen=_TRAIL_POINTS)
        self.count = 0
        """how many points were ever added"""

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Follow the arm from now on."""
        del before  # another arm, or one calibrated otherwise
        trail = cls()

        def follow(snapshot: Snapshot) -> None:
            is_known = not np.isnan(known(snapshot)).any()
            arm = console.robot.with_tool(snapshot.tool)
            tip = arm.forward(console.last_known.drawn(snapshot))[:3, 3]
            trail.add(tip if is_known else np.full(3, np.nan))

        console.frame_listeners.append(follow)
        return trail

    def add(self, point: FloatArray) -> None:
        """Add a tool point (3,) [m], if it lies far enough from the last one; NaN: not known, a gap."""
        before = self._points[-1] if self._points else np.full(3, np.nan)
        away = np.linalg.norm(point - before)
        if not (away < _TRAIL_SPACING_M or np.isnan([point, before]).all()):
            self._points.append(point.copy())
            self.count += 1

    def since(self, first: int) -> FloatArray:
        """Points (k, 3) [m] still kept, from the ``first``-th ever added on; NaN stands between two lines."""
        dropped = self.count - len(self._points)
        return np.array(list(self._points)[max(first - dropped, 0) :]).reshape(-1, 3)


# Live target: what is dragged in the 3D view is followed at once, by the twin or by the arm.


_LONGEST_FRAME_S = 0.1
OFF, TWIN, ARM = "off", "the twin follows", "THE ARM follows"
_REPEAT_S = 0.1
_SIGN_OF_LIFE_S, _PATIENCE_S = 0.3, 1.5
"""While the arm follows, the page is asked for a sign of life this often, and given up after this long."""
_TARGET_HINT = "Drag the arrows of the target in the 3D view. It begins where the tool is, so nothing jumps."
_TEXT = {
    OFF: muted("Choose who follows a target that you drag in the scene."),
    TWIN: "Drag the target: <b>the orange twin</b> follows, the arm does not move.",
    ARM: f"<b style='color:{ERROR}'>Drag the target: THE ARM follows at once</b>, at Speed %. STOP ends it.",
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
        self._box = field_grid(gui)
        self._box.visible = False
        with self._box:
            moved = self._moved.set
            self._point = DraggedPoint(gui, scene, session.on, "/live_target", point, moved, "Target ")
            session.other_arrows.append(self._point.target)
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
                await asyncio.sleep(FRAME_S)
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
