"""Hold-to-jog of a joint or the tool, with buttons or keys, steps of the tool, and the gripper."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal, get_args

import numpy as np
import viser

from armctl.errors import ArmctlError, InputError
from armctl.facts import Need
from armctl.facts.angles import DEGREE
from armctl.program import UserFrame
from armctl.protocol import Jog, JogTool, MonotonicClock, MoveGripper, Snapshot
from armctl.protocol.snapshot import tool_turns
from armctl.robot import CarriedPart, Robot
from armctl.ui.offers import Offer
from armctl.ui.session import Session
from armctl.ui.tabs.manual.joints import GripperSlider
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.manual.sticks import StickJog
from armctl.ui.widgets.angle_fields import held_at
from armctl.ui.widgets.html import LiveHtml, muted, table
from armctl.ui.widgets.number_field import (
    EditWatch,
    TextEntry,
    button_pairs,
    format_number,
    in_row,
    parse_numbers,
)

Frame = Literal["base", "tool"]
FRAMES: dict[str, Frame] = {"base axes": "base", "tool axes": "tool"}
_TURN_DEG_PER_MM = 0.5
_SPEED_HINT = "How fast the tool goes while a button is held. The joints' limits and Speed % slow it down."
_TURNS = "A joint turns for as long as its button is held."
_KEEPS = "The tool moves on a straight line for as long as a button is held."
_NOTE = (
    "The tool keeps its {} where the arm can. {} turn it in its place, "
    f"{_TURN_DEG_PER_MM:g}°/s for each mm/s."
)
_PITCH_AND_ROLL = _NOTE.format("pitch and roll", "Pitch and Roll")
_ORIENTATION = _NOTE.format("orientation", "Rx, Ry and Rz")

Key = Literal["R", "F", "T", "G", "Y", "H", "U", "J", "I", "K", "O", "L", "P", "M"]
KEYS: tuple[tuple[Key, Key], ...] = tuple(zip(get_args(Key)[::2], get_args(Key)[1::2], strict=True))
"""Key for + above key for −; the page's own camera keys (W A S D Q E, arrows) are left out."""
_HOLD_HZ, _SILENCE_S = 20.0, 0.3
"""ticks of a held button, and how long one is silent that was let go [s]"""
_KEY_SILENCE_S = 1.2
"""A key that was silent for this long was let go: longer than the delay before it repeats."""
_ON, _OFF = "Keyboard jog is ON: press to switch off", "Keyboard jog is off: press to switch on"
_KEYS_NOTE = (
    "A tap is a small step; hold a key to go on. The motion ends 100 ms after the key is let go. Keys do "
    "nothing while a field has the focus: click into the 3D view first."
)


_EMPTY, _ENDS = "empty", "0 % is closed, 100 % open."
_PART_HINT = (
    "How large the part between the jaws is, along X, Y, Z of the tool, e.g. 20 × 30 × 40: its middle is at "
    "the tool point. All that moves stays clear with it, until the gripper is set again."
)
_ABOUT = ("Rx", "Ry", "Rz")


def tool_axes(robot: Robot) -> tuple[str, ...]:
    """What the tool of an arm can be jogged along and about."""
    if robot.orients_tool:
        return ("X", "Y", "Z", *_ABOUT)
    pitch, roll = tool_turns(robot)
    return ("X", "Y", "Z", *(["Pitch"] if pitch else []), *(["Roll"] if roll else []))


def tool_jog(axis: str, sign: float, speed_mm_s: float, frame: Frame) -> JogTool:
    """One short command; ``sign`` is 1 or -1."""
    linear, rate = np.zeros(3), sign * _TURN_DEG_PER_MM * speed_mm_s * DEGREE
    match axis:
        case "Pitch":
            return JogTool(linear, pitch_rate=rate, frame=frame)
        case "Roll":
            return JogTool(linear, roll_rate=rate, frame=frame)
        case "Rx" | "Ry" | "Rz":
            return JogTool(linear, frame=frame, angular=rate * np.eye(3)[_ABOUT.index(axis)])
        case _:
            linear["XYZ".index(axis)] = sign * speed_mm_s / 1000
            return JogTool(linear, frame=frame)


def joint_jog(robot: Robot, joint: int, rate: float) -> Jog:
    """One short command that turns one joint; ``rate`` is -1 … 1 of its speed limit."""
    rates = np.zeros(robot.n)
    rates[joint] = rate
    return Jog(rates)


class HeldJog:
    """Sends a short command, which expires by itself, for each tick of what is held. Refused once a hold."""

    def __init__(
        self, session: Session, silence_s: float = _SILENCE_S, now: Callable[[], float] = MonotonicClock.now
    ) -> None:
        """What was silent for ``silence_s`` was let go."""
        self._session, self._silence_s, self._now = session, silence_s, now
        self._last_s = -math.inf
        self._refused = False

    def attach(self, button: viser.GuiButtonHandle, command: Callable[[], Jog | JogTool]) -> None:
        """Send what ``command`` gives, ``_HOLD_HZ`` times a second, while the button is held."""
        on_hold: Any = button.on_hold  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
        self._session.on(partial(on_hold, callback_hz=_HOLD_HZ), lambda: self.send(command))

    async def send(self, command: Callable[[], Jog | JogTool]) -> None:
        """One tick; raises what the controller refuses, once a hold."""
        now_s = self._now()
        if now_s - self._last_s > self._silence_s:
            self._refused = False
        self._last_s = now_s
        if self._refused:
            return
        try:
            await self._session.submit(command())
        except ArmctlError:
            self._refused = True
            raise


