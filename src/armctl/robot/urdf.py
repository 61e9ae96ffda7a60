"""A robot from a URDF file: one serial chain of turning joints, its limits and its masses."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.kinematics import Body, Chain, GravityModel
from armctl.kinematics.angles import rest_angle
from armctl.kinematics.chain import frame_along
from armctl.kinematics.yaw_pitch_roll.geometry import recognise
from armctl.robot.parts import JERK_UP_S, MOST_JOINTS, Joint
from armctl.robot.robot import Robot
from armctl.robot.urdf_file import Rounding, UrdfJoint, UrdfTree, read_urdf_file
from armctl.robot.urdf_tool import UrdfTool, suggested_tool

ASSUMED_SPEED = math.radians(60)
"""[rad/s]"""
SPEED_UP_S = 1 / 6
"""time from rest to full speed [s]"""
AXES = {f"{sign}{axis}": (sign, k) for sign in ("", "-") for k, axis in enumerate("xyz")}
"""the axes of a link, as ``approach=`` names them: sign and column"""
_APPROACH = "approach="
_UNSEEN = 1e-9
"""a shift of the tool that is not worth a word [m]"""
_ALONG = math.cos(math.radians(1))
"""cosine from which on two directions look the same"""
_LEANS = 1e-6
"""angle from which on a base is not upright [rad]"""
_SHORTEST = 1e-6
"""length from which on a link has a direction [m]"""


def load_urdf(path: Path, wanted: str | None) -> Robot:
    """The arm of a URDF file.

    The base frame is the root link, the tool frame the tool link, turned so that z is the approach axis, and
    the zero of every joint that of the file. What lies off the chain counts as mass only. ``wanted``: the
    tool link (else ``suggested_tool``), the axis of it that is taken for z, or both: ``link,approach=x``.
    """
    try:
        link, approach = _wanted(wanted)
        tree = read_urdf_file(path)
        if link is not None and link not in tree.links:
            raise RobotFileError(f"there is no link {link!r}; it has {', '.join(tree.links)}")
        return _robot(tree, suggested_tool(tree) if link is None else UrdfTool(link, ""), approach)
    except RobotFileError as refusal:
        raise RobotFileError(f"{path}: {refusal}") from refusal


def _wanted(text: str | None) -> tuple[str | None, str]:
    """The tool link, if one is named, and the approach axis."""
    if text is None:
        return None, "z"
    parts = [part.strip() for part in text.split(",")]
    axes = [part.removeprefix(_APPROACH) for part in parts if part.startswith(_APPROACH)]
    links = [part for part in parts if not part.startswith(_APPROACH)]
    if "" in parts or len(links) > 1 or len(axes) > 1 or not set(axes) <= set(AXES):
        raise RobotFileError(
            f"behind the # stands the name of the tool link, {_APPROACH}AXIS ({', '.join(AXES)}), "
            f"or both with a comma between; got {text!r}"
        )
    return (links[0] if links else None), (axes[0] if axes else "z")


def _robot(tree: UrdfTree, tool: UrdfTool, approach: str) -> Robot:
    way = tree.way(tool.link)
    moving = [joint for joint in way if joint.kind != "fixed"]
    if not moving:
        raise RobotFileError(f"no joint turns between {tree.root} and {tool.link}")
    if len(moving) > MOST_JOINTS:
        raise RobotFileError(
            f"{len(moving)} joints turn between {tree.root} and {tool.link}; an arm has {MOST_JOINTS} at most"
        )
    sign, column = AXES[approach]
    chain = _chain(way, frame_along(np.eye(3)[column] * (-1.0 if sign else 1.0)))
    names = _distinct(_plain(joint.name, "joint") for joint in moving)
    joints = tuple(_joint(joint, name) for joint, name in zip(moving, names, strict=True))
    home = np.array([rest_angle(joint.lower, joint.upper) for joint in joints])
    turned = "" if approach == "z" else f", whose {approach} axis is taken for the tool's z"
    title = tree.name or tree.path.stem
    assumed = [
        *_about_tool(tree, tool, names, chain, approach),
        *_about_fixed(way),
        *_about_joints(moving, names),
        "accelerations: full speed within 1/6 s",
        "home and rest poses: all joints at zero, or at the limit next to it",
        "the floor, at the height of the base frame",
    ]
    return Robot(
        name=_plain(title, "arm"),
        title=title,
        source=f"URDF file {tree.path.name}, from {tree.root} to {tool.link}{turned}",
        assumed=tuple(assumed),
        joints=joints,
        chain=chain,
        poses={"home": home, "rest": home},
        output_map=None,
        gripper=None,
        gravity=GravityModel(chain, tuple(_bodies(tree, way, chain))),
        floor_z=0.0,
    )


def _chain(way: Sequence[UrdfJoint], turn: FloatArray) -> Chain:
    """The chain of the joints from the root to the tool link, whose frame is turned by ``turn`` (4, 4)."""
    origins: list[FloatArray] = []
    ahead = np.eye(4)
    for joint in way:
        ahead = ahead @ joint.origin
        if joint.kind != "fixed":
            origins.append(ahead)
            ahead = np.eye(4)
    return Chain.from_joints(origins, [joint.axis for joint in way if joint.kind != "fixed"], ahead @ turn)


def _joint(joint: UrdfJoint, name: str) -> Joint:
    lower, upper = joint.limits or (0.0, 0.0)
    speed = joint.speed or ASSUMED_SPEED
    return Joint(
        name=name,
        title=_title(joint.name),
        lower=lower,
        upper=upper,
        speed=speed,
        acceleration=speed / SPEED_UP_S,
        jerk=speed / SPEED_UP_S / JERK_UP_S,
        stall_torque=joint.effort or None,
    )


def _bodies(tree: UrdfTree, way: Sequence[UrdfJoint], chain: Chain) -> Iterable[Body]:
    """The masses that each joint carries, in its link's frame; branches off the chain at their zero."""
    frames = chain.frames(np.zeros(chain.n))
    poses, carrier = {tree.root: np.eye(4)}, {tree.root: -1}
    on_way = {joint.name: joint for joint in way}
    for written in tree.below(tree.root):
        joint = on_way.get(written.name, written)
        poses[joint.child] = poses[joint.parent] @ joint.origin
        carrier[joint.child] = carrier[joint.parent] + (joint.name in on_way and joint.kind != "fixed")
    for name, link in tree.links.items():
        k = carrier[name]
        if link.mass_kg > 0.0 and k >= 0:
            frame = frames[k + 1]
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


