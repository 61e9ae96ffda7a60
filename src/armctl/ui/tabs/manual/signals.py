"""Inputs and outputs of the board: what they are at, outputs to press, simulated inputs to set, new ones."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Self, cast

import msgspec
import viser

from armctl.errors import InputError
from armctl.facts import Need
from armctl.hardware.boards import signal_kinds
from armctl.hardware.input_script import SCRIPT_FILES, read_script
from armctl.lazy_dataclass import dataclass
from armctl.protocol import Command, PlayInputs, SetOutput, SimulateInput, Snapshot
from armctl.protocol.snapshot import POWERED
from armctl.robot import Robot, robot_path, user_robots, user_robots_folder
from armctl.robot.draft import Draft
from armctl.robot.load import is_urdf
from armctl.robot.parts import spoken
from armctl.robot.signals import ON, Input, Output
from armctl.ui.console import Console
from armctl.ui.own_copy import taken_along
from armctl.ui.robot_switch import RobotChoice, not_replaceable
from armctl.ui.session import Session
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.widgets.html import LiveHtml, muted, table
from armctl.ui.widgets.number_field import NumberField, in_row

_SHARES = {"0 %": 0.0, "25 %": 0.25, "50 %": 0.5, "75 %": 0.75, "100 %": 1.0}
_SWITCH = {"On": 1.0, "Off": 0.0}
PLAY, STOP_SCRIPT = "Play script", "Stop script"
_SCRIPT_HINT = (
    "What the inputs see over time, e.g. 'at 2 s part = on; every 5 s part on for 200 ms', or a table (CSV) "
    "with time_s and the inputs as its columns."
)
_SIMULATED = "The board is simulated: nothing is connected to it. Set here what its inputs see."
_NONE = "No input and no output has a name yet. Name one below, then programs can set it or wait for it."


class InputScriptText:
    """The script of the simulated inputs, as it was played last: all pages begin with it."""

    def __init__(self, inputs: Sequence[Input]) -> None:
        self.inputs = tuple(inputs)
        first = next((one.name for one in inputs), "")
        self.text = f"every 5 s {first} on for 1 s"

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Go on with that of an arm that has the same inputs."""
        inputs = console.robot.signals.inputs
        return before if before is not None and before.inputs == inputs else cls(inputs)


