"""A robot as it was calibrated: its map, its limits and its named poses."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armctl.calibration.record import Calibration, JointCalibration, checked_calibration
from armctl.errors import CalibrationError
from armctl.robot import Joint, OutputMap, Robot
from armctl.robot.file import LONGEST_PULSE_US, SHORTEST_PULSE_US

FloatArray = NDArray[np.float64]
_ROUNDING = 1e-9
"""limits that differ by less are the same [rad]"""
_FILE_ROUNDING = 0.125
"""robot files may round the safe outputs inwards by this"""


@dataclass(frozen=True, slots=True)
class _Applied:
    """What a calibration makes of a robot."""

    outputs: OutputMap
    limits: FloatArray
    """(n, 2) what is left of the joint limits [rad]"""
    words: tuple[str, ...]
    """what was taken away, and why"""


def own_map(robot: Robot) -> OutputMap:
    """The robot's map.

    Raises:
        CalibrationError: its file gives none.
    """
    if robot.output_map is None:
        raise CalibrationError(
            f"the robot file of {robot.title} gives neither servos nor encoders: there is nothing to "
            "calibrate; add an entry to each joint"
        )
    return robot.output_map


def joint_index(robot: Robot, joint: str) -> int:
    """Place of a joint, by its name.

    Raises:
        CalibrationError: there is none of that name.
    """
    if joint not in robot.joint_names:
        raise CalibrationError(f"{robot.title} has no joint {joint!r}; it has {', '.join(robot.joint_names)}")
    return robot.joint_names.index(joint)


def own_calibration(robot: Robot, joint: str) -> JointCalibration:
    """What the robot's own map says of a joint.

    Raises:
        CalibrationError: no such joint, or a robot without a map.
    """
    outputs, i = own_map(robot), joint_index(robot, joint)
    return JointCalibration(
        float(outputs.zero[i]), float(outputs.per_rad[i]), float(outputs.low[i]), float(outputs.high[i])
    )


def calibrated(robot: Robot, calibration: Calibration) -> Robot:
    """The same robot by what was measured: its map, and the limits that the safe outputs allow.

    Where an end of the safe outputs comes before the joint's limit, the limit moves in, and so do named
    poses (``narrowed`` tells both). Nothing is ever widened: no servo is sent beyond its range in the robot
    file, no motor beyond its joint's limits.

    Args:
        robot: as its file describes it.
        calibration: of this robot, as it is kept; one that is not kept yet is judged by ``narrowed``.

    Raises:
        CalibrationError: it is of another robot or kind of board, names a joint or a gripper that is not
            there, leaves nothing of a joint's limits, or lets homing end outside of them.
    """
    _require_robot(robot, calibration)
    try:
        applied = _applied(robot, calibration)
    except CalibrationError as cause:
        raise CalibrationError(
            f"the calibration of {robot.name} on board {calibration.board} cannot be used: {cause} (set it "
            f"aside with `armctl calibrate forget {robot.name} --board {shlex.quote(calibration.board)}`)"
        ) from cause
    joints = tuple(
        replace(joint, lower=low, upper=high)
        for joint, (low, high) in zip(robot.joints, applied.limits.tolist(), strict=True)
    )
    poses = _poses_inside(robot.poses, applied.limits)
    return replace(robot, joints=joints, output_map=applied.outputs, poses=poses)


def narrowed(robot: Robot, calibration: Calibration) -> tuple[str, ...]:
    """What ``calibrated`` takes from the robot's limits and moves of its poses, in words; empty: nothing.

    Raises:
        CalibrationError: as ``calibrated``.
    """
    _require_robot(robot, calibration)
    applied = _applied(robot, calibration)
    moved: list[str] = []
    for name, pose in _poses_inside(robot.poses, applied.limits).items():
        before = robot.poses[name]
        changed = [
            f"{joint.title} {np.degrees(pose[i]):.2f}° (was {np.degrees(before[i]):.2f}°)"
            for i, joint in enumerate(robot.joints)
            if abs(pose[i] - before[i]) > _ROUNDING
        ]
        if changed:
            moved.append(f"pose {name} moves in: {', '.join(changed)}")
    return (*applied.words, *moved)


def outputs_at_limits(robot: Robot, joint: str, zero: float, per_rad: float) -> tuple[float, float]:
    """The outputs at the joint's limits through a line, the smaller one first."""
    limits = robot.joints[joint_index(robot, joint)]
    first, last = sorted((zero + per_rad * limits.lower, zero + per_rad * limits.upper))
    return first, last


def _applied(robot: Robot, calibration: Calibration) -> _Applied:
    """What comes out, with every check."""
    outputs = own_map(robot)
    _require_unit(robot, calibration, outputs)
    checked_calibration(calibration)
    _require_gripper(robot, calibration, outputs)
    arrays = {key: getattr(outputs, key).copy() for key in ("zero", "per_rad", "low", "high")}
    limits, words = robot.limits.copy(), list[str]()
    for name, kept in calibration.joints.items():
        i = joint_index(robot, name)
        one = _inside_file(robot, name, kept)
        for key, array in arrays.items():
            array[i] = getattr(one, key)
        if (one.low, one.high) != (kept.low, kept.high):
            words.append(_cut_words(robot.joints[i], kept, one, outputs))
        low, high = _limits_left(robot.joints[i], one, own_calibration(robot, name), outputs)
        if low - limits[i, 0] > _ROUNDING or limits[i, 1] - high > _ROUNDING:
            words.append(_narrowed_words(robot.joints[i], low, high, one, outputs))
            limits[i] = low, high
    for array in arrays.values():
        array.flags.writeable = False
    closed, opened = calibration.gripper or (outputs.gripper_closed, outputs.gripper_open)
    applied = replace(outputs, **arrays, gripper_closed=closed, gripper_open=opened)
    _require_home_inside(robot.joints, limits, applied)
    return _Applied(applied, limits, tuple(words))


