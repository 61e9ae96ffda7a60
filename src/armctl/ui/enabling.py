"""Enable: what it will do, and the question "Is the arm here?" where nobody knows how the arm stands."""

from __future__ import annotations

import asyncio
from html import escape

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, MotionRefusedError
from armctl.facts import Need, State
from armctl.facts.angles import DEGREE
from armctl.hardware.boards import board_type
from armctl.motion.clearance import clear_rest
from armctl.protocol import Enable, Snapshot
from armctl.ui.console import PortWatch
from armctl.ui.session import Session
from armctl.ui.widgets.angle_fields import angle_fields
from armctl.ui.widgets.html import LiveHtml, button, refused, sentence
from armctl.ui.widgets.number_field import EditWatch, FieldArray, field_grid, in_row

_ROUNDED_RAD = 0.01 * DEGREE
"""fields round what they are filled with"""
_LOOK = (
    "The servos are off and cannot tell where the arm stands. <b>Look at the arm:</b> does it stand like "
    "the orange ghost? If not, type its angles, or put it there by hand. If the pose is wrong, the arm jumps."
)
_WAS_MOVING = "<b>The arm was moving when it was last seen.</b> The ghost shows where that was."
_ENABLE_NOTE = "Enable asks where the arm stands. Then it switches the servos on, one by one: keep clear."
_SIMULATED_NOTE = "Enable switches the simulated servos on, in the rest pose."
_TAKE_OVER_NOTE = "The servos are on: Enable takes the arm over where it stands. Nothing jumps."
_MOTORS_NOTE = "Enable switches the motors on; they hold the arm where it stands."
_LOST_NOTE = "Connect is in Main. Nothing moves by itself."
_BACK_NOTE = "The board is plugged in again ({}). Press Connect in Main. Nothing moves by itself."
_UNREACHABLE_NOTE = "The arm does not answer; the line above says what to do. Nothing goes on by itself."
_MOTORS_HOLD = "The motors are on and hold the arm where it stands; Release switches them off."
_TOOL_NOTE = "Look which tool is on, and say so in Main. Then press Enable."
_UNHOMED_NOTE = (
    "The arm does not know where it is yet. Homing in Main moves every axis slowly to its home switch, one "
    "after the other: keep clear. STOP ends it."
)


def enable_note(snapshot: Snapshot, board: str, back_on: str | None = None) -> str:
    """What Enable will do, or what must be done before; ``back_on``: the port where a lost board is again."""
    if snapshot.unreachable:
        return _UNREACHABLE_NOTE
    if snapshot.state is State.FAULT and snapshot.board is None:
        return _LOST_NOTE if back_on is None else _BACK_NOTE.format(back_on)
    if snapshot.tool_unconfirmed and snapshot.board is not None:
        return _TOOL_NOTE
    if not board_type(board).homing:
        if snapshot.limp:
            return f"{', '.join(snapshot.limp)}: off, the other joints hold. Enable switches on what is off."
        if snapshot.powered:
            return _TAKE_OVER_NOTE
        simulated = snapshot.board is not None and snapshot.board.simulated
        return _SIMULATED_NOTE if simulated else _ENABLE_NOTE
    homed = bool(snapshot.homing) and all(axis.homed for axis in snapshot.homing)
    if homed:
        return _MOTORS_NOTE
    return f"{_MOTORS_HOLD} {_UNHOMED_NOTE}" if snapshot.powered else _UNHOMED_NOTE


def must_be_told(snapshot: Snapshot) -> bool:
    """Whether somebody has to say where the arm stands before it is enabled."""
    board = snapshot.board
    waits = (snapshot.state is State.OFF or bool(snapshot.limp)) and all(
        axis.homed for axis in snapshot.homing
    )
    return waits and board is not None and not board.simulated and bool(np.isnan(snapshot.q).any())


def show_typed(
    session: Session,
    angles: FieldArray,
    problem: LiveHtml,
    owner: object,
    seen_moving: FloatArray | None = None,
) -> None:
    """Show the joint angles of fields as the page's ghost, which is ``owner``'s; else say what cannot be.

    ``seen_moving``: (n,) [rad] where the arm was seen moving last; the ghost says so while it shows that.
    """
    try:
        q = session.console.robot.check_limits(angles.array)
    except ArmctlError as refusal:
        problem.show(refused(sentence(refusal.reason)))
        session.ghost.hide(owner)
        return
    problem.show("")
    there = seen_moving is not None and bool(np.abs(q - seen_moving).max() <= _ROUNDED_RAD)
    session.ghost.show(q, owner, label="was moving" if there else "here?")


