"""A path made a motion by a named profile."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError, MotionRefusedError
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.profiles import ProfileName, law_over
from armctl.motion.timing.path_trajectory import PathTrajectory
from armctl.motion.timing.speed_plan import PathLimits
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_ROUNDING = 1e-9
_REGIONS = 4
_JERK_SAMPLES = 1001
_WITH_JERK = ("quintic", "s-curve")


def timed(
    robot: Robot,
    path: PiecewisePolynomial,
    *,
    profile: ProfileName = "trapezoid",
    rate_cap: float = math.inf,
    duration_s: float | None = None,
) -> PathTrajectory:
    """Follow a path from rest to rest inside the robot's limits.

    ``trapezoid`` is as fast as the speed and acceleration limits allow at every place of the path. The
    other profiles spread their own shape over the whole path, as fast as its narrowest place allows.

    Args:
        robot: whose limits.
        path: q(s), (n,) [rad].
        profile: the law of s over time.
        rate_cap: largest ds/dt besides, e.g. the tool's speed [m/s] where s is its way [m].
        duration_s: seconds; None: the shortest.

    Raises:
        InputError: a cap that is not positive, or a duration that is not a time.
        MotionRefusedError: the duration is too short; names the joint that needs more, and the shortest.
    """
    if profile == "trapezoid":
        shortest = PathTrajectory.fastest(robot, path, rate_cap)
    else:
        shortest = _shaped(robot, path, profile, rate_cap)
    if duration_s is None:
        return shortest
    if not (math.isfinite(duration_s) and duration_s >= 0):
        raise InputError(f"a motion cannot take {duration_s} s; leave it open for the shortest")
    if duration_s < shortest.duration * (1 - _ROUNDING):
        peaks = shortest.peaks
        load = np.maximum(
            peaks.speed / robot.speed_limits, np.sqrt(peaks.acceleration / robot.acceleration_limits)
        )
        joint = robot.joints[int(load.argmax())].title
        asked = float(rate_cap) if math.isfinite(rate_cap) else None
        why = f"{joint} is the slowest" if asked is None else f"{joint} or the speed asked for is the slowest"
        raise MotionRefusedError(
            f"the motion cannot take {duration_s:.3f} s: {why}; "
            f"the shortest possible duration is {shortest.duration:.3f} s"
        )
    return shortest.scaled(max(duration_s / shortest.duration, 1.0))


def _shaped(robot: Robot, path: PiecewisePolynomial, profile: ProfileName, rate_cap: float) -> PathTrajectory:
    # The caps of the middle of the path give the s-curve its shape; the scale makes all of it fit.
    limits = PathLimits.of(path, robot.speed_limits, robot.acceleration_limits, rate_cap, _REGIONS)
    slope = path.derivative().bound_by_piece().max(axis=0)
    moving = slope > 0
    jerk = float((robot.jerk_limits[moving] / slope[moving]).min()) if moving.any() else math.inf
    rate, push = float(np.median(limits.rate)), float(np.median(limits.acceleration))
    law = law_over(path.high - path.low, rate, push, jerk, profile)
    law = PiecewisePolynomial(law.breaks, law.coefficients + _offset(law, path.low))
    shaped = PathTrajectory(path, law)
    needed = [shaped.slowness(robot)]
    if math.isfinite(rate_cap):
        needed.append(float(law.derivative().bound_by_piece().max()) / rate_cap)
    if profile in _WITH_JERK:
        jerks = shaped.sample(np.linspace(0.0, shaped.duration, _JERK_SAMPLES)).jerk
        needed.append(float((np.abs(jerks) / robot.jerk_limits).max()) ** (1 / 3))
    return shaped.scaled(max(needed))


def _offset(law: PiecewisePolynomial, begin: float) -> FloatArray:
    shift = np.zeros_like(law.coefficients)
    shift[:, 0] = begin
    return shift
