"""The list of robots."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from html import escape
from pathlib import Path

import viser

from armctl.errors import InputError, StateError
from armctl.facts import Need
from armctl.facts.angles import DEGREE
from armctl.protocol import MoveJoints, Snapshot
from armctl.robot import Robot, robot_path, user_robots_folder
from armctl.robot.body.arm_body import BODY_GUESSED
from armctl.robot.draft import Draft
from armctl.ui.console import PortChoice
from armctl.ui.robot_switch import RobotChoice, not_replaceable
from armctl.ui.session import Session
from armctl.ui.widgets.html import (
    LiveHtml,
    folded,
    muted,
    refused,
    sentence,
    simulated_only_html,
    warned,
)
from armctl.ui.widgets.motors import motors_html


class RobotChooser:
    """Shows the present robot; choosing another one changes it for every page."""

    def __init__(self, session: Session) -> None:
        self._session, self._robots = session, session.robots
        self._names = labelled(self._robots.choices)
        self._present = next(
            label for label, name in self._names.items() if name == self._robots.present.name
        )
        self._list = session.gui.add_dropdown("Robot", tuple(self._names), initial_value=self._present)
        kept = partial(not_replaceable, reopen=False)
        session.needs(None, self._list, also=kept, hint=joints_of(session.console.robot))
        self._about = about(session.console.robot)
        self._text = LiveHtml(session.gui, self._about)
        self._leave = session.gui.add_button("Stop opening", visible=False)
        session.on(self._leave.on_click, self._on_leave)
        session.on(self._list.on_update, self._on_choose)

    def refresh(self, _: Snapshot) -> None:
        """Tell that the robot is being changed, and offer to leave it where that takes long."""
        opening, progress = self._robots.opening, self._robots.progress
        self._leave.visible = progress is not None
        self._text.show(self._about if opening is None else opening_html(opening.title, progress))

    def _on_leave(self) -> None:
        self._session.require_operator()
        self._robots.give_up()

    async def _on_choose(self) -> None:
        session = self._session
        try:
            await session.change_robot(self._names[self._list.value])
        finally:
            if not session.closed:  # refused, or asked: this page still shows the present robot
                self._list.value = self._present


def opening_html(title: str, progress: tuple[int, int] | None) -> str:
    """That an arm is being opened; ``progress``: how many of how many parts of its meshes are read."""
    if progress is None:
        return f"Opening {escape(title)} …"
    done, parts = progress
    return (
        f"Opening {escape(title)}: reading its meshes, {done} of {parts} parts done. "
        "The first time this takes some seconds."
    )


def labelled(choices: Sequence[RobotChoice]) -> dict[str, str]:
    """Names by label: the title; with the file's name, or all of its path, where that is not its alone."""
    titles = Counter(choice.title for choice in choices)
    files = Counter(_with_file(choice) for choice in choices)

    def label(choice: RobotChoice) -> str:
        if titles[choice.title] == 1:
            return choice.title
        short = _with_file(choice)
        return short if files[short] == 1 else f"{choice.title} ({choice.name})"

    ends = {choice.name: " – simulated only" if choice.simulated_only else "" for choice in choices}
    return {label(choice) + ends[choice.name]: choice.name for choice in choices}


def _with_file(choice: RobotChoice) -> str:
    return f"{choice.title} ({Path(choice.name.partition('#')[0]).name})"


def joints_of(robot: Robot) -> str:
    """How many joints a robot has, and whether a gripper."""
    return f"{robot.n} joints" + (" and a gripper" if robot.gripper is not None else "")


def about(robot: Robot) -> str:
    """Source of a robot and what is assumed of it, as HTML: once it is unfolded, what may stay unread."""
    guessed = warned(sentence(BODY_GUESSED)) if robot.body_is_guessed else ""
    assumed = [f"Assumed, not in the source: {text}" for text in robot.assumed if text != BODY_GUESSED]
    source = [robot.source, *assumed] if robot.source else assumed
    more = folded("Source and assumed values", source) if source else ""
    return f"{simulated_only_html(robot)}{guessed}{more}"


# What *Main* says of the boards: which are there, which is connected, which axes are homed.


def homing_html(snapshot: Snapshot) -> str:
    """Each axis with a sign: homed, being looked for, or not."""
    if not snapshot.homing:
        return ""
    signs = (
        f"<span style='white-space:nowrap'>{'✓' if axis.homed else '…' if axis.running else '○'} "
        f"{'<b>' if axis.running else ''}{escape(axis.title)}{'</b>' if axis.running else ''}</span>"
        for axis in snapshot.homing
    )
    done = sum(axis.homed for axis in snapshot.homing)
    return f"<div>Homed {done} of {len(snapshot.homing)}: {' &nbsp; '.join(signs)}</div>"


