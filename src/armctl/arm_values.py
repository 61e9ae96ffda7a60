"""The arguments of ``Arm``'s calls, checked: millimetres and degrees, as people give them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError, StateError
from armctl.facts.angles import DEGREE, from_degrees, to_degrees
from armctl.kinematics import Target, roll_pitch_yaw, rotation_of
from armctl.kinematics.target import as_numbers, checked_number, require_finite
from armctl.motion import PitchMode, TurnMode
from armctl.program.base_steps import WIDEST_BLEND_MM, Step, keys_of
from armctl.program.motion_steps import END, RPY
from armctl.program.standing_steps import EDGES
from armctl.protocol import Enable, Snapshot
from armctl.robot import Robot

LAST_POSE = "last"
"""for ``Arm.enable``: where armctl saw the arm last, if it stood"""
LAST_MOVING = "last-moving"
"""the same where the arm was moving then: somebody has looked at it, and it stands there"""


def enable_command(robot: Robot, now: Snapshot, pose: str | Sequence[float] | None) -> Enable:
    """What enables an arm in a pose that is given in words or degrees."""
    if pose is None:
        return Enable()
    if not isinstance(pose, str):
        return Enable(robot.read(robot.chain.checked(pose)))
    if pose not in (LAST_POSE, LAST_MOVING):
        return Enable(robot.pose(pose))
    if now.last_pose is None:
        if now.board is not None and now.board.simulated:
            return Enable()
        raise StateError(
            f"no last pose of {robot.name} on this board is kept: give a named pose, or joint angles in "
            "degrees"
        )
    if now.last_pose.moving and pose == LAST_POSE:
        raise StateError(
            f"{robot.name} was {now.last_pose}. Look at the arm: if it does stand at these angles, "
            f'say so (--pose {LAST_MOVING}, arm.enable("{LAST_MOVING}")); else give its angles in degrees'
        )
    return Enable(now.last_pose.q, now.last_pose.gripper)


def target_of(
    point_mm: FloatArray, pitch_deg: float | None, roll_deg: float | None, rotation: FloatArray | None
) -> Target:
    """What inverse kinematics is asked for; angles in degrees."""
    pitch = from_degrees(optional_number(pitch_deg, "pitch_deg"))
    return Target.of(point_mm / 1000, pitch, from_degrees(optional_number(roll_deg, "roll_deg")), rotation)


def point_of(value: ArrayLike, what: str) -> FloatArray:
    """(3,) finite numbers."""
    array = as_numbers(value, what)
    if array.shape != (3,):
        raise InputError(f"{what} needs three numbers, x, y and z, got {value!r}")
    require_finite(array, what)
    return array


def led_keys(
    pitch: PitchMode | None,
    pitch_deg: float | None,
    speed_mm_s: float | None,
    duration_s: float | None,
    blend_mm: float,
) -> dict[str, Any]:
    """What a line and an arc of the tool share, checked."""
    return {
        "pitch": pitch,
        "pitch_deg": optional_number(pitch_deg, "pitch_deg"),
        "speed_mm_s": optional_number(speed_mm_s, "speed_mm_s"),
        "duration_s": optional_number(duration_s, "duration_s"),
        "blend_mm": checked_number(blend_mm, "blend_mm"),
    }


def turned_keys(
    orientation: TurnMode | None, rpy_deg: Sequence[float] | None, quaternion_wxyz: Sequence[float] | None
) -> dict[str, Any]:
    """The orientation of a line or an arc, checked."""
    rpy = None if rpy_deg is None else as_numbers(rpy_deg, "rpy_deg") * DEGREE
    rotation = rotation_of(rpy, quaternion_wxyz)
    turned: dict[str, Any] = {"orientation": orientation}
    if rotation is not None:
        angles = to_degrees(roll_pitch_yaw(rotation)).tolist()
        turned |= zip(("rx_deg", "ry_deg", "rz_deg"), angles, strict=True)
    return turned


def optional_number(value: float | None, what: str) -> float | None:
    """A number that may be left out; ``InputError``: none at all."""
    return None if value is None else checked_number(value, what)


def require_blend(blend_mm: float) -> None:
    """Refuse (``InputError``) what is no blend radius."""
    if not 0 <= checked_number(blend_mm, "blend_mm") <= WIDEST_BLEND_MM:
        raise InputError(f"a blend radius is 0 … {WIDEST_BLEND_MM} mm, not {blend_mm}")


_TOGETHER = {"rpy_deg": RPY, "part_mm": EDGES}
"""arguments that are several keys of a step"""


def handling_keys(kind: type[Step], point_mm: Sequence[float], how: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a step that takes a part or puts it down; ``InputError``: one that it has not."""
    keys: dict[str, Any] = {}
    known = {one.name for one in keys_of(kind)} - {*END, "frame", "note"}
    for name, value in how.items():
        several = _TOGETHER.get(name, ())
        if several and known.issuperset(several) and value is not None:
            numbers = as_numbers(value, name).tolist()
            if len(numbers) != len(several):
                raise InputError(f"{name} needs three numbers, got {value!r}")
            keys |= zip(several, numbers, strict=True)
        elif name in known:
            keys[name] = value
        elif not several:
            raise InputError(f"{kind.__name__} has no {name!r}; it has {', '.join(sorted(known))}")
    point = point_of(point_mm, ", ".join(END)).tolist()
    return {**keys, **dict(zip(END, point, strict=True))}
