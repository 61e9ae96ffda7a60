"""A robot from a URDF file: one serial chain of turning joints, its limits, masses and shapes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import starmap
from pathlib import Path

import msgspec
import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.facts import About
from armctl.kinematics import Body, Chain, GravityModel
from armctl.kinematics.angles import rest_angle
from armctl.kinematics.families.offset_roll.roll_sweep import recognise_offset_roll
from armctl.kinematics.families.yaw_pitch_roll.geometry import recognise
from armctl.kinematics.frames import FixedFrame, frame_along
from armctl.robot.body.arm_body import BODY_ASSUMED, BODY_GUESSED
from armctl.robot.body.meshes import unreadable
from armctl.robot.parts import JERK_UP_S, MOST_JOINTS, Joint, Shape
from armctl.robot.robot import Robot
from armctl.robot.urdf.chain import (
    MOST_TOLD,
    ArmChain,
    about_fixed,
    about_noise,
    arm_chain,
    arm_way,
    require_solvable,
)
from armctl.robot.urdf.elements import read_urdf_file
from armctl.robot.urdf.package import UrdfSource
from armctl.robot.urdf.side_file import SideFile, ToolEntry, applied, read_side_file
from armctl.robot.urdf.tool import (
    AXES,
    GIVES,
    ArgumentValue,
    UrdfTool,
    Wanted,
    about_beside,
    about_tool,
    argument_texts,
    left_out,
    suggested_tool,
)
from armctl.robot.urdf.tree import UrdfJoint, UrdfTree, is_free
from armctl.robot.urdf.unpacking import arm_stem

ASSUMED_SPEED = math.radians(60)  # [rad/s]
SPEED_UP_S = 1 / 6
"""time from rest to full speed [s]"""
_FASTER = 1.001
"""a speed is raised by more than rounding"""

_ALONG = math.cos(math.radians(1))
"""cosine from which on two directions look the same"""
_LEANS = 1e-6
"""angle from which on a base is not upright [rad]"""
_SHORTEST = 1e-6
"""length from which on a link has a direction [m]"""
_MOST_SHAPES = 500
"""of an arm; further ones are passed over"""
_MOST_NAMED = 40
"""links of a file in one refusal"""


def load_urdf(path: Path, wanted: str | None, arguments: Mapping[str, ArgumentValue] | None = None) -> Robot:
    """The arm of a URDF or xacro file, of a zip file or folder with one, or of a side file that names one.

    The base frame is the root link, the tool frame the tool link, turned so that z is the approach axis, and
    the zero of every joint that of the file. What lies off the chain is carried with it. ``wanted``: as
    ``Wanted.of`` reads it. It goes before what the side file says; where neither names a link,
    ``suggested_tool`` does. ``arguments`` of a xacro file go before those that ``wanted`` names.
    """
    try:
        source = UrdfSource.at(path)
        side, document = read_side_file(source.side_path)
        wish = Wanted.of(wanted)
        link, approach = wish.link, wish.approach
        if link is not None:
            side = msgspec.structs.replace(side, tool=ToolEntry())
        side = msgspec.structs.replace(side, exact=side.exact or wish.exact)
        given = {**side.arguments, **wish.arguments, **(arguments or {})}
        tree = read_urdf_file(source, argument_texts(given))
        link = link or side.tool.link
        if link is not None and link not in tree.links:
            some = ", ".join(list(tree.links)[:_MOST_NAMED]) + ", …" * (len(tree.links) > _MOST_NAMED)
            raise RobotFileError(f"there is no link {link!r}; it has {some}")
        tool = suggested_tool(tree) if link is None else UrdfTool(link)
        robot, endless = _robot(source, tree, tool, approach or side.tool.approach, side)
        if document is None or source.side_path is None:
            return robot
        try:
            return applied(robot, side, document, endless)
        except RobotFileError as refusal:
            raise refusal.about(source.side_path.name) from refusal
    except RobotFileError as refusal:
        match refusal.reason:
            case About(thing) if Path(thing).is_relative_to(path):  # it names the file already
                raise
            case _:
                raise refusal.about(str(path)) from refusal


def _robot(
    source: UrdfSource, tree: UrdfTree, tool: UrdfTool, approach: str, side: SideFile
) -> tuple[Robot, list[str]]:
    """The arm as the file has it, with the tool of the side file; and the names of its continuous joints."""
    way = arm_way(tree, tool.link, exact=side.exact)
    moving = [joint for joint in way if is_free(joint)]
    if not moving:
        others = [joint.name for joint in tree.below(tree.root) if is_free(joint)]
        names = ", ".join(others[:MOST_TOLD]) + ", …" * (len(others) > MOST_TOLD)
        taken = f"; {names} look like a gripper or wheels; an arm with them is named: {tree.path.name}#LINK"
        raise RobotFileError(f"no joint turns between {tree.root} and {tool.link}{taken if others else ''}")
    if len(moving) > MOST_JOINTS:
        raise RobotFileError(
            f"{len(moving)} joints turn between {tree.root} and {tool.link}; an arm has {MOST_JOINTS} at most"
        )
    sign, column = AXES[approach]
    turn = frame_along(np.eye(3)[column] * (-1.0 if sign else 1.0))
    turn[:3, 3] = np.array(side.tool.offset_mm) / 1000
    arm = arm_chain(tree, way, turn)
    chain = arm.chain
    names = _distinct(_plain(joint.name, "joint") for joint in moving)
    joints = tuple(_joint(joint, name) for joint, name in zip(moving, names, strict=True))
    home = np.array([rest_angle(joint.lower, joint.upper) for joint in joints])
    carried = _carried(tree, way, arm)
    shapes, missing = _shapes(source, tree, carried) if side.body == "meshes" else ((), ())
    turned = "" if approach == "z" else f", whose {approach} axis is taken for the tool's z"
    offset = ", ".join(f"{value:g}" for value in side.tool.offset_mm)
    offset = f", the tool point at ({offset}) mm" if any(side.tool.offset_mm) else ""
    title = tree.name or arm_stem(source.file)
    assumed = [
        *_about_arguments(tree),
        *about_tool(tree, tool, way),
        *about_beside(tree, way),
        *_about_approach(tree, tool, names, chain, approach),
        *about_fixed(way),
        *about_noise(tree, tool, chain, turn),
        *_about_joints(moving, names, side),
        *_about_poses(side),
        *_about_shapes(tree, way, shapes, missing, side),
    ]
    robot = Robot(
        name=_plain(title, "arm"),
        title=title,
        source=f"URDF file {source.file.name}, from {tree.root} to {tool.link}{turned}{offset}",
        assumed=tuple(assumed),
        joints=joints,
        chain=chain,
        poses={"home": home, "rest": home},
        output_map=None,
        gripper=None,
        gravity=GravityModel(chain, tuple(_bodies(tree, carried))),
        floor_z=0.0,
        shapes=shapes,
        left_out=left_out(tree, way),
        named_links=() if chain.coupling is None else _named_links(arm.links),
    )
    require_solvable(robot, way)
    return robot, [name for name, joint in zip(names, moving, strict=True) if joint.kind == "continuous"]


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
        torque_is_effort=bool(joint.effort),
    )


def _carried(tree: UrdfTree, way: Sequence[UrdfJoint], arm: ArmChain) -> dict[str, FixedFrame]:
    """Which link of the chain carries each link (-1: none), and where; what is off the chain at its zero."""
    frames = arm.chain.frames(np.zeros(arm.chain.n))
    poses, carrier = {tree.root: np.eye(4)}, {tree.root: -1}
    on_way = {joint.name: joint for joint in way}
    for written in tree.below(tree.root):
        joint = on_way.get(written.name, written)
        poses[joint.child] = poses[joint.parent] @ joint.origin
        carrier[joint.child] = arm.link_of.get(joint.name, carrier[joint.parent])
    inverse = np.linalg.inv(frames).astype(np.float64)
    return {name: FixedFrame(carrier[name], inverse[carrier[name] + 1] @ poses[name]) for name in tree.links}


def _bodies(tree: UrdfTree, carried: Mapping[str, FixedFrame]) -> Iterable[Body]:
    """The masses that each joint carries, in its link's frame."""
    for name, link in tree.links.items():
        k, T = carried[name]
        if link.mass_kg > 0.0 and k >= 0:
            x, y, z = (T[:3, :3] @ link.com + T[:3, 3]).tolist()
            yield Body(joint=k, mass_kg=link.mass_kg, com_m=(x, y, z))