class EnableControl:
    """Enable, and the question where nobody knows how the arm stands, in the present container."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._ports = session.console.shared(PortWatch)
        self._told_back_on: str | None = None
        self._clear: tuple[FloatArray, str] | None = None
        """where the arm may be enabled instead, and its angles in words"""
        self._question = EnableQuestion(session)
        command = session.command("Enable", self.enable, "Switch the motors on")
        session.needs(Need.OFF, command, also=lambda now: _unhomed(now) or _untold(now), told=False)

    def why_not(self, snapshot: Snapshot) -> str | None:
        """Why Enable is refused now, and what to do; None: it is not."""
        if self._question.asked:
            return "answer the question “Is the arm here?” first"
        return self._session.why_not(Need.OFF, snapshot) or _unhomed(snapshot) or _untold(snapshot)

    def refresh(self, snapshot: Snapshot) -> None:
        """Keep the question up to date; tell once when a board that was lost is there again."""
        self._question.refresh(snapshot)
        if snapshot.powered:
            self._clear = None
        back_on = self._ports.back_on
        if back_on != self._told_back_on:
            self._told_back_on = back_on
            if back_on is not None:
                self._session.notify("Board", _BACK_NOTE.format(back_on), "yellow")

    def html(self, snapshot: Snapshot) -> str:
        """What Enable will do, or what must be done before; nothing while the arm is on, or is asked for."""
        if self._question.asked:
            return "<p class='warn'>Answer “Is the arm here?”, above the tabs.</p>"
        if snapshot.powered and snapshot.state is not State.OFF and not snapshot.limp:
            return ""
        note = enable_note(snapshot, self._session.console.robot.board, self._ports.back_on)
        elsewhere = ""
        if self._clear is not None:
            label = f"Enable in {self._clear[1]}°"
            elsewhere = button("enable-elsewhere", label, why=self._session.why_not(Need.OFF, snapshot))
        kind = " class='warn'" if snapshot.limp else ""
        return f"<p{kind}>{escape(note)}</p>{elsewhere}"

    async def enable(self) -> None:
        """Where nobody knows how the arm stands, the operator is asked first."""
        session = self._session
        if must_be_told(session.snapshot):
            session.require_operator()
            self._question.ask(session.snapshot)
            session.gui.main_panel.expand()
            return
        try:
            await session.submit(Enable())
        except MotionRefusedError as refusal:
            board = session.snapshot.board
            if board is None or not board.simulated:
                raise  # where the arm stands is no choice
            self._clear = await asyncio.to_thread(clear_rest, session.console.robot)
            if self._clear is None:
                raise
            angles = self._clear[1]
            raise MotionRefusedError(
                f"{refusal}: press “Enable in {angles}°”. Main → Tool, rest pose and floor keeps such a pose"
            ) from refusal

    async def enable_elsewhere(self) -> None:
        """Enable where the arm is clear, as was offered."""
        if self._clear is not None:
            await self._session.submit(Enable(self._clear[0]))


def _unhomed(snapshot: Snapshot) -> str | None:
    homed = all(axis.homed for axis in snapshot.homing)
    return None if homed else "home the arm first"


def _untold(snapshot: Snapshot) -> str | None:
    return "say in Main which tool is on" if snapshot.tool_unconfirmed else None


class EnableQuestion:
    """The question, the angles that the ghost shows, and the answers; hidden until it is asked."""

    def __init__(self, session: Session) -> None:
        self._session, self._robot = session, session.console.robot
        self._opening: float | None = None
        self._seen_moving: FloatArray | None = None
        gui = session.gui
        self._box = gui.add_folder("Is the arm here?", visible=False)
        with self._box:
            self._text = LiveHtml(gui)
            with field_grid(gui):
                self._angles = angle_fields(gui, self._robot, self._robot.pose("rest"))
            self._problem = LiveHtml(gui)
            with in_row(gui):
                yes = gui.add_button("Yes, enable here", icon=viser.Icon.BOLT)
                rest = gui.add_button("It is at the rest pose", color="gray")
                cancel = gui.add_button("Cancel", color="gray")
        session.needs(Need.OFF, yes, rest, told=False)
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
        self._seen_moving = last.q if last is not None and last.moving else None
        words = "Nobody has seen this arm on this board yet." if last is None else sentence(str(last))
        if self._robot.gripper is not None and self._opening is None:
            words += " The gripper comes on half open."
        moving = f"<div>{_WAS_MOVING}</div>" if self._seen_moving is not None else ""
        self._text.show(f"{moving}<div>{_LOOK}</div><div style='opacity:.75'>{escape(words)}</div>")
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
        show_typed(self._session, self._angles, self._problem, self, self._seen_moving)

    async def _on_yes(self) -> None:
        self._watch.require_settled()
        await self._session.submit(Enable(self._angles.array, self._opening))
        self.hide()

    async def _on_rest(self) -> None:
        await self._session.submit(Enable(self._robot.pose("rest"), self._opening))
        self.hide()
