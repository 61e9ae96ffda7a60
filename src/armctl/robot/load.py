"""Loading robots: shipped ones by name, a user's own by path."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from platformdirs import user_data_path

from armctl.arrays import FloatArray
from armctl.decoding import REFUSED, did_you_mean, known
from armctl.documents import Document, as_path, shipped_folder
from armctl.errors import Errors, RobotFileError
from armctl.facts import Several, say
from armctl.kinematics import Body, Chain, DHRow, GravityModel
from armctl.kinematics.chain import TurnLimit
from armctl.robot.board_entries import read_outputs
from armctl.robot.body.arm_body import BODY_GUESSED, Capsule, capsule
from armctl.robot.file import (
    ROBOT_FILES,
    CapsuleEntry,
    DHRowEntry,
    JointEntry,
    RobotFile,
    signals_of,
    without_board,
)
from armctl.robot.look.pieces import MASSES_ASSUMED, masses
from armctl.robot.look_sound import check_look
from armctl.robot.outputs import OutputMap
from armctl.robot.parts import JERK_UP_S, Joint, Look, spoken
from armctl.robot.robot import Robot
from armctl.robot.tool_entries import with_tools

_SIDE_SUFFIX = ".armctl.toml"
_URDF = re.compile(
    r"(?P<path>.+?\.(?:urdf|xacro|zip|xml|sdf|srdf|mjcf|armctl\.toml))(?:#(?P<wanted>.*))?",
    re.IGNORECASE | re.DOTALL,
)


def robots_folder() -> Path:
    """The folder of the shipped robot files."""
    return shipped_folder("robots")


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


def says_no_board(name: str) -> bool:
    """Whether a robot file has ``no_board``, without working the rest out; False where it cannot be read."""
    if is_urdf(name):
        return False
    try:
        return ROBOT_FILES.load(robot_path(name), lambda text: "no_board" in ROBOT_FILES.parse(text).record)
    except RobotFileError:
        return False


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


def with_argument(name: str, argument: str) -> str | None:
    """A robot's name with one more argument (``model:=mk3``) of its xacro file; None: it is no URDF robot."""
    if not is_urdf(name):
        return None
    escaped = re.sub(r"[%,#/\\]", lambda sign: f"%{ord(sign[0]):02X}", argument)
    return f"{name}{',' if '#' in name else '#'}{escaped}"


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


def load_robot(name: str | Path, arguments: Mapping[str, str | bool | int | float] | None = None) -> Robot:
    """Load a shipped robot or one of your own by its name, or one from a path.

    A shipped name always means the shipped robot: your own file of that name is opened by its path.
    A path leads to a robot file (``.toml``), or to an arm in URDF: a ``.urdf`` or ``.xacro`` file, a folder
    or a ``.zip`` file with one, or the side file (``.armctl.toml``) beside it. Behind these may stand the
    tool link, which of its axes is the approach axis, and the arguments of a xacro file:
    ``arm.urdf#gripper_link,approach=x``, ``arm.urdf.xacro#model:=mk3``. ``arguments`` gives these, too:
    ``{"model": "mk3"}``.
    ``RobotFileError`` names the file and what is wrong with it.
    """
    path = as_path(name, "a robot is a shipped name or the path of a robot file")
    if "\0" in str(name):
        raise RobotFileError(f"{str(name)!r}: the name of a file holds no NUL")
    if urdf := urdf_path(name):
        from armctl.robot.urdf import load_urdf  # 15 ms that no other robot needs

        return load_urdf(*urdf, arguments)
    if arguments:
        raise RobotFileError(f"{name}: only a xacro file has arguments, such as {next(iter(arguments))!r}")
    if path.suffix == "" and len(path.parts) == 1:
        path = robot_path(str(name))
        if path.suffix == "":
            own = ", ".join(user_robots())
            hint = did_you_mean(name, (*shipped_robots(), *user_robots()))
            raise RobotFileError(
                f"there is no robot {str(name)!r}{hint}; shipped are {', '.join(shipped_robots())}"
                f"{own and f'; your own are {own}'} (or give a path to a .toml or .urdf file)"
            )
    elif path.suffix.lower() != ".toml":
        raise RobotFileError(f"{path}: a robot file ends in .toml or .urdf (or .xacro, or .zip)")
    return ROBOT_FILES.load(path, lambda content: robot_of(ROBOT_FILES.parse(content)))


