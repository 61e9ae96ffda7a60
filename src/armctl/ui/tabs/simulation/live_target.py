"""Live target: what is dragged in the 3D view is followed at once, by the twin or by the arm.

Where the twin follows there is no arm to ask: this module alone of the pages uses the runtime's own follower.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from html import escape

import numpy as np

from armctl.errors import ArmctlError, StateError
from armctl.facts import State
from armctl.kinematics import Target
from armctl.protocol import FollowTarget, Snapshot
from armctl.protocol.commands import FOLLOW_EXPIRY_S
from armctl.runtime.joint_servo import KeepClear
from armctl.runtime.live_target import Follower
from armctl.ui.events import Newest
from armctl.ui.scene.arm_model import ArmFigure
from armctl.ui.session import Session
from armctl.ui.tabs.simulation.twin import FRAME_S, twin_figure
from armctl.ui.widgets.html import WARNING, LiveHtml
from armctl.ui.widgets.number_field import DraggedPoint, EditWatch

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