def _shapes(
    source: UrdfSource, tree: UrdfTree, carried: Mapping[str, FixedFrame]
) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """The shapes of all links in the frames of their carriers, and what was passed over.

    A link is what is drawn of it (visual); where that is missing, what is meant for collisions.
    """
    found: list[Shape] = []
    missing: list[str] = []
    files: dict[str, list[str]] = {}
    for name, link in tree.links.items():
        k, T = carried[name]
        missing += [f"{name}: {problem}" for problem in link.problems]
        here, lacking = _found(source, link.visual)
        note = ""
        if lacking or not here:
            instead, lost = _found(source, link.collision)
            if instead and not lost:
                here, note = instead, " (drawn: what is meant for collisions)"
        for file, why in lacking:
            files.setdefault(why + note, []).append(file)
        found += [replace(shape, pose=T @ shape.pose, link=k) for shape in here]
    if len(found) > _MOST_SHAPES:
        missing.insert(0, f"{len(found) - _MOST_SHAPES} shapes beyond the {_MOST_SHAPES} of an arm")
    return tuple(found[:_MOST_SHAPES]), (*dict.fromkeys(missing), *starmap(_lacking, files.items()))


def _lacking(why: str, files: Sequence[str]) -> str:
    """One line for all files that are passed over for one reason."""
    first, *more = dict.fromkeys(files)
    if not more:
        return f"{first} {why}"
    some = ", ".join(more[:MOST_TOLD]) + ", …" * (len(more) > MOST_TOLD)
    return f"{first} {why}; the same with {len(more)} more: {some}"


