"""Loading robots: shipped ones by name, a user's own by path."""

from __future__ import annotations

import math
import re
from importlib.resources import files
from pathlib import Path

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.kinematics import Body, Chain, DHRow, GravityModel
from armctl.robot.body import Capsule, capsule
from armctl.robot.file import (
    BoardTables,
    JointEntry,
    LookEntry,
    ObstacleEntry,
    RobotFile,
    read_robot_file,
)
from armctl.robot.outputs_of_file import read_outputs
from armctl.robot.parts import JERK_UP_S, Color, Gripper, Joint, Look, Obstacle
from armctl.robot.robot import Robot

_URDF = re.compile(r"(?P<path>.+?\.urdf)(?:#(?P<wanted>.*))?", re.IGNORECASE | re.DOTALL)


def robots_folder() -> Path:
    """The folder of the shipped robot files: inside an installed package, or beside ``src`` in a checkout."""
    package = Path(str(files("armctl")))
    installed = package / "robots"
    return installed if installed.is_dir() else package.parent.parent / "robots"


def shipped_robots() -> tuple[str, ...]:
    """Names of the shipped robots, sorted."""
    return tuple(sorted(path.stem for path in robots_folder().glob("*.toml")))


def is_urdf(name: str | Path) -> bool:
    """True for the name of a URDF robot: a path that ends in ``.urdf``, with or without a tool link."""
    return _URDF.fullmatch(str(name)) is not None


def load_robot(name: str | Path) -> Robot:
    """Load a robot.

    Args:
        name: the name of a shipped robot, or a path to a robot file (``.toml``) or a ``.urdf`` file. Behind a
            ``.urdf`` file may stand the tool link, and which of its axes is the approach axis:
            ``arm.urdf#gripper_link,approach=x``.

    Raises:
        RobotFileError: no such robot, or a file that cannot be read or contradicts itself.
    """
    path = Path(name)
    if "\0" in str(name):
        raise RobotFileError(f"{str(name)!r}: the name of a file holds no NUL")
    if urdf := _URDF.fullmatch(
        name.as_posix() if isinstance(name, Path) else name
    ):  # slashes of the link stay
        from armctl.robot.urdf import load_urdf  # 15 ms that no other robot needs

        return load_urdf(Path(urdf["path"]), urdf["wanted"])
    if path.suffix == "" and len(path.parts) == 1:
        if str(name) not in shipped_robots():
            raise RobotFileError(
                f"there is no robot {str(name)!r}; shipped are {', '.join(shipped_robots())} "
                "(or give a path to a .toml or .urdf file)"
            )
        path = robots_folder() / f"{name}.toml"
    elif path.suffix.lower() != ".toml":
        raise RobotFileError(f"{path}: a robot file ends in .toml or .urdf")
    return _build(*read_robot_file(path), path)


def _build(file: RobotFile, tables: BoardTables, path: Path) -> Robot:
    by_name = {joint.name: joint for joint in file.joints}
    _check_joints(file, by_name, path)
    order = [row.joint for row in file.dh.rows if row.joint is not None]
    entries = [by_name[name] for name in order]
    chain = Chain.from_dh(
        [
            DHRow(
                row.a_mm / 1000,
                math.radians(row.alpha_deg),
                row.d_mm / 1000,
                math.radians(row.theta_deg),
                joint=row.joint is not None,
            )
            for row in file.dh.rows
        ],
        file.dh.convention,
    )
    board, outputs, settings = read_outputs(file, tables, entries, path)
    robot = Robot(
        name=file.name,
        title=file.title,
        source=file.source,
        assumed=file.assumed,
        joints=tuple(_joint(entry) for entry in entries),
        chain=chain,
        poses={name: _pose(values, entries, f"{path}: poses.{name}") for name, values in file.poses.items()},
        output_map=outputs,
        board=board,
        board_settings=settings,
        gripper=None
        if file.gripper is None
        else Gripper(file.gripper.title, file.gripper.speed_percent_s / 100),
        gravity=_gravity(file, order, chain, path),
        floor_z=file.floor.z_mm / 1000,
        points={name: _point(value) for name, value in file.points.items()},
        look=_look(file.look),
        capsules=_capsules(file, entries, chain, path),
        obstacles=tuple(_obstacle(entry, path) for entry in file.obstacles),
    )
    for needed in ("home", "rest"):
        if needed not in robot.poses:
            raise RobotFileError(f"{path}: poses.{needed} is missing; every robot names home and rest")
    return robot


