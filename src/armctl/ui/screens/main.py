"""Main: robot, board, enable, named poses and points, log."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING, ClassVar

import viser

from armctl.errors import InputError
from armctl.kinematics import Target
from armctl.robot import BoardKind
from armctl.runtime import (
    ClearFault,
    Connect,
    Disconnect,
    Enable,
    Event,
    HomeAxes,
    MoveJoints,
    MoveTo,
    Snapshot,
    State,
)
from armctl.ui.screens.robot_choice import RobotChooser
from armctl.ui.widgets.text import LiveHtml
from armctl.ui.widgets.when import time_of_day

if TYPE_CHECKING:
    from armctl.ui.console import PortChoice
    from armctl.ui.session import Session

_LOG_LINES = 14
_LEVEL_COLOR = {"warning": "#e67700", "error": "#c92a2a"}
_ENABLE_NOTE = (
    "**Enable** switches the servos on. A servo that was off jumps to the rest pose at full speed: "
    "hold the arm near that pose or keep clear."
)
_TAKE_OVER_NOTE = "The servos are on: **Enable** takes the arm over where it stands. Nothing jumps."
_MOTORS_NOTE = "**Enable** switches the motors on; they hold the arm where it stands."
_UNHOMED_NOTE = (
    "The arm does not know where it is yet. **Homing** moves every axis slowly to its home switch, one after "
    "the other: keep clear."
)
_ASKED_S = 5.0
_DISCONNECT_DROPS = (
    "The board switches its motors off when nobody speaks to it: THE ARM MAY DROP half a second later. Click "
    "Disconnect again to go on."
)
_HOMING_HINT = "Find the zero of every axis: the arm moves to its home switches. STOP ends it."


class MainScreen:
    """Choose a robot, connect, enable, go home, and read what happened."""

    label: ClassVar[str] = "Main"
    icon: ClassVar[viser.IconName | None] = None

    def __init__(self, session: Session) -> None:
        self._session = session
        gui, console = session.gui, session.console
        self._choices = {choice.label: choice for choice in console.list_ports()}
        labels = tuple(self._choices)
        chosen = next((c.label for c in self._choices.values() if c.port == console.default_port), labels[0])
        self._asked_to_disconnect = -math.inf
        self._robot = RobotChooser(session)
        self._port = gui.add_dropdown("Port", labels, initial_value=chosen)
        self._line = gui.add_button_group("Board", ("Connect", "Disconnect", "Rescan"))
        self._ports = LiveHtml(gui)
        self._board = LiveHtml(gui)
        self._homing = gui.add_button("Homing", icon=viser.Icon.TARGET, hint=_HOMING_HINT, visible=False)
        self._homed = LiveHtml(gui)
        self._enable_note = gui.add_markdown(_ENABLE_NOTE)
        self._enable = gui.add_button("Enable", icon=viser.Icon.BOLT, color="green")
        self._clear = gui.add_button("Clear fault", color="orange", visible=False)
        self._home = gui.add_button("Home", icon=viser.Icon.HOME)
        self._poses = gui.add_button_group(
            "Go to pose", tuple(name for name in console.robot.poses if name != "home")
        )
        if console.robot.points:
            self._add_points()
        with gui.add_folder("Log"):
            self._log = LiveHtml(gui)
        session.on(self._line.on_click, self._on_line)
        session.on(self._enable.on_click, self._on_enable)
        session.on(self._homing.on_click, self._on_homing)
        session.on(self._clear.on_click, self._on_clear)
        session.on(self._home.on_click, self._on_home)
        session.on(self._poses.on_click, self._on_pose)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the board, what can be done, and the newest log lines."""
        self._robot.refresh(snapshot)
        self._clear.visible = snapshot.state is State.FAULT and snapshot.board is not None
        holds = snapshot.powered and snapshot.state is not State.OFF
        self._enable.visible = self._enable_note.visible = not holds
        note = _note(snapshot, self._session.console.robot.board)
        if self._enable_note.content != note:
            self._enable_note.content = note
        unhomed = any(not axis.homed for axis in snapshot.homing)
        self._enable.disabled = snapshot.state is not State.OFF or unhomed
        self._homing.visible = bool(snapshot.homing)
        self._homing.disabled = snapshot.state not in (State.OFF, State.HOLDING)
        self._homed.show(_homing_text(snapshot))
        self._home.disabled = snapshot.state is not State.HOLDING
        self._ports.show(_ports_text(self._choices.values()))
        self._board.show(self._board_text(snapshot))
        events = (*self._session.console.earlier, *snapshot.events)[-_LOG_LINES:]
        self._log.show("".join(self._log_line(event) for event in reversed(events)))

    def _add_points(self) -> None:
        group = self._session.gui.add_button_group("Go to point", tuple(self._session.console.robot.points))
        self._session.on(group.on_click, lambda: self._on_point(group.value))

    @staticmethod
    def _board_text(snapshot: Snapshot) -> str:
        board = snapshot.board
        if board is None:
            return "<div>not connected</div>"
        serial = f" · serial number {escape(board.serial_number)}" if board.serial_number else ""
        lines = [f"<div><b>{escape(board.kind)}</b> on {escape(board.port)}{serial}</div>"]
        lines += [f"<div style='opacity:.75'>{escape(note)}</div>" for note in board.notes]
        return "".join(lines)

    @staticmethod
    def _log_line(event: Event) -> str:
        color = _LEVEL_COLOR.get(event.level, "inherit")
        when = f"<span style='opacity:.6'>{time_of_day(event.stamp)}</span>"
        return f"<div style='color:{color}'>{when} {escape(event.text)}</div>"

    async def _on_line(self) -> None:
        asked = self._line.value
        if asked == "Rescan":
            self._choices = {choice.label: choice for choice in self._session.console.list_ports()}
            self._port.options = tuple(self._choices)
        elif asked == "Disconnect":
            await self._disconnect()
        else:
            choice = self._choices[self._port.value]
            if choice.why_not is not None:
                raise InputError(f"{choice.label} cannot be used: {choice.why_not}")
            await self._connect(choice.port)

    async def _disconnect(self) -> None:
        """Where that lets the arm drop, the first click asks, and a second one soon after disconnects."""
        session = self._session
        session.require_operator()
        drops = session.console.robot.board == "encoder" and session.snapshot.powered
        now = asyncio.get_running_loop().time()
        if drops and now - self._asked_to_disconnect > _ASKED_S:
            self._asked_to_disconnect = now
            session.notify("Disconnect?", _DISCONNECT_DROPS, color="yellow")
            return
        self._asked_to_disconnect = -math.inf
        await session.submit(Disconnect())

    async def _connect(self, port: str) -> None:
        """The board on another port may be calibrated otherwise: then the arm is opened anew with it."""
        session = self._session
        session.require_operator()
        if await session.robots.needs_reopening(port):
            await session.reopen_arm(port)
        else:
            await session.submit(Connect(port))

    async def _on_enable(self) -> None:
        await self._session.submit(Enable())

    async def _on_homing(self) -> None:
        await self._session.submit(HomeAxes())

    async def _on_clear(self) -> None:
        await self._session.submit(ClearFault())

    async def _on_home(self) -> None:
        await self._session.submit(MoveJoints(self._session.console.robot.pose("home")))

    async def _on_pose(self) -> None:
        await self._session.submit(MoveJoints(self._session.console.robot.pose(self._poses.value)))

    async def _on_point(self, name: str) -> None:
        """Of all the ways to stand there, the one nearest to the present pose: what an operator expects."""
        point = self._session.console.robot.point(name)
        await self._session.submit(MoveTo(Target.of(point), "least-travel"))


