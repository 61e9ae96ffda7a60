"""A robot as it was calibrated: its map, its limits and its named poses."""

from __future__ import annotations

import math
import shlex
from dataclasses import replace
from itertools import product

import msgspec
import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.calibration.fit import JointFit
from armctl.calibration.record import Calibration, JointCalibration, JointDeflection, checked_record
from armctl.errors import CalibrationError
from armctl.kinematics import Chain, GravityModel
from armctl.lazy_dataclass import dataclass
from armctl.robot import Deflection, Joint, OutputMap, Robot

_ROUNDING = 1e-9
"""limits that differ by less are the same [rad]"""
_MOST_SAG = math.radians(10.0)
"""a joint that would sag by more is not corrected"""
_FILE_ROUNDING = 0.125
"""robot files may round the safe outputs inwards by this"""


def own_map(robot: Robot) -> OutputMap:
    """The map of a robot's outputs; refuses a robot file that gives none."""
    if robot.output_map is None:
        raise CalibrationError(
            f"the robot file of {robot.title} gives neither servos nor encoders: there is nothing to "
            "calibrate; add an entry to each joint"
        )
    return robot.output_map


def own_calibration(robot: Robot, joint: str) -> JointCalibration:
    """What the robot's own map says of a joint; refuses a joint or a map that is not there."""
    return _parts(robot, joint)[2]


def calibrated(robot: Robot, calibration: Calibration) -> Robot:
    """The same robot by what was measured: its map, and the limits that the safe outputs allow.

    Where an end of the safe outputs comes before the joint's limit, the limit moves in, and so do named
    poses (``narrowed`` tells both). Nothing is ever widened: no servo is sent beyond its range in the robot
    file, no motor beyond its joint's limits. A calibration that is not kept yet is judged by ``narrowed``.
    Refuses another robot or board, and what leaves nothing of a joint's limits or homing outside of them.
    """
    _require_robot(robot, calibration)
    try:
        return _applied(robot.flange or robot, calibration)[0].with_tool(robot.tool)
    except CalibrationError as cause:
        raise CalibrationError(
            f"the calibration of {robot.name} on board {calibration.board} cannot be used: {cause} (set it "
            f"aside with `armctl calibrate forget {robot.name} --board {shlex.quote(calibration.board)}`)"
        ) from cause


def narrowed(robot: Robot, calibration: Calibration) -> tuple[str, ...]:
    """What ``calibrated`` takes from the robot's limits and moves of its poses, in words; empty: nothing."""
    _require_robot(robot, calibration)
    return _applied(robot.flange or robot, calibration)[1]


def _applied(robot: Robot, calibration: Calibration) -> tuple[Robot, tuple[str, ...]]:
    """The calibrated robot, and what was taken away and why."""
    outputs = own_map(robot)
    unit = outputs.unit
    if calibration.unit != unit:
        raise CalibrationError(
            f"it is in {calibration.unit}, and the robot file of {robot.name} is for a board in "
            f"{unit}: calibrate the arm on that board"
        )
    checked_record(calibration)
    _require_gripper(robot, calibration, outputs)
    arrays = {key: getattr(outputs, key).copy() for key in ("zero", "per_rad", "low", "high")}
    joints, words = list(robot.joints), list[str]()
    for name, kept in calibration.joints.items():
        one, (lower, upper) = _inside_file(robot, name, kept)
        i = robot.joint_names.index(name)
        joint = joints[i]
        for key, array in arrays.items():
            array[i] = getattr(one, key)
        if (one.low, one.high) != (kept.low, kept.high):
            words.append(
                f"{joint.title}: of the safe outputs {kept.low:.1f} … {kept.high:.1f} {unit} the "
                f"robot file allows {one.low:.1f} … {one.high:.1f}"
            )
        if lower - joint.lower > _ROUNDING or joint.upper - upper > _ROUNDING:
            words.append(
                f"{joint.title}: {_range(lower, upper, 2)} instead of "
                f"{_range(joint.lower, joint.upper, 2)}, because the safe outputs end at {one.low:.1f} and "
                f"{one.high:.1f} {unit}"
            )
            joints[i] = replace(joint, lower=lower, upper=upper)
    for array in arrays.values():
        array.flags.writeable = False
    closed, opened = calibration.gripper or (outputs.gripper_closed, outputs.gripper_open)
    outputs = replace(outputs, **arrays, gripper_closed=closed, gripper_open=opened)
    _require_home_inside(joints, outputs)
    low, high = np.array([(joint.lower, joint.upper) for joint in joints]).T
    poses = {name: np.clip(pose, low, high) for name, pose in robot.poses.items()}
    for name, pose in poses.items():
        before = robot.poses[name]
        moved = [
            f"{joint.title} {np.degrees(pose[i]):.2f}° (was {np.degrees(before[i]):.2f}°)"
            for i, joint in enumerate(joints)
            if abs(pose[i] - before[i]) > _ROUNDING
        ]
        if moved:
            words.append(f"pose {name} moves in: {', '.join(moved)}")
    chain = _with_lengths(robot, calibration)
    gravity = replace(robot.gravity, chain=chain)
    outputs = replace(outputs, deflection=_deflection(robot, gravity, calibration))
    arm = replace(robot, joints=tuple(joints), output_map=outputs, poses=poses, chain=chain, gravity=gravity)
    return arm, tuple(words)


