"""The chain of an arm: the joints from the root of its file to the tool link.

What slides or floats ahead of the first joint that turns is held at rest. Where rods keep a hand level, the
file has joints that follow others (``<mimic>``). Two of them on one axis are one link that turns by both.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError, RobotFileError
from armctl.kinematics import Chain
from armctl.kinematics.families.registry import has_closed_form
from armctl.lazy_dataclass import dataclass
from armctl.robot.robot import Robot
from armctl.robot.urdf.tool import EXACT, UrdfTool
from armctl.robot.urdf.tree import Rounding, UrdfJoint, UrdfTree, is_free

_SAME = 1e-9
"""how far apart two axes may be that are one: sine, and metres"""
_ALONG = math.cos(math.radians(1))
"""cosine of the angle up to which two axes are along each other"""


@dataclass(frozen=True, slots=True)
class ArmChain:
    """A chain, and which link of it each joint of the file turns."""

    chain: Chain
    links: tuple[UrdfJoint, ...]
    """of each link, the joint that turns it"""
    link_of: Mapping[str, int]
    """by the names of the joints"""


def arm_way(tree: UrdfTree, tool: str, *, exact: bool = False) -> list[UrdfJoint]:
    """The joints from the root link to a link, fixed ones too, as an arm has them; refuses what slides.

    ``exact``: nearly right angles are taken as right.
    """
    way = [joint.without_noise() if exact else joint for joint in tree.route(tool)]
    for k, joint in enumerate(way):
        if joint.kind in ("revolute", "continuous", "fixed"):
            continue
        if joint.mimics is None and all(one.kind == "fixed" for one in way[:k]):
            way[k] = joint.at_rest()
            continue
        raise RobotFileError(
            f'<joint name="{joint.name}">: type="{joint.kind}": the chain of an arm holds revolute, '
            "continuous and fixed joints; an arm that ends ahead of it is named as "
            f"{tree.path.name}#{joint.parent}, and if the joint never moves, make it fixed"
        )
    _refuse_lift(tree, way)
    return [joint.settled() for joint in _following(way)]


def _refuse_lift(tree: UrdfTree, way: Sequence[UrdfJoint]) -> None:
    """Refuse to hold still what alone moves the tool along the axes of all joints: the lift of a SCARA."""
    axes = [tree.pose(joint.child)[:3, :3] @ joint.axis for joint in way if joint.kind != "fixed"]
    for joint in tree.route(way[-1].child) if axes else ():
        along = tree.pose(joint.child)[:3, :3] @ joint.axis
        if joint.kind == "prismatic" and min(abs(float(along @ axis)) for axis in axes) > _ALONG:
            raise RobotFileError(
                f'<joint name="{joint.name}">: type="prismatic": it slides along the axes of all joints that '
                "turn, as in a SCARA. Without it the tool stays in a plane, and armctl moves only joints "
                'that turn. If it really stays where it is, make it type="fixed" at that height'
            )


def _following(way: Sequence[UrdfJoint]) -> Iterator[UrdfJoint]:
    """The joints; those that follow others as they follow a joint of their own."""
    joints = {joint.name: joint for joint in way}
    for joint in way:
        if joint.kind == "fixed" or joint.mimics is None:
            yield joint
            continue
        factor, offset, leader, seen = joint.multiplier, joint.offset, joints.get(joint.mimics), {joint.name}
        while leader is not None and leader.mimics is not None and leader.name not in seen:
            seen.add(leader.name)
            offset += factor * leader.offset
            factor *= leader.multiplier
            leader = joints.get(leader.mimics)
        if leader is None or not is_free(leader):
            raise RobotFileError(
                f'<joint name="{joint.name}">: follows the joint "{joint.mimics}", which does not turn on '
                "the way to the tool; take its <mimic> out, or make it fixed"
            )
        yield replace(joint.turned(offset), mimics=leader.name, multiplier=factor, offset=0.0)


def arm_chain(tree: UrdfTree, way: Sequence[UrdfJoint], turn: FloatArray) -> ArmChain:
    """The chain of the joints from the root to the tool link, whose frame is moved by ``turn`` (4, 4)."""
    names = [joint.name for joint in way if is_free(joint)]
    links: list[UrdfJoint] = []
    origins: list[FloatArray] = []
    rows: list[FloatArray] = []
    link_of: dict[str, int] = {}
    ahead = np.eye(4)
    for joint in way:
        ahead = ahead @ joint.origin
        if joint.kind == "fixed":
            continue
        row = np.zeros(len(names))
        row[names.index(joint.mimics or joint.name)] = joint.multiplier
        if links and (sense := _shared_axis(tree, links[-1], joint, ahead)):
            links.pop()
            row += sense * rows.pop()
            ahead = origins.pop() @ ahead
        links.append(joint)
        origins.append(ahead)
        rows.append(row)
        link_of[joint.name] = len(links) - 1
        ahead = np.eye(4)
    chain = Chain.from_joints(origins, [joint.axis for joint in links], ahead @ turn)
    if len(links) > len(names):
        chain = Chain(chain.segments, chain.tail, coupling=rows)
    return ArmChain(chain, tuple(links), link_of)


def _shared_axis(tree: UrdfTree, joint: UrdfJoint, other: UrdfJoint, T: FloatArray) -> int:
    """1 or -1 where two joints that follow others turn about one axis, in one sense or in both; else 0.

    ``T`` (4, 4) is the frame of the second in that of the first. Between them is nothing that can be seen.
    """
    if joint.mimics is None or other.mimics is None:
        return 0
    if any(tree.links[link].is_solid for link in tree.body(joint.child)):
        return 0
    axis = T[:3, :3] @ other.axis
    apart = max(np.linalg.norm(np.cross(joint.axis, axis)), np.linalg.norm(np.cross(joint.axis, T[:3, 3])))
    return 0 if apart > _SAME else int(np.sign(joint.axis @ axis))


def require_solvable(robot: Robot, way: Sequence[UrdfJoint]) -> None:
    """Refuse rods that no solver takes, by the name of the joint that follows."""
    if robot.chain.coupling is None:
        return
    try:
        robot.inverse_kinematics  # noqa: B018
    except InputError as cause:
        joint = next(one for one in way if one.mimics is not None and one.kind != "fixed")
        raise RobotFileError(
            f'<joint name="{joint.name}">: follows the joint "{joint.mimics}": {cause}. If that joint has a '
            "motor of its own, take its <mimic> out; if it does not turn, make it fixed"
        ) from cause


# What ``Robot.assumed`` says of joints that are held, and of right angles that were rounded.

_UNSEEN = 1e-9
"""a shift of the tool that is not worth a word [m]"""
MOST_TOLD = 8
"""shapes that were passed over, told by name"""


def about_fixed(way: Sequence[UrdfJoint]) -> Iterable[str]:
    """Joints that are held where they are, and right angles that were rounded."""
    if held := [joint.held for joint in way if joint.held is not None]:
        yield f"fixed: {'; '.join(held)}"
    total, shift = _rounding(way)
    if shift < _UNSEEN:
        return
    parts: list[str] = []
    if total.quarters:
        kinds = ", ".join(sorted(set(total.quarters)))
        parts.append(f"{_count(len(total.quarters), 'angle')} written as rounded quarter turns ({kinds})")
    if total.zeros:
        parts.append(f"{_count(total.zeros, 'number')} below 1e-6 written for zero")
    if total.noise:
        parts.append(f"what is nearly right ({_noisy(total)})")
    yield f"exact: {' and '.join(parts)}; the tool moves by at most {1000 * shift:.2g} mm"


def _rounding(way: Sequence[UrdfJoint]) -> tuple[Rounding, float]:
    """What was rounded on the way to the tool, and how far that moves the tool, at most [m]."""
    total, shift, reach = Rounding(), 0.0, 0.0
    for joint in reversed(way):
        total = joint.rounding + total
        shift += joint.rounding.shift * reach + joint.rounding.moved
        reach += float(np.linalg.norm(joint.origin[:3, 3]))
    return total, shift


def _noisy(rounding: Rounding) -> str:
    return ", ".join(rounding.noise[:MOST_TOLD]) + ", …" * (len(rounding.noise) > MOST_TOLD)


def about_noise(tree: UrdfTree, tool: UrdfTool, chain: Chain, turn: FloatArray) -> Iterable[str]:
    """Angles that are nearly right, where they cost the closed form."""
    way = arm_way(tree, tool.link, exact=True)
    total, shift = _rounding(way)
    if not total.noise or chain.coupling is not None or has_closed_form(chain):
        return
    if not has_closed_form(arm_chain(tree, way, turn).chain):
        return
    yield (
        f"off a right angle by a little: {_noisy(total)}. So no closed form fits the arm: solutions are "
        "searched, which is slower and may miss some. If right angles are meant, write exact = true into the "
        f"side file (or {tree.path.name}#{EXACT}yes): the tool moves by at most {1000 * shift:.2g} mm"
    )


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
