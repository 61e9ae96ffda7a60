"""A path made a motion by a named profile."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armctl.errors import MotionRefusedError
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.profiles import ProfileName, checked_duration, law_over, shortest_words
from armctl.motion.timing.path_trajectory import PathTrajectory
from armctl.motion.timing.speed_plan import PathLimits
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_ROUNDING = 1e-9
_REGIONS = 4
_JERK_SAMPLES, _SAMPLES = 1001, 201
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
        MotionRefusedError: the duration is too short; names which joint and limit ask for more, and
            the shortest.
    """
    if profile == "trapezoid":
        shortest = PathTrajectory.fastest(robot, path, rate_cap)
    else:
        shortest = _shaped(robot, path, profile, rate_cap)
    if duration_s is None:
        return shortest
    duration_s = checked_duration(duration_s)
    if duration_s < shortest.duration * (1 - _ROUNDING):
        raise MotionRefusedError(
            f"the motion cannot take {duration_s:g} s: {_bound(robot, shortest, profile, rate_cap)}; "
            f"{shortest_words(shortest.duration)}"
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


def _bound(robot: Robot, motion: PathTrajectory, profile: ProfileName, rate_cap: float) -> str:
    """Which limit the motion is nearest to for the longest time, in words."""
    times = np.linspace(0.0, motion.duration, _SAMPLES)
    state = motion.sample(times)
    limits = [
        ("speed", "°/s", state.velocity, robot.speed_limits),
        ("acceleration", "°/s²", state.acceleration, robot.acceleration_limits),
    ]
    if profile in _WITH_JERK:
        limits.append(("jerk", "°/s³", state.jerk, robot.jerk_limits))
    shares = [np.abs(values) / most for _, _, values, most in limits]
    shares.append(np.abs(motion.rates(times))[:, None] / rate_cap)
    nearest = np.concatenate(shares, axis=1).argmax(axis=1)
    kind, joint = divmod(int(np.bincount(nearest).argmax()), robot.n)
    if kind == len(limits):
        return "most of the time it goes at the speed that was asked for"
    what, unit, _, most = limits[kind]
    limit = math.degrees(float(most[joint]))
    return f"most of the time {robot.joints[joint].title} is near its largest {what}, {limit:.3g} {unit}"


def _offset(law: PiecewisePolynomial, begin: float) -> FloatArray:
    shift = np.zeros_like(law.coefficients)
    shift[:, 0] = begin
    return shift
