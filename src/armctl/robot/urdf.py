"""A robot from a URDF file: one serial chain of turning joints, its limits and its masses."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.kinematics import Body, Chain, GravityModel
from armctl.kinematics.angles import rest_angle
from armctl.kinematics.chain import frame_along
from armctl.kinematics.yaw_pitch_roll.geometry import recognise
from armctl.robot.parts import JERK_UP_S, Joint
from armctl.robot.robot import Robot
from armctl.robot.urdf_file import Rounding, UrdfJoint, fixed_where_held, limits_of, read_urdf_file
from armctl.robot.urdf_tree import UrdfTool, UrdfTree, named_tool, suggested_tool

ASSUMED_SPEED = math.radians(60)
"""[rad/s]"""
SPEED_UP_S = 1 / 6
"""time from rest to full speed [s]"""
AXES = {f"{sign}{axis}": (sign, k) for sign in ("", "-") for k, axis in enumerate("xyz")}
"""the axes of a link, as ``approach=`` names them: sign and column"""
_NAMED = re.compile(r"(?P<path>.+?\.urdf)(?:#(?P<wanted>.*))?", re.IGNORECASE | re.DOTALL)
_APPROACH = "approach="
_UNSEEN = 1e-9
"""a shift of the tool that is not worth a word [m]"""
_ALONG = math.cos(math.radians(1))
"""cosine from which on two directions are the same to somebody who looks at the arm"""
_LEANS = 1e-6
"""angle from which on a base is not upright [rad]"""
_SHORTEST = 1e-6
"""length from which on a link has a direction [m]"""


@dataclass(frozen=True, slots=True)
class UrdfName:
    """``arm.urdf``, ``arm.urdf#link``, ``arm.urdf#link,approach=x`` or ``arm.urdf#approach=x``."""

    path: Path
    link: str | None = None
    """the tool link; None: the one that the file suggests"""
    approach: str = "z"
    """the axis of the tool link that armctl takes for the tool's z, a key of ``AXES``"""

    @classmethod
    def of(cls, name: str | Path) -> UrdfName | None:
        """Read a robot's name; None where it names no URDF file.

        Raises:
            RobotFileError: something behind the ``#`` that says neither a link nor an axis.
        """
        text = name.as_posix() if isinstance(name, Path) else name  # a link's own slashes are kept everywhere
        match = _NAMED.fullmatch(text)
        if match is None:
            return None
        path, wanted = Path(match["path"]), match["wanted"]
        if wanted is None:
            return cls(path)
        parts = [part.strip() for part in wanted.split(",")]
        axes = [part.removeprefix(_APPROACH) for part in parts if part.startswith(_APPROACH)]
        links = [part for part in parts if not part.startswith(_APPROACH)]
        if "" in parts or len(links) > 1 or len(axes) > 1 or not set(axes) <= set(AXES):
            raise RobotFileError(
                f"{text}: behind the # stands the name of the tool link, {_APPROACH}AXIS "
                f"({', '.join(AXES)}), or both with a comma between; got {wanted!r}"
            )
        return cls(path, links[0] if links else None, axes[0] if axes else "z")

    @property
    def direction(self) -> FloatArray:
        """(3,) the approach axis in the tool link's frame."""
        sign, column = AXES[self.approach]
        return np.eye(3)[column] * (-1.0 if sign else 1.0)


def is_urdf(name: str | Path) -> bool:
    """True for the name of a URDF robot: a path that ends in ``.urdf``, with or without a tool link."""
    return _NAMED.fullmatch(str(name)) is not None


