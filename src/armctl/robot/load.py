"""Loading robots: shipped ones by name, a user's own by path."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path

import numpy as np
from platformdirs import user_data_path

from armctl.arrays import FloatArray
from armctl.documents import as_path
from armctl.errors import RobotFileError
from armctl.kinematics import Body, Chain, DHRow, GravityModel
from armctl.kinematics.chain import TurnLimit
from armctl.robot.board_entries import read_outputs
from armctl.robot.body import Capsule, capsule
from armctl.robot.file import (
    ROBOT_FILES,
    CapsuleEntry,
    DHRowEntry,
    JointEntry,
    RobotFile,
    read_robot_file,
)
from armctl.robot.parts import JERK_UP_S, Gripper, Joint, Look
from armctl.robot.robot import Robot

_SIDE_SUFFIX = ".armctl.toml"
_URDF = re.compile(
    r"(?P<path>.+?\.(?:urdf|xacro|zip|armctl\.toml))(?:#(?P<wanted>.*))?", re.IGNORECASE | re.DOTALL
)


def robots_folder() -> Path:
    """The folder of the shipped robot files: inside an installed package, or beside ``src`` in a checkout."""
    package = Path(str(files("armctl")))
    installed = package / "robots"
    return installed if installed.is_dir() else package.parent.parent / "robots"


def shipped_robots() -> tuple[str, ...]:
    """Names of the shipped robots, sorted."""
    return tuple(sorted(path.stem for path in robots_folder().glob("*.toml")))


def user_robots_folder() -> Path:
    """The folder of the user's own robot files, which may not be there yet."""
    return user_data_path("armctl") / "robots"


def user_robots() -> tuple[str, ...]:
    """Names of the user's own robots, sorted."""
    return tuple(sorted(_user_files().keys() - set(shipped_robots())))


def hidden_robots() -> tuple[Path, ...]:
    """The user's own robots that have the name of a shipped one: the name means that, a path means them."""
    shipped = set(shipped_robots())
    return tuple(path for name, path in sorted(_user_files().items()) if name in shipped)


def _user_files() -> dict[str, Path]:
    """The user's own robots by name: robot files, side files of URDF arms, folders with a URDF arm."""
    folder = user_robots_folder()
    folders = {path.name: path for path in folder.glob("[!.]*/")}
    files = {path.stem.removesuffix(".armctl"): path for path in folder.glob("*.toml")}
    return folders | files


def robot_title(name: str) -> str:
    """A robot's title, of a robot file without working the rest out; its name where it cannot be read."""
    try:
        if is_urdf(name):
            return load_robot(name).title
        return ROBOT_FILES.load(robot_path(name), lambda text: str(ROBOT_FILES.parse(text).record["title"]))
    except (RobotFileError, KeyError):  # choosing it says what is wrong with it
        return name


def is_urdf(name: str | Path) -> bool:
    """True for the name of a URDF robot: what ``load_robot`` takes for one, with or without a tool link."""
    return urdf_path(name) is not None


def urdf_path(name: str | Path) -> tuple[Path, str | None] | None:
    """The path of a URDF robot, and what stands behind the ``#``; None for the name of another robot."""
    text = name.as_posix() if isinstance(name, Path) else name
    if match := _URDF.fullmatch(text):
        return Path(match["path"]), match["wanted"]
    text, mark, wanted = text.partition("#")
    path = robot_path(text)
    is_folder = path.suffix.lower() not in (".toml", ".csv") and os.path.isdir(path)
    if is_folder or _URDF.fullmatch(path.as_posix()):
        return path, wanted if mark else None
    return None


def robot_path(name: str) -> Path:
    """The file that a robot's name or path stands for, without the tool link of a URDF file.

    A shipped name means the shipped robot, also where the user has one of that name.
    """
    if name and os.path.basename(name) == name:
        own = user_robots_folder()
        files = (robots_folder() / f"{name}.toml", own / f"{name}.toml", own / f"{name}{_SIDE_SUFFIX}")
        for path in files:
            if os.path.isfile(path):
                return path
        if not name.startswith(".") and os.path.isdir(own / name):
            return own / name
    return Path(name.split("#")[0])


