"""Live target: what is dragged in the 3D view is followed at once, by the twin or by the arm."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from html import escape

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, StateError
from armctl.kinematics import Target
from armctl.runtime import FollowTarget, Snapshot, State
from armctl.runtime.joint_servo import KeepClear
from armctl.runtime.live_target import FOLLOW_EXPIRY_S, Follower, LiveGoal, live_goal
from armctl.ui.newest import Newest
from armctl.ui.scene.arm_figure import ArmFigure
from armctl.ui.scene.ghost import thicker
from armctl.ui.session import Session
from armctl.ui.widgets.html import WARNING, LiveHtml
from armctl.ui.widgets.number_field import EditWatch, NumberField

# The orange twin that follows a target, exactly as the arm would, on the page's own clock.

_FRAME_S = 1 / 30
_LONGEST_S = 0.1
_COLOR = (240, 140, 0)


class LiveTwin:
    """Begins where the arm stands; ends with ``remove``."""

    def __init__(self, session: Session, q: FloatArray) -> None:
        """Stand at ``q`` (n,) [rad]."""
        self._session = session
        self._robot = session.console.robot
        self._clear = KeepClear(self._robot)
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="armctl-twin")
        self._follower = Follower(self._robot, self._clear, q, session.snapshot.speed, self._solve)
        self._figure = ArmFigure(
            session.client.scene, thicker(self._robot), "/live_twin", color=_COLOR, opacity=0.55
        )
        self._removed = False

    @property
    def notice(self) -> str | None:
        """What is not as the target asks for it."""
        return self._follower.notice

    @property
    def q(self) -> FloatArray:
        """(n,) where the twin is [rad]."""
        return self._follower.q

    def remove(self) -> None:
        """Take it out of the view."""
        if not self._removed:
            self._removed = True
            self._figure.remove()

    async def play(self, target: Callable[[], Target]) -> None:
        """Follow what ``target`` gives at each frame, at the speed override, until removed."""
        clock = asyncio.get_running_loop().time
        before = clock()
        try:
            while not self._removed:
                now = clock()
                self._follower.set_speed(self._session.snapshot.speed)
                self._follower.aim(target(), now + FOLLOW_EXPIRY_S)
                if now > before:
                    self._follower.advance(now, min(now - before, _LONGEST_S))
                before = now
                with self._session.client.atomic():
                    self._figure.pose(self._follower.q, self._session.snapshot.gripper)
                await asyncio.sleep(_FRAME_S)
        finally:
            self._executor.shutdown(wait=False, cancel_futures=True)

    def _solve(self, q: FloatArray, target: Target, pitch: float | None) -> Future[LiveGoal]:
        return self._executor.submit(live_goal, self._robot, self._clear, q, target, pitch)


OFF, TWIN, ARM = "off", "the twin follows", "THE ARM follows"
_GIZMO_SCALE = 0.12
_REPEAT_S = 0.1
_SIGN_OF_LIFE_S, _PATIENCE_S = 0.3, 1.5
"""While the arm follows, the page is asked for a sign of life this often, and given up after this long."""
_HINT = "Drag the arrows of the target in the 3D view. It begins where the tool is, so nothing jumps."
_TEXT = {
    OFF: "Off. Nothing follows.",
    TWIN: "Drag the target: <b>the orange twin</b> follows, the arm does not move.",
    ARM: "<b style='color:#c92a2a'>Drag the target: THE ARM follows at once</b>, at Speed %. STOP ends it.",
}


class LiveTarget:
    """The switch, the target and its fields. Only the operator may have the arm follow.

    The arm is sent the newest target ten times a second; it brakes half a second after the last one. That
    goes on only while the page gives signs of life.
    """

    def __init__(self, session: Session) -> None:
        """Add the controls to the present container."""
        self._session = session
        self._robot = session.console.robot
        self._twin: LiveTwin | None = None
        self._mode = OFF
        self._newest = Newest()
        self._moved = asyncio.Event()
        gui = session.gui
        self._switch = gui.add_dropdown("Live target", (OFF, TWIN, ARM), initial_value=OFF, hint=_HINT)
        self._text = LiveHtml(gui, _TEXT[OFF])
        point = self._robot.forward(session.snapshot.q_command)[:3, 3]
        self._box = gui.add_folder(None, visible=False)
        with self._box:
            self._xyz = [
                NumberField(gui, f"Target {name} mm", value)
                for name, value in zip("XYZ", (1000 * point).tolist(), strict=True)
            ]
            put = gui.add_button("Put target there")
        self._note = LiveHtml(gui, visible=False)
        self._watch = EditWatch(self._xyz)
        self._gizmo = session.client.scene.add_transform_controls(
            "/live_target", scale=_GIZMO_SCALE, disable_rotations=True, depth_test=False, visible=False,
            position=point,
        )  # fmt: skip
        session.on(self._switch.on_update, self._on_switch)
        session.on(self._gizmo.on_update, self._on_drag)
        session.on(put.on_click, self._on_put)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what follows, and what holds it back."""
        note = None if self._twin is None else self._twin.notice
        if self._mode == ARM:
            note = next((text for text in snapshot.warnings if text.startswith("live target")), None)
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
        """Set the target to where the tool is, and follow it.

        Raises:
            ArmctlError: this page does not operate, or the arm is not enabled or does something else.
        """
        session = self._session
        snapshot = session.snapshot
        if mode == ARM:
            session.require_operator()
            if snapshot.state is not State.HOLDING:
                raise StateError(
                    f"a live target needs the arm holding, it is {snapshot.state.value}; "
                    "enable it, or let it come to rest"
                )
        self._mode = mode
        is_newest = self._newest.begin()
        self._put(self._robot.forward(snapshot.q_command)[:3, 3])
        self._gizmo.visible = self._box.visible = True
        if mode == TWIN:
            self._twin = LiveTwin(session, snapshot.q_command)
            session.spawn(self._lead_twin(self._twin, is_newest))
        else:
            session.spawn(self._lead_arm(is_newest))
            session.spawn(self._listen(is_newest))

    async def _end(self) -> None:
        """Nothing follows any more."""
        before, self._mode = self._mode, OFF
        self._newest.drop()
        self._gizmo.visible = self._box.visible = False
        if self._twin is not None:
            self._twin.remove()
            self._twin = None
        if before == ARM and self._session.operates:
            await self._session.submit(FollowTarget(None))

    @property
    def _target(self) -> Target:
        return Target.of(np.array(self._gizmo.position))

    async def _lead_twin(self, twin: LiveTwin, is_newest: Callable[[], bool]) -> None:
        try:
            await twin.play(lambda: self._target)
        except ArmctlError as refusal:
            await self._give_up(is_newest, str(refusal))

    async def _lead_arm(self, is_newest: Callable[[], bool]) -> None:
        """Send the target again and again, at once when it has moved."""
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

    async def _listen(self, is_newest: Callable[[], bool]) -> None:
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

    async def _on_drag(self) -> None:
        for field, value in zip(self._xyz, self._gizmo.position.tolist(), strict=True):
            field.fill(round(1000 * value, 1))
        self._moved.set()

    async def _on_put(self) -> None:
        self._watch.require_settled()
        self._put(Target.of(np.array([field.value for field in self._xyz]) / 1000).position)
        self._moved.set()

    def _put(self, point: FloatArray) -> None:
        """Move the target to a point (3,) [m]."""
        self._gizmo.position = point
        for field, value in zip(self._xyz, (1000 * point).tolist(), strict=True):
            field.fill(value)
