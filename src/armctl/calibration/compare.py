"""A measured joint beside what its robot says of it."""

from __future__ import annotations

import math

from armctl.calibration.apply import joint_index, own_calibration, own_map
from armctl.calibration.fit import JointFit
from armctl.errors import CalibrationError
from armctl.robot import Robot

_TOLD_DEG, _TOLD_SCALE = 0.05, 0.0005


def safe_outputs(robot: Robot, joint: str, fit: JointFit) -> tuple[float, float]:
    """The outputs that the joint's limits need, as far as its servo may be sent there.

    An encoder has no range of its own: there the joint's limits alone decide.

    Raises:
        CalibrationError: none is left: the servo's range does not reach the joint's limits.
    """
    own, limits = own_calibration(robot, joint), robot.joints[joint_index(robot, joint)]
    first, last = sorted((fit.output(limits.lower), fit.output(limits.upper)))
    if own_map(robot).unit == "counts":
        return first, last
    low, high = max(own.low, first), min(own.high, last)
    if low >= high:
        raise CalibrationError(
            f"{limits.title}: its limits {math.degrees(limits.lower):.1f}° … "
            f"{math.degrees(limits.upper):.1f}° need pulses of {first:.0f} … {last:.0f} µs, and pulse_us of "
            f"the robot file allows {own.low:.0f} … {own.high:.0f} µs: read the marks "
            "again, or put the horn on anew"
        )
    return low, high


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
