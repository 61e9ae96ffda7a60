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

FloatArray = NDArray[np.float64]
_ROUNDING = 1e-9
"""limits that differ by less are the same [rad]"""
_FILE_ROUNDING = 0.125
"""robot files may round the safe outputs inwards by this"""


@dataclass(frozen=True, slots=True)
class _Narrower:
    """The limits that are left of each joint, and which outputs took the rest."""

    limits: FloatArray
    """(n, 2) [rad]"""
    words: tuple[str, ...]


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
    poses (``narrowed`` tells both). Nothing is ever widened.

    Args:
        robot: as its file describes it.
        calibration: of this robot.

    Raises:
        CalibrationError: it is of another robot or kind of board, names a joint or a gripper that is not
            there, leaves nothing of a joint's limits, or lets homing end outside of them.
    """
    _require_robot(robot, calibration)
    try:
        outputs = _new_map(robot, calibration)
        limits = _narrower(robot, calibration, outputs).limits
        joints = tuple(
            replace(joint, lower=low, upper=high)
            for joint, (low, high) in zip(robot.joints, limits.tolist(), strict=True)
        )
        _require_home_inside(joints, outputs)
    except CalibrationError as cause:
        raise CalibrationError(
            f"the calibration of {robot.name} on board {calibration.board} cannot be used: {cause} (set it "
            f"aside with `armctl calibrate forget {robot.name} --board {shlex.quote(calibration.board)}`)"
        ) from cause
    return replace(robot, joints=joints, output_map=outputs, poses=_poses_inside(robot.poses, limits))


def narrowed(robot: Robot, calibration: Calibration) -> tuple[str, ...]:
    """What ``calibrated`` takes from the robot's limits and moves of its poses, in words; empty: nothing.

    Raises:
        CalibrationError: as ``calibrated``.
    """
    _require_robot(robot, calibration)
    outputs = _new_map(robot, calibration)
    narrower = _narrower(robot, calibration, outputs)
    moved: list[str] = []
    for name, pose in robot.poses.items():
        inside = np.clip(pose, narrower.limits[:, 0], narrower.limits[:, 1])
        changed = [
            f"{joint.title} {np.degrees(inside[i]):.2f}° (was {np.degrees(pose[i]):.2f}°)"
            for i, joint in enumerate(robot.joints)
            if abs(inside[i] - pose[i]) > _ROUNDING
        ]
        if changed:
            moved.append(f"pose {name} moves in: {', '.join(changed)}")
    return (*narrower.words, *moved)


def _new_map(robot: Robot, calibration: Calibration) -> OutputMap:
    outputs = own_map(robot)
    _require_unit(robot, calibration, outputs)
    checked_calibration(calibration)
    if calibration.gripper is not None and outputs.gripper_channel is None:
        raise CalibrationError(f"it sets a gripper, and {robot.title} has none")
    arrays = {key: getattr(outputs, key).copy() for key in ("zero", "per_rad", "low", "high")}
    for name, joint in calibration.joints.items():
        i = joint_index(robot, name)
        for key, array in arrays.items():
            array[i] = getattr(joint, key)
    for array in arrays.values():
        array.flags.writeable = False
    closed, opened = calibration.gripper or (outputs.gripper_closed, outputs.gripper_open)
    return replace(outputs, **arrays, gripper_closed=closed, gripper_open=opened)


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


def _narrower(robot: Robot, calibration: Calibration, outputs: OutputMap) -> _Narrower:
    limits, words = robot.limits.copy(), list[str]()
    for i, joint in enumerate(robot.joints):
        one = calibration.joints.get(joint.name)
        if one is None:
            continue
        first, last = _reach(one, own_calibration(robot, joint.name))
        low, high = max(joint.lower, first), min(joint.upper, last)
        if low > high:
            raise CalibrationError(
                f"{joint.title}: the safe outputs {one.low:.1f} … {one.high:.1f} {outputs.unit} put it at "
                f"{np.degrees(first):.1f}° … {np.degrees(last):.1f}°, and its limits are "
                f"{np.degrees(joint.lower):.1f}° … {np.degrees(joint.upper):.1f}°: nothing is left; "
                "measure it again, or correct the limits in the robot file"
            )
        if low - joint.lower > _ROUNDING or joint.upper - high > _ROUNDING:
            words.append(_narrowed_joint(joint, low, high, one, outputs))
            limits[i] = low, high
    return _Narrower(limits, tuple(words))


def _reach(one: JointCalibration, own: JointCalibration) -> tuple[float, float]:
    """The angles at the safe outputs [rad].

    Where these are the robot file's own, the file's rounding is no reason to move a limit.
    """
    low = one.low - _FILE_ROUNDING * (one.low == own.low)
    high = one.high + _FILE_ROUNDING * (one.high == own.high)
    return JointCalibration(one.zero, one.per_rad, low, high).angles()


def _narrowed_joint(joint: Joint, low: float, high: float, one: JointCalibration, outputs: OutputMap) -> str:
    return (
        f"{joint.title}: {np.degrees(low):.2f}° … {np.degrees(high):.2f}° instead of "
        f"{np.degrees(joint.lower):.2f}° … {np.degrees(joint.upper):.2f}°, because the safe outputs end at "
        f"{one.low:.1f} and {one.high:.1f} {outputs.unit}"
    )


def _require_home_inside(joints: tuple[Joint, ...], outputs: OutputMap) -> None:
    """Homing ends at count 0: a joint must be allowed to be there."""
    if outputs.unit != "counts":
        return
    for joint, home in zip(joints, (-outputs.zero / outputs.per_rad).tolist(), strict=True):
        if not joint.lower - _ROUNDING <= home <= joint.upper + _ROUNDING:
            raise CalibrationError(
                f"{joint.title}: homing ends at {np.degrees(home):.2f}°, outside of its limits "
                f"{np.degrees(joint.lower):.2f}° … {np.degrees(joint.upper):.2f}°; measure it again, or "
                "correct limit_deg in the robot file"
            )


def _poses_inside(poses: Mapping[str, FloatArray], limits: FloatArray) -> dict[str, FloatArray]:
    inside = {name: np.clip(pose, limits[:, 0], limits[:, 1]) for name, pose in poses.items()}
    for pose in inside.values():
        pose.flags.writeable = False
    return inside