def robot_of(document: Document) -> Robot:
    """The robot of a file's tables. Raises ``RobotFileError``: all that is wrong in them."""
    errors = Errors()
    file = without_board(document, RobotFile, errors)
    joints: Sequence[JointEntry] = file.joints
    with errors:
        joints = _joints_by_rows(file, document)
        for name, values in file.poses.items():
            with errors:
                _check_pose(values, joints, document, name)
    _check_entries(file, document, errors)
    board: Any = None
    with errors:
        board = _board(file, document, [(joint.name, joint.limit_deg) for joint in joints])
    errors.raise_all()
    links = [row for row in file.dh.rows if row.turning is not None]
    by_name = {joint.name: joint for joint in joints}
    chain = Chain.from_dh(
        [_row(row) for row in file.dh.rows],
        file.dh.convention,
        _coupling(links, joints),
        _turn_limits(links, by_name),
    )
    kind, outputs, settings = board
    robot = Robot(
        name=file.name,
        title=file.title,
        source=file.source,
        assumed=file.assumed,
        no_board=file.no_board,
        criterion=file.criterion,
        joints=tuple(map(_joint, joints)),
        chain=chain,
        poses={name: np.radians(np.array(values, dtype=np.float64)) for name, values in file.poses.items()},
        output_map=outputs,
        board=kind,
        board_settings=settings,
        gripper=None if file.gripper is None else file.gripper.gripper(),
        signals=signals_of(file),
        gravity=_gravity(file, [str(row.turning) for row in links], chain),
        floor_z=file.floor.z_mm / 1000,
        points={name: np.array(point_mm) / 1000 for name, point_mm in file.points.items()},
        look=Look() if file.look is None else file.look.look(),
        capsules=tuple(_capsule(entry, links, by_name, chain) for entry in file.capsules) or None,
        named_links=() if chain.coupling is None else tuple(_named_link(row, by_name) for row in links),
        obstacles=tuple(entry.obstacle() for entry in file.obstacles),
    )
    check_look(robot, document, errors)
    for name, pose in robot.poses.items():
        with errors:
            if beyond := robot.turns_beyond(pose):
                raise document.error(f"poses.{name}: {say(Several(beyond))}", ("poses", name))
    errors.raise_all()
    if robot.body_is_guessed:
        robot = replace(robot, assumed=(*robot.assumed, BODY_GUESSED))
    elif not file.bodies and robot.look.rows:
        bodies = masses(chain, robot.look.rows, robot.pieces, robot.look.material)
        gravity = replace(robot.gravity, bodies=bodies)
        robot = replace(robot, gravity=gravity, assumed=(*robot.assumed, MASSES_ASSUMED))
    return with_tools(robot, file.tools, document)


def _board(
    file: RobotFile, document: Document, limits: Sequence[tuple[str, tuple[float, float]]]
) -> tuple[str, OutputMap | None, object]:
    """Its kind, the outputs if there are any, and its settings."""
    gripper = None if file.gripper is REFUSED else file.gripper
    kind, outputs, settings = read_outputs(document, limits, gripper, signals_of(file))
    if outputs is not None and file.no_board and file.no_board is not REFUSED:
        raise document.error("no_board: the joints have outputs; remove the one or the others", ("no_board",))
    return kind, outputs, settings


def _joints_by_rows(file: RobotFile, document: Document) -> list[JointEntry]:
    """The joints in the order of their DH rows."""
    by_name: dict[str, JointEntry] = {}
    for i, joint in enumerate(file.joints):
        if joint.name in by_name:
            what = f"joints: two joints have the same name, {joint.name}"
            raise document.error(what, ("joints", i, "name"))
        by_name[joint.name] = joint
    used = [row.joint for row in file.dh.rows if row.joint is not None]
    if sorted(used) != sorted(by_name):
        strange = next((i for i, row in enumerate(file.dh.rows) if row.joint not in (None, *by_name)), None)
        hint = "" if strange is None else did_you_mean(file.dh.rows[strange].joint, by_name)
        raise document.error(
            "dh.rows and joints must name the same joints once each: "
            f"rows name {', '.join(used)}; joints are {', '.join(by_name)}{hint}",
            ("dh", "rows") if strange is None else ("dh", "rows", strange, "joint"),
        )
    return [by_name[name] for name in used]


def _check_entries(file: RobotFile, document: Document, errors: Errors) -> None:
    """All that needs no order of the joints."""
    names, links = list[str](), list[str]()
    rows: Sequence[DHRowEntry] = ()
    with errors:
        names = [joint.name for joint in known(file.joints)]
    with errors:
        rows = known(file.dh.rows)
        links = [row.turning for row in rows if row.turning is not None]
        named = [row.link for row in rows if row.link is not None]
        if any(links.count(link) > 1 for link in named):
            raise document.error("dh.rows: two links have the same name", ("dh", "rows"))
    for i, joint in enumerate(known(file.joints)):
        with errors:
            low, high = joint.limit_deg
            if not low <= high:
                raise document.error(
                    f"joints.{joint.name}.limit_deg = [{low}, {high}]: the lower limit comes first "
                    "(the same number twice holds the joint there)",
                    ("joints", i, "limit_deg"),
                )
    for i, row in enumerate(rows):
        with errors:
            _check_row(row, names, document, i)
    for key, entries in (("bodies", known(file.bodies)), ("capsules", known(file.capsules))):
        for i, entry in enumerate(entries):
            with errors:
                if links and entry.joint is not None and entry.joint not in (*links, *names):
                    what = f"{key}: there is no joint {entry.joint!r}{did_you_mean(entry.joint, links)}"
                    raise document.error(what, (key, i, "joint"))
    for i, entry in enumerate(known(file.obstacles)):
        with errors, document.at(("obstacles", i)):
            entry.obstacle()
    for needed in ("home", "rest"):
        with errors:
            if needed not in file.poses:
                what = f"poses.{needed} is missing; every robot names home and rest"
                raise document.error(what, ("poses", needed))


