"""The outputs at which the gripper is closed, and open."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from armctl.errors import ArmctlError
from armctl.runtime import MoveGripper, Snapshot
from armctl.ui.calibration_work import Jaw
from armctl.ui.widgets.html_bits import fixed, muted, sentence
from armctl.ui.widgets.joint_step import checked_percent
from armctl.ui.widgets.standing import standing_gripper
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

_HOW = (
    "Move the gripper until it just closes, without squeezing, and press 'Closed here'; open it as far as it "
    "should, and press 'Open here'."
)


class CalibrationGripper:
    """Move it, and say where it is closed and where it is open."""

    def __init__(self, session: Session) -> None:
        """Add the controls to the present container."""
        self._session, self._work = session, session.console.calibrating.work
        gui = session.gui
        LiveHtml(gui, muted(_HOW))
        self._percent = gui.add_slider("Gripper %", min=0, max=100, step=1, initial_value=50)
        move = gui.add_button("Move gripper")
        self._now = LiveHtml(gui)
        closed = gui.add_button("Closed here", color="gray")
        opened = gui.add_button("Open here", color="gray")
        self._jaws = LiveHtml(gui)
        session.on(move.on_click, self._on_move)
        session.on(closed.on_click, partial(self._on_jaw, "closed"))
        session.on(opened.on_click, partial(self._on_jaw, "open"))

    def refresh(self, snapshot: Snapshot) -> None:
        """Show where the gripper is, and what was set."""
        work = self._work
        self._now.show(self._now_html(snapshot))
        set_here = "set here, not saved yet" if work.jaws else "as in force"
        self._jaws.show(
            f"<div>Closed at <b>{fixed(work.jaw('closed'), 1)}</b>, open at "
            f"<b>{fixed(work.jaw('open'), 1)} {work.map.unit}</b> ({set_here})</div>"
        )

    def _now_html(self, snapshot: Snapshot) -> str:
        try:
            output = standing_gripper(self._session.console.robot, snapshot)
        except ArmctlError as error:
            return muted(sentence(str(error)))
        return f"<div>Stands at <b>{fixed(output, 1)} {self._work.map.unit}</b></div>"

    async def _on_move(self) -> None:
        await self._session.submit(MoveGripper(checked_percent(self._percent.value, "gripper") / 100))

    async def _on_jaw(self, jaw: Jaw) -> None:
        self._session.require_operator()
        self._work.set_jaw(jaw, standing_gripper(self._session.console.robot, self._session.snapshot))