def _note(snapshot: Snapshot, board: BoardKind) -> str:
    """What Enable will do."""
    if board != "encoder":
        return _TAKE_OVER_NOTE if snapshot.powered else _ENABLE_NOTE
    return _UNHOMED_NOTE if any(not axis.homed for axis in snapshot.homing) else _MOTORS_NOTE


def _homing_text(snapshot: Snapshot) -> str:
    """Each axis with a sign: homed, being looked for, or not."""
    signs = [
        f"<span style='white-space:nowrap'>{'✓' if axis.homed else '…' if axis.running else '○'} "
        f"{'<b>' if axis.running else ''}{escape(axis.title)}{'</b>' if axis.running else ''}</span>"
        for axis in snapshot.homing
    ]
    if not signs:
        return ""
    done = sum(axis.homed for axis in snapshot.homing)
    return f"<div>Homed {done} of {len(signs)}: {' &nbsp; '.join(signs)}</div>"


def _ports_text(choices: Iterable[PortChoice]) -> str:
    """The boards that are plugged in, and why one cannot be used."""
    lines: list[str] = []
    for choice in choices:
        if not choice.listed:
            continue
        serial = f" · serial number {escape(choice.serial_number)}" if choice.serial_number else ""
        lines.append(f"<div>{escape(choice.label)}{serial}</div>")
        if choice.why_not is not None:
            lines.append(f"<div style='color:#c92a2a'>cannot be used: {escape(choice.why_not)}</div>")
        lines += [f"<div style='opacity:.75'>{escape(note)}</div>" for note in choice.notes]
    return "".join(lines)
