"""Enable where servos are off and cannot say where the arm stands: a ghost, and "Is the arm here?"."""

from __future__ import annotations

from html import escape

import numpy as np
import viser

from armctl.errors import ArmctlError
from armctl.runtime import Enable, Snapshot, State
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, refused, sentence
from armctl.ui.widgets.joint_angles import angle_fields
from armctl.ui.widgets.number_field import EditWatch, FieldArray

_LOOK = (
    "The servos are off and cannot tell where the arm stands. <b>Look at the arm:</b> does it stand like the "
    "blue ghost? If not, type its angles below, or put it there by hand. Enabled in a wrong pose, it jumps."
)


def must_be_told(snapshot: Snapshot) -> bool:
    """Whether somebody has to say where the arm stands before it is enabled."""
    board = snapshot.board
    waits = snapshot.state is State.OFF and all(axis.homed for axis in snapshot.homing)
    return waits and board is not None and not board.simulated and bool(np.isnan(snapshot.q).any())


def show_typed(session: Session, angles: FieldArray, problem: LiveHtml, owner: object) -> None:
    """Show the joint angles of fields as the page's ghost, which is ``owner``'s; else say what cannot be."""
    try:
        q = session.console.robot.check_limits(angles.array)
    except ArmctlError as refusal:
        problem.show(refused(sentence(str(refusal))))
        session.ghost.hide(owner)
        return
    problem.show("")
    session.ghost.show(q, owner)


class EnableQuestion:
    """The question, the angles that the ghost shows, and the answers; hidden until it is asked."""

    def __init__(self, session: Session) -> None:
        self._session, self._robot = session, session.console.robot
        self._opening: float | None = None
        gui = session.gui
        self._box = gui.add_folder("Is the arm here?", visible=False)
        with self._box:
            self._text = LiveHtml(gui)
            yes = gui.add_button("Yes, enable here", icon=viser.Icon.BOLT, color="green")
            rest = gui.add_button("It is at the rest pose")
            cancel = gui.add_button("Cancel")
            self._problem = LiveHtml(gui)
            self._angles = angle_fields(gui, self._robot, self._robot.pose("rest"))
        self._watch = EditWatch(self._angles.fields)
        session.on(yes.on_click, self._on_yes)
        session.on(rest.on_click, self._on_rest)
        session.on(cancel.on_click, self.hide)

    @property
    def asked(self) -> bool:
        """Whether it waits for an answer."""
        return self._box.visible

    def ask(self, snapshot: Snapshot) -> None:
        """Show it, filled with where the arm was seen last."""
        last = snapshot.last_pose
        self._angles.fill(self._robot.pose("rest") if last is None else last.q)
        self._opening = None if last is None else last.gripper
        words = "Nobody has seen this arm on this board yet." if last is None else sentence(str(last))
        if self._robot.gripper is not None and self._opening is None:
            words += " The gripper comes on half open."
        self._text.show(f"<div>{_LOOK}</div><div style='opacity:.75'>{escape(words)}</div>")
        self._box.visible = True
        self.refresh(snapshot)

    def hide(self) -> None:
        """The question is over."""
        self._box.visible = False
        self._session.ghost.hide(self)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the angles as the ghost; what cannot be is told. Over once the arm is on, or gone."""
        if not self._box.visible:
            return
        if not must_be_told(snapshot):
            self.hide()
            return
        show_typed(self._session, self._angles, self._problem, self)

    async def _on_yes(self) -> None:
        self._watch.require_settled()
        await self._session.submit(Enable(self._angles.array, self._opening))
        self.hide()

    async def _on_rest(self) -> None:
        await self._session.submit(Enable(self._robot.pose("rest"), self._opening))
        self.hide()
