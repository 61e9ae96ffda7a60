"""Sliders that are edited first and sent by Go, and −/+ steps that move one joint at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import viser

from armctl.runtime import MoveJoints, Snapshot
from armctl.ui.screens.joint_stepper import JointStepper
from armctl.ui.widgets.joint_step import asked_pose, held_at, slider_degrees, slider_limits
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

_STEPS = ("0.1", "1", "5", "10")
_FOLLOWING = "The sliders show the arm. Move one, then press <b>Go</b>."
_EDITED = "<b style='color:#0c8599'>The ghost shows the new pose.</b> Press <b>Go</b>."


class JointControl:
    """One slider and one pair of step buttons a joint.

    The sliders follow the arm until somebody moves one; then they stay until Go has been obeyed or they
    are put back.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        gui = session.gui
        self._hint = LiveHtml(gui, _FOLLOWING)
        self._edited = False
        self._stepper = JointStepper(session)
        self._shown = self._present(session.snapshot)
        self._sliders = [self._add_slider(i) for i in range(self._robot.n)]
        self._go = gui.add_button("Go", icon=viser.Icon.PLAYER_PLAY)
        self._reset = gui.add_button("Sliders to present pose", color="gray")
        session.on(self._go.on_click, self._on_go)
        session.on(self._reset.on_click, self._on_reset)
        with gui.add_folder("Step one joint (moves at once)"):
            self._step = gui.add_dropdown("Step °", _STEPS, initial_value="1")
            for i in range(self._robot.n):
                self._add_step(i)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the arm; the sliders follow it while nobody has moved them."""
        present = self._present(snapshot)
        if self._edited and present == slider_degrees(self._robot, np.radians(self._asked())):
            self._set_edited(False)
        if not self._edited and present != self._shown:
            self._show(present)

    def _present(self, snapshot: Snapshot) -> list[float]:
        return slider_degrees(self._robot, self._session.console.last_known.standing(snapshot))

    def _add_slider(self, i: int) -> viser.GuiSliderHandle[float] | None:
        """A joint that is held has no slider: there is nothing to slide."""
        joint = self._robot.joints[i]
        if (held := held_at(joint)) is not None:
            self._session.gui.add_text(f"{joint.title} °", held, disabled=True)
            return None
        low, high = slider_limits(self._robot)[i].tolist()
        slider = self._session.gui.add_slider(
            f"{joint.title} °", min=low, max=high, step=0.01, initial_value=self._shown[i]
        )
        self._session.on(slider.on_update, self._on_slider)
        return slider

    def _add_step(self, i: int) -> None:
        joint = self._robot.joints[i]
        if (held := held_at(joint)) is not None:
            self._session.gui.add_text(joint.title, held, disabled=True)
            return
        group = self._session.gui.add_button_group(joint.title, ("−", "+"))
        self._session.on(group.on_click, lambda: self._on_step(i, 1 if group.value == "+" else -1))

    def _asked(self) -> list[float]:
        """What the sliders ask for [degrees]; a joint that is held stays where it is."""
        return [
            shown if slider is None else float(slider.value)
            for slider, shown in zip(self._sliders, self._shown, strict=True)
        ]

    def _show(self, degrees: list[float]) -> None:
        self._shown = degrees
        for slider, value in zip(self._sliders, degrees, strict=True):
            if slider is not None and slider.value != value:
                slider.value = value

    def _set_edited(self, edited: bool) -> None:
        if self._edited and not edited:
            self._session.ghost.hide()
        self._edited = edited
        self._hint.show(_EDITED if edited else _FOLLOWING)

    async def _on_slider(self) -> None:
        self._set_edited(True)
        self._session.ghost.show(np.radians(self._asked()))

    async def _on_go(self) -> None:
        await self._session.submit(MoveJoints(asked_pose(self._robot, self._asked())))

    async def _on_reset(self) -> None:
        self._set_edited(False)
        self._show(self._present(self._session.snapshot))

    async def _on_step(self, i: int, sign: int) -> None:
        await self._stepper.step(i, sign * float(self._step.value))