def _found(source: UrdfSource, shapes: Iterable[Shape]) -> tuple[list[Shape], list[tuple[str, str]]]:
    """The shapes with the paths of their files, and which files cannot be used, and why."""
    here: list[Shape] = []
    lacking: list[tuple[str, str]] = []
    for shape in shapes:
        if shape.kind != "mesh":
            here.append(shape)
        elif (path := source.find(shape.file)) is None:
            near = source.near(shape.file)
            lacking.append((shape.file, f"is not found, but {near} is there" if near else "is not found"))
        elif (why := unreadable(path)) is not None:
            lacking.append((path.name, why))
        else:
            here.append(replace(shape, file=str(path.absolute())))
    return here, lacking


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


def _named_links(links: Sequence[UrdfJoint]) -> tuple[tuple[str, str], ...]:
    names = _distinct(_plain(joint.name, "link") for joint in links)
    return tuple(zip(names, (_title(joint.name) for joint in links), strict=True))


def _title(name: str) -> str:
    """``shoulder_pan_joint`` as *Shoulder pan*."""
    words = re.sub(r"[_\W]+", " ", name).strip()
    short = re.sub(r" joint$", "", words, flags=re.IGNORECASE)
    return short[:1].upper() + short[1:]


# ``Robot.assumed``: what the file leaves open, and what armctl takes instead, a sentence each.


def _about_arguments(tree: UrdfTree) -> Iterable[str]:
    """Arguments that are as the file has them, and files that were left out."""
    left = [f"{one.name}{GIVES}{one.value}" for one in tree.arguments if one.value == one.default]
    if left:
        more = ", …" * (len(left) > MOST_TOLD)
        other = f"others: armctl check {tree.path.name} NAME{GIVES}VALUE"
        yield f"arguments as the file has them: {', '.join(left[:MOST_TOLD])}{more} ({other})"
    if tree.left_out:
        yield f"left out, as only simulators and controllers need it: {', '.join(tree.left_out)}"


def _about_approach(
    tree: UrdfTree, tool: UrdfTool, names: Sequence[str], chain: Chain, approach: str
) -> Iterable[str]:
    """Which way the tool points, and what its pitch is measured from."""
    if chain.coupling is not None:
        return  # rods keep the hand at its pitch
    file, beside = tree.path.name, recognise_offset_roll(chain)
    geometry = recognise(chain) if beside is None else beside.plane
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
        if not axes and rolls and geometry is not None and geometry.tool_angle is None:
            yield (
                f"no axis of the link {tool.link} lies along the axis of {names[-1]}, so that no pitch can "
                f"be asked for: a link with such an axis, on a fixed joint, can be named ({file}#LINK)"
            )
    if geometry is not None and geometry.tool_angle is not None:
        lean = math.atan2(float(np.hypot(*geometry.frame[:2, 2])), float(geometry.frame[2, 2]))
        if lean > _LEANS:
            yield (
                f"pitch is measured from the plane that the axis of {names[0]} stands on, not from the "
                f"horizontal: that axis leans by {math.degrees(lean):.1f}° in the root frame"
            )


