"""Main: robot, board, enable, named poses and points, log."""

from __future__ import annotations

import asyncio
import math
from html import escape

import viser

from armctl.errors import ArmctlError, InputError
from armctl.hardware.boards import board_type
from armctl.kinematics import Target
from armctl.report import report
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
from armctl.ui.console import PortChoice
from armctl.ui.session import Session
from armctl.ui.tabs.main.boards import RobotChooser, board_html, enable_note, homing_html, ports_html
from armctl.ui.tabs.main.enabling import EnableQuestion, must_be_told
from armctl.ui.tabs.main.own_arm import OwnArm
from armctl.ui.tabs.main.people import People
from armctl.ui.tabs.main.urdf_arm import UrdfArm
from armctl.ui.tabs.main.which_joint import of_own_arm
from armctl.ui.widgets.html import WARNING, LiveHtml, muted, time_of_day

_LOG_LINES = 14
_LEVEL_COLOR = {"warning": WARNING, "error": "#c92a2a"}
_REPORT_HINT = (
    "The report holds versions, robot file, log, and the last minute of the arm: send it with a question."
)
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
        self._question = EnableQuestion(session)
        self._clear = gui.add_button("Clear fault", color="orange", visible=False)
        self._home = gui.add_button("Home", icon=viser.Icon.HOME)
        poses = gui.add_button_group(
            "Go to pose", tuple(name for name in console.robot.poses if name != "home")
        )
        if console.robot.points:
            points = gui.add_button_group("Go to point", tuple(console.robot.points))
            session.on(points.on_click, lambda: self._go_to_point(points.value))
        self._people = People(session)
        OwnArm(session)
        self._urdf = UrdfArm(session)
        self._which_joint = of_own_arm(session)
        with gui.add_folder("Log"):
            self._log = LiveHtml(gui)
            save = gui.add_button("Download report", icon=viser.Icon.DOWNLOAD, color="gray")
            LiveHtml(gui, muted(_REPORT_HINT))
        session.on(save.on_click, self._on_report)
        session.on(self._line.on_click, self._on_line)
        session.on(self._enable.on_click, self._on_enable)
        session.on(self._homing.on_click, lambda: session.submit(HomeAxes()))
        session.on(self._clear.on_click, lambda: session.submit(ClearFault()))
        session.on(self._home.on_click, lambda: self._go_to_pose("home"))
        session.on(poses.on_click, lambda: self._go_to_pose(poses.value))

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the board, what can be done, and the newest log lines."""
        self._robot.refresh(snapshot)
        self._people.refresh(snapshot)
        self._urdf.refresh(snapshot)
        if self._which_joint is not None:
            self._which_joint.refresh(snapshot)
        fault = snapshot.state is State.FAULT and not snapshot.unreachable
        self._clear.visible = fault and snapshot.board is not None
        holds = snapshot.powered and snapshot.state is not State.OFF
        self._question.refresh(snapshot)
        self._enable.visible = self._enable_note.visible = not (holds or self._question.asked)
        self._enable_note.content = enable_note(snapshot, self._session.console.robot.board)
        unhomed = any(not axis.homed for axis in snapshot.homing)
        self._enable.disabled = snapshot.state is not State.OFF or unhomed
        self._homing.visible = bool(snapshot.homing)
        self._homing.disabled = snapshot.state not in (State.OFF, State.HOLDING)
        self._homed.show(homing_html(snapshot))
        self._home.disabled = snapshot.state is not State.HOLDING
        self._ports.show(ports_html(self._choices.values()))
        self._board.show(board_html(snapshot))
        events = (*self._session.console.earlier, *snapshot.events)[-_LOG_LINES:]
        self._log.show("".join(_log_line(event) for event in reversed(events)))

    async def _on_enable(self) -> None:
        """Where nobody knows how the arm stands, the operator is asked first."""
        session = self._session
        if must_be_told(session.snapshot):
            session.require_operator()
            self._question.ask(session.snapshot)
        else:
            await session.submit(Enable())

    async def _on_line(self) -> None:
        match self._line.value:
            case "Rescan":
                self._choices = {choice.label: choice for choice in self._session.console.list_ports()}
                self._port.options = tuple(self._choices)
            case "Disconnect":
                await self._disconnect()
            case _:
                await self._connect(self._choices[self._port.value])

    async def _on_report(self) -> None:
        session, console = self._session, self._session.console
        robot, calibration = session.robots.present.name, console.calibration.calibration
        folder = console.files / "programs" / console.robot.name

        def made() -> bytes:
            try:
                recording = console.controller.black_box()
            except ArmctlError as cause:
                recording = cause
            names = sorted(path.name for path in folder.glob("*.toml"))
            return report(robot, calibration, recording, names)

        session.download("report.zip", await asyncio.to_thread(made))

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

    async def _connect(self, choice: PortChoice) -> None:
        """The board on another port may be calibrated otherwise: then the arm is opened anew with it."""
        session = self._session
        if choice.why_not is not None:
            raise InputError(f"{choice.label} cannot be used: {choice.why_not}")
        session.require_operator()
        if await session.robots.needs_reopening(choice.port):
            await session.reopen_arm(choice.port)
        else:
            await session.submit(Connect(choice.port))

    async def _go_to_pose(self, name: str) -> None:
        await self._session.submit(MoveJoints(self._session.console.robot.pose(name)))

    async def _go_to_point(self, name: str) -> None:
        """Of all the ways to stand there, the one nearest to the present pose: what an operator expects."""
        point = self._session.console.robot.point(name)
        await self._session.submit(MoveTo(Target.of(point), "least-travel"))


def _log_line(event: Event) -> str:
    color = _LEVEL_COLOR.get(event.level, "inherit")
    when = f"<span style='opacity:.6'>{time_of_day(event.stamp)}</span>"
    return f"<div style='color:{color}'>{when} {escape(event.text)}</div>"
