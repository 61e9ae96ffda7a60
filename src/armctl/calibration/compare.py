"""A measured joint beside what its robot says of it."""

from __future__ import annotations

import math

from armctl.calibration.apply import joint_index, outputs_at_limits, own_calibration, own_map
from armctl.calibration.fit import JointFit
from armctl.calibration.record import JointCalibration
from armctl.errors import CalibrationError
from armctl.robot import Robot

_TOLD_DEG, _TOLD_SCALE = 0.05, 0.0005
_SAME = 0.5
"""outputs that differ by less are one place"""


def safe_outputs(
    robot: Robot, joint: str, fit: JointFit, in_force: JointCalibration | None = None
) -> tuple[float, float]:
    """The outputs that the joint's limits need, as far as its servo may be sent there.

    An encoder has no range of its own: there the joint's limits alone decide.

    Args:
        robot: as its file describes it.
        joint: its name.
        fit: the line through its marks.
        in_force: the joint as it was calibrated so far. Where it ends before its line needed it, somebody
            had set that end by hand, for what is in the way there; so it stays.

    Raises:
        CalibrationError: none is left: the servo's range does not reach the joint's limits.
    """
    low, high = default_outputs(robot, joint, fit.zero, fit.per_rad)
    if in_force is not None:
        kept = _default(robot, joint, in_force.zero, in_force.per_rad)
        low = max(low, in_force.low) if in_force.low > kept[0] + _SAME else low
        high = min(high, in_force.high) if in_force.high < kept[1] - _SAME else high
    if low < high:
        return low, high
    raise CalibrationError(
        f"{robot.joints[joint_index(robot, joint)].title}: the safe outputs that were set by hand do not "
        "reach its limits any more; set them anew"
    )


def default_outputs(robot: Robot, joint: str, zero: float, per_rad: float) -> tuple[float, float]:
    """As ``safe_outputs``, for a line of which only the two numbers are known.

    Raises:
        CalibrationError: as ``safe_outputs``.
    """
    low, high = _default(robot, joint, zero, per_rad)
    if low < high:
        return low, high
    own, limits = own_calibration(robot, joint), robot.joints[joint_index(robot, joint)]
    first, last = outputs_at_limits(robot, joint, zero, per_rad)
    raise CalibrationError(
        f"{limits.title}: its limits {math.degrees(limits.lower):.1f}° … "
        f"{math.degrees(limits.upper):.1f}° need pulses of {first:.0f} … {last:.0f} µs, and pulse_us of "
        f"the robot file allows {own.low:.0f} … {own.high:.0f} µs: read the marks "
        "again, or put the horn on anew"
    )


def _default(robot: Robot, joint: str, zero: float, per_rad: float) -> tuple[float, float]:
    first, last = outputs_at_limits(robot, joint, zero, per_rad)
    if own_map(robot).unit == "counts":
        return first, last
    own = own_calibration(robot, joint)
    return max(own.low, first), min(own.high, last)


def differences(robot: Robot, joint: str, fit: JointFit) -> tuple[str, ...]:
    """What the marks say otherwise than the robot's own map, in words; empty: nothing worth telling."""
    own, title = own_calibration(robot, joint), robot.joints[joint_index(robot, joint)].title
    words: list[str] = []
    if own.per_rad * fit.per_rad < 0:
        words.append(f"{title} turns the other way than {robot.name} says")
    else:
        scale = fit.per_rad / own.per_rad - 1
        if abs(scale) > _TOLD_SCALE:
            words.append(
                f"{title} needs {abs(scale):.1%} {'more' if scale > 0 else 'fewer'} "
                f"{own_map(robot).unit} a degree"
            )
    # Where the marks are, not at 0°: that may be far outside of the joint's range.
    told = (fit.centre - own.zero) / own.per_rad
    offset = math.degrees(fit.angle(fit.centre) - told)
    if abs(offset) > _TOLD_DEG:
        words.append(
            f"{title} stands at {math.degrees(fit.angle(fit.centre)):.1f}° where {robot.name} says "
            f"{math.degrees(told):.1f}° ({offset:+.1f}°)"
        )
    return tuple(words)
