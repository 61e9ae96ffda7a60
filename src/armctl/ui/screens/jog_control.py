"""Hold-to-jog of a joint or the tool, with buttons or keys, and the gripper."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from armctl.errors import ArmctlError
from armctl.runtime import Jog, MoveGripper, Snapshot
from armctl.ui.screens.keyboard_jog import KeyboardJog
from armctl.ui.screens.tool_jog import ToolJog
from armctl.ui.widgets.hold import Hold, attach_hold
from armctl.ui.widgets.joint_step import checked_percent, held_at
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session


class JogControl:
    """The arm moves while a jog button or key is held; letting go, or losing the page, stops it."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui = session.gui
        with gui.add_folder("Jog (moves while the button is held)"):
            tabs = gui.add_tab_group()
            with tabs.add_tab("Joint"):
                self._joint = JointJog(session)
            with tabs.add_tab("Tool"):
                self._tool = ToolJog(session)
            with tabs.add_tab("Keyboard"):
                self._keys = KeyboardJog(
                    session, lambda: self._joint.speed_percent, lambda: self._tool.speed_mm_s
                )
        gripper = session.console.robot.gripper
        self._gripper = None if gripper is None else GripperControl(session, gripper.title)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the arm, the keys and the gripper."""
        self._keys.refresh()
        if self._gripper is not None:
            self._gripper.refresh(snapshot)


class JointJog:
    """Two buttons for the joint that is chosen."""

    def __init__(self, session: Session) -> None:
        """Add the controls to the present container."""
        self._session = session
        self._robot = session.console.robot
        self._hold = Hold()
        gui = session.gui
        held = {joint.title: text for joint in self._robot.joints if (text := held_at(joint)) is not None}
        titles = tuple(joint.title for joint in self._robot.joints if joint.title not in held)
        self._joint = gui.add_dropdown("Joint", titles, initial_value=titles[0])
        self._speed = gui.add_slider("Jog speed %", min=1, max=100, step=1, initial_value=25)
        minus = gui.add_button("Jog −")
        plus = gui.add_button("Jog +")
        for title, text in held.items():
            gui.add_text(title, text, disabled=True)
        session.on(partial(attach_hold, minus), partial(self._on_hold, -1.0))
        session.on(partial(attach_hold, plus), partial(self._on_hold, 1.0))

    @property
    def speed_percent(self) -> float:
        """How fast joints are jogged, of their speed limits."""
        return self._speed.value

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


class GripperControl:
    """How far it is open."""

    def __init__(self, session: Session, title: str) -> None:
        """Add the controls to the present container."""
        self._session = session
        gui = session.gui
        with gui.add_folder(title):
            self._percent = gui.add_slider("Gripper %", min=0, max=100, step=1, initial_value=50)
            self._set = gui.add_button("Set gripper")
            self._opening = LiveHtml(gui)
        session.on(self._set.on_click, self._on_gripper)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what it was told."""
        opening = snapshot.gripper
        self._opening.show(
            "0 % is closed, 100 % open. It has not been told to move yet."
            if opening is None
            else f"0 % is closed, 100 % open. Commanded: <b>{100 * opening:.0f} %</b>."
        )

    async def _on_gripper(self) -> None:
        percent = checked_percent(self._percent.value, "gripper")
        await self._session.submit(MoveGripper(percent / 100))
