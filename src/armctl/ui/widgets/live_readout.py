"""The live table: where the tool is, how it moves, and what the joints are told and do."""

from __future__ import annotations

import math

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.hardware import Source
from armctl.robot import Robot
from armctl.runtime import Snapshot
from armctl.ui.widgets.text import LiveHtml, table
from armctl.ui.widgets.tool_motion import tool_motion

FloatArray = NDArray[np.float64]


class LiveReadout:
    """The same table in one or more places; computed anew only when the arm's state is another."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._blocks: list[LiveHtml] = []
        self._shown: tuple[bytes, ...] = ()

    def add_to(self, gui: viser.GuiApi) -> None:
        """Show the table in the present GUI container, too."""
        self._blocks.append(LiveHtml(gui))

    def refresh(self, snapshot: Snapshot) -> None:
        """Show a snapshot, if it differs from the one before."""
        state = (snapshot.q_command, snapshot.velocity_command, snapshot.acceleration_command, snapshot.q)
        key = (
            *(array.tobytes() for array in state),
            snapshot.source.value.encode(),
            bytes([snapshot.commanded]),
        )
        if key == self._shown:
            return
        self._shown = key
        content = tool_table(self._robot, snapshot) + joint_table(self._robot, snapshot)
        for block in self._blocks:
            block.show(content)


def tool_table(robot: Robot, snapshot: Snapshot) -> str:
    """Commanded position, velocity and acceleration of the tool point, pitch and roll, as HTML.

    An arm that was told nothing has none.
    """
    if not snapshot.commanded:
        return table(["Tool", "x", "y", "z"], [["position mm", *3 * ["–"]]])
    motion = tool_motion(robot, snapshot.q_command, snapshot.velocity_command, snapshot.acceleration_command)
    rows = [
        ["position mm", *_numbers(1000 * motion.position, 2), ""],
        ["velocity mm/s", *_with_size(1000 * motion.velocity)],
        ["acceleration mm/s²", *_with_size(1000 * motion.acceleration)],
    ]
    angles = f"pitch <b>{_fixed(math.degrees(motion.pitch), 2)}°</b>"
    if motion.roll is not None:
        angles += f" · roll <b>{_fixed(math.degrees(motion.roll), 2)}°</b>"
    return table(["Tool", "x", "y", "z", "size"], rows) + f"<div style='padding:0 6px'>Tool {angles}</div>"


def joint_table(robot: Robot, snapshot: Snapshot) -> str:
    """Joint angles in degrees, as commanded and as the board tells them, as HTML."""
    told = snapshot.q_command if snapshot.commanded else np.full(robot.n, np.nan)
    source = "board" if snapshot.source is Source.COMMANDED else snapshot.source.value
    rows = [
        ["commanded", *_numbers(np.degrees(told), 2)],
        [source, *_numbers(np.degrees(snapshot.q), 2)],
    ]
    return table(["Joints °", *(joint.title for joint in robot.joints)], rows)


def _with_size(vector: FloatArray) -> list[str]:
    return [*_numbers(vector, 1), _fixed(float(np.linalg.norm(vector)), 1)]


def _numbers(values: FloatArray, digits: int) -> list[str]:
    return [_fixed(value, digits) for value in values.tolist()]


def _fixed(value: float, digits: int) -> str:
    """A number with a real minus sign and no negative zero; a dash where it is not known."""
    if not math.isfinite(value):
        return "–"
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")