def load_urdf(name: UrdfName) -> Robot:
    """The arm of a URDF file.

    The base frame is the root link, the tool frame the link that ``name`` or else ``suggested_tool`` picks,
    turned so that z is the approach axis of ``name``, and the zero of every joint that of the file. What lies
    off the chain counts as mass only.

    Raises:
        RobotFileError: a file that cannot be read, contradicts itself, or holds no arm of turning joints.
    """
    path = name.path
    tree = UrdfTree(read_urdf_file(path))
    tool = suggested_tool(tree) if name.link is None else named_tool(tree, name.link)
    way = [fixed_where_held(joint, path) for joint in tree.chain(tool.link)]
    moving = [joint for joint in way if joint.kind != "fixed"]
    if not moving:
        raise RobotFileError(f"{path}: no joint turns between {tree.root} and {tool.link}")
    chain = _chain(way, frame_along(name.direction))
    names = _distinct(_plain(joint.name, "joint") for joint in moving)
    joints = tuple(_joint(joint, plain, path) for joint, plain in zip(moving, names, strict=True))
    home = np.array([rest_angle(joint.lower, joint.upper) for joint in joints])
    turned = "" if name.approach == "z" else f", whose {name.approach} axis is taken for the tool's z"
    title = tree.file.name or path.stem
    return Robot(
        name=_plain(title, "arm"),
        title=title,
        source=f"URDF file {path.name}, from {tree.root} to {tool.link}{turned}",
        assumed=(
            *_tool(name, tool),
            *_approach(name, tool, names, chain),
            *_leaning(names, chain),
            *_held(way),
            *_rounding(way),
            *_numbers(moving, names),
        ),
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
    axes: list[FloatArray] = []
    ahead = np.eye(4)
    for joint in way:
        ahead = ahead @ joint.origin
        if joint.kind != "fixed":
            origins.append(ahead)
            axes.append(joint.axis)
            ahead = np.eye(4)
    return Chain.from_joints(origins, axes, ahead @ turn)


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


def _bodies(tree: UrdfTree, way: Sequence[UrdfJoint], chain: Chain) -> Iterable[Body]:
    """The masses that each joint carries, in its link's frame; branches off the chain at their zero."""
    frames = chain.frames(np.zeros(chain.n))
    poses, carrier = {tree.root: np.eye(4)}, {tree.root: -1}
    on_way = {joint.name: joint for joint in way}
    for written in tree.below(tree.root):
        joint = on_way.get(written.name, written)
        poses[joint.child] = poses[joint.parent] @ joint.origin
        carrier[joint.child] = carrier[joint.parent] + (joint.name in on_way and joint.kind != "fixed")
    for name, link in tree.file.links.items():
        k = carrier[name]
        if link.mass_kg == 0.0 or k < 0:
            continue
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


# ``Robot.assumed``: what the file leaves open, and what armctl takes otherwise, a sentence each.


def _tool(name: UrdfName, tool: UrdfTool) -> Iterable[str]:
    if name.link is None:
        out = (
            f"; taken for the gripper's own and left out: {', '.join(tool.left_out)}" if tool.left_out else ""
        )
        yield f"the tool is the link {tool.link}, {tool.why}{out} (another: {name.path.name}#LINK)"


def _approach(name: UrdfName, tool: UrdfTool, names: Sequence[str], chain: Chain) -> Iterable[str]:
    """Frames of ROS often have x ahead, where armctl takes z."""
    ahead, rolls = _ahead(chain)
    if ahead is None or name.approach != "z":
        return
    along = chain.forward(np.zeros(chain.n))[:3, :3].T @ ahead
    axes = [axis for axis, (sign, k) in AXES.items() if (-along[k] if sign else along[k]) > _ALONG]
    if not axes or axes == ["z"]:
        return
    geometry = recognise(chain)
    none = ", so that no pitch can be asked for" if geometry and geometry.tool_angle is None else ""
    where = f"along the axis of {names[-1]}" if rolls else "along the last link"
    yield (
        f"pitch is the elevation of the tool's z axis; in the link {tool.link} not z but {axes[0]} points "
        f"ahead, {where}{none} ({name.path.name}#{tool.link},approach={axes[0]} takes {axes[0]} for z)"
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


def _leaning(names: Sequence[str], chain: Chain) -> Iterable[str]:
    geometry = recognise(chain)
    if geometry is None:
        return
    lean = math.atan2(float(np.hypot(*geometry.frame[:2, 2])), float(geometry.frame[2, 2]))
    if lean > _LEANS:
        yield (
            f"pitch is measured from the plane that the axis of {names[0]} stands on, not from the "
            f"horizontal: that axis leans by {math.degrees(lean):.1f}° in the root frame"
        )


def _held(way: Sequence[UrdfJoint]) -> Iterable[str]:
    held = [
        f"{joint.name} at {math.degrees(joint.held_at):.1f}°" for joint in way if joint.held_at is not None
    ]
    if held:
        yield f"fixed, as both limits are the same: {', '.join(held)}"


def _rounding(way: Sequence[UrdfJoint]) -> Iterable[str]:
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


def _numbers(moving: Sequence[UrdfJoint], names: Sequence[str]) -> Iterable[str]:
    pairs = list(zip(names, moving, strict=True))
    endless = [name for name, joint in pairs if joint.kind == "continuous"]
    if endless:
        yield f"limits of ±180° of the continuous joints: {', '.join(endless)}"
    slow = [name for name, joint in pairs if joint.limit is None or joint.limit.velocity == 0]
    if slow:
        yield f"a speed of 60°/s of joints without one: {', '.join(slow)}"
    yield "accelerations: full speed within 1/6 s"
    yield "home and rest poses: all joints at zero, or at the limit next to it"
    yield "the floor, at the height of the base frame"
