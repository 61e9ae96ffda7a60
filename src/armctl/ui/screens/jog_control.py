"""Hold-to-jog of one joint, and the gripper."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import viser

from armctl.errors import ArmctlError
from armctl.runtime import Jog, MoveGripper, Snapshot
from armctl.ui.widgets.joint_step import checked_percent, held_at
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

_HOLD_HZ = 20.0
_NEW_HOLD_S = 0.3
"""A button that was silent for this long was let go."""


class Hold:
    """Tells the ticks of one hold from those of the next, so that one hold is refused once."""

    def __init__(self) -> None:
        self._last_s = -np.inf
        self._refused = False

    def wants(self, now_s: float) -> bool:
        """One tick of a held button at the controller's clock; False when this hold was refused before."""
        if now_s - self._last_s > _NEW_HOLD_S:
            self._refused = False
        self._last_s = now_s
        return not self._refused

    def refuse(self) -> None:
        """Nothing more of this hold is sent."""
        self._refused = True


class JogControl:
    """The arm moves while a jog button is held; letting go, or losing the page, stops it."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._hold = Hold()
        gui = session.gui
        held = {joint.title: text for joint in self._robot.joints if (text := held_at(joint)) is not None}
        titles = tuple(joint.title for joint in self._robot.joints if joint.title not in held)
        with gui.add_folder("Jog (moves while the button is held)"):
            self._joint = gui.add_dropdown("Joint", titles, initial_value=titles[0])
            self._speed = gui.add_slider("Jog speed %", min=1, max=100, step=1, initial_value=25)
            self._minus = gui.add_button("Jog −")
            self._plus = gui.add_button("Jog +")
            for title, text in held.items():
                gui.add_text(title, text, disabled=True)
        session.on(partial(_attach_hold, self._minus), partial(self._on_hold, -1.0))
        session.on(partial(_attach_hold, self._plus), partial(self._on_hold, 1.0))
        if self._robot.gripper is not None:
            self._add_gripper(self._robot.gripper.title)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the arm and the gripper."""
        if self._robot.gripper is not None:
            opening = snapshot.gripper
            self._opening.show(
                "0 % is closed, 100 % open. It has not been told to move yet."
                if opening is None
                else f"0 % is closed, 100 % open. Commanded: <b>{100 * opening:.0f} %</b>."
            )

    def _add_gripper(self, title: str) -> None:
        gui, session = self._session.gui, self._session
        with gui.add_folder(title):
            self._percent = gui.add_slider("Gripper %", min=0, max=100, step=1, initial_value=50)
            self._set = gui.add_button("Set gripper")
            self._opening = LiveHtml(gui)
        session.on(self._set.on_click, self._on_gripper)

    async def _on_hold(self, sign: float) -> None:
        """One tick of a held button: a short command that expires by itself."""
        if not self._hold.wants(self._session.snapshot.stamp):
            return
        rate = np.zeros(self._robot.n)
        rate[self._chosen()] = sign * self._speed.value / 100
        try:
            await self._session.submit(Jog(rate))
        except ArmctlError:
            self._hold.refuse()
            raise

    def _chosen(self) -> int:
        return [joint.title for joint in self._robot.joints].index(self._joint.value)

    async def _on_gripper(self) -> None:
        percent = checked_percent(self._percent.value, "gripper")
        await self._session.submit(MoveGripper(percent / 100))


def _attach_hold(button: viser.GuiButtonHandle, callback: Callable[[Any], Coroutine[Any, Any, None]]) -> None:
    button.on_hold(callback, _HOLD_HZ)  # pyright: ignore[reportUnknownMemberType]
