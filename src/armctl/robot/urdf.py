"""A robot from a URDF file: one serial chain of turning joints, its limits and its masses."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armctl.errors import RobotFileError
from armctl.kinematics import Body, Chain, GravityModel
from armctl.kinematics.angles import rest_angle
from armctl.kinematics.chain import frame_along
from armctl.kinematics.yaw_pitch_roll.geometry import recognise
from armctl.robot.parts import JERK_UP_S, Joint
from armctl.robot.robot import Robot
from armctl.robot.urdf_file import Rounding, UrdfFile, UrdfJoint, fixed_where_held, limits_of, read_urdf_file
from armctl.robot.urdf_tool import AXES, UrdfName, UrdfTool, named_tool, suggested_tool
from armctl.robot.urdf_tree import UrdfTree

# What is assumed of an arm from a URDF file: what the file leaves open, and what armctl takes otherwise.

FloatArray = NDArray[np.float64]
ASSUMED_SPEED = math.radians(60)
"""[rad/s]"""
_UNSEEN = 1e-9
"""a shift of the tool that is not worth a word [m]"""
_ALONG = math.cos(math.radians(1))
"""cosine from which on two directions are the same to somebody who looks at the arm"""
_LEANS = 1e-6
"""angle from which on a base is not upright [rad]"""
_SHORTEST = 1e-6
"""length from which on a link has a direction [m]"""


def assumed_of(
    name: UrdfName, tool: UrdfTool, chain: list[UrdfJoint], names: list[str], dh: Chain
) -> tuple[str, ...]:
    """The assumptions, a sentence each.

    Args:
        name: what was asked for.
        tool: the tool link.
        chain: the joints from the root to the tool, fixed ones among them.
        names: of the moving ones among them.
        dh: the same chain as rows.
    """
    moving = [joint for joint in chain if joint.kind != "fixed"]
    return (
        *_tool(name, tool),
        *_approach(name, tool, names, dh),
        *_leaning(names, dh),
        *_held(chain),
        *_rounding(chain),
        *_numbers(moving, names),
    )


def _tool(name: UrdfName, tool: UrdfTool) -> Iterable[str]:
    if name.link is None:
        out = (
            f"; taken for the gripper's own and left out: {', '.join(tool.left_out)}" if tool.left_out else ""
        )
        yield f"the tool is the link {tool.link}, {tool.why}{out} (another: {name.path.name}#LINK)"


def _approach(name: UrdfName, tool: UrdfTool, names: list[str], dh: Chain) -> Iterable[str]:
    """Frames of ROS often have x ahead, where armctl takes z."""
    ahead = _ahead(dh)
    if ahead is None or name.approach != "z":
        return
    along = dh.forward(np.zeros(dh.n))[:3, :3].T @ ahead.direction
    axes = [axis for axis, (sign, k) in AXES.items() if (-along[k] if sign else along[k]) > _ALONG]
    if not axes or axes == ["z"]:
        return
    geometry = recognise(dh)
    none = ", so that no pitch can be asked for" if geometry and geometry.tool_angle is None else ""
    where = f"along the axis of {names[-1]}" if ahead.rolls else "along the last link"
    yield (
        f"pitch is the elevation of the tool's z axis; in the link {tool.link} not z but {axes[0]} points "
        f"ahead, {where}{none} ({name.path.name}#{tool.link},approach={axes[0]} takes {axes[0]} for z)"
    )


@dataclass(frozen=True, slots=True)
class _Ahead:
    """The direction that the tool points in by the arm's build, all joints at zero."""

    direction: FloatArray
    """(3,) unit vector, base frame"""
    rolls: bool
    """it is the axis of the last joint, which rolls the tool; else the last link's"""


def _ahead(dh: Chain) -> _Ahead | None:
    """Where the tool points; None where the arm ends on the axis of a joint that does not roll."""
    points, axes = dh.axes()
    tip, last = dh.forward(np.zeros(dh.n))[:3, 3], axes[-1]
    if dh.n > 1 and np.linalg.norm(np.cross(last, axes[-2])) > math.sin(math.acos(_ALONG)):
        outward = float((tip - points[-2]) @ last)
        return _Ahead(last * math.copysign(1.0, outward), rolls=True)
    link = tip - points[-1]
    across = link - (link @ last) * last
    length = float(np.linalg.norm(across))
    return _Ahead(across / length, rolls=False) if length > _SHORTEST else None


def _leaning(names: list[str], dh: Chain) -> Iterable[str]:
    geometry = recognise(dh)
    if geometry is None:
        return
    lean = math.atan2(float(np.hypot(*geometry.frame[:2, 2])), float(geometry.frame[2, 2]))
    if lean > _LEANS:
        yield (
            f"pitch is measured from the plane that the axis of {names[0]} stands on, not from the "
            f"horizontal: that axis leans by {math.degrees(lean):.1f}° in the root frame"
        )


def _held(chain: list[UrdfJoint]) -> Iterable[str]:
    held = [
        f"{joint.name} at {math.degrees(joint.held_at):.1f}°" for joint in chain if joint.held_at is not None
    ]
    if held:
        yield f"fixed, as both limits are the same: {', '.join(held)}"


def _rounding(chain: list[UrdfJoint]) -> Iterable[str]:
    total, shift, reach = Rounding(), 0.0, 0.0
    for joint in reversed(chain):
        total += joint.rounding
        shift += joint.rounding.shift * reach
        reach += float(np.linalg.norm(joint.origin[:3, 3]))
    if shift < _UNSEEN:
        return
    parts: list[str] = []
    if total.quarters:
        kinds = ", ".join(sorted(set(total.quarters)))
        parts.append(f"{_count(len(total.quarters), 'angle')} written as rounded quarter turns ({kinds})")
    if total.zeros:
        parts.append(f"{_count(total.zeros, 'number')} below 1e-6 written for zero")
    yield f"exact: {' and '.join(parts)}; the tool moves by at most {1000 * shift:.2g} mm"


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _numbers(moving: list[UrdfJoint], names: list[str]) -> Iterable[str]:
    endless = [name for name, joint in zip(names, moving, strict=True) if joint.kind == "continuous"]
    if endless:
        yield f"limits of ±180° of the continuous joints: {', '.join(endless)}"
    pairs = [(name, joint.limit) for name, joint in zip(names, moving, strict=True)]
    slow = [name for name, limit in pairs if limit is None or limit.velocity == 0]
    if slow:
        yield f"a speed of 60°/s of joints without one: {', '.join(slow)}"
    yield "accelerations: full speed within 1/6 s"
    yield "home and rest poses: all joints at zero, or at the limit next to it"
    yield "the floor, at the height of the base frame"


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
    dh = Chain.from_joints(origins, [joint.axis for joint in moving], last)
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


def _bodies(file: UrdfFile, tree: UrdfTree, chain: list[UrdfJoint], dh: Chain) -> Iterable[Body]:
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
