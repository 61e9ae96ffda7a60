"""Which tool is on: chosen by whoever has looked at the arm, or has just changed it."""

from __future__ import annotations

from html import escape

import numpy as np

from armctl.errors import StateError
from armctl.protocol import SetTool, Snapshot
from armctl.robot import Robot
from armctl.robot.tools import tool_of
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, fixed, warned

ON, STILL = "This tool is on", "Yes, it is still on"
_UNCONFIRMED = (
    "Look at the arm: which tool is on? Say so before Enable. With another tool the tip is elsewhere, and "
    "may hit the table."
)
_STANDS = "a tool is changed only while the arm stands"


class ToolChoice:
    """The list of tools and the button that says which one is on; nothing for an arm without tools."""

    def __init__(self, session: Session) -> None:
        robot = session.console.robot
        self._session, self._robot = session, robot
        self._names = {tool.title: tool.name for tool in robot.tools}
        if not robot.tools:
            return
        gui = session.gui
        self._list = gui.add_dropdown("Tool", tuple(self._names), initial_value=title_of(robot, robot.tool))
        self._on = gui.add_button(ON)
        self._said = LiveHtml(gui)
        session.needs(None, self._on, also=self._why_not)
        session.on(self._on.on_click, self._say)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what is known of the chosen tool, and whether somebody has to say which one is on."""
        if not self._names:
            return
        chosen = self._names[self._list.value]
        self._on.label = STILL if snapshot.tool_unconfirmed and chosen == snapshot.tool else ON
        self._on.color = "green" if snapshot.tool_unconfirmed else None
        self._said.show(tool_html(self._robot, chosen, snapshot))

    def _why_not(self, snapshot: Snapshot) -> str | None:
        if snapshot.busy:
            return _STANDS
        if self._names[self._list.value] == snapshot.tool and not snapshot.tool_unconfirmed:
            return "it is on; choose the one that you have put on"
        return None

    async def _say(self) -> None:
        if self._session.snapshot.busy:
            raise StateError(_STANDS)
        await self._session.submit(SetTool(self._names[self._list.value]))


def title_of(robot: Robot, name: str) -> str:
    """What a tool is shown as."""
    return next((tool.title for tool in robot.tools if tool.name == name), name)


def tool_html(robot: Robot, chosen: str, snapshot: Snapshot) -> str:
    """Where the tip of a tool is, what it weighs and whether it grips; and which one is on, if not this."""
    tool = tool_of(robot.tools, chosen)
    x, y, z = (fixed(value, 1) for value in (1000 * tool.T_flange_tip[:3, 3]).tolist())
    facts = [f"tip {x}, {y}, {z} mm from the flange"]
    if not np.array_equal(tool.T_flange_tip[:3, :3], np.eye(3)):
        facts.append("turned")
    if tool.mass_kg:
        facts.append(f"{tool.mass_kg:g} kg")
    facts.append("nothing grips" if tool.gripper is None else f"grips: {tool.gripper.title}")
    text = f"<div>{escape('; '.join(facts))}</div>"
    if snapshot.tool_unconfirmed:
        return text + warned(_UNCONFIRMED)
    if chosen != snapshot.tool:
        text += f"<div>On now: <b>{escape(title_of(robot, snapshot.tool))}</b></div>"
    return text
