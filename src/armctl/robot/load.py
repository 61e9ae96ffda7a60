"""Loading robots: shipped ones by name, a user's own by path."""

from __future__ import annotations

import math
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armctl.errors import RobotFileError
from armctl.kinematics import Body, DHChain, DHRow, GravityModel
from armctl.robot.capsules import Capsule, capsule
from armctl.robot.file import JointEntry, LookEntry, ObstacleEntry, RobotFile, read_robot_file
from armctl.robot.look import Color, Look
from armctl.robot.obstacle import Obstacle
from armctl.robot.robot import JERK_UP_S, Gripper, Joint, Robot
from armctl.robot.servo_map import ServoMap
from armctl.robot.urdf import load_urdf

FloatArray = NDArray[np.float64]


def robots_folder() -> Path:
    """The folder of the shipped robot files: inside an installed package, or beside ``src`` in a checkout."""
    package = Path(str(files("armctl")))
    installed = package / "robots"
    return installed if installed.is_dir() else package.parent.parent / "robots"


def shipped_robots() -> tuple[str, ...]:
    """Names of the shipped robots, sorted."""
    return tuple(sorted(path.stem for path in robots_folder().glob("*.toml")))


def load_robot(name: str | Path) -> Robot:
    """Load a robot.

    Args:
        name: the name of a shipped robot, or a path to a robot file (``.toml``) or a ``.urdf`` file.

    Raises:
        RobotFileError: no such robot, or a file that cannot be read or contradicts itself.
    """
    path = Path(name)
    if path.suffix == "" and len(path.parts) == 1:
        shipped = robots_folder() / f"{name}.toml"
        if not shipped.is_file():
            raise RobotFileError(
                f"there is no robot {str(name)!r}; shipped are {', '.join(shipped_robots())} "
                "(or give a path to a .toml or .urdf file)"
            )
        path = shipped
    elif path.suffix == ".urdf":
        return load_urdf(path)
    elif path.suffix != ".toml":
        raise RobotFileError(f"{path}: a robot file ends in .toml or .urdf")
    return _build(read_robot_file(path), path)


def _build(file: RobotFile, path: Path) -> Robot:
    by_name = {joint.name: joint for joint in file.joints}
    _check_joints(file, by_name, path)
    order = [row.joint for row in file.dh.rows if row.joint is not None]
    entries = [by_name[name] for name in order]
    chain = DHChain(
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
    robot = Robot(
        name=file.name,
        title=file.title,
        source=file.source,
        assumed=file.assumed,
        joints=tuple(_joint(entry) for entry in entries),
        chain=chain,
        poses={name: _pose(values, entries, f"{path}: poses.{name}") for name, values in file.poses.items()},
        servo_map=_servo_map(file, entries, path),
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
    pose = np.radians(np.array(values, dtype=np.float64))
    pose.flags.writeable = False
    return pose


def _point(value_mm: tuple[float, float, float]) -> FloatArray:
    point = np.array(value_mm, dtype=np.float64) / 1000
    point.flags.writeable = False
    return point


def _capsules(
    file: RobotFile, joints: list[JointEntry], chain: DHChain, path: Path
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


def _servo_map(file: RobotFile, entries: list[JointEntry], path: Path) -> ServoMap | None:
    servos = [entry.servo for entry in entries if entry.servo is not None]
    if not servos:
        return None
    if len(servos) != len(entries):
        missing = [entry.name for entry in entries if entry.servo is None]
        raise RobotFileError(f"{path}: joints.{missing[0]}.servo is missing; the other joints have one")
    channels = [servo.channel for servo in servos]
    if file.gripper is not None:
        channels.append(file.gripper.servo.channel)
        if file.gripper.servo.closed_us == file.gripper.servo.open_us:
            raise RobotFileError(f"{path}: gripper.servo: closed_us and open_us are the same")
    if len(set(channels)) != len(channels):
        raise RobotFileError(f"{path}: two servos are on the same channel: {channels}")
    for entry, servo in zip(entries, servos, strict=True):
        _check_servo_range(entry, f"{path}: joints.{entry.name}.servo")
        if servo.us_per_deg == 0:
            raise RobotFileError(f"{path}: joints.{entry.name}.servo.us_per_deg is 0")
    gripper = None if file.gripper is None else file.gripper.servo
    return ServoMap(
        channels=tuple(servo.channel for servo in servos),
        zero_us=np.array([servo.zero_us for servo in servos]),
        us_per_rad=np.array([servo.us_per_deg for servo in servos]) * (180 / math.pi),
        pulse_min_us=np.array([servo.pulse_us[0] for servo in servos]),
        pulse_max_us=np.array([servo.pulse_us[1] for servo in servos]),
        gripper_channel=None if gripper is None else gripper.channel,
        gripper_closed_us=0.0 if gripper is None else gripper.closed_us,
        gripper_open_us=0.0 if gripper is None else gripper.open_us,
    )


def _check_servo_range(entry: JointEntry, where: str) -> None:
    servo = entry.servo
    if servo is None:
        return
    pulses = sorted(servo.zero_us + servo.us_per_deg * angle for angle in entry.limit_deg)
    low, high = servo.pulse_us
    if pulses[0] < low - 0.125 or pulses[1] > high + 0.125:
        raise RobotFileError(
            f"{where}: the limits {entry.limit_deg[0]}° … {entry.limit_deg[1]}° need pulses of "
            f"{pulses[0]:.1f} … {pulses[1]:.1f} µs, pulse_us allows {low} … {high} µs"
        )


def _gravity(file: RobotFile, order: list[str], chain: DHChain, path: Path) -> GravityModel:
    bodies: list[Body] = []
    for body in file.bodies:
        if body.joint not in order:
            raise RobotFileError(f"{path}: bodies: there is no joint {body.joint!r}")
        index = order.index(body.joint)
        x, y, z = (value / 1000 for value in body.com_mm)
        bodies.append(Body(joint=index, mass_kg=body.mass_kg, com_m=(x, y, z)))
    return GravityModel(chain, tuple(bodies), file.payload_kg)
