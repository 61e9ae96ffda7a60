"""What the names in a URDF file give away: a usual tool frame, a sensor, a joint of the gripper."""

from __future__ import annotations

import re

from armctl.robot.urdf_file import UrdfJoint

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_TOOL = {"tool", "tcp", "ee", "eef", "effector", "grasp", "gripperframe"}
_SENSOR = {"camera", "cam", "imu", "sensor", "optical"}
_FINGER = {"finger", "fingers", "jaw", "jaws", "claw", "claws", "knuckle", "pincer"}
_GRIPPER = {"gripper", "grip"}
_ARM = {"roll", "rotate", "rotation", "rot", "pitch", "yaw", "wrist", "pan", "tilt", "twist", "arm", "to"}


def is_tool_frame(link: str) -> bool:
    """True where a link's name is one that tool frames have: ``ee_gripper_link``, ``gripper_frame_link``."""
    words = _words(link)
    usual = bool(words & _TOOL) or {"gripper", "frame"} <= words
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