def _with_lengths(robot: Robot, calibration: Calibration) -> Chain:
    """The robot's chain with the lengths that were measured."""
    chain = robot.chain
    if not calibration.lengths:
        return chain
    rows = list(chain.rows)
    for one in calibration.lengths:
        if one.row >= len(rows):
            raise CalibrationError(
                f"lengths: it corrects DH row {one.row + 1}, and the robot file has {len(rows)} rows"
            )
        key = f"{one.key}_m"
        rows[one.row] = replace(rows[one.row], **{key: getattr(rows[one.row], key) + one.off_m})
    return Chain.from_dh(
        rows, "modified" if chain.convention == "modified" else "standard", chain.coupling, chain.turn_limits
    )


def _deflection(robot: Robot, gravity: GravityModel, calibration: Calibration) -> Deflection | None:
    """How the arm gives way, as it was measured; None: it is taken as rigid."""
    if not calibration.deflection:
        return None
    for name in calibration.deflection:
        _parts(robot, name)
    ways = [calibration.deflection.get(name, JointDeflection()) for name in robot.joint_names]
    gravity = replace(gravity, payload_kg=calibration.load_kg)
    heaviest = gravity.heaviest(robot.limits)
    for joint, one, torque in zip(robot.joints, ways, heaviest.tolist(), strict=True):
        if (one.compliance + one.drive) * torque > _MOST_SAG:
            raise CalibrationError(
                f"deflection.{joint.name}: by it {joint.title} sags by "
                f"{math.degrees((one.compliance + one.drive) * torque):.1f}°; more than "
                f"{math.degrees(_MOST_SAG):.0f}° is broken, not soft: look what is loose"
            )
    rigid = Deflection.of(gravity, heaviest)
    soft = replace(
        rigid,
        link=np.array([one.compliance for one in ways]),
        drive=np.array([one.drive for one in ways]),
        play=np.array([one.play for one in ways]),
    )
    return soft.invertible(robot.limits)


def _parts(robot: Robot, name: str) -> tuple[OutputMap, Joint, JointCalibration]:
    """The robot's own map, one of its joints, and what the map says of that."""
    outputs = own_map(robot)
    if name not in robot.joint_names:
        raise CalibrationError(f"{robot.title} has no joint {name!r}; it has {', '.join(robot.joint_names)}")
    i = robot.joint_names.index(name)
    own = [float(array[i]) for array in (outputs.zero, outputs.per_rad, outputs.low, outputs.high)]
    return outputs, robot.joints[i], JointCalibration(*own)


def _range(low: float, high: float, digits: int = 1) -> str:
    """Angles [rad] as degrees."""
    return f"{math.degrees(low):.{digits}f}° … {math.degrees(high):.{digits}f}°"


def _require_robot(robot: Robot, calibration: Calibration) -> None:
    if calibration.robot != robot.name:
        raise CalibrationError(
            f"this calibration is of {calibration.robot}, not of {robot.name}: another arm's servos say "
            "nothing of this one; calibrate it, or choose the other robot"
        )


def _require_gripper(robot: Robot, calibration: Calibration, outputs: OutputMap) -> None:
    """A gripper has no range of its own in the robot file: what any output may be told holds for it."""
    if calibration.gripper is None:
        return
    if outputs.gripper_channel is None:
        raise CalibrationError(f"it sets a gripper, and {robot.title} has none")
    low, high = sorted(calibration.gripper)
    if not outputs.lowest <= low < high <= outputs.highest:
        raise CalibrationError(
            f"gripper: {low:g} … {high:g} {outputs.unit}; the board takes {outputs.lowest:g} … "
            f"{outputs.highest:g} {outputs.unit}"
        )


