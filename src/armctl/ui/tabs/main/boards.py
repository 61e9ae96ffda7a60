"""The list of robots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from armctl.hardware.boards import board_type
from armctl.robot import Robot
from armctl.runtime import Snapshot, State
from armctl.ui.console import PortChoice
from armctl.ui.robot_switch import RobotChoice, release_first
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, folded, muted, refused, sentence


class RobotChooser:
    """Shows the present robot; choosing another one changes it for every page."""

    def __init__(self, session: Session) -> None:
        self._session, self._robots = session, session.robots
        self._names = labelled(self._robots.choices)
        self._present = next(
            label for label, name in self._names.items() if name == self._robots.present.name
        )
        self._list = session.gui.add_dropdown("Robot", tuple(self._names), initial_value=self._present)
        self._about = about(session.console.robot)
        self._text = LiveHtml(session.gui, self._about)
        session.on(self._list.on_update, self._on_choose)

    def refresh(self, snapshot: Snapshot) -> None:
        """Nothing can be chosen while the robot is being changed, or held up by real servos or motors."""
        opening, held = self._robots.opening, release_first(snapshot, reopen=False)
        self._list.disabled = opening is not None or held is not None
        if opening is not None:
            self._text.show(f"Opening {escape(opening.title)} …")
        else:
            self._text.show(self._about if held is None else self._about + muted(sentence(held)))

    async def _on_choose(self) -> None:
        session = self._session
        try:
            await self._robots.change(self._names[self._list.value], session.origin, session.require_operator)
        finally:
            if not session.closed:  # refused: this page still shows the present robot
                self._list.value = self._present


def labelled(choices: Sequence[RobotChoice]) -> dict[str, str]:
    """Names by label: the title; with the file's name, or all of its path, where that is not its alone."""
    titles = Counter(choice.title for choice in choices)
    files = Counter(_with_file(choice) for choice in choices)

    def label(choice: RobotChoice) -> str:
        if titles[choice.title] == 1:
            return choice.title
        short = _with_file(choice)
        return short if files[short] == 1 else f"{choice.title} ({choice.name})"

    return {label(choice): choice.name for choice in choices}


def _with_file(choice: RobotChoice) -> str:
    """The title with the name of the file; which link of a URDF is its tool goes behind a ``#``."""
    return f"{choice.title} ({Path(choice.name.partition('#')[0]).name})"


def about(robot: Robot) -> str:
    """Joints, gripper, source and what is assumed of a robot, as HTML."""
    joints = f"{robot.n} joints" + (" and a gripper" if robot.gripper is not None else "")
    source = f"<b>{joints}</b><div style='opacity:.75'>{escape(robot.source)}</div>"
    return source + (folded("Assumed values (not in the source)", robot.assumed) if robot.assumed else "")


# What *Main* says of the boards: which are there, which is connected, what Enable and Homing will do.

_ENABLE_NOTE = (
    "**Enable** asks where the arm stands, then switches the servos on there, one by one: keep clear."
)
_SIMULATED_NOTE = "**Enable** switches the servos of the simulated board on, in the rest pose."
_TAKE_OVER_NOTE = "The servos are on: **Enable** takes the arm over where it stands. Nothing jumps."
_LOST_NOTE = (
    "The board is lost. See to its cable and its power, then press **Connect**; nothing moves by itself."
)
_UNHOMED_NOTE = (
    "The arm does not know where it is yet. **Homing** moves every axis slowly to its home switch, one after "
    "the other: keep clear. STOP ends it."
)


def enable_note(snapshot: Snapshot, board: str) -> str:
    """What Enable will do, or what must be done before."""
    if snapshot.state is State.FAULT and snapshot.board is None:
        return _LOST_NOTE
    if not board_type(board).homing:
        if snapshot.powered:
            return _TAKE_OVER_NOTE
        simulated = snapshot.board is not None and snapshot.board.simulated
        return _SIMULATED_NOTE if simulated else _ENABLE_NOTE
    homed = bool(snapshot.homing) and all(axis.homed for axis in snapshot.homing)
    return "**Enable** switches the motors on; they hold the arm where it stands." if homed else _UNHOMED_NOTE


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
    kind = f"<b>{escape(board.kind)}</b> on {escape(board.port)}"
    lines = [f"<div>{kind}{_serial(board.serial_number)}</div>"]
    lines += [f"<div>{escape(title)}: {escape(words)}</div>" for title, words in snapshot.measured.items()]
    return "".join([*lines, *map(_note, (*board.notes, *board.earlier))])


def _serial(number: str | None) -> str:
    return f" · serial number {escape(number)}" if number else ""


def _note(text: str) -> str:
    return f"<div style='opacity:.75'>{escape(sentence(text))}</div>"
