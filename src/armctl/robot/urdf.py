"""A robot from a URDF file: one serial chain of turning joints, its limits and its masses."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armctl.errors import RobotFileError
from armctl.kinematics import Body, DHChain, GravityModel
from armctl.kinematics.angles import rest_angle
from armctl.robot.joint import JERK_UP_S, Joint
from armctl.robot.robot import Robot
from armctl.robot.urdf_assumed import ASSUMED_SPEED, assumed_of
from armctl.robot.urdf_file import UrdfFile, UrdfJoint, read_urdf_file
from armctl.robot.urdf_limits import fixed_where_held, limits_of
from armctl.robot.urdf_name import UrdfName
from armctl.robot.urdf_rows import frame_along, rows_of
from armctl.robot.urdf_tool import named_tool, suggested_tool
from armctl.robot.urdf_tree import UrdfTree

FloatArray = NDArray[np.float64]
SPEED_UP_S = 1 / 6
"""time from rest to full speed [s]"""


def load_urdf(name: UrdfName) -> Robot:
    """The arm of a URDF file.

    The base frame is the root link, the tool frame the link that ``name`` or else ``suggested_tool`` picks,
    turned so that z is the approach axis of ``name``, and the zero of every joint that of the file. What lies
    off the chain counts as mass only.

    Raises:
        RobotFileError: a file that cannot be read, contradicts itself, or holds no arm of turning joints.
    """
    path = name.path
    file = read_urdf_file(path)
    tree = UrdfTree(file)
    tool = suggested_tool(tree) if name.link is None else named_tool(tree, name.link)
    chain = [fixed_where_held(joint, path) for joint in tree.chain(tool.link)]
    moving = [joint for joint in chain if joint.kind != "fixed"]
    if not moving:
        raise RobotFileError(f"{path}: no joint turns between {tree.root} and {tool.link}")
    origins, last = _origins(chain)
    last = last @ frame_along(name.direction)
    dh = DHChain(rows_of(origins, [joint.axis for joint in moving], last))
    names = _distinct(_plain(joint.name, "joint") for joint in moving)
    joints = tuple(_joint(joint, name, path) for joint, name in zip(moving, names, strict=True))
    home = np.array([rest_angle(joint.lower, joint.upper) for joint in joints])
    turned = "" if name.approach == "z" else f", whose {name.approach} axis is taken for the tool's z"
    return Robot(
        name=_plain(file.name or path.stem, "arm"),
        title=file.name or path.stem,
        source=f"URDF file {path.name}, from {tree.root} to {tool.link}{turned}",
        assumed=assumed_of(name, tool, chain, names, dh),
        joints=joints,
        chain=dh,
        poses={"home": home, "rest": home},
        output_map=None,
        gripper=None,
        gravity=GravityModel(dh, tuple(_bodies(file, tree, chain, dh))),
        floor_z=0.0,
    )


def _origins(chain: list[UrdfJoint]) -> tuple[list[FloatArray], FloatArray]:
    """Poses (4, 4): each moving joint in the link that the one ahead carries, the tool in the last link."""
    origins: list[FloatArray] = []
    ahead = np.eye(4)
    for joint in chain:
        ahead = ahead @ joint.origin
        if joint.kind != "fixed":
            origins.append(ahead)
            ahead = np.eye(4)
    return origins, ahead


def _joint(joint: UrdfJoint, name: str, path: Path) -> Joint:
    lower, upper = limits_of(joint, path)
    limit = joint.limit
    speed = limit.velocity if limit is not None and limit.velocity > 0 else ASSUMED_SPEED
    return Joint(
        name=name,
        title=_title(joint.name),
        lower=lower,
        upper=upper,
        speed=speed,
        acceleration=speed / SPEED_UP_S,
        jerk=speed / SPEED_UP_S / JERK_UP_S,
        stall_torque=limit.effort if limit is not None and limit.effort > 0 else None,
    )


def _bodies(file: UrdfFile, tree: UrdfTree, chain: list[UrdfJoint], dh: DHChain) -> Iterable[Body]:
    """The masses that each joint carries, in its DH row's frame; branches off the chain at their zero."""
    rows = dh.frames(np.zeros(dh.n))
    poses, carrier = {tree.root: np.eye(4)}, {tree.root: -1}
    on_chain = {joint.name: joint for joint in chain}
    for written in tree.below(tree.root):
        joint = on_chain.get(written.name, written)
        poses[joint.child] = poses[joint.parent] @ joint.origin
        carrier[joint.child] = carrier[joint.parent] + (joint.name in on_chain and joint.kind != "fixed")
    for name, link in file.links.items():
        k = carrier[name]
        if link.mass_kg == 0.0 or k < 0:
            continue
        frame = rows[dh.joint_rows[k] + 1]
        point = (poses[name] @ np.append(link.com, 1.0))[:3]
        x, y, z = (frame[:3, :3].T @ (point - frame[:3, 3])).tolist()
        yield Body(joint=k, mass_kg=link.mass_kg, com_m=(x, y, z))


def _plain(name: str, otherwise: str) -> str:
    """A name as robot files have them: small letters, digits and underscores, a letter first."""
    plain = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    if not plain:
        return otherwise
    return plain if plain[0].isalpha() else f"{otherwise}_{plain}"


def _distinct(names: Iterable[str]) -> list[str]:
    """The names, those that come again with a number."""
    taken: list[str] = []
    for name in names:
        new, k = name, 2
        while new in taken:
            new, k = f"{name}_{k}", k + 1
        taken.append(new)
    return taken


def _title(name: str) -> str:
    """``shoulder_pan_joint`` as *Shoulder pan*."""
    words = re.sub(r"[_\W]+", " ", name).strip()
    short = re.sub(r" joint$", "", words, flags=re.IGNORECASE)
    return short[:1].upper() + short[1:]