def _inside_file(
    robot: Robot, name: str, one: JointCalibration
) -> tuple[JointCalibration, tuple[float, float]]:
    """The joint with safe outputs that the robot file allows too, and what they leave of its limits [rad]."""
    outputs, joint, own = _parts(robot, name)
    # an encoder has no range of its own: the joint's limits are it
    first, last = _at_limits(joint, one) if outputs.homed else (own.low, own.high)
    low = first if one.low < first - _FILE_ROUNDING else one.low
    high = last if one.high > last + _FILE_ROUNDING else one.high
    if low >= high:
        raise CalibrationError(
            f"{joint.title}: the safe outputs {one.low:.1f} … {one.high:.1f} {outputs.unit} lie outside of "
            f"{first:.1f} … {last:.1f}, which is all that the robot file allows: nothing is left; measure it "
            "again, or correct the robot file"
        )
    one = msgspec.structs.replace(one, low=low, high=high)
    # where they are the robot file's own, the file's rounding is no reason to move a limit
    if low == own.low:
        low -= _FILE_ROUNDING
    if high == own.high:
        high += _FILE_ROUNDING
    first, last = msgspec.structs.replace(one, low=low, high=high).angles()
    lower, upper = max(joint.lower, first), min(joint.upper, last)
    if lower > upper:
        raise CalibrationError(
            f"{joint.title}: the safe outputs {one.low:.1f} … {one.high:.1f} {outputs.unit} put it at "
            f"{_range(first, last)}, and its limits are {_range(joint.lower, joint.upper)}: nothing is left; "
            "measure it again, or correct the limits in the robot file"
        )
    return one, (lower, upper)


def _require_home_inside(joints: list[Joint], outputs: OutputMap) -> None:
    """Homing ends at output 0: a joint must be allowed to be there."""
    if not outputs.homed:
        return
    for joint, home in zip(joints, (-outputs.zero / outputs.per_rad).tolist(), strict=True):
        if not joint.lower - _ROUNDING <= home <= joint.upper + _ROUNDING:
            raise CalibrationError(
                f"{joint.title}: homing ends at {math.degrees(home):.2f}°, outside of its limits "
                f"{_range(joint.lower, joint.upper, 2)}; measure it again, or "
                "correct limit_deg in the robot file"
            )


# The pose for looking at the arm once it is calibrated: right angles that the eye can judge.

_QUARTER = math.pi / 2
_CLEAR_M = 0.01
_MOST, _AT_ONCE = 20_000, 16
"""of the configurations that are looked at"""


@dataclass(frozen=True, slots=True)
class CheckPose:
    """A configuration to look at, and what must be seen."""

    title: str
    q: FloatArray
    """(n,) [rad]"""
    words: tuple[str, ...]
    """the angle of each joint and the place of the tool"""


def check_pose(robot: Robot) -> CheckPose:
    """The pose nearest to home with every joint of a calibrated robot at a multiple of 90°; else home.

    It is inside the limits, clear of the floor, of the arm itself and of its obstacles; the way there is
    for pre-flight to judge.
    """
    title, q = "home", robot.pose("home")
    right = _right_angles(robot)
    right = right[np.argsort((np.abs(right - q) / robot.speed_limits).sum(axis=1), kind="stable")]
    for first in range(0, len(right), _AT_ONCE):
        some = right[first : first + _AT_ONCE]
        if (clear := np.flatnonzero(_touches_nothing(robot, some))).size:
            title, q = "right angles", some[clear[0]]
            break
    x, y, z = (1000 * robot.forward(q)[:3, 3]).tolist()
    words = [
        f"{joint.title} at {angle + 0.0:.1f}°"
        for joint, angle in zip(robot.joints, robot.shown(q).round(3).tolist(), strict=True)
    ]
    return CheckPose(title, q, (*words, f"the tool at x {x:z.1f}, y {y:z.1f}, z {z:z.1f} mm from the base"))