# ``Robot.assumed``: what the file leaves open, and what armctl takes instead, a sentence each.


def _about_tool(
    tree: UrdfTree, tool: UrdfTool, names: Sequence[str], chain: Chain, approach: str
) -> Iterable[str]:
    file, geometry = tree.path.name, recognise(chain)
    if tool.why:
        left_out = ", ".join(tool.left_out)
        out = f"; taken for the gripper's own and left out: {left_out}" if left_out else ""
        yield f"the tool is the link {tool.link}, {tool.why}{out} (another: {file}#LINK)"
    ahead, rolls = _ahead(chain)
    if ahead is not None and approach == "z":  # frames of ROS often have x ahead, where armctl takes z
        along = chain.forward(np.zeros(chain.n))[:3, :3].T @ ahead
        axes = [axis for axis, (sign, k) in AXES.items() if (-along[k] if sign else along[k]) > _ALONG]
        if axes and axes != ["z"]:
            none = ", so that no pitch can be asked for" if geometry and geometry.tool_angle is None else ""
            where = f"along the axis of {names[-1]}" if rolls else "along the last link"
            yield (
                f"pitch is the elevation of the tool's z axis; in the link {tool.link} not z but {axes[0]} "
                f"points ahead, {where}{none} ({file}#{tool.link},approach={axes[0]} takes {axes[0]} for z)"
            )
    if geometry is not None:
        lean = math.atan2(float(np.hypot(*geometry.frame[:2, 2])), float(geometry.frame[2, 2]))
        if lean > _LEANS:
            yield (
                f"pitch is measured from the plane that the axis of {names[0]} stands on, not from the "
                f"horizontal: that axis leans by {math.degrees(lean):.1f}° in the root frame"
            )


def _ahead(chain: Chain) -> tuple[FloatArray | None, bool]:
    """Where the tool points by the arm's build, all joints at zero: a unit vector (3,) in the base frame.

    With it, whether that is the axis of the last joint, which rolls the tool; else it is the last link. None
    where the arm ends on the axis of a joint that does not roll.
    """
    points, axes = chain.axes()
    tip, last = chain.forward(np.zeros(chain.n))[:3, 3], axes[-1]
    if chain.n > 1 and np.linalg.norm(np.cross(last, axes[-2])) > math.sin(math.acos(_ALONG)):
        return last * math.copysign(1.0, float((tip - points[-2]) @ last)), True
    link = tip - points[-1]
    across = link - (link @ last) * last
    length = float(np.linalg.norm(across))
    return (across / length if length > _SHORTEST else None), False


def _about_fixed(way: Sequence[UrdfJoint]) -> Iterable[str]:
    """Joints that are held at one angle, and right angles that were rounded."""
    held = [f"{one.name} at {math.degrees(one.held_at):.1f}°" for one in way if one.held_at is not None]
    if held:
        yield f"fixed, as both limits are the same: {', '.join(held)}"
    total, shift, reach = Rounding(), 0.0, 0.0
    for joint in reversed(way):
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


def _about_joints(moving: Sequence[UrdfJoint], names: Sequence[str]) -> Iterable[str]:
    pairs = list(zip(names, moving, strict=True))
    if endless := [name for name, joint in pairs if joint.kind == "continuous"]:
        yield f"limits of ±180° of the continuous joints: {', '.join(endless)}"
    if slow := [name for name, joint in pairs if joint.speed == 0]:
        yield f"a speed of 60°/s of joints without one: {', '.join(slow)}"