class SignalPanel:
    """For an arm that has inputs or outputs, or may have some."""

    def __init__(self, session: Session) -> None:
        self._session, self._signals = session, session.console.robot.signals
        gui, gripper = session.gui, session.console.robot.gripper
        own = "" if gripper is None else gripper.output
        self._table = LiveHtml(gui)
        for one in self._signals.outputs:
            group, grips = self._group(one, partial(SetOutput, one.name)), one.name == own
            told = grips or one is self._signals.outputs[-1]
            session.needs(Need.CONNECTED, group, also=_use_gripper if grips else None, told=told)
        self._script = session.console.shared(InputScriptText)
        self._simulated = gui.add_folder("Simulated inputs", visible=False)
        with self._simulated:
            LiveHtml(gui, muted(_SIMULATED))
            for one in self._signals.inputs:
                session.needs(None, self._group(one, partial(SimulateInput, one.name)), told=False)
            if self._signals.inputs:
                self._add_script()
        if kinds_of(session.console.robot):
            some = bool(self._signals.inputs and self._signals.outputs)
            with gui.add_folder("New input or output", expand_by_default=not some):
                NewSignal(session)
        self.refresh(session.snapshot)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what they are at."""
        board = snapshot.board
        self._simulated.visible = board is not None and board.simulated and bool(self._signals.inputs)
        if self._signals.inputs:
            self._show_script(snapshot)
        rows = [
            [one.title, kind, said(one, values.get(one.name))]
            for kind, every, values in (
                ("input", self._signals.inputs, snapshot.inputs),
                ("output", self._signals.outputs, snapshot.outputs),
            )
            for one in every
        ]
        self._table.show(table(("Name", "", "is"), rows, words=(0, 1, 2)) if rows else muted(_NONE))

    # A script that sets the inputs.

    def _add_script(self) -> None:
        gui, session = self._session.gui, self._session
        self._text = gui.add_text("Script", self._script.text, multiline=True, hint=_SCRIPT_HINT)
        upload = gui.add_upload_button("Choose a script or a table (CSV)", icon=viser.Icon.UPLOAD)
        play = gui.add_button_group("Inputs over time", (PLAY, STOP_SCRIPT))
        self._played = LiveHtml(gui)
        session.needs(None, upload, play, told=False)
        session.on(upload.on_upload, lambda: self._on_upload(upload.value.name, upload.value.content))
        session.on(play.on_click, lambda: self._on_play(play.value))

    def _show_script(self, snapshot: Snapshot) -> None:
        names = ", ".join(snapshot.scripted)
        said = f"A script sets {names}. What you press counts until it sets that again."
        self._played.show(muted(said) if names else "")

    def _on_upload(self, name: str, content: bytes) -> None:
        self._session.require_operator()
        try:
            text = SCRIPT_FILES.text(content)
            read_script(text, self._signals)
        except InputError as cause:
            raise cause.about(name) from cause
        self._text.value = self._script.text = text

    async def _on_play(self, what: str) -> None:
        text = self._text.value.strip() if what == PLAY else ""
        if what == PLAY:
            read_script(text, self._signals)  # also an empty one is refused
            self._script.text = self._text.value
        await self._session.submit(PlayInputs(text))

    def _group(self, one: Input | Output, command: partial[Command]) -> viser.GuiButtonGroupHandle:
        """Buttons that give it a value."""
        values = _SHARES if one.kind in ("analog", "pwm") else _SWITCH
        group = self._session.gui.add_button_group(one.title, tuple(values))

        async def on_press() -> None:
            await self._session.submit(command(values[group.value]))

        self._session.on(group.on_click, on_press)
        return group


def said(one: Input | Output, value: float | None) -> str:
    """A value in words."""
    if value is None:
        return "–"
    if one.kind in ("analog", "pwm"):
        return f"{100 * value:.0f} %"
    return "on" if value > ON else "off"


def _use_gripper(snapshot: Snapshot) -> str | None:
    return "it is the gripper's: use the gripper" if snapshot.state in POWERED else None


# Another input or output: it is named in the arm's file, and the arm is opened anew.


@dataclass(frozen=True, slots=True)
class SignalKind:
    """What a pin can be."""

    table: str
    """of the robot file: ``inputs`` or ``outputs``"""
    kind: str
    words: str
    usual: str
    """a name for it"""


_KINDS = (
    SignalKind("inputs", "digital", "input: button, sensor", "Button"),
    SignalKind("inputs", "pull-up", "input, pulled up: button to ground", "Button"),
    SignalKind("inputs", "analog", "analog input: knob, distance", "Knob"),
    SignalKind("outputs", "digital", "output: lamp, valve, pump", "Lamp"),
    SignalKind("outputs", "pwm", "PWM output: dimmed lamp", "Lamp"),
)
_LAST_CHANNEL = 63
_CHANNEL_HINT = "Of the board: the channel of a Maestro, the pin of an Arduino. None that drives a joint."
_LOW_HINT = "Its pin is low while it is on, as that of a button to ground is."
_OPENED = "The arm is opened anew with it."
_COPIED = (
    "A copy of this arm becomes one of yours, with its programs, drawings and calibrations, and is opened."
)
_OF_URDF = "Name them in the side file of this arm, NAME.armctl.toml: tables [[inputs]] and [[outputs]]."


def kinds_of(robot: Robot) -> dict[str, SignalKind]:
    """What pins of the arm's board can be, by what a person reads; empty: it has none to spare."""
    if robot.output_map is None:
        return {}
    read, switched = signal_kinds(robot.board)
    known = {*(("inputs", kind) for kind in read), *(("outputs", kind) for kind in switched)}
    return {one.words: one for one in _KINDS if (one.table, one.kind) in known}


