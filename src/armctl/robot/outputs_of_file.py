"""What a robot file says of servos and encoders, as one map and the axes behind it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from armctl.errors import RobotFileError
from armctl.robot.file import AxisEntry, EncoderEntry, JointEntry, RobotFile, ServoEntry
from armctl.robot.outputs import FLATTEST_PER_DEG, OutputMap
from armctl.robot.parts import EncoderAxis

Entry = TypeVar("Entry")
_ROUNDING_US = 0.125
"""robot files may round the safe range inwards by this"""
_PERCENT = 0.01


def output_map(file: RobotFile, entries: Sequence[JointEntry], path: Path) -> OutputMap | None:
    """The map of the joints ``entries``, in their order; None where the file has none.

    Raises:
        RobotFileError: only some joints have one, or of the other kind of board, two share a channel, or
            the range does not hold the limits.
    """
    if file.board.kind == "encoder":
        _require_none([entry.servo for entry in entries], "servo", "encoder", file, path)
        return _encoder_map(file, entries, path)
    _require_none([entry.encoder for entry in entries], "encoder", "servo", file, path)
    return _servo_map(file, entries, path)


def encoder_axes(file: RobotFile, entries: Sequence[JointEntry]) -> tuple[EncoderAxis, ...]:
    """The axes of an encoder board, the gripper's last; empty for servos."""
    axes = [_joint_axis(entry.encoder) for entry in entries if entry.encoder is not None]
    if file.gripper is not None and file.gripper.encoder is not None:
        encoder = file.gripper.encoder
        axes.append(_axis(encoder, 1, encoder.home_speed_counts_s, encoder.following_error_counts))
    return tuple(axes)


def differential_axes(
    file: RobotFile, by_name: Mapping[str, JointEntry], path: Path
) -> tuple[int, int] | None:
    """Axes of the two joints that are driven by the sum and the difference of two motors.

    Raises:
        RobotFileError: a name that is no joint with an encoder, or the same one twice.
    """
    if file.board.differential is None:
        return None
    axes: list[int] = []
    for name in file.board.differential:
        entry = by_name.get(name)
        if entry is None or entry.encoder is None:
            raise RobotFileError(f"{path}: board.differential: {name!r} is no joint with an encoder")
        axes.append(entry.encoder.axis)
    if axes[0] == axes[1]:
        raise RobotFileError(f"{path}: board.differential names one joint twice; it takes two")
    return axes[0], axes[1]


def _require_none(there: Sequence[object | None], key: str, right: str, file: RobotFile, path: Path) -> None:
    if file.gripper is not None:
        there = [*there, file.gripper.servo if key == "servo" else file.gripper.encoder]
    if any(entry is not None for entry in there):
        raise RobotFileError(
            f"{path}: board.kind = {file.board.kind!r}: its joints and its gripper have {right} entries, "
            f"not {key} entries"
        )


def _servo_map(file: RobotFile, entries: Sequence[JointEntry], path: Path) -> OutputMap | None:
    servos = _all_or_none([(entry.name, entry.servo) for entry in entries], "servo", path)
    if not servos:
        return None
    gripper = None
    if file.gripper is not None:
        gripper = _gripper_part(file.gripper.servo, "servo", lambda one: (one.closed_us, one.open_us), path)
    _check_channels([servo.channel for servo in servos], gripper and gripper.channel, "servos", path)
    for entry, servo in zip(entries, servos, strict=True):
        _check_servo(entry, servo, f"{path}: joints.{entry.name}.servo")
    return OutputMap(
        unit="µs",
        channels=tuple(servo.channel for servo in servos),
        zero=np.array([servo.zero_us for servo in servos]),
        per_rad=np.array([servo.us_per_deg for servo in servos]) * (180 / math.pi),
        low=np.array([servo.pulse_us[0] for servo in servos]),
        high=np.array([servo.pulse_us[1] for servo in servos]),
        gripper_channel=None if gripper is None else gripper.channel,
        gripper_closed=0.0 if gripper is None else gripper.closed_us,
        gripper_open=0.0 if gripper is None else gripper.open_us,
    )


