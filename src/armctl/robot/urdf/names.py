"""What the names of links and joints tell: tools, grippers, cameras, wheels. Many names tell nothing."""

from __future__ import annotations

import re
from collections.abc import Iterable

TOOL_NAMES = ("tool0", "tcp", "tool", "ee_link", "end_effector", "gripper_base")
"""what the tool link is called by custom, wherever in the file it is; the surest first"""
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_TOOL_WORDS = {"tool", "tcp", "ee", "effector", "eef", "grasp", "gripperframe"}
"""the customary names count in other names too: ``ee_gripper_link``"""
_CAMERA = {"camera", "cameras", "cam"}
_SENSOR = _CAMERA | {"imu", "sensor", "optical", "accelerometer", "led"}
_FINGER = {"finger", "fingers", "jaw", "jaws", "claw", "claws", "knuckle", "pincer", "thumb", "pinky"}
_STILL = {"fixed", "static"}
_MOVING = {"moving", "movable"}
_GRIPPER = {"gripper", "grip"}
_HAND = _GRIPPER | {"hand", "palm"}
_TURN = {"roll", "rotate", "rotation", "rot", "pitch", "yaw", "wrist", "pan", "tilt", "twist"}
_WRIST = _TURN | {"to"}
_ARM = _WRIST | {"arm"}
_BESIDE = {
    "wheel", "wheels", "caster", "castor", "track", "propeller", "rotor", "antenna",
    "rod", "rods", "counterweight", "spring", "damper", "piston",
}  # fmt: skip


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


def is_hand(link: str) -> bool:
    """True where a link's name is one of what carries the fingers."""
    words = _words(link)
    return bool(words & _HAND) and not words & (_SENSOR | _FINGER)


def is_sensor(link: str) -> bool:
    """True where a link's name is one of a camera, another sensor or a lamp."""
    return bool(_words(link) & _SENSOR)


def opens_gripper(joint: str, carried: str) -> bool:
    """True where a joint's name, or that of the link that it carries, says that it opens the gripper.

    A link called gripper says nothing: the wrist carries it. So does a joint ``gripper_roll`` or
    ``wrist_to_gripper``, and a ``Wrist_Roll`` that carries the ``Fixed_Jaw``. ``arm`` may be a prefix of all
    joints: ``arm_gripper`` opens it where it carries a jaw.
    """
    own, link = _words(joint), _words(carried)
    if own & _FINGER:
        return True
    moves = bool(link & _FINGER or own & _GRIPPER or (link & _GRIPPER and link & _MOVING))
    return moves and not (own & (_WRIST if link & _FINGER else _ARM) or link & _STILL)


def is_beside(joint: str, carried: str) -> bool:
    """True where the names say that a joint opens the gripper, aims a camera, or turns a wheel or a rod."""
    own, link = _words(joint), _words(carried)
    return opens_gripper(joint, carried) or bool(own & _BESIDE or link & (_BESIDE | _CAMERA))


def turns_arm(joint: str, carried: str) -> bool:
    """True where the names say that a joint is one of the arm: ``wrist_roll``."""
    return bool(_words(joint) & _TURN) and not opens_gripper(joint, carried)


def is_moving_part(link: str) -> bool:
    """True where a link's name says that it moves against the others beside it: ``moving_part_v2``."""
    return bool(_words(link) & _MOVING)


def unlikely(link: str) -> int:
    """How little a name is that of a tool."""
    if is_tool_frame(link):
        return 0
    words = _words(link)
    return 4 if words & _SENSOR else 1 if words & _HAND else 3 if words & (_FINGER | _BESIDE) else 2


def _words(name: str) -> set[str]:
    """``leftJaw_link1`` as left, jaw, link."""
    return {word.lower() for word in _WORD.findall(name)}