def load_robot(name: str | Path) -> Robot:
    """Load a shipped robot or one of your own by its name, or one from a path.

    A shipped name always means the shipped robot: your own file of that name is opened by its path.
    A path leads to a robot file (``.toml``), or to an arm in URDF: a ``.urdf`` or ``.xacro`` file, a folder
    or a ``.zip`` file with one, or the side file (``.armctl.toml``) beside it. Behind these may stand the
    tool link, and which of its axes is the approach axis: ``arm.urdf#gripper_link,approach=x``.
    ``RobotFileError`` names the file and what is wrong with it.
    """
    path = as_path(name, "a robot is a shipped name or the path of a robot file")
    if "\0" in str(name):
        raise RobotFileError(f"{str(name)!r}: the name of a file holds no NUL")
    if urdf := urdf_path(name):
        from armctl.robot.urdf import load_urdf  # 15 ms that no other robot needs

        return load_urdf(*urdf)
    if path.suffix == "" and len(path.parts) == 1:
        path = robot_path(str(name))
        if path.suffix == "":
            own = ", ".join(user_robots())
            raise RobotFileError(
                f"there is no robot {str(name)!r}; shipped are {', '.join(shipped_robots())}"
                f"{own and f'; your own are {own}'} (or give a path to a .toml or .urdf file)"
            )
    elif path.suffix.lower() != ".toml":
        raise RobotFileError(f"{path}: a robot file ends in .toml or .urdf (or .xacro, or .zip)")
    return ROBOT_FILES.load(path, robot_of)


def robot_of(content: bytes) -> Robot:
    """The robot of a file's content. Raises ``RobotFileError``, which does not name the file."""
    file, document = read_robot_file(content)
    by_name = {joint.name: joint for joint in file.joints}
    _check_joints(file, by_name)
    joints = [by_name[row.joint] for row in file.dh.rows if row.joint is not None]
    links = [row for row in file.dh.rows if row.turning is not None]
    chain = Chain.from_dh(
        [_row(row) for row in file.dh.rows],
        file.dh.convention,
        _coupling(links, joints),
        _turn_limits(links, by_name),
    )
    board, outputs, settings = read_outputs(
        document, [(joint.name, joint.limit_deg) for joint in joints], has_gripper=file.gripper is not None
    )
    gripper, look = file.gripper, file.look
    robot = Robot(
        name=file.name,
        title=file.title,
        source=file.source,
        assumed=file.assumed,
        joints=tuple(map(_joint, joints)),
        chain=chain,
        poses={name: _pose(values, joints, f"poses.{name}") for name, values in file.poses.items()},
        output_map=outputs,
        board=board,
        board_settings=settings,
        gripper=None if gripper is None else Gripper(gripper.title, gripper.speed_percent_s / 100),
        gravity=_gravity(file, [str(row.turning) for row in links], chain),
        floor_z=file.floor.z_mm / 1000,
        points={name: np.array(point_mm) / 1000 for name, point_mm in file.points.items()},
        look=Look() if look is None else look.look(),
        capsules=tuple(_capsule(entry, links, by_name, chain) for entry in file.capsules) or None,
        named_links=() if chain.coupling is None else tuple(_link_title(row, by_name) for row in links),
        obstacles=tuple(entry.obstacle() for entry in file.obstacles),
    )
    for needed in ("home", "rest"):
        if needed not in robot.poses:
            raise RobotFileError(f"poses.{needed} is missing; every robot names home and rest")
    for name, pose in robot.poses.items():
        if words := robot.turn_words(pose):
            raise RobotFileError(f"poses.{name}: {'; '.join(words)}")
    return robot


def _check_joints(file: RobotFile, by_name: dict[str, JointEntry]) -> None:
    if len(by_name) != len(file.joints):
        raise RobotFileError("joints: two joints have the same name")
    used = [row.joint for row in file.dh.rows if row.joint is not None]
    if sorted(used) != sorted(by_name):
        raise RobotFileError(
            "dh.rows and joints must name the same joints once each: "
            f"rows name {', '.join(used)}; joints are {', '.join(by_name)}"
        )
    turning = [row.turning for row in file.dh.rows if row.turning is not None]
    if len(set(turning)) != len(turning):
        raise RobotFileError("dh.rows: two links have the same name")
    for number, row in enumerate(file.dh.rows, 1):
        where = f"dh.rows, row {number}"
        if row.joint is not None and row.link is not None:
            raise RobotFileError(f"{where}: a row with a joint is called after it; leave out link")
        if (row.link is None) != (not row.follows) and row.joint is None:
            raise RobotFileError(f"{where}: a row that follows joints needs a name, link, and the reverse")
        if row.between_deg is not None and (not row.follows or row.between_deg[0] > row.between_deg[1]):
            raise RobotFileError(
                f"{where}: between_deg = {list(row.between_deg)}: only a row that follows joints has it, "
                "the lower limit first (other links keep to limit_deg of their joint)"
            )
        for name in row.follows:
            if name not in by_name or name == row.joint:
                raise RobotFileError(f"{where}: follows {name!r}, which is no other joint")
    for joint in file.joints:
        low, high = joint.limit_deg
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            raise RobotFileError(
                f"joints.{joint.name}.limit_deg = [{low}, {high}]: the lower limit comes first "
                "(the same number twice holds the joint there)"
            )


