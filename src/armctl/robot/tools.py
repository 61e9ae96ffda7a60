"""Tools of an arm: where the tip of each is, what it weighs, what it is made of, and whether it grips."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import msgspec
import numpy as np

from armctl.arrays import ArrayRecord, FloatArray
from armctl.errors import InputError
from armctl.facts import UnknownTool
from armctl.kinematics import Body, Chain, DHRow, GravityModel
from armctl.kinematics.frames import Convention
from armctl.lazy_dataclass import dataclass
from armctl.robot.body.arm_body import Capsule, moved
from armctl.robot.look.pieces import TOOL, Drawing
from armctl.robot.look.rows import AnyRow, Paint, Spanned, Tube
from armctl.robot.outputs import OutputMap
from armctl.robot.parts import Gripper, Look

_LEAST = 1e-12
"""a length or an angle of a tool below this is none [m, rad]"""


@dataclass(frozen=True, slots=True, eq=False)
class ToolPiece(ArrayRecord):
    """A round bar of a tool: all within a radius of a segment, in the frame of the flange."""

    start: FloatArray
    """(3,) [m]"""
    end: FloatArray
    """(3,) [m]"""
    radius: float
    """[m]"""
    color: Paint = "graphite"


@dataclass(frozen=True, slots=True, eq=False)
class Tool(ArrayRecord):
    """What can be put on at the flange: the frame behind the last DH row, where z points ahead."""

    name: str
    """in programs and commands"""
    title: str
    """as it is shown"""
    T_flange_tip: FloatArray
    """(4, 4) the tool frame with this tool on, in that of the flange [m]"""
    mass_kg: float = 0.0
    com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """its centre of mass in the frame of the flange [m]"""
    pieces: tuple[ToolPiece, ...] = ()
    """what is drawn of it, and kept apart from everything else"""
    gripper: Gripper | None = None
    """what grips with this tool on; None: nothing does"""


def tool_of(tools: Sequence[Tool], name: str) -> Tool:
    """The tool of that name; ``InputError`` where an arm has none."""
    found = next((tool for tool in tools if tool.name == name), None)
    if found is None:
        raise InputError(UnknownTool(name, tuple(tool.name for tool in tools)))
    return found


class _Equipped(Protocol):
    @property
    def gripper(self) -> Gripper | None: ...
    @property
    def tools(self) -> tuple[Tool, ...]: ...


class _Own(Protocol):
    @property
    def gripper(self) -> Gripper | None: ...
    @property
    def flange(self) -> _Own | None: ...


def own_gripper(arm: _Own) -> Gripper | None:
    """What the arm itself grips with, whichever tool is on; None: nothing."""
    return (arm.flange or arm).gripper


def grippers(arm: _Equipped) -> tuple[Gripper, ...]:
    """What grips with the tool that is on, and with the others."""
    every = [arm.gripper, *(tool.gripper for tool in arm.tools)]
    return tuple(dict.fromkeys(one for one in every if one is not None))


class _Flange(Protocol):
    """What of an arm without a tool changes with one."""

    @property
    def chain(self) -> Chain: ...
    @property
    def gravity(self) -> GravityModel: ...
    @property
    def drawing(self) -> Drawing: ...
    @property
    def link_names(self) -> tuple[str, ...]: ...
    @property
    def capsules(self) -> tuple[Capsule, ...] | None: ...
    @property
    def output_map(self) -> OutputMap | None: ...
    @property
    def limits(self) -> FloatArray: ...


class WithTool(NamedTuple):
    """What it is then; the names are those of ``Robot``."""

    chain: Chain
    gravity: GravityModel
    look: Look
    capsules: tuple[Capsule, ...] | None
    output_map: OutputMap | None
    gripper: Gripper | None


def with_tool(arm: _Flange, look: Look, tool: Tool) -> WithTool:
    """What an arm is with a tool on, of what it is without one; ``look``: all of its look then."""
    chain, capsules = _reaching(arm.chain, tool.T_flange_tip), arm.capsules
    if capsules is not None:
        capsules += tuple(_capsules(arm.chain, tool))
    return WithTool(
        chain=chain,
        gravity=_carrying(arm.gravity, chain, tool),
        look=replace(look, rows=_rows(arm, look, tool)),
        capsules=capsules,
        output_map=_bending(arm, chain, tool),
        gripper=tool.gripper,
    )


# The chain: rows behind the last one, which lead from the flange to the tip.


def _reaching(chain: Chain, T: FloatArray) -> Chain:
    """The chain of an arm whose tool frame is at ``T`` (4, 4) [m] of what it is."""
    if np.array_equal(T, np.eye(4)):
        return chain
    if not chain.rows or chain.convention is None:
        segments, tail = [np.array(one) for one in chain.segments], chain.tail @ T
        return Chain(segments, tail, coupling=chain.coupling, turn_limits=chain.turn_limits)
    convention: Convention = "modified" if chain.convention == "modified" else "standard"
    rows = (*chain.rows, *_tool_rows(T, modified=convention == "modified"))
    return Chain.from_dh(rows, convention, chain.coupling, chain.turn_limits)


def _tool_rows(T: FloatArray, *, modified: bool) -> Iterator[DHRow]:
    """DH rows that lead to a frame at ``T`` (4, 4) [m]: to its point, then turned there about z, x, z.

    With θ towards the point, a beside the axis and d along it, T = Rz(θ)·Tz(d)·Tx(a)·Rz(u)·Rx(α)·Rz(v), where
    Rz(u)·Rx(α)·Rz(v) = Rz(−θ)·R. No frame in between is beside the line from the flange to the tip.
    """
    x, y, d = T[:3, 3].tolist()
    a = math.hypot(x, y)
    theta = math.atan2(y, x) if a > _LEAST else 0.0
    c, s = math.cos(theta), math.sin(theta)
    R: FloatArray = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ T[:3, :3]
    alpha = math.acos(min(max(float(R[2, 2]), -1.0), 1.0))
    if math.sin(alpha) > 1e-9:
        u, v = math.atan2(R[0, 2], -R[1, 2]), math.atan2(R[2, 0], R[2, 1])
    else:  # z stays on its line: all of the turn is about it
        alpha = 0.0 if R[2, 2] > 0 else math.pi
        u, v = math.atan2(R[1, 0], R[0, 0]), 0.0
    if modified:
        rows = [(0.0, 0.0, d, theta), (a, 0.0, 0.0, u), (0.0, alpha, 0.0, v)]
    else:
        rows = [(a, 0.0, d, theta), (0.0, alpha, 0.0, u), (0.0, 0.0, 0.0, v)]
    for a_m, alpha_rad, d_m, theta_rad in rows:
        if max(map(abs, (a_m, alpha_rad, d_m, theta_rad))) > _LEAST:
            yield DHRow(a_m, alpha_rad, d_m, theta_rad, joint=False)


# What it weighs.


def _carrying(gravity: GravityModel, chain: Chain, tool: Tool) -> GravityModel:
    """The masses of an arm with those of its tool; ``chain`` with the tool on."""
    link, T_link_flange = gravity.chain.places[-1]
    bodies = gravity.bodies
    if tool.mass_kg:
        T_row_link = np.linalg.inv(chain.places[chain.joint_rows[link] + 1].T_link_frame)
        x, y, z = moved(T_row_link @ T_link_flange, tool.com_m).tolist()
        bodies = (*bodies, Body(link, tool.mass_kg, (x, y, z)))
    return GravityModel(chain, bodies, gravity.payload_kg)


def _bending(arm: _Flange, chain: Chain, tool: Tool) -> OutputMap | None:
    """The outputs of an arm that gives way under its weight, and under that of its tool."""
    outputs = arm.output_map
    if outputs is None or outputs.deflection is None:
        return outputs
    gravity = _carrying(outputs.deflection.gravity, chain, tool)
    bent = replace(outputs.deflection, gravity=gravity).invertible(arm.limits)
    return replace(outputs, deflection=bent)


# Its body.


def tool_rows(tool: Tool) -> int:
    """How many of the last rows of the look of an arm with this tool on are the tool's own."""
    return sum(map(_has_length, tool.pieces))


