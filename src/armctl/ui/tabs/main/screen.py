"""Main: first steps, robot, board, who operates, named poses and points."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from html import escape

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.boards import has_servos
from armctl.errors import InputError
from armctl.facts import Need, State
from armctl.hardware.boards import board_type
from armctl.kinematics import Target
from armctl.protocol import (
    Arrive,
    Connect,
    Control,
    Disconnect,
    HomeAxes,
    LockControl,
    MoveTo,
    Snapshot,
    TakeControl,
)
from armctl.protocol.commands import LONGEST_NAME
from armctl.robot import Robot
from armctl.ui.console import PortChoice, PortWatch
from armctl.ui.next_pose import PoseWriter
from armctl.ui.offers import Disableable
from armctl.ui.session import Session
from armctl.ui.tabs.main.boards import RobotChooser, board_html, homing_html, of_own_arm, ports_html
from armctl.ui.tabs.main.own_arm import OwnArm
from armctl.ui.tabs.main.servos import Servos
from armctl.ui.tabs.main.tool_choice import ToolChoice
from armctl.ui.tabs.main.urdf_arm import UrdfArm
from armctl.ui.widgets.html import LiveHtml, beside, button, muted, numbers
from armctl.ui.widgets.number_field import in_row

# Who operates the arm: names, taking control, locking it.


_NOTES = (
    "Lock control: no other page can take control of the arm until it is unlocked.",
    "Everybody may press STOP. A page that does not answer for a second loses control, and the arm stops.",
)

_TYPED_S = 0.7
"""a pause after which a name counts as typed"""
_MOST_GUESSERS = 8


class People:
    """A tab in *Main*."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui = session.gui
        self._list = LiveHtml(gui)
        name = gui.add_text("Your name", initial_value=session.name)
        self._pin = gui.add_text("Teacher's PIN", initial_value="", visible=session.snapshot.control.pin)
        with in_row(gui):
            self._take = gui.add_button("Take control of the arm", icon=viser.Icon.HAND_GRAB)
            self._lock = gui.add_button("Lock control", icon=viser.Icon.LOCK, color="gray")
        LiveHtml(gui, "".join(map(muted, _NOTES)))
        self._name = name
        self._typed = 0
        session.on(name.on_update, self._on_name)
        session.on(self._take.on_click, self._on_take)
        session.on(self._lock.on_click, self._on_lock)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show who is there, and what may be done."""
        control, session = snapshot.control, self._session
        self._list.show(people_html(control, session.me))
        self._take.visible = not session.operates
        self._pin.visible = control.pin
        self._lock.label = "Unlock control" if control.locked else "Lock control"
        self._lock.disabled = not session.operates and not control.pin

    async def _on_name(self) -> None:
        """Everybody is told once the name is typed, not at each letter."""
        self._typed += 1
        typed = self._typed
        await asyncio.sleep(_TYPED_S)
        if typed == self._typed:
            await self._session.say(Arrive(self._name.value[:LONGEST_NAME], watch=True))

    async def _on_take(self) -> None:
        await self._session.say(TakeControl(self._taken_pin()))

    async def _on_lock(self) -> None:
        locked = self._session.snapshot.control.locked
        await self._session.say(LockControl(not locked, self._taken_pin()))

    def _taken_pin(self) -> str:
        """The PIN that was typed; it does not stay on the screen."""
        pin, self._pin.value = self._pin.value, ""
        return pin


def people_html(control: Control, me: str) -> str:
    """Who is there, as seen from page ``me``."""
    lines: list[str] = []
    for party in control.parties:
        what = "operates" if party.operates else "watches"
        you = " (this page)" if party.id == me else ""
        known = "" if party.name == party.id else f" · {escape(party.id)}"
        name = f"<b>{escape(party.name)}</b>" if party.operates else escape(party.name)
        lines.append(f"<div>{name}{you} {what}<span style='opacity:.65'>{known}</span></div>")
    if control.locked:
        whose = "the teacher" if control.by_teacher else "the operator"
        lines.append(f"<div>Control is locked by {whose}.</div>")
    if control.wrong_pins:
        lines.append("<div>Wrong PINs in the last hour:</div>")
    for one in control.wrong_pins[:_MOST_GUESSERS]:
        where = f"<span style='opacity:.65'> · {escape(one.source)}</span>" if one.source else ""
        lines.append(f"<div><b>{escape(one.name)}</b>: {one.count}{where}</div>")
    return "".join(lines)


_ASKED_S = 5.0
_DISCONNECT_DROPS = (
    "Without armctl the board switches its motors off after 0.5 s: THE ARM MAY DROP. Click Disconnect again "
    "to go on."
)


_JOINS = (State.DISCONNECTED, State.FAULT)
"""in which states Connect is there"""
_LINES = {
    "Disconnect": (State.OFF, State.HOLDING, State.MOVING, State.PAUSED, State.FAULT),
    "Rescan": tuple(State),
}
"""… and each button beside it"""


class MainScreen:
    """First steps, the robot, the board, and where to go at once."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui, console = session.gui, session.console
        self._choices = {choice.label: choice for choice in console.list_ports()}
        labels = tuple(self._choices)
        chosen = next((c.label for c in self._choices.values() if c.port == console.default_port), labels[0])
        self._asked_to_disconnect = -math.inf
        self._watched = console.shared(PortWatch)
        self._offered: str | None = None
        """the port that was chosen for the operator, as the lost board is there again"""
        self._writer = PoseWriter(session, "pose")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Arm"):
            self._first = FirstSteps(session)
            self._robot = RobotChooser(session)
            self._port = gui.add_dropdown("Port", labels, initial_value=chosen)
            self._board = LiveHtml(gui)
            with in_row(gui, " "):
                self._join = gui.add_button("Connect", icon=viser.Icon.PLUG_CONNECTED, visible=False)
                self._line = gui.add_button_group("Board", tuple(_LINES))
            self._ports = LiveHtml(gui)
            self._tool = ToolChoice(session)
            self._homing = gui.add_button("Homing", icon=viser.Icon.TARGET, visible=False)
            self._homed = LiveHtml(gui)
            self._add_goals()
        self._servos: Servos | None = None
        if has_servos(console.robot):
            with tabs.add_tab("Servos"):
                self._servos = Servos(
                    session,
                    lambda: self._choices[self._port.value],
                    lambda: self._connect(self._choices[self._port.value]),
                    self._disconnect,
                )
        with tabs.add_tab("Your own arm"):
            OwnArm(session)
            self._which_joint = of_own_arm(session)
        with tabs.add_tab("Arms from URDF files"):
            self._urdf = UrdfArm(session)
        with tabs.add_tab("Who operates"):
            self._people = People(session)
        session.needs(Need.OFF_OR_HOLDING, self._homing, told=False)
        session.needs(None, self._line, self._join, told=False)
        session.on(self._line.on_click, self._on_line)
        session.on(self._join.on_click, lambda: self._connect(self._choices[self._port.value]))
        session.on(self._homing.on_click, lambda: session.submit(HomeAxes()))

    def _add_goals(self) -> None:
        """Named poses and points, to which the arm goes at once."""
        session, gui, robot = self._session, self._session.gui, self._session.console.robot
        with in_row(gui, "Go to pose"):
            home = gui.add_button("Home", color="gray")
            poses = gui.add_button_group("Go to pose", tuple(one for one in robot.poses if one != "home"))
        command = session.command("Home", self._go_home, "Go to the home pose")
        goals: list[Disableable] = [home, poses, command]
        if robot.points:
            with in_row(gui, "Go to point"):
                points = gui.add_button_group("Go to point", tuple(robot.points))
            goals.append(points)
            session.on(points.on_click, lambda: self._go_to_point(points.value))
        session.needs(Need.HOLDING, *goals, hint="The arm goes there at once.")
        session.on(home.on_click, self._go_home)
        session.on(poses.on_click, lambda: self._go_to_pose(poses.value))

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the board, and what can be done."""
        self._first.refresh(snapshot)
        self._robot.refresh(snapshot)
        self._people.refresh(snapshot)
        self._urdf.refresh(snapshot)
        if self._servos is not None:
            self._servos.refresh(snapshot)
        gone = snapshot.state is State.FAULT and snapshot.board is None  # there is nothing to disconnect
        self._join.visible = snapshot.state in _JOINS
        self._line.options = tuple(
            one for one in _LINES if snapshot.state in _LINES[one] and not (gone and one == "Disconnect")
        )
        self._homing.visible = bool(snapshot.homing)
        self._tool.refresh(snapshot)
        self._offer_board_again()
        if self._session.sees("Main"):
            self._homed.show(homing_html(snapshot))
            self._ports.show(ports_html(self._choices.values()))
            self._board.show(beside("Board", board_html(snapshot)))

    def _list(self, choices: Sequence[PortChoice]) -> None:
        self._choices = {choice.label: choice for choice in choices}
        self._port.options = tuple(self._choices)

    def _offer_board_again(self) -> None:
        """Choose the port where the board that was lost is plugged in again, for Connect."""
        back_on = self._watched.back_on
        if back_on == self._offered:
            return
        self._offered = back_on
        if back_on is not None:
            self._list(self._watched.choices)
            self._port.value = next(
                (one.label for one in self._choices.values() if one.port == back_on), self._port.value
            )

    async def _on_line(self) -> None:
        if self._line.value == "Rescan":
            self._list(self._session.console.list_ports())
        else:
            await self._disconnect()

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
        if self._servos is not None:
            self._servos.require_free()
        if await session.robots.needs_reopening(choice.port):
            await session.reopen_arm(choice.port)
        else:
            await session.submit(Connect(choice.port))

    async def _go_home(self) -> None:
        await self._go_to_pose("home")

    async def _go_to_pose(self, name: str) -> None:
        self._writer.words = f"pose {name}"
        await self._writer.go(self._session.console.robot.pose(name))

    async def _go_to_point(self, name: str) -> None:
        """Of all the ways to stand there, the one nearest to the present pose: what an operator expects."""
        point = self._session.console.robot.point(name)
        await self._session.submit(MoveTo(Target.of(point), "least-travel"))


# First steps.

_FIRST, _HIDDEN = "first-steps", "hidden"
_FIRST_STEPS = {"enable", "slider", "point", "program"}
_TO_A_POINT = {"Go by least energy", "Go by the selected one"}


class FirstSteps:
    """A card for who is here for the first time; each step is ticked off once it was done in this browser."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._done: set[str] = set()
        session.parts.add(session.gui, _FIRST)
        self._known = False
        """whether it is known what was done here before"""
        self._told: tuple[frozenset[str], bool] | None = None
        """what the text depends on, as it is shown"""
        session.on_part("hide-first-steps", lambda _: self._note(_HIDDEN))
        session.spawn(self._begin())

    def refresh(self, snapshot: Snapshot) -> None:
        """Tick off what was done."""
        pressed = self._session.obeyed
        if snapshot.state is State.HOLDING and self._session.operates:
            self._note("enable")
        if "Go" in pressed:
            self._note("slider")
        if pressed & _TO_A_POINT:
            self._note("point")
        if snapshot.program is not None and self._session.operates:
            self._note("program")
        if (told := (frozenset(self._done), self._session.operates)) != self._told:
            self._told = told
            shown = self._known and _HIDDEN not in self._done and not self._done >= _FIRST_STEPS
            self._session.parts.show(_FIRST, self._html() if shown else "")

    async def _begin(self) -> None:
        kept = await self._session.recall("first-steps")
        self._done |= set((kept or "").split())
        self._known, self._told = True, None

    def _note(self, step: str) -> None:
        if step not in self._done:
            self._done.add(step)
            if self._known:
                self._session.remember("first-steps", " ".join(sorted(self._done)))

    def _html(self) -> str:
        point = numbers((1000 * example_point(self._session.console.robot)).round().tolist(), 0)
        steps = {
            "enable": "Press <b>Enable</b> at the top.",
            "slider": "<b>Manual</b>: move a slider, and press <b>Go</b>.",
            "point": f"<b>Inverse</b>: type {point}, press <b>Solve</b>, then <b>Go</b>.",
            "program": "<b>Load a sample</b> in the empty program, and press <b>Run once</b>.",
        }
        hide = button("hide-first-steps", "", title="Hide first steps", kind="bare", icon="cross")
        if not self._session.operates:
            steps = {"control": "Press <b>Take control</b> at the top.", **steps}
        lines = "".join(
            f"<li{' class=done' * (step in self._done)}>{text}{' ✓' * (step in self._done)}</li>"
            for step, text in steps.items()
        )
        return (
            f"<section class=armctl-first><header><b>First steps</b>{hide}</header><ol>{lines}</ol></section>"
        )


def example_point(robot: Robot) -> FloatArray:
    """A point (3,) [m] that the tool can reach, and where it is not at rest."""
    home, rest = robot.pose("home"), robot.pose("rest")
    if np.allclose(home, rest):
        low, high = robot.limits[:, 0], robot.limits[:, 1]
        home = 0.5 * (rest + np.where(high - rest > rest - low, high, low))
    return robot.forward(0.5 * (home + rest))[:3, 3]
