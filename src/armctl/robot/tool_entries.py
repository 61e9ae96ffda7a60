"""``[[tools]]`` of a robot file: what can be put on at the flange."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from armctl.decoding import must_be
from armctl.documents import Document
from armctl.errors import Errors, InputError
from armctl.kinematics import rotation_from_rpy
from armctl.robot.look.rows import Length, LinkName, Paint, called
from armctl.robot.parts import Gripper, spoken
from armctl.robot.robot import Robot
from armctl.robot.tools import Tool, ToolPiece

MOST_TOOLS = 20
_Offset = Annotated[float, Meta(ge=-2000, le=2000)]
_Turn = Annotated[float, Meta(ge=-360, le=360)]
_Place = tuple[_Offset, _Offset, _Offset]


class ToolPieceEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A bar of a tool with round ends, in the frame of the flange."""

    from_mm: _Place
    """one end"""
    to_mm: _Place
    """the other end"""
    radius_mm: Length
    color: Paint = "graphite"


class RobotToolEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A tool that can be put on at the flange: the frame behind the last DH row, where z points ahead."""

    name: LinkName
    """in programs and commands"""
    title: str = ""
    """as it is shown; left out: its name"""
    offset_mm: _Place = (0.0, 0.0, 0.0)
    """where its tip is, in the frame of the flange"""
    turn_deg: tuple[_Turn, _Turn, _Turn] = (0.0, 0.0, 0.0)
    """how the frame of the tip is turned there: Rz·Ry·Rx, about x, y and z of the flange"""
    mass_kg: Annotated[float, Meta(ge=0)] = 0.0
    com_mm: _Place | None = None
    """its centre of mass, in the frame of the flange; left out: halfway to the tip"""
    pieces: Annotated[tuple[ToolPieceEntry, ...], Meta(max_length=40)] = ()
    """its body: drawn, and kept apart from everything else"""
    gripper: bool = False
    """the arm's gripper works with this tool on"""
    output: LinkName | None = None
    """the output that closes it, of a vacuum or magnet gripper: on is closed; instead of the arm's gripper"""
    part_input: LinkName | None = None
    """the input that is on while it holds a part"""
    speed_percent_s: Annotated[float, Meta(ge=1e-6)] = 500.0
    """with an output: 100 opens it in a second"""

    def tool(self, own: Gripper | None) -> Tool:
        """What it says; ``own``: the arm's gripper."""
        tip = np.array(self.offset_mm) / 1000
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation_from_rpy(*map(math.radians, self.turn_deg)), tip
        x, y, z = (tip / 2 if self.com_mm is None else np.array(self.com_mm) / 1000).tolist()
        title, gripper = self.title or spoken(self.name), own if self.gripper else None
        if self.output is not None:
            gripper = Gripper(title, self.speed_percent_s / 100, self.output, self.part_input or "")
        pieces = tuple(
            ToolPiece(
                np.array(one.from_mm) / 1000, np.array(one.to_mm) / 1000, one.radius_mm / 1000, one.color
            )
            for one in self.pieces
        )
        return Tool(self.name, title, T, self.mass_kg, (x, y, z), pieces, gripper)

    def wrong(self, robot: Robot) -> tuple[str, str]:
        """The key that cannot be as it is on an arm without tools, and why; empty: none."""
        inputs, outputs = (
            [one.name for one in every] for every in (robot.signals.inputs, robot.signals.outputs)
        )
        if self.gripper and robot.gripper is None:
            return "gripper", "the arm has no [gripper]; leave it out, or give the tool an output"
        if self.gripper and self.output is not None:
            return "output", "the arm's gripper works with it already (gripper = true); give one of both"
        if self.output is not None and self.output not in outputs:
            return "output", f"{must_be(outputs) if outputs else 'the file has none'}, not {self.output!r}"
        if self.part_input is not None and self.output is None:
            return "part_input", "only a tool with an output has it"
        if self.part_input is not None and self.part_input not in inputs:
            return (
                "part_input",
                f"{must_be(inputs) if inputs else 'the file has none'}, not {self.part_input!r}",
            )
        if any(one.from_mm == one.to_mm for one in self.pieces):
            return "pieces", "from_mm and to_mm of one are the same; they are the two ends of a bar"
        return "", ""


def with_tools(robot: Robot, entries: Sequence[RobotToolEntry], document: Document) -> Robot:
    """An arm with the tools of its file, the first of them on; ``RobotFileError``: all that cannot be.

    A tool with which no family solves the arm in closed form is refused where one does without it: all that
    plans would search then, and could miss solutions that the arm has with its other tools.
    """
    tools, errors = list[Tool](), Errors()
    for i, entry in enumerate(entries):
        key, what = entry.wrong(robot)
        if any(entry.name == tool.name for tool in tools):
            key, what = "name", "two tools have it; each needs its own"
        elif not what and any((entry.title or spoken(entry.name)) == tool.title for tool in tools):
            key, what = "title", "two tools are shown by it; nobody could tell which one is chosen"
        with errors:
            if what:
                raise document.error(f"tools.{entry.name}.{key}: {what}", ("tools", i, key))
            tools.append(entry.tool(robot.gripper))
    known = [tool.name for tool in tools]
    for i, row in enumerate(robot.look.rows):
        for name in row.tools or ():
            with errors:
                if name not in known:
                    must = must_be(known) if known else "left out: the file has no [[tools]]"
                    raise document.error(
                        f"{called(i, row)}: tools: {must}, not {name!r}", ("look", "solids", i, "tools")
                    )
    errors.raise_all()
    if not tools:
        return robot
    robot = replace(robot, tools=tuple(tools))
    for i, tool in enumerate(tools):
        with errors:
            if _searched_only(robot.with_tool(tool.name)):
                family = robot.inverse_kinematics.family
                raise document.error(
                    f"tools.{tool.name}.offset_mm: the arm is solved in closed form as {family!r}, and no "
                    "family does it with the tip there: put the tip on the axis of the last joint",
                    ("tools", i, "offset_mm"),
                )
    errors.raise_all()
    return robot.with_tool(tools[0].name)


def _searched_only(robot: Robot) -> bool:
    """Whether an arm that has a closed form without its tool has none with it."""
    flange = robot.flange or robot
    if not flange.inverse_kinematics.complete:
        return False
    try:
        return not robot.inverse_kinematics.complete
    except InputError:  # a linkage that no family takes
        return True