def _check_row(row: DHRowEntry, joints: Sequence[str], document: Document, index: int) -> None:
    what = ""
    if row.joint is not None and row.link is not None:
        what = "a row with a joint is called after it; leave out link"
    elif (row.link is None) != (not row.follows) and row.joint is None:
        what = "a row that follows joints needs a name, link, and the reverse"
    elif row.between_deg is not None and (not row.follows or row.between_deg[0] > row.between_deg[1]):
        what = (
            f"between_deg = {list(row.between_deg)}: only a row that follows joints has it, "
            "the lower limit first (other links keep to limit_deg of their joint)"
        )
    for name in row.follows:
        if joints and (name not in joints or name == row.joint):
            what = f"follows {name!r}, which is no other joint{did_you_mean(name, joints)}"
    if what:
        raise document.error(f"dh.rows, row {index + 1}: {what}", ("dh", "rows", index))


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
    titles = ["the base", *(_named_link(row, joints)[1] for row in links)]
    return [
        TurnLimit(link, math.radians(low), math.radians(high), f"the angle from {ahead} to {title}")
        for link, (row, ahead, title) in enumerate(zip(links, titles[:-1], titles[1:], strict=True))
        for low, high in ([] if row.between_deg is None else [row.between_deg])
    ]


def _named_link(row: DHRowEntry, joints: Mapping[str, JointEntry]) -> tuple[str, str]:
    if row.joint is not None:
        return row.joint, joints[row.joint].title
    name = row.link or ""
    return name, spoken(name)


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
        jerk_told=entry.jerk_deg_s3 is not None,
        stall_torque=entry.stall_torque_nm,
    )


def _check_pose(
    values: tuple[float, ...], joints: Sequence[JointEntry], document: Document, name: str
) -> None:
    what = ""
    if len(values) != len(joints):
        what = f"{len(joints)} angles are needed, there are {len(values)}"
    else:
        for value, joint in zip(values, joints, strict=True):
            low, high = joint.limit_deg
            if low <= high and not low <= value <= high:
                what += f"{what and '; '}{joint.name} = {value}° is outside {low}° … {high}°"
    if what:
        raise document.error(f"poses.{name}: {what}", ("poses", name))


def _capsule(
    entry: CapsuleEntry, links: Sequence[DHRowEntry], joints: Mapping[str, JointEntry], chain: Chain
) -> Capsule:
    frame = 0
    if entry.joint is not None:
        frame = chain.joint_rows[[row.turning for row in links].index(entry.joint)] + 1
    ends = np.array([entry.from_mm, entry.to_mm]) / 1000
    titles = [_named_link(row, joints)[1] for row in links]
    return capsule(chain, titles, frame, (ends[0], ends[1]), entry.radius_mm / 1000)


def _gravity(file: RobotFile, links: Sequence[str], chain: Chain) -> GravityModel:
    bodies: list[Body] = []
    for body in file.bodies:
        x, y, z = (value / 1000 for value in body.com_mm)
        bodies.append(Body(links.index(body.joint), body.mass_kg, (x, y, z)))
    return GravityModel(chain, tuple(bodies), file.payload_kg)


_ACROSS, _PARALLEL = 0.4, 0.999


class AxisNote(NamedTuple):
    """That the tool axis lies across the last link."""

    what: str
    mend: str


def across_the_link(chain: Chain) -> AxisNote | None:
    """What to know where the tool axis is parallel to the last joint, and the tool point is off that axis.

    So it is where the DH rows of an arm of pitch joints end with its last joint. Such a tool cannot be
    pitched: all pitch joints turn it about its own axis. None: it is not so, or there are no DH rows.
    """
    axis, (x, y, z) = chain.tail[:3, 2], chain.tail[:3, 3].tolist()
    off = math.hypot(x, y)
    if not chain.rows or off < 1e-6 or abs(axis[2]) < _PARALLEL or abs(z) > _ACROSS * off:
        return None
    ahead = chain.tail[:3, :3].T @ [x, y, 0.0]
    theta = round(math.degrees(math.atan2(ahead[1], ahead[0])) + 90.0, 3) + 0.0
    theta = theta - 360.0 if theta > 180.0 else theta
    turn = f"{{ a_mm = 0, alpha_deg = 90, d_mm = 0, theta_deg = {theta:g} }}"
    if chain.convention == "modified":  # alpha comes before theta there
        turn = (
            f"{{ a_mm = 0, alpha_deg = 0, d_mm = 0, theta_deg = {theta:g} }}, "
            "{ a_mm = 0, alpha_deg = 90, d_mm = 0 }"
        )
    rows = "these two rows" if chain.convention == "modified" else "this row"
    return AxisNote(
        "z of the last DH row lies across the last link, along the axis of the last joint: "
        "no joint can change the pitch of the tool",
        f"add {rows} at the end of dh.rows, and z points along the link: {turn}",
    )