def _row(row: DHRowEntry) -> DHRow:
    alpha, theta = math.radians(row.alpha_deg), math.radians(row.theta_deg)
    return DHRow(row.a_mm / 1000, alpha, row.d_mm / 1000, theta, joint=row.turning is not None)


def _coupling(links: Sequence[DHRowEntry], joints: Sequence[JointEntry]) -> FloatArray | None:
    """(links, joints) of a parallel linkage; None: each link has a joint of its own."""
    if not any(row.follows for row in links):
        return None
    names = [joint.name for joint in joints]
    coupling = np.zeros((len(links), len(joints)))
    for turns, row in zip(coupling, links, strict=True):
        if row.joint is not None:
            turns[names.index(row.joint)] = 1.0
        for name, factor in row.follows.items():
            turns[names.index(name)] = factor
    return coupling


def _turn_limits(links: Sequence[DHRowEntry], joints: Mapping[str, JointEntry]) -> list[TurnLimit]:
    titles = ["the base", *(_link_title(row, joints) for row in links)]
    return [
        TurnLimit(link, math.radians(low), math.radians(high), f"the angle between {ahead} and {title}")
        for link, (row, ahead, title) in enumerate(zip(links, titles[:-1], titles[1:], strict=True))
        for low, high in ([] if row.between_deg is None else [row.between_deg])
    ]


def _link_title(row: DHRowEntry, joints: Mapping[str, JointEntry]) -> str:
    if row.joint is not None:
        return joints[row.joint].title
    return (row.link or "").replace("_", " ").capitalize()


def _joint(entry: JointEntry) -> Joint:
    low, high = entry.limit_deg
    jerk = entry.acceleration_deg_s2 / JERK_UP_S if entry.jerk_deg_s3 is None else entry.jerk_deg_s3
    return Joint(
        name=entry.name,
        title=entry.title,
        lower=math.radians(low),
        upper=math.radians(high),
        speed=math.radians(entry.speed_deg_s),
        acceleration=math.radians(entry.acceleration_deg_s2),
        jerk=math.radians(jerk),
        stall_torque=entry.stall_torque_nm,
    )


def _pose(values: tuple[float, ...], joints: Sequence[JointEntry], where: str) -> FloatArray:
    if len(values) != len(joints):
        raise RobotFileError(f"{where}: {len(joints)} angles are needed, there are {len(values)}")
    for value, joint in zip(values, joints, strict=True):
        low, high = joint.limit_deg
        if not low <= value <= high:
            raise RobotFileError(f"{where}: {joint.name} = {value}° is outside {low}° … {high}°")
    return np.radians(np.array(values, dtype=np.float64))


def _index(name: str, links: Sequence[str], where: str) -> int:
    if name not in links:
        raise RobotFileError(f"{where}: there is no joint {name!r}")
    return links.index(name)


def _capsule(
    entry: CapsuleEntry, links: Sequence[DHRowEntry], joints: Mapping[str, JointEntry], chain: Chain
) -> Capsule:
    frame = 0
    if entry.joint is not None:
        frame = chain.joint_rows[_index(entry.joint, [str(row.turning) for row in links], "capsules")] + 1
    ends = np.array([entry.from_mm, entry.to_mm]) / 1000
    titles = [_link_title(row, joints) for row in links]
    return capsule(chain, titles, frame, (ends[0], ends[1]), entry.radius_mm / 1000)


def _gravity(file: RobotFile, links: Sequence[str], chain: Chain) -> GravityModel:
    bodies: list[Body] = []
    for body in file.bodies:
        x, y, z = (value / 1000 for value in body.com_mm)
        bodies.append(Body(_index(body.joint, links, "bodies"), body.mass_kg, (x, y, z)))
    return GravityModel(chain, tuple(bodies), file.payload_kg)
