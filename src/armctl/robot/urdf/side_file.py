"""``NAME.armctl.toml``: what a URDF file leaves open, beside it or in the user's own folder.

Tool, poses, floor, narrower limits, speeds, and a board's outputs, so that the arm drives real servos. The
tables are those of robot files. What is left out stays as the URDF file has it, or as armctl assumes it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import msgspec
import numpy as np
import tomli_w
from msgspec import Meta

from armctl.arrays import FloatArray
from armctl.decoding import did_you_mean
from armctl.documents import Document, not_written, write_atomically
from armctl.errors import Errors, RobotFileError
from armctl.facts import AngleLimit, what
from armctl.kinematics.angles import rest_angle
from armctl.robot.board_entries import read_outputs
from armctl.robot.file import (
    ROBOT_FILES,
    FloorEntry,
    GripperEntry,
    InputEntry,
    Limit,
    LookEntry,
    Name,
    NotNegative,
    ObstacleEntry,
    OutputEntry,
    PointName,
    Positive,
    Strict,
    Table,
    signals_of,
    without_board,
)
from armctl.robot.look_sound import check_look
from armctl.robot.parts import MOST_JOINTS, Joint
from armctl.robot.robot import Robot
from armctl.robot.signals import MOST_SIGNALS
from armctl.robot.tool_entries import MOST_TOOLS, RobotToolEntry, with_tools

SIDE_SUFFIX = ".armctl.toml"
"""Beside ``arm.urdf`` stands ``arm.armctl.toml``."""
_ROUNDED_DEG = 0.01
"""a pose or a limit that was rounded may be beyond the URDF file's limit by this"""


class ToolEntry(Strict, frozen=True):
    """The tool frame."""

    link: Annotated[str, Meta(min_length=1)] | None = None
    """a link of the URDF file; left out: as armctl finds it"""
    approach: Literal["x", "y", "z", "-x", "-y", "-z"] = "z"
    """the axis of that link along which the tool points"""
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """where the tool point is, along the axes of that link"""


class SideJointEntry(Strict, frozen=True):
    """What is said of one joint. A board's table (``servo``, ``encoder``) stands here, too."""

    name: Name
    """as ``armctl check`` shows it"""
    title: str | None = None
    limit_deg: tuple[Limit, Limit] | None = None
    """within those of the URDF file; a continuous joint may have any"""
    speed_deg_s: Positive | None = None
    acceleration_deg_s2: Positive | None = None
    jerk_deg_s3: Positive | None = None
    stall_torque_nm: Positive | None = None


ArgumentName = Annotated[str, Meta(min_length=1, max_length=100)]


class SideFile(Strict, frozen=True):
    """One side file, as written. The board stands in ``[board]``, as in a robot file."""

    format: Literal[1]
    urdf: Annotated[str, Meta(min_length=1)] | None = None
    """the URDF file, seen from this one; left out: the one of the same name beside it"""
    name: Name | None = None
    title: str | None = None
    source: str = ""
    arguments: dict[ArgumentName, str | bool | int | float] = msgspec.field(
        default_factory=dict[str, str | bool | int | float]
    )
    """values of what the xacro file declares by ``<xacro:arg>``"""
    exact: bool = False
    """whether angles within 0.1° of right ones are taken as right"""
    tool: ToolEntry = ToolEntry()
    body: Literal["meshes", "look", "bars"] = "meshes"
    """what is drawn and kept apart: the file's shapes, or a look (``bars`` is its older name)"""
    joints: Annotated[tuple[SideJointEntry, ...], Meta(max_length=MOST_JOINTS)] = ()
    poses: dict[Name, tuple[float, ...]] = msgspec.field(default_factory=dict[str, tuple[float, ...]])
    """angles [degrees] from the base to the tool"""
    points: dict[PointName, tuple[float, float, float]] = msgspec.field(
        default_factory=dict[str, tuple[float, float, float]]
    )
    """named tool points [mm]"""
    payload_kg: NotNegative = 0.0
    gripper: GripperEntry | None = None
    inputs: Annotated[tuple[InputEntry, ...], Meta(max_length=MOST_SIGNALS)] = ()
    outputs: Annotated[tuple[OutputEntry, ...], Meta(max_length=MOST_SIGNALS)] = ()
    tools: Annotated[tuple[RobotToolEntry, ...], Meta(max_length=MOST_TOOLS)] = ()
    """what can be put on at the end of the chain, in the frame of ``tool``"""
    floor: FloorEntry | None = None
    obstacles: Annotated[tuple[ObstacleEntry, ...], Meta(max_length=4 * MOST_JOINTS)] = ()
    look: LookEntry | None = None


def decode_side_file(content: bytes | str) -> tuple[SideFile, Document]:
    """Decode a side file without judging what it says; the board's part stays in the document."""
    document, errors = ROBOT_FILES.parse(content), Errors()
    side = without_board(document, SideFile, errors)
    errors.raise_all()
    return side, document


def read_side_file(path: Path | None) -> tuple[SideFile, Document | None]:
    """What a side file says; None: there is none."""
    return (SideFile(1), None) if path is None else ROBOT_FILES.load(path, decode_side_file)


def encode_side_file(record: Mapping[str, object]) -> str:
    """The text of a side file from its tables (those of ``SideFile``, and the board's); refuses as decoding.

    None stands for a key that is left out.
    """
    text = tomli_w.dumps(cast("dict[str, object]", _without_none(msgspec.to_builtins(record))))
    decode_side_file(text)
    return text


def _without_none(value: object) -> object:
    if isinstance(value, dict):
        table = cast("dict[str, object]", value)
        return {key: _without_none(one) for key, one in table.items() if one is not None}
    if isinstance(value, list):
        return [_without_none(one) for one in cast("list[object]", value)]
    return value