def _encoder_map(file: RobotFile, entries: Sequence[JointEntry], path: Path) -> OutputMap | None:
    encoders = _all_or_none([(entry.name, entry.encoder) for entry in entries], "encoder", path)
    if not encoders:
        return None
    gripper = None
    if file.gripper is not None:
        gripper = _gripper_part(
            file.gripper.encoder, "encoder", lambda one: (one.closed_counts, one.open_counts), path
        )
        _check_drive(gripper, f"{path}: gripper.encoder")
    _check_channels([encoder.axis for encoder in encoders], gripper and gripper.axis, "encoders", path)
    for entry, encoder in zip(entries, encoders, strict=True):
        _check_scale(encoder.counts_per_deg, f"{path}: joints.{entry.name}.encoder.counts_per_deg")
        _check_drive(encoder, f"{path}: joints.{entry.name}.encoder")
        low, high = entry.limit_deg
        if not low <= encoder.home_deg <= high:
            raise RobotFileError(
                f"{path}: joints.{entry.name}.encoder.home_deg = {encoder.home_deg}° is outside the limits "
                f"{low}° … {high}°: homing would end where the joint may not be"
            )
    per_deg = np.array([encoder.counts_per_deg for encoder in encoders])
    zero = -per_deg * np.array([encoder.home_deg for encoder in encoders])
    ends = zero[:, None] + per_deg[:, None] * np.array([entry.limit_deg for entry in entries])
    return OutputMap(
        unit="counts",
        channels=tuple(encoder.axis for encoder in encoders),
        zero=zero,
        per_rad=per_deg * (180 / math.pi),
        low=ends.min(axis=1),
        high=ends.max(axis=1),
        gripper_channel=None if gripper is None else gripper.axis,
        gripper_closed=0.0 if gripper is None else gripper.closed_counts,
        gripper_open=0.0 if gripper is None else gripper.open_counts,
    )


def _all_or_none(named: Sequence[tuple[str, Entry | None]], key: str, path: Path) -> list[Entry]:
    there = [entry for _, entry in named if entry is not None]
    if there and len(there) != len(named):
        missing = next(name for name, entry in named if entry is None)
        raise RobotFileError(f"{path}: joints.{missing}.{key} is missing; the other joints have one")
    return there


def _gripper_part(
    part: Entry | None, key: str, ends: Callable[[Entry], tuple[float, float]], path: Path
) -> Entry:
    """The gripper's servo or encoder, which must be there and have two ends."""
    if part is None:
        raise RobotFileError(f"{path}: gripper.{key} is missing; the joints have one")
    closed, opened = ends(part)
    if closed == opened:
        raise RobotFileError(
            f"{path}: gripper.{key}: closed and open are both {closed:g}; they must differ, or it cannot move"
        )
    return part


def _check_drive(entry: AxisEntry, where: str) -> None:
    if entry.breakaway_percent > entry.max_drive_percent:
        raise RobotFileError(
            f"{where}.breakaway_percent = {entry.breakaway_percent:g} is above max_drive_percent = "
            f"{entry.max_drive_percent:g}: the motor could not start; raise the one or lower the other"
        )


def _check_channels(channels: list[int], gripper: int | None, what: str, path: Path) -> None:
    if gripper is not None:
        channels = [*channels, gripper]
    if len(set(channels)) != len(channels):
        raise RobotFileError(f"{path}: two {what} are on the same channel: {channels}")


def _check_servo(entry: JointEntry, servo: ServoEntry, where: str) -> None:
    pulses = sorted(servo.zero_us + servo.us_per_deg * angle for angle in entry.limit_deg)
    low, high = servo.pulse_us
    if pulses[0] < low - _ROUNDING_US or pulses[1] > high + _ROUNDING_US:
        raise RobotFileError(
            f"{where}: the limits {entry.limit_deg[0]}° … {entry.limit_deg[1]}° need pulses of "
            f"{pulses[0]:.1f} … {pulses[1]:.1f} µs, pulse_us allows {low} … {high} µs"
        )
    _check_scale(servo.us_per_deg, f"{where}.us_per_deg")


def _check_scale(per_deg: float, where: str) -> None:
    """Refuse a scale on which a whole turn is about a step of the board, or less."""
    if abs(per_deg) < FLATTEST_PER_DEG:
        raise RobotFileError(f"{where} is {per_deg:g}: the joint would not move; {FLATTEST_PER_DEG} or more")


def _joint_axis(entry: EncoderEntry) -> EncoderAxis:
    per_deg = abs(entry.counts_per_deg)
    turn = 1 if entry.counts_per_deg > 0 else -1
    return _axis(entry, turn, entry.home_speed_deg_s * per_deg, entry.following_error_deg * per_deg)


def _axis(entry: AxisEntry, turn: int, home_speed: float, following_error: float) -> EncoderAxis:
    """``turn``: -1 where the joint's angle grows against the counts."""
    return EncoderAxis(
        axis=entry.axis,
        home_order=entry.home_order,
        home_toward=1 if (entry.home_toward == "+") == (turn > 0) else -1,
        home_by=entry.home_by,
        home_speed=home_speed,
        p=entry.p_percent * _PERCENT,
        i=entry.i_percent_s * _PERCENT,
        d=entry.d_percent * _PERCENT,
        breakaway=entry.breakaway_percent * _PERCENT,
        following_error=following_error,
        stall_s=entry.stall_s,
        encoder_inverted=entry.encoder_inverted,
        motor_inverted=entry.motor_inverted,
        switch_inverted=entry.switch_inverted,
        max_drive=entry.max_drive_percent * _PERCENT,
    )