def _ahead(chain: Chain) -> tuple[FloatArray | None, bool]:
    """Where the tool points by the arm's build, all joints at zero: a unit vector (3,) in the base frame.

    With it, whether that is the axis of the last joint, which rolls the tool; else it is the last link. None
    where the arm ends on the axis of a joint that does not roll, or beside a joint that may point either way.
    """
    points, axes = chain.axes()
    tip, last = chain.forward(np.zeros(chain.n))[:3, 3], axes[-1]
    if chain.n > 1 and np.linalg.norm(np.cross(last, axes[-2])) > math.sin(math.acos(_ALONG)):
        wrist = tip - points[-2]
        wrist -= (wrist @ axes[-2]) * axes[-2]
        along = float(wrist @ last)
        if abs(along) < 0.5 * np.linalg.norm(wrist):
            return None, False
        return last * math.copysign(1.0, along), True
    link = tip - points[-1]
    across = link - (link @ last) * last
    length = float(np.linalg.norm(across))
    return (across / length if length > _SHORTEST else None), False


def _about_joints(moving: Sequence[UrdfJoint], names: Sequence[str], side: SideFile) -> Iterable[str]:
    pairs = list(zip(names, moving, strict=True))
    said = {entry.name: entry for entry in side.joints}

    def silent(name: str, key: str) -> bool:
        return name not in said or getattr(said[name], key) is None

    endless = [
        name
        for name, joint in pairs
        if joint.kind == "continuous" and joint.limits == (-math.pi, math.pi) and silent(name, "limit_deg")
    ]
    if told := [
        joint.limits_told for name, joint in pairs if joint.limits_told and silent(name, "limit_deg")
    ]:
        yield f"limits: {'; '.join(told)} (limit_deg in the side file sets others)"
    if endless:
        yield f"limits of ±180° of the continuous joints: {', '.join(endless)}"
    if slow := [name for name, joint in pairs if joint.speed == 0 and silent(name, "speed_deg_s")]:
        yield f"a speed of 60°/s of joints without one, or with one beyond 3600°/s: {', '.join(slow)}"
    faster = [
        f"{name} {said[name].speed_deg_s:g} °/s instead of {math.degrees(joint.speed):.3g} °/s"
        for name, joint in pairs
        if joint.speed
        and not silent(name, "speed_deg_s")
        and (said[name].speed_deg_s or 0) > _FASTER * math.degrees(joint.speed)
    ]
    if faster:
        yield f"faster than the URDF file allows, by the side file: {', '.join(faster)}"
    if any(silent(name, "acceleration_deg_s2") for name in names):
        yield "accelerations: full speed within 1/6 s"


def _about_poses(side: SideFile) -> Iterable[str]:
    unsaid = [name for name in ("home", "rest") if name not in side.poses]
    if unsaid == ["rest"]:
        yield "rest pose: as the home pose"
    elif unsaid:
        which = f"{' and '.join(unsaid)} pose{'s' * (len(unsaid) - 1)}"
        yield f"{which}: all joints at zero, or at the limit next to it"
    if side.floor is None:
        yield "the floor, at the height of the base frame"


def _about_shapes(
    tree: UrdfTree, way: Sequence[UrdfJoint], shapes: Sequence[Shape], missing: Sequence[str], side: SideFile
) -> Iterable[str]:
    if shapes:
        yield BODY_ASSUMED
        on_way = {joint.name for joint in way}
        idle = [
            joint.name
            for joint in tree.below(tree.root)
            if joint.kind != "fixed" and joint.name not in on_way
        ]
        if idle:
            yield f"no joint of the arm, drawn and checked as it is at zero: {', '.join(idle)}"
    elif side.look is None or not side.look.solids:
        yield BODY_GUESSED
    for text in missing[:MOST_TOLD]:
        yield f"passed over: {text}"
    if len(missing) > MOST_TOLD:
        yield f"passed over: {len(missing) - MOST_TOLD} more shapes"
