"""Main: robot, board, enable, named poses and points, log."""

from __future__ import annotations

import asyncio
import math
from html import escape

import viser

from armctl.errors import InputError
from armctl.hardware.boards import board_type
from armctl.kinematics import Target
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
from armctl.ui.session import Session
from armctl.ui.tabs.main.boards import RobotChooser, board_html, enable_note, homing_html, ports_html
from armctl.ui.widgets.html import WARNING, LiveHtml, time_of_day

_LOG_LINES = 14
_LEVEL_COLOR = {"warning": WARNING, "error": "#c92a2a"}
_ASKED_S = 5.0
_DISCONNECT_DROPS = (
    "The board switches its motors off when nobody speaks to it: THE ARM MAY DROP half a second later. Click "
    "Disconnect again to go on."
)


class MainScreen:
    """Choose a robot, connect, enable, go home, and read what happened."""

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
        self._homing = gui.add_button("Homing", icon=viser.Icon.TARGET, visible=False)
        self._homed = LiveHtml(gui)
        self._enable_note = gui.add_markdown(enable_note(session.snapshot, console.robot.board))
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
        note = enable_note(snapshot, self._session.console.robot.board)
        if self._enable_note.content != note:
            self._enable_note.content = note
        unhomed = any(not axis.homed for axis in snapshot.homing)
        self._enable.disabled = snapshot.state is not State.OFF or unhomed
        self._homing.visible = bool(snapshot.homing)
        self._homing.disabled = snapshot.state not in (State.OFF, State.HOLDING)
        self._homed.show(homing_html(snapshot))
        self._home.disabled = snapshot.state is not State.HOLDING
        self._ports.show(ports_html(self._choices.values()))
        self._board.show(board_html(snapshot))
        events = (*self._session.console.earlier, *snapshot.events)[-_LOG_LINES:]
        self._log.show("".join(self._log_line(event) for event in reversed(events)))

    def _add_points(self) -> None:
        group = self._session.gui.add_button_group("Go to point", tuple(self._session.console.robot.points))
        self._session.on(group.on_click, lambda: self._on_point(group.value))

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
        drops = board_type(session.console.robot.board).off_when_left and session.snapshot.powered
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