def _right_angles(robot: Robot) -> FloatArray:
    """Every configuration (k, n) [rad] of quarter turns that is inside the limits."""
    choices: list[list[float]] = []
    for low, high in robot.limits.tolist():
        first, last = math.ceil(low / _QUARTER - 1e-9), math.floor(high / _QUARTER + 1e-9)
        choices.append([min(max(k * _QUARTER, low), high) for k in range(first, last + 1)])
    if not 0 < math.prod(map(len, choices)) <= _MOST:
        return np.empty((0, robot.n))
    return np.array(list(product(*choices)), dtype=np.float64)


def _touches_nothing(robot: Robot, q: FloatArray) -> NDArray[np.bool_]:
    """(k,) Whether the arm is clear of the floor, of itself and of its obstacles at ``q`` (k, n) [rad]."""
    clear: NDArray[np.bool_] = robot.frames(q)[:, 1:, 2, 3].min(axis=1) > robot.floor_z + _CLEAR_M
    links = robot.body_frames(q)
    itself = robot.collision.gaps(links) - robot.collision.closed[:, None]
    for gaps in (itself, robot.collision.gaps_around(links)):
        if gaps.size:
            clear &= gaps.reshape(-1, len(q)).min(axis=0) >= 0
    return clear


# A measured joint beside what its robot says of it.

_TOLD_DEG, _TOLD_SCALE = 0.05, 0.0005
_SAME = 0.5
"""outputs that differ by less are one place"""


def safe_outputs(
    robot: Robot, joint: str, line: JointFit | JointCalibration, in_force: JointCalibration | None = None
) -> tuple[float, float]:
    """The outputs that the joint's limits need, as far as its servo may be sent there.

    An encoder has no range of its own: there the joint's limits alone decide. An end of ``in_force`` that
    lies before what its line needed was set by hand, for what is in the way there; so it stays. Refuses a
    line by which no output is left.
    """
    outputs, limits, own = _parts(robot, joint)
    low, high = _needed(robot, joint, line)
    if low >= high:
        first, last = _at_limits(limits, line)
        raise CalibrationError(
            f"{limits.title}: its limits {_range(limits.lower, limits.upper)} need outputs of {first:.0f} … "
            f"{last:.0f} {outputs.unit}, and the robot file allows {own.low:.0f} … {own.high:.0f}: "
            "read the marks again, or put the horn on anew"
        )
    if in_force is not None:
        first, last = _needed(robot, joint, in_force)
        low = max(low, in_force.low) if in_force.low > first + _SAME else low
        high = min(high, in_force.high) if in_force.high < last - _SAME else high
        if low >= high:
            raise CalibrationError(
                f"{limits.title}: the safe outputs that were set by hand do not reach its limits any more; "
                "set them anew"
            )
    return low, high


def _needed(robot: Robot, name: str, line: JointFit | JointCalibration) -> tuple[float, float]:
    """What a line needs of the outputs that the robot file allows; the ends crossed where that is nothing."""
    outputs, joint, own = _parts(robot, name)
    first, last = _at_limits(joint, line)
    return (first, last) if outputs.homed else (max(own.low, first), min(own.high, last))


def _at_limits(joint: Joint, line: JointFit | JointCalibration) -> tuple[float, float]:
    """The outputs at the joint's limits through a line, the smaller one first."""
    first, last = sorted(line.zero + line.per_rad * limit for limit in (joint.lower, joint.upper))
    return first, last


def differences(robot: Robot, joint: str, fit: JointFit) -> tuple[str, ...]:
    """What the marks say otherwise than the robot's own map, in words; empty: nothing worth telling."""
    outputs, limits, own = _parts(robot, joint)
    title, scale = limits.title, fit.per_rad / own.per_rad - 1
    words: list[str] = []
    if scale < -1:
        words.append(f"{title} turns the other way than {robot.name} says")
    elif abs(scale) > _TOLD_SCALE:
        more = "more" if scale > 0 else "fewer"
        words.append(f"{title} needs {abs(scale):.1%} {more} {outputs.unit} a degree")
    # Where the marks are, not at 0°: that may be far outside of the joint's range.
    stands, told = math.degrees(fit.angle(fit.centre)), math.degrees((fit.centre - own.zero) / own.per_rad)
    if abs(stands - told) > _TOLD_DEG:
        words.append(
            f"{title} stands at {stands:.1f}° where {robot.name} says {told:.1f}° "
            f"({round(stands, 1) - round(told, 1):+.1f}°)"
        )
    return tuple(words)