def changed_side_file(path: Path, changes: Mapping[str, object]) -> None:
    """Put tables into a side file, which need not be there yet; the one before is kept as ``NAME~``.

    A table is merged with the one of its name that is there; None takes it away, or a key of it.
    """
    record: dict[str, object] = {"format": 1}
    if path.exists():
        _, document = ROBOT_FILES.load(path, decode_side_file)
        record = dict(document.record)
    for key, value in changes.items():
        before = record.get(key)
        if isinstance(before, dict) and isinstance(value, Mapping):
            value = {**cast("Table", before), **cast("Mapping[str, object]", value)}
        record[key] = value
    text = encode_side_file(record)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, text.encode(), keep=True)
    except OSError as cause:
        raise RobotFileError(not_written(path, cause)) from cause


def applied(robot: Robot, side: SideFile, document: Document, endless: Sequence[str]) -> Robot:
    """The arm of the URDF file with what the side file says of it; the tool is in its chain already.

    ``endless``: names of the continuous joints.
    """
    errors, joints, poses = Errors(), list(robot.joints), dict[str, FloatArray]()
    if len({entry.name for entry in side.joints}) != len(side.joints):
        errors.found.append(RobotFileError("joints: two entries have the same name"))
    for i, entry in enumerate(side.joints):
        with errors, document.at(("joints", i)):
            if entry.name not in robot.joint_names:
                hint = did_you_mean(entry.name, robot.joint_names)
                what = f"there is no joint {entry.name!r}{hint}; it has {', '.join(robot.joint_names)}"
                raise RobotFileError(f"joints: {what}")
            k = robot.joint_names.index(entry.name)
            joints[k] = _joint(joints[k], entry, entry.name in endless)
    for name, values in side.poses.items():
        with errors, document.at(("poses", name)):
            poses[name] = _pose(values, joints, f"poses.{name}")
    board: Any = None
    with errors:
        limits = [(one.name, (math.degrees(one.lower), math.degrees(one.upper))) for one in joints]
        board = read_outputs(document, limits, side.gripper, signals_of(side))
    errors.raise_all()
    kind, outputs, settings = board
    home = np.array([rest_angle(joint.lower, joint.upper) for joint in joints])
    applied = replace(
        robot,
        name=side.name or robot.name,
        title=side.title or robot.title,
        source=side.source or robot.source,
        joints=tuple(joints),
        poses={"home": home, "rest": poses.get("home", home)} | poses,
        output_map=outputs,
        board=kind,
        board_settings=settings,
        gripper=None if side.gripper is None else side.gripper.gripper(),
        signals=signals_of(side),
        gravity=replace(robot.gravity, payload_kg=side.payload_kg),
        floor_z=robot.floor_z if side.floor is None else side.floor.z_mm / 1000,
        points={name: np.array(point_mm) / 1000 for name, point_mm in side.points.items()},
        look=robot.look if side.look is None else side.look.look(),
        obstacles=tuple(entry.obstacle() for entry in side.obstacles),
    )
    check_look(applied, document, errors)
    errors.raise_all()
    return with_tools(applied, side.tools, document)


def _joint(joint: Joint, entry: SideJointEntry, endless: bool) -> Joint:
    lower, upper = joint.lower, joint.upper
    if entry.limit_deg is not None:
        low, high = entry.limit_deg
        where = f"joints.{joint.name}.limit_deg = [{low:g}, {high:g}]"
        if low > high:
            raise RobotFileError(f"{where}: the lower limit comes first")
        least, most = math.degrees(lower), math.degrees(upper)
        if not endless and (low < least - _ROUNDED_DEG or high > most + _ROUNDED_DEG):
            raise RobotFileError(
                f"{where}: the URDF file allows {least:.2f}° … {most:.2f}°; a side file narrows limits only"
            )
        lower, upper = math.radians(low), math.radians(high)
        if not endless:
            lower, upper = max(lower, joint.lower), min(upper, joint.upper)
    speed = joint.speed if entry.speed_deg_s is None else math.radians(entry.speed_deg_s)
    acceleration = joint.acceleration * speed / joint.speed
    if entry.acceleration_deg_s2 is not None:
        acceleration = math.radians(entry.acceleration_deg_s2)
    jerk = joint.jerk * acceleration / joint.acceleration
    return replace(
        joint,
        title=entry.title or joint.title,
        lower=lower,
        upper=upper,
        speed=speed,
        acceleration=acceleration,
        jerk=jerk if entry.jerk_deg_s3 is None else math.radians(entry.jerk_deg_s3),
        jerk_told=entry.jerk_deg_s3 is not None,
        stall_torque=entry.stall_torque_nm or joint.stall_torque,
        torque_is_effort=joint.torque_is_effort and entry.stall_torque_nm is None,
    )


def _pose(values: Sequence[float], joints: Sequence[Joint], where: str) -> FloatArray:
    if len(values) != len(joints):
        raise RobotFileError(
            f"{where}: {len(joints)} angles are needed ({', '.join(joint.name for joint in joints)}), "
            f"there are {len(values)}"
        )
    for value, joint in zip(values, joints, strict=True):
        low, high = math.degrees(joint.lower), math.degrees(joint.upper)
        if not low - _ROUNDED_DEG <= value <= high + _ROUNDED_DEG:
            words = what(AngleLimit(joint.title, math.radians(value), joint.lower, joint.upper))
            raise RobotFileError(f"{where}: {joint.name} = {words}")
    limits = np.array([(joint.lower, joint.upper) for joint in joints])
    return np.clip(np.radians(np.array(values, dtype=np.float64)), limits[:, 0], limits[:, 1])