def _has_length(piece: ToolPiece) -> bool:
    return float(np.linalg.norm(piece.end - piece.start)) > 0


def _rows(flange: _Flange, look: Look, tool: Tool) -> tuple[AnyRow, ...]:
    """The look of an arm, which ends at the flange, and its tool as rows of the same."""
    there = [row for row in look.rows if row.tools is None or tool.name in row.tools]
    rows = [_ending_at_flange(row, flange.drawing) for row in there]
    link, T_link_flange = flange.chain.places[-1]
    name = flange.link_names[link]
    R = flange.drawing.links.pose(link)[0][..., 0]
    for piece in filter(_has_length, tool.pieces):
        ends = [1000 * R @ moved(T_link_flange, end) for end in (piece.start, piece.end)]
        first, last = (tuple(end.tolist()) for end in ends)
        tube = Tube(joint=name, from_mm=first, to_mm=last, width_mm=2000 * piece.radius, ends="round",
                    color=piece.color, name=f"the {tool.title.lower()}")  # fmt: skip
        rows.append(tube)
    return tuple(rows)


def _ending_at_flange(row: AnyRow, drawing: Drawing) -> AnyRow:
    """A row of the arm without a tool, which would reach to the tip of the tool otherwise."""
    if not isinstance(row, Spanned) or TOOL not in (row.from_, row.to):
        return row
    at = np.zeros(3) if row.joint is None else drawing.points[row.joint]
    point = tuple((drawing.points[TOOL] - at).tolist())
    if row.from_ == TOOL:
        row = msgspec.structs.replace(row, from_=None, from_mm=point)
    return msgspec.structs.replace(row, to=None, to_mm=point) if row.to == TOOL else row


def _capsules(chain: Chain, tool: Tool) -> Iterator[Capsule]:
    """The body of the tool beside that of the arm, where that is not as it is drawn."""
    link, T = chain.places[-1]
    for piece in tool.pieces:
        ends = moved(T, piece.start), moved(T, piece.end)
        yield Capsule(link, *ends, piece.radius, f"the {tool.title.lower()}")
