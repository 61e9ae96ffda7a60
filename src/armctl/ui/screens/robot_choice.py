"""The list of robots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from armctl.robot import Robot
from armctl.runtime import Snapshot
from armctl.ui.leaving import release_to_leave
from armctl.ui.robot_desk import RobotChoice
from armctl.ui.widgets.html_bits import folded, muted, sentence
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session


class RobotChooser:
    """Shows the present robot; choosing another one changes it for every page."""

    def __init__(self, session: Session) -> None:
        self._session, self._desk = session, session.robots
        self._names = labelled(self._desk.choices)
        self._present = next(label for label, name in self._names.items() if name == self._desk.present.name)
        self._list = session.gui.add_dropdown("Robot", tuple(self._names), initial_value=self._present)
        self._about = about(session.console.robot)
        self._text = LiveHtml(session.gui, self._about)
        session.on(self._list.on_update, self._on_choose)

    def refresh(self, snapshot: Snapshot) -> None:
        """Nothing can be chosen while the robot is being changed, or held up by real servos or motors."""
        opening, held = self._desk.opening, release_to_leave(snapshot)
        if self._list.disabled != (disabled := opening is not None or held is not None):
            self._list.disabled = disabled
        if opening is not None:
            self._text.show(f"Opening {escape(opening.title)} …")
        else:
            self._text.show(self._about if held is None else self._about + muted(sentence(held)))

    async def _on_choose(self) -> None:
        session = self._session
        try:
            await self._desk.change(self._names[self._list.value], session.origin, session.require_operator)
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
    return source + (folded("Assumed, where the source is silent", robot.assumed) if robot.assumed else "")
