"""The live table: where the tool is, how it moves, and what the joints are told and do."""

from __future__ import annotations

import math

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.hardware import Source
from armctl.kinematics import roll_pitch_yaw
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.widgets.html import LiveHtml, fixed, table

_PROBE_S = 1e-4


def tool_motion(
    robot: Robot, q: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The tool point's position, velocity and acceleration, each (3,) [m, m/s, m/s²] in the base frame.

    ``v = J q̇`` and ``a = J q̈ + J̇ q̇``, of joints (n,) [rad, rad/s, rad/s²]; ``J̇`` is the central difference
    of the Jacobian along ``q̇``.
    """
    J = robot.jacobian(q)[:3]
    probes = robot.jacobian(np.stack([q + _PROBE_S * velocity, q - _PROBE_S * velocity]))[:, :3]
    J_dot = (probes[0] - probes[1]) / (2 * _PROBE_S)
    return robot.forward(q)[:3, 3], J @ velocity, J @ acceleration + J_dot @ velocity


class LiveReadout:
    """The same table in one or more places; computed anew only when the arm's state is another."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._blocks: list[LiveHtml] = []
        self._shown: tuple[object, ...] = ()

    def add_to(self, gui: viser.GuiApi) -> None:
        """Show the table in the present GUI container, too."""
        self._blocks.append(LiveHtml(gui))

    def refresh(self, snapshot: Snapshot) -> None:
        """Show a snapshot, if it differs from the one before."""
        state = (snapshot.q_command, snapshot.velocity_command, snapshot.acceleration_command, snapshot.q)
        key = (*(array.tobytes() for array in state), snapshot.source, snapshot.commanded)
        if key != self._shown:
            self._shown = key
            content = tool_table(self._robot, snapshot) + joint_table(self._robot, snapshot)
            for block in self._blocks:
                block.show(content)


def tool_table(robot: Robot, snapshot: Snapshot) -> str:
    """Commanded position, velocity and acceleration of the tool point, and how it is turned, as HTML."""
    if not snapshot.commanded:
        return table(["Tool", "x", "y", "z"], [["position mm", *3 * ["–"]]])
    q = snapshot.q_command
    motion = tool_motion(robot, q, snapshot.velocity_command, snapshot.acceleration_command)
    position, velocity, acceleration = (1000 * vector for vector in motion)
    rows = [
        ["position mm", *_numbers(position, 2), ""],
        ["velocity mm/s", *_with_size(velocity)],
        ["acceleration mm/s²", *_with_size(acceleration)],
    ]
    pitch = math.asin(min(1.0, max(-1.0, float(robot.forward(q)[2, 2]))))  # of the approach axis, tool z
    roll = robot.inverse_kinematics.pitch_and_roll(q)[1]
    angles = f"pitch <b>{fixed(math.degrees(pitch), 2)}°</b>"
    if roll is not None:
        angles += f" · roll <b>{fixed(math.degrees(roll), 2)}°</b>"
    html = table(["Tool", "x", "y", "z", "size"], rows) + f"<div style='padding:0 6px'>Tool {angles}</div>"
    if robot.orients_tool:
        turns = np.degrees(roll_pitch_yaw(robot.forward(q)[:3, :3])).tolist()
        named = " · ".join(
            f"R{axis} <b>{fixed(turn, 2)}°</b>" for axis, turn in zip("xyz", turns, strict=True)
        )
        html += f"<div style='padding:0 6px'>Orientation {named}</div>"
    return html


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
    return [*_numbers(vector, 1), fixed(float(np.linalg.norm(vector)), 1)]


def _numbers(values: FloatArray, digits: int) -> list[str]:
    return [fixed(value, digits) for value in values.tolist()]