def ports_html(choices: Iterable[PortChoice]) -> str:
    """The boards that are plugged in, and why one cannot be used."""
    lines: list[str] = []
    for choice in choices:
        if choice.listed:
            lines.append(f"<div>{escape(choice.label)}{_serial(choice.serial_number)}</div>")
            if choice.why_not is not None:
                lines.append(refused(sentence(f"cannot be used: {choice.why_not}")))
            lines += map(_note, choice.notes)
    return "".join(lines)


def board_html(snapshot: Snapshot) -> str:
    """The board that is connected, and what the user must know of it."""
    board = snapshot.board
    if board is None:
        return "<div>Not connected.</div>"
    title, port = escape(board.title), escape(board.port)
    lines = [f"<div>{title}<small>on {port}{_serial(board.serial_number)}</small></div>"]
    return "".join([*lines, motors_html(snapshot.quantities), *map(_note, (*board.notes, *board.earlier))])


def _serial(number: str | None) -> str:
    return f" · serial number {escape(number)}" if number else ""


def _note(text: str) -> str:
    return f"<div style='opacity:.75'>{escape(sentence(text))}</div>"


# Which joint moved? Finds out on which channel of the board each servo of one's own arm is plugged in.


_NUDGE_RAD, _NUDGE_S = 4.0 * DEGREE, 0.6
_HINT = (
    "Nudge turns one servo by 4° and back. Say which joint moved; once every channel has a joint, the robot "
    "file gets the channels."
)


def of_own_arm(session: Session) -> WhichJoint | None:
    """The section for the present arm, if it is the user's own and has outputs."""
    name = session.robots.present.name
    own = robot_path(name) == user_robots_folder() / f"{name}.toml"
    return WhichJoint(session) if own and session.console.robot.output_map is not None else None


class WhichJoint:
    """Channels, nudged one after the other, and the joints that were seen to move."""

    def __init__(self, session: Session) -> None:
        self._session, self._robot = session, session.console.robot
        outputs = self._robot.output_map
        self._channels = () if outputs is None else outputs.channels
        self._found: dict[int, str] = {}
        """joint by channel"""
        gui = session.gui
        titles = {joint.title: joint.name for joint in self._robot.joints}
        self._titles = titles
        with gui.add_folder("Which joint moved?", expand_by_default=False):
            LiveHtml(gui, muted(_HINT))
            self._channel = gui.add_dropdown("Channel", tuple(map(str, self._channels)))
            self._nudge = gui.add_button("Nudge", icon=viser.Icon.HAND_FINGER)
            session.needs(Need.HOLDING, self._nudge)
            self._joint = gui.add_dropdown("It moved", tuple(titles))
            seen = gui.add_button("This joint moved")
            self._list = LiveHtml(gui)
            self._write = gui.add_button("Write channels", icon=viser.Icon.DEVICE_FLOPPY)
            session.needs(None, self._write, also=self._missing)
        session.on(self._nudge.on_click, self._on_nudge)
        session.on(seen.on_click, self._on_seen)
        session.on(self._write.on_click, self._on_write)

    def _missing(self, _: Snapshot) -> str | None:
        left = len(self._channels) - len(self._found)
        return None if left == 0 else f"{left} channel{'s have' if left > 1 else ' has'} no joint yet"

    async def _on_nudge(self) -> None:
        """Turn by 4° to where there is more room, and back."""
        session, robot = self._session, self._robot
        k = self._channels.index(int(self._channel.value))
        q = session.snapshot.q.copy()
        low, high = robot.limits[k]
        if high - low < _NUDGE_RAD:
            raise InputError(f"{robot.joints[k].title} has no room to move inside its limits")
        there = q.copy()
        there[k] += _NUDGE_RAD if high - q[k] > q[k] - low else -_NUDGE_RAD
        for goal in (there, q):
            ticket = await session.submit(MoveJoints(robot.check_limits(goal), _NUDGE_S))
            await asyncio.wrap_future(ticket.finished)

    def _on_seen(self) -> None:
        channel, joint = int(self._channel.value), self._titles[self._joint.value]
        self._found = {one: name for one, name in self._found.items() if name != joint}
        self._found[channel] = joint
        by_name = {name: title for title, name in self._titles.items()}
        self._list.show(
            "".join(f"<div>Channel {one}: {by_name[name]}</div>" for one, name in sorted(self._found.items()))
        )
        left = [str(one) for one in self._channels if one not in self._found]
        if left:
            self._channel.value = left[0]

    async def _on_write(self) -> None:
        session = self._session
        session.require_operator()
        if (missing := self._missing(session.snapshot)) is not None:
            raise StateError(missing)
        name = session.robots.present.name
        session.robots.require_reopenable()
        await asyncio.to_thread(_rewrite, name, self._found)
        session.notify("Robot", f"The channels of {self._robot.title} are written; the arm is opened anew.")
        await session.reopen_arm()


def _rewrite(name: str, joints: dict[int, str]) -> None:
    """Give each joint's table of outputs its channel. Raises ``RobotFileError``."""
    draft = Draft.of_file(user_robots_folder() / f"{name}.toml")
    draft.with_channels({joint: channel for channel, joint in joints.items()}).save(replace_old=True)
