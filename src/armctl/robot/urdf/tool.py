"""Which link of a URDF file is the tool, as far as its joints and names give it away."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from armctl.errors import UnclearArmError
from armctl.robot.urdf.tree import UrdfJoint, UrdfTree

TOOL_NAMES = ("tool0", "tcp", "tool", "ee_link", "end_effector", "gripper_base")
"""what the tool link is called by custom, wherever in the file it is; the surest first"""
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_TOOL_WORDS = {"tool", "tcp", "ee", "effector", "eef", "grasp", "gripperframe"}
"""the customary names count in other names too: ``ee_gripper_link``"""
_SENSOR = {"camera", "cam", "imu", "sensor", "optical"}
_FINGER = {"finger", "fingers", "jaw", "jaws", "claw", "claws", "knuckle", "pincer"}
_STILL = {"fixed", "static"}
_GRIPPER = {"gripper", "grip"}
_ARM = {"roll", "rotate", "rotation", "rot", "pitch", "yaw", "wrist", "pan", "tilt", "twist", "arm", "to"}


@dataclass(frozen=True, slots=True)
class UrdfTool:
    """The tool link, and why it is that one."""

    link: str
    why: str
    left_out: tuple[str, ...] = ()
    """joints that turn, and are taken for the gripper's own"""


def suggested_tool(tree: UrdfTree) -> UrdfTool:
    """The link that is most likely the tool.

    One with a customary name. Without one, the arm follows the moving joints from the root. It ends where
    none is left, or at a gripper: at a link with several moving joints that slide or follow each other, or
    whose joints are the gripper's own by their names. From there it goes on over fixed joints, to the link
    that has a name as tool frames have, else to the last one that is no camera. Refuses to choose of several.
    """
    if tools := customary_tools(tree.links):
        link = _only(tree, tools)
        own = tuple(joint.name for joint in tree.below(link) if _turns(joint))
        return UrdfTool(link, "which has a customary name", own)
    end = _end_of_motion(tree)
    left_out = tuple(joint.name for joint in tree.below(end) if _turns(joint))
    fixed = list(_fixed_below(tree, end))
    frames = [link for link in fixed if is_tool_frame(link)]
    last = [link for link in frames if not set(_fixed_below(tree, link)) & set(frames)]
    if last:
        return UrdfTool(_only(tree, last), "which has a name as tool frames have", left_out)
    leaves = [link for link in fixed if not tree.children(link) and not _words(link) & _SENSOR]
    if leaves:
        return UrdfTool(_only(tree, leaves), "the last one", left_out)
    return UrdfTool(end, "which the last joint of the arm moves", left_out)


def customary_tools(links: Iterable[str]) -> list[str]:
    """The links with the surest of ``TOOL_NAMES`` that any has, also behind a prefix (``left_tool0``)."""
    links = list(links)
    for name in TOOL_NAMES:
        behind = tuple(f"{mark}{name}" for mark in "_-/.")
        tools = [link for link in links if link == name] or [link for link in links if link.endswith(behind)]
        if tools:
            return tools
    return []


def is_tool_frame(link: str) -> bool:
    """True where a link's name is one that tool frames have: ``ee_gripper_link``, ``gripper_frame_link``."""
    words = _words(link)
    usual = bool(words & _TOOL_WORDS) or {"gripper", "frame"} <= words
    return usual and not words & (_SENSOR | _FINGER)


def _fixed_below(tree: UrdfTree, link: str) -> Iterator[str]:
    """The links that a link carries with no moving joint in between."""
    waiting = [link]
    while waiting:
        fixed = [joint.child for joint in tree.children(waiting.pop(0)) if joint.kind == "fixed"]
        yield from fixed
        waiting += fixed


def _end_of_motion(tree: UrdfTree) -> str:
    """The link that the last moving joint of the arm carries."""
    link = tree.root
    while True:
        branches = {joint.child: [joint, *tree.below(joint.child)] for joint in tree.children(link)}
        moving = {
            child: movers
            for child, joints in branches.items()
            if (movers := [joint for joint in joints if joint.kind != "fixed"])
        }
        arms = [c for c, joints in moving.items() if any(_turns(j) and not _is_gripper(j) for j in joints)]
        if all(map(_only_gripper, moving.values())) or _are_fingers(moving, arms):
            return link
        if len(arms) > 1:
            ends = [joint.child for arm in arms for joint in branches[arm] if not tree.children(joint.child)]
            raise _unclear(tree, ends)
        (link,) = arms or moving


def _only_gripper(moving: list[UrdfJoint]) -> bool:
    """True when all that moves in a branch is the gripper's own, or follows that."""
    free = [joint for joint in moving if joint.mimics is None]
    return bool(free) and all(map(_is_gripper, free))


def _are_fingers(moving: dict[str, list[UrdfJoint]], arms: list[str]) -> bool:
    if len(moving) < 2 or not arms:
        return len(moving) > 1
    names = {joint.name for joints in moving.values() for joint in joints}
    first = [joint for child, joints in moving.items() for joint in joints if joint.child == child]
    return len(arms) == 1 and any(joint.mimics in names for joint in first)


def _turns(joint: UrdfJoint) -> bool:
    return joint.kind in ("revolute", "continuous") and joint.mimics is None


def _is_gripper(joint: UrdfJoint) -> bool:
    """True where a joint's name or its link's says that it opens the gripper.

    A link called gripper says nothing: the wrist carries it. So does a joint ``gripper_roll`` or
    ``wrist_to_gripper``, and a ``Wrist_Roll`` that carries the ``Fixed_Jaw``.
    """
    own, carried = _words(joint.name), _words(joint.child)
    if own & _FINGER:
        return True
    return not (own & _ARM or carried & _STILL) and bool(carried & _FINGER or own & _GRIPPER)


def _words(name: str) -> set[str]:
    """``leftJaw_link1`` as left, jaw, link."""
    return {word.lower() for word in _WORD.findall(name)}


def _only(tree: UrdfTree, links: list[str]) -> str:
    if len(links) > 1:
        raise _unclear(tree, links)
    return links[0]


def _unclear(tree: UrdfTree, links: list[str]) -> UnclearArmError:
    links = sorted(links, key=_unlikely)
    error = UnclearArmError(
        f"several links could be the tool: {', '.join(links)}; name one: {tree.path.name}#{links[0]}"
    )
    error.links = links
    return error


def _unlikely(link: str) -> int:
    """How little a name is that of a tool."""
    if is_tool_frame(link):
        return 0
    words = _words(link)
    return 4 if words & _SENSOR else 1 if words & _GRIPPER else 2 if words & _FINGER else 3