def _require_robot(robot: Robot, calibration: Calibration) -> None:
    if calibration.robot != robot.name:
        raise CalibrationError(
            f"this calibration is of {calibration.robot}, not of {robot.name}: another arm's servos say "
            "nothing of this one; calibrate it, or choose the other robot"
        )


def _require_unit(robot: Robot, calibration: Calibration, outputs: OutputMap) -> None:
    if calibration.unit != outputs.unit:
        raise CalibrationError(
            f"it is in {calibration.unit}, and the robot file of {robot.name} is for a board in "
            f"{outputs.unit}: calibrate the arm on that board"
        )


def _require_gripper(robot: Robot, calibration: Calibration, outputs: OutputMap) -> None:
    """A gripper has no range of its own in the robot file: what any servo may be sent holds for it."""
    if calibration.gripper is None:
        return
    if outputs.gripper_channel is None:
        raise CalibrationError(f"it sets a gripper, and {robot.title} has none")
    low, high = sorted(calibration.gripper)
    if outputs.unit == "µs" and not SHORTEST_PULSE_US <= low < high <= LONGEST_PULSE_US:
        raise CalibrationError(
            f"gripper: {low:g} … {high:g} µs; a servo's pulses are {SHORTEST_PULSE_US:g} … "
            f"{LONGEST_PULSE_US:g} µs long"
        )


def _inside_file(robot: Robot, name: str, one: JointCalibration) -> JointCalibration:
    """The joint with safe outputs that the robot file allows too."""
    own = own_calibration(robot, name)
    first, last = (own.low, own.high)
    if own_map(robot).unit == "counts":  # an encoder has no range of its own: the joint's limits are it
        first, last = outputs_at_limits(robot, name, one.zero, one.per_rad)
    low = first if one.low < first - _FILE_ROUNDING else one.low
    high = last if one.high > last + _FILE_ROUNDING else one.high
    if low < high:
        return JointCalibration(one.zero, one.per_rad, low, high)
    raise CalibrationError(
        f"{robot.joints[joint_index(robot, name)].title}: the safe outputs {one.low:.1f} … {one.high:.1f} "
        f"{own_map(robot).unit} lie outside of {first:.1f} … {last:.1f}, which is all that the robot file "
        "allows: nothing is left; measure it again, or correct the robot file"
    )


def _limits_left(
    joint: Joint, one: JointCalibration, own: JointCalibration, outputs: OutputMap
) -> tuple[float, float]:
    """What the safe outputs leave of a joint's limits [rad]."""
    first, last = _reach(one, own)
    low, high = max(joint.lower, first), min(joint.upper, last)
    if low <= high:
        return low, high
    raise CalibrationError(
        f"{joint.title}: the safe outputs {one.low:.1f} … {one.high:.1f} {outputs.unit} put it at "
        f"{np.degrees(first):.1f}° … {np.degrees(last):.1f}°, and its limits are "
        f"{np.degrees(joint.lower):.1f}° … {np.degrees(joint.upper):.1f}°: nothing is left; "
        "measure it again, or correct the limits in the robot file"
    )


def _reach(one: JointCalibration, own: JointCalibration) -> tuple[float, float]:
    """The angles at the safe outputs [rad].

    Where these are the robot file's own, the file's rounding is no reason to move a limit.
    """
    low = one.low - _FILE_ROUNDING * (one.low == own.low)
    high = one.high + _FILE_ROUNDING * (one.high == own.high)
    return JointCalibration(one.zero, one.per_rad, low, high).angles()


def _narrowed_words(joint: Joint, low: float, high: float, one: JointCalibration, outputs: OutputMap) -> str:
    return (
        f"{joint.title}: {np.degrees(low):.2f}° … {np.degrees(high):.2f}° instead of "
        f"{np.degrees(joint.lower):.2f}° … {np.degrees(joint.upper):.2f}°, because the safe outputs end at "
        f"{one.low:.1f} and {one.high:.1f} {outputs.unit}"
    )


def _cut_words(joint: Joint, kept: JointCalibration, one: JointCalibration, outputs: OutputMap) -> str:
    return (
        f"{joint.title}: of the safe outputs {kept.low:.1f} … {kept.high:.1f} {outputs.unit} the robot file "
        f"allows {one.low:.1f} … {one.high:.1f}"
    )


def _require_home_inside(joints: tuple[Joint, ...], limits: FloatArray, outputs: OutputMap) -> None:
    """Homing ends at count 0: a joint must be allowed to be there."""
    if outputs.unit != "counts":
        return
    homes = -outputs.zero / outputs.per_rad
    for joint, home, (low, high) in zip(joints, homes.tolist(), limits.tolist(), strict=True):
        if not low - _ROUNDING <= home <= high + _ROUNDING:
            raise CalibrationError(
                f"{joint.title}: homing ends at {np.degrees(home):.2f}°, outside of its limits "
                f"{np.degrees(low):.2f}° … {np.degrees(high):.2f}°; measure it again, or "
                "correct limit_deg in the robot file"
            )


def _poses_inside(poses: Mapping[str, FloatArray], limits: FloatArray) -> dict[str, FloatArray]:
    return {name: np.clip(pose, limits[:, 0], limits[:, 1]) for name, pose in poses.items()}