def free_channel(robot: Robot) -> int:
    """The first one behind all that are used."""
    outputs, signals = robot.outputs, robot.signals
    used = [one.channel for one in (*signals.inputs, *signals.outputs, *outputs.mirrors)]
    return 1 + max(*used, *outputs.channels, outputs.gripper_channel or 0)


def with_signal(draft: Draft, what: SignalKind, title: str, channel: int, *, active_low: bool) -> Draft:
    """A robot file with one more input or output. Raises ``InputError``: its name has no letters."""
    name = re.sub(r"[^a-z0-9]+", "_", title.strip().lower()).strip("_").lstrip("0123456789_")
    if not name:
        raise InputError(f"Name {title!r}: write what it is, such as Button; it begins with a letter a … z")
    entry: dict[str, Any] = {"name": name, "channel": channel}
    entry |= {} if what.kind == "digital" else {"kind": what.kind}
    entry |= {} if title.strip() == spoken(name) else {"title": title.strip()}
    entry |= {"active_low": True} if active_low else {}
    before = cast("Sequence[Mapping[str, Any]]", draft.table.get(what.table, ()))
    return draft.changed(**{what.table: [*before, entry]})


def as_own(draft: Draft) -> Draft:
    """A copy with a name of its own among the user's arms."""
    taken, name = {Path(one).stem for one in user_robots()}, f"my_{draft.name}"
    numbered = (name, *(f"{name}_{k}" for k in range(2, len(taken) + 3)))
    title = draft.table["title"]
    return draft.changed(name=next(one for one in numbered if one not in taken), title=f"My {title}")


class NewSignal:
    """Fields of one more input or output."""

    def __init__(self, session: Session) -> None:
        self._session, self._kinds = session, kinds_of(session.console.robot)
        gui, present = session.gui, session.robots.present.name
        if is_urdf(present):
            LiveHtml(gui, muted(_OF_URDF))
            return
        self._own = robot_path(present) == user_robots_folder() / f"{present}.toml"
        self._kind = gui.add_dropdown("It is an", tuple(self._kinds))
        self._title = gui.add_text("Name", next(iter(self._kinds.values())).usual)
        channel = free_channel(session.console.robot)
        self._channel = NumberField(gui, "Channel", channel, hint=_CHANNEL_HINT)
        self._low = gui.add_checkbox("Active low", initial_value=False, hint=_LOW_HINT)
        with in_row(gui):
            add = gui.add_button("Add it to the arm", icon=viser.Icon.PLUS)
        session.needs(
            None, add, also=partial(not_replaceable, reopen=True), hint=_OPENED if self._own else _COPIED
        )
        session.on(self._kind.on_update, self._on_kind)
        session.on(add.on_click, self._on_add)

    def _on_kind(self) -> None:
        """Another usual name, where nobody has typed one."""
        if self._title.value in [one.usual for one in self._kinds.values()]:
            self._title.value = self._kinds[self._kind.value].usual

    async def _on_add(self) -> None:
        session, what = self._session, self._kinds[self._kind.value]
        session.require_operator()
        session.robots.require_reopenable()
        channel = self._channel.whole(0, _LAST_CHANNEL)
        draft = await asyncio.to_thread(Draft.of_file, robot_path(session.robots.present.name))
        draft = draft if self._own else as_own(draft)
        draft = with_signal(draft, what, self._title.value, channel, active_low=self._low.value)
        path = await asyncio.to_thread(draft.save, replace_old=self._own)
        said = f"{self._title.value} is saved in {path}; the arm is opened anew."
        if self._own:
            session.notify("Inputs and outputs", said)
            await session.reopen_arm()
            return
        came = await taken_along(session.console, draft.robot())
        session.notify("Inputs and outputs", f"{said} {came}".strip())
        program, robots = session.console.shared(SharedProgram).program, session.robots
        robots.offer(RobotChoice(draft.name, str(draft.table["title"])))
        await robots.change(draft.name, session.origin, session.require_operator)
        taken = robots.console.shared(SharedProgram)
        if program.steps and not taken.program.steps:
            taken.edit(msgspec.structs.replace(program, robot=draft.name))
