"""Which joint moved? Finds out on which channel of the board each servo of one's own arm is plugged in."""

from __future__ import annotations

import asyncio
import math

import viser

from armctl.errors import InputError, StateError
from armctl.facts import Need
from armctl.protocol import MoveJoints, Snapshot
from armctl.robot import robot_path, user_robots_folder
from armctl.robot.draft import Draft
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, muted

_NUDGE_RAD, _NUDGE_S = math.radians(4.0), 0.6
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