def _check_joints(file: RobotFile, by_name: dict[str, JointEntry], path: Path) -> None:
    if len(by_name) != len(file.joints):
        raise RobotFileError(f"{path}: joints: two joints have the same name")
    used = [row.joint for row in file.dh.rows if row.joint is not None]
    if sorted(used) != sorted(by_name):
        raise RobotFileError(
            f"{path}: dh.rows and joints must name the same joints once each: "
            f"rows name {', '.join(used)}; joints are {', '.join(by_name)}"
        )
    for joint in file.joints:
        low, high = joint.limit_deg
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            raise RobotFileError(
                f"{path}: joints.{joint.name}.limit_deg = [{low}, {high}]: the lower limit comes first "
                "(the same number twice holds the joint there)"
            )


def _joint(entry: JointEntry) -> Joint:
    low, high = entry.limit_deg
    return Joint(
        name=entry.name,
        title=entry.title,
        lower=math.radians(low),
        upper=math.radians(high),
        speed=math.radians(entry.speed_deg_s),
        acceleration=math.radians(entry.acceleration_deg_s2),
        jerk=math.radians(
            entry.acceleration_deg_s2 / JERK_UP_S if entry.jerk_deg_s3 is None else entry.jerk_deg_s3
        ),
        stall_torque=entry.stall_torque_nm,
    )


def _pose(values: tuple[float, ...], entries: list[JointEntry], where: str) -> FloatArray:
    if len(values) != len(entries):
        raise RobotFileError(f"{where}: {len(entries)} angles are needed, there are {len(values)}")
    for value, entry in zip(values, entries, strict=True):
        low, high = entry.limit_deg
        if not low <= value <= high:
            raise RobotFileError(f"{where}: {entry.name} = {value}° is outside {low}° … {high}°")
    return np.radians(np.array(values, dtype=np.float64))


def _point(value_mm: tuple[float, float, float]) -> FloatArray:
    return np.array(value_mm, dtype=np.float64) / 1000


def _capsules(
    file: RobotFile, joints: list[JointEntry], chain: Chain, path: Path
) -> tuple[Capsule, ...] | None:
    order = [joint.name for joint in joints]
    capsules: list[Capsule] = []
    for entry in file.capsules:
        if entry.joint is not None and entry.joint not in order:
            raise RobotFileError(f"{path}: capsules: there is no joint {entry.joint!r}")
        frame = 0 if entry.joint is None else chain.joint_rows[order.index(entry.joint)] + 1
        ends = np.array([entry.from_mm, entry.to_mm]) / 1000
        titles = [joint.title for joint in joints]
        capsules.append(capsule(chain, titles, frame, (ends[0], ends[1]), entry.radius_mm / 1000))
    return tuple(capsules) or None


def _obstacle(entry: ObstacleEntry, path: Path) -> Obstacle:
    corners = np.array([entry.from_mm, entry.to_mm]) / 1000
    flat = np.flatnonzero(corners[0] == corners[1])
    if len(flat):
        raise RobotFileError(
            f"{path}: obstacles: {entry.title}: from_mm and to_mm have the same {'xyz'[flat[0]]}; "
            "they must be opposite corners of a box"
        )
    return Obstacle(entry.title, corners.min(axis=0), corners.max(axis=0))


def _look(entry: LookEntry | None) -> Look:
    if entry is None:
        return Look()
    return Look(tuple(map(_color, entry.links)), _color(entry.joints), entry.shape, entry.width_percent / 100)


def _color(text: str) -> Color:
    red, green, blue = bytes.fromhex(text.removeprefix("#"))
    return red, green, blue


def _gravity(file: RobotFile, order: list[str], chain: Chain, path: Path) -> GravityModel:
    bodies: list[Body] = []
    for body in file.bodies:
        if body.joint not in order:
            raise RobotFileError(f"{path}: bodies: there is no joint {body.joint!r}")
        index = order.index(body.joint)
        x, y, z = (value / 1000 for value in body.com_mm)
        bodies.append(Body(joint=index, mass_kg=body.mass_kg, com_m=(x, y, z)))
    return GravityModel(chain, tuple(bodies), file.payload_kg)