def part_of(text: str) -> CarriedPart | None:
    """The part that a field tells of, as ``20 × 30 × 40``; None: it is empty, or says so. ``InputError``."""
    if text.strip().casefold() in ("", _EMPTY):
        return None
    return CarriedPart.of(parse_numbers(text, "Part mm", ("X", "Y", "Z")))


def _part_text(edges_mm: Sequence[float] | None) -> str:
    return _EMPTY if edges_mm is None else " × ".join(map(format_number, edges_mm))


class JogControl:
    """The arm moves while a jog button or key is held, and stops when it is let go or the page is lost."""

    def __init__(self, session: Session) -> None:
        gui = session.gui
        with gui.add_folder("Jog (moves while the button is held)"):
            tabs = gui.add_tab_group()
            with tabs.add_tab("Joint"):
                joint = JointJog(session)
            with tabs.add_tab("Tool"):
                self._tool = tool = ToolJog(session)
            with tabs.add_tab("Keyboard"):
                self._keys = KeyboardJog(session, joint, tool)
            with tabs.add_tab("Gamepad"):
                self._sticks = StickJog(session, HeldJog(session).send, joint.share, tool.rates)
        self._session = session
        self._opening: Offer | None = None
        if (gripper := session.console.robot.gripper) is not None:
            with gui.add_folder(gripper.title):
                self._slider = GripperSlider(session)
                self._part = gui.add_text("Part mm", _part_text(session.snapshot.part_mm), hint=_PART_HINT)
                self._watch = EditWatch([TextEntry(self._part)])
                with in_row(gui, " "):
                    move = gui.add_button("Set gripper")
                self._opening = session.needs(Need.GRIPPER, move, hint=_ENDS)
            session.on(move.on_click, self._on_gripper)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the keys, and where the gripper was sent last."""
        self._keys.refresh()
        self._sticks.refresh(snapshot)
        self._tool.refresh()
        if self._opening is not None:
            self._slider.follow(snapshot)
            text = "It has not been told to move yet."
            if snapshot.gripper is not None:
                text = f"Commanded: {100 * snapshot.gripper:.0f} %."
            if (part := CarriedPart.of(snapshot.part_mm)) is not None:
                text += f" It carries a part of {part}."
            self._opening.hint = f"{_ENDS} {text}"

    async def _on_gripper(self) -> None:
        self._watch.require_settled()
        part = part_of(self._part.value)
        await self._session.submit(MoveGripper(self._slider.opening, None if part is None else part.edges_mm))


def add_pairs(
    session: Session, axes: Sequence[str], command: Callable[[str, float], Jog | JogTool], hint: str
) -> None:
    """A button for − and one for + of each axis, which move for as long as they are held; and a ``hint``."""
    jog = HeldJog(session)
    with button_pairs(session.gui):
        for axis in axes:
            for sign, text in ((-1.0, "−"), (1.0, "+")):
                button = session.gui.add_button(f"{axis} {text}", color="gray")
                jog.attach(button, partial(command, axis, sign))
                session.needs(Need.JOG, button, told=False)
    session.needs(Need.JOG, hint=hint)


class JointJog:
    """Two buttons a joint; letting go, or losing the page, stops the arm."""

    def __init__(self, session: Session) -> None:
        gui, self._robot = session.gui, session.console.robot
        self._titles = [joint.title for joint in self._robot.joints]
        held = {joint.title: text for joint in self._robot.joints if (text := held_at(joint)) is not None}
        self.axes = tuple(title for title in self._titles if title not in held)
        """the joints that can turn"""
        self._speed = gui.add_slider("Jog speed %", min=1, max=100, step=1, initial_value=25)
        add_pairs(session, self.axes, self.command, _TURNS)
        for title, text in held.items():
            gui.add_text(title, text, disabled=True)

    @property
    def speed(self) -> str:
        """How fast joints are jogged, in words."""
        return f"{self._speed.value:.0f} % of each joint's speed"

    def share(self) -> float:
        """The same, 0 … 1."""
        return self._speed.value / 100

    def command(self, axis: str, sign: float) -> Jog:
        """One short command; ``sign`` is 1 or -1."""
        return joint_jog(self._robot, self._titles.index(axis), sign * self.share())


SLOW_MM_S = 5.0
"""for a tip that is brought onto something"""


class ToolJog:
    """Two buttons an axis; letting go, or losing the page, stops the arm."""

    def __init__(self, session: Session, speed_mm_s: float = 30) -> None:
        """``speed_mm_s``: how fast it is to begin with."""
        gui, self._shared = session.gui, session.console.shared(SharedProgram)
        self.axes = tool_axes(session.console.robot)
        note = _ORIENTATION if session.console.robot.orients_tool else _PITCH_AND_ROLL
        self._frame = gui.add_dropdown("Along the", tuple(FRAMES), initial_value="base axes", hint=note)
        self._offered: Mapping[str, UserFrame] = {}
        self._names: dict[str, str] = {}
        """of the user frames that are offered, by what is chosen"""
        self._speed = gui.add_slider("Tool mm/s", 1, 150, 1, initial_value=speed_mm_s, hint=_SPEED_HINT)
        add_pairs(session, self.axes, self.command, _KEEPS)

    @property
    def speed(self) -> str:
        """How fast the tool is jogged, in words."""
        return f"{self._speed.value:.0f} mm/s"

    def rates(self) -> tuple[float, float]:
        """The same: along [m/s], and about an axis [rad/s]."""
        return self._speed.value / 1000, _TURN_DEG_PER_MM * self._speed.value * DEGREE

    def refresh(self) -> None:
        """Offer the axes of the frames of the program, too; the chosen ones may be gone."""
        frames = self._shared.program.frames
        if frames is self._offered:
            return
        self._offered, self._names = frames, {f"axes of {name}": name for name in frames}
        options, chosen = (*FRAMES, *self._names), self._frame.value
        if self._frame.options != options:
            self._frame.options = options
            self._frame.value = chosen if chosen in options else options[0]

    def command(self, axis: str, sign: float, frame: Frame | None = None) -> JogTool:
        """One short command; ``sign`` is 1 or -1; ``frame`` None: the chosen one."""
        chosen = self._frame.value
        if frame is not None or chosen in FRAMES:
            return tool_jog(axis, sign, self._speed.value, frame or FRAMES[chosen])
        user = self._shared.program.frames.get(self._names.get(chosen, ""))
        if user is None:
            raise InputError(f"the program has no such frame any more: {chosen}")
        return tool_jog(axis, sign, self._speed.value, "base").from_user_frame(user.matrix[:3, :3])


class KeyboardJog:
    """A switch, what the keys move, and the legend of the keys. Off until the operator switches it on.

    A page reports key presses only, and a held key repeats after half a second. Each press counts for 100 ms:
    a tap is a small step, a held key a step, a rest, and a motion that ends 100 ms after it is let go.
    """

    def __init__(self, session: Session, joint: JointJog, tool: ToolJog) -> None:
        """The speeds are those of the buttons."""
        self._session = session
        self._moves: dict[str, tuple[JointJog | ToolJog, Callable[[str, float], Jog | JogTool]]] = {
            "Joints": (joint, joint.command),
            "Tool, base axes": (tool, partial(tool.command, frame="base")),
            "Tool, tool axes": (tool, partial(tool.command, frame="tool")),
        }
        self._jog = HeldJog(session, _KEY_SILENCE_S)
        self._commands: list[viser.CommandHandle] = []
        self._on = False
        gui = session.gui
        self._switch = gui.add_button(_OFF, color="gray", icon=viser.Icon.KEYBOARD)
        self._choice = gui.add_dropdown("Keys move", tuple(self._moves))
        self._what = next(iter(self._moves))
        self._legend = LiveHtml(gui)
        LiveHtml(gui, muted(_KEYS_NOTE))
        session.needs(None, self._switch)
        session.on(self._switch.on_click, self._on_switch)
        session.on(self._choice.on_update, self._on_choice)

    def refresh(self) -> None:
        """Show the keys and their speed; a page that no longer operates has none."""
        if self._on and not self._session.operates:
            self._set(on=False)
        moved, _ = self._moves[self._what]
        rows = [[name, plus, minus] for name, (plus, minus) in zip(moved.axes, KEYS, strict=False)]
        state = "" if self._on else muted("Off: the keys do nothing.")
        head = f"<b>{self._what}</b> at {moved.speed}"
        self._legend.show(f"<div>{head}</div>{table(('Moves', 'key +', 'key −'), rows)}{state}")

    def _on_switch(self) -> None:
        self._session.require_operator()
        self._set(on=not self._on)

    def _on_choice(self) -> None:
        self._what = self._choice.value
        self._set(on=self._on)

    def _set(self, *, on: bool) -> None:
        """Give the keys to the page, or take them away: a key that is not registered never comes."""
        for command in self._commands:
            self._session.take_key(command)
        self._commands.clear()
        self._on = on
        self._switch.label = _ON if on else _OFF
        self._switch.color = "orange" if on else "gray"
        moved, jog = self._moves[self._what]
        for axis, keys in zip(moved.axes, KEYS, strict=False) if on else ():
            for key, sign, text in zip(keys, (1.0, -1.0), "+−", strict=True):
                command = self._session.gui.add_command(f"Jog {axis} {text}", hotkey=key)
                self._session.on_key(command, partial(self._on_key, partial(jog, axis, sign)))
                self._commands.append(command)

    async def _on_key(self, command: Callable[[], Jog | JogTool]) -> None:
        if self._on:
            await self._jog.send(command)
