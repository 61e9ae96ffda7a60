"""What the names in a URDF file give away: a usual tool frame, a sensor, a joint of the gripper."""

from __future__ import annotations

import re
from collections.abc import Iterable

from armctl.robot.urdf_file import UrdfJoint

TOOL_NAMES = ("tool0", "tcp", "tool", "ee_link", "end_effector", "gripper_base")
"""what the tool link is called by custom, wherever in the file it is; the surest first"""

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_OF_OTHER_LINKS = {"link", "end", "base", "gripper"}
_SENSOR = {"camera", "cam", "imu", "sensor", "optical"}
_FINGER = {"finger", "fingers", "jaw", "jaws", "claw", "claws", "knuckle", "pincer"}
_GRIPPER = {"gripper", "grip"}
_ARM = {"roll", "rotate", "rotation", "rot", "pitch", "yaw", "wrist", "pan", "tilt", "twist", "arm", "to"}


def customary_tools(links: Iterable[str]) -> list[str]:
    """The links with the surest of ``TOOL_NAMES`` that any has, also behind a prefix (``left_tool0``)."""
    links = list(links)
    for name in TOOL_NAMES:
        tools = [link for link in links if link == name] or [link for link in links if _ends_in(link, name)]
        if tools:
            return tools
    return []


def is_tool_frame(link: str) -> bool:
    """True where a link's name is one that tool frames have: ``ee_gripper_link``, ``gripper_frame_link``."""
    words = _words(link)
    usual = bool(words & _TOOL_WORDS) or {"gripper", "frame"} <= words
    return usual and not words & (_SENSOR | _FINGER)


def is_sensor(link: str) -> bool:
    """True where a link's name says that it is a camera or another sensor, not what the arm works with."""
    return bool(_words(link) & _SENSOR)


def is_of_gripper(joint: UrdfJoint) -> bool:
    """True where a joint's name or its link's says that it opens the gripper.

    A link called gripper says nothing: the wrist carries it. So does a joint ``gripper_roll`` or
    ``wrist_to_gripper``.
    """
    own, carried = _words(joint.name), _words(joint.child)
    return bool((own | carried) & _FINGER or (own & _GRIPPER and not own & _ARM))


def _words(name: str) -> set[str]:
    """``leftJaw_link1`` as left, jaw, link."""
    return {word.lower() for word in _WORD.findall(name)}


def _ends_in(link: str, name: str) -> bool:
    return any(link.endswith(f"{mark}{name}") for mark in "_-/.")


# What is left of the customary names counts in other names too: ``ee_gripper_link``.
_TOOL_WORDS = {word for name in TOOL_NAMES for word in _words(name)} - _OF_OTHER_LINKS | {
    "eef",
    "grasp",
    "gripperframe",
}
