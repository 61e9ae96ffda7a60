"""A path made a motion by a named profile."""

from __future__ import annotations

import math
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError, MotionRefusedError
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.profiles import ProfileName, checked_duration, law_over, shortest_words
from armctl.motion.speed_plan import PathLimits, SpeedPlan
from armctl.motion.trajectory import Peaks, Sample
from armctl.robot import Robot

# A path and a law over time, made one motion.

FloatArray = NDArray[np.float64]
_REGIONS = 4
"""regions a piece of a path, for its limits"""
_SLICES, _SLICES_IN_ALL = 4, 96
"""slices of time between two breaks, for the peaks, and at least in a whole motion of few breaks"""
_SECTIONS, _SECTIONINGS = 32, 4
"""where a slice begins is sought in so many parts of the duration, that often: to a millionth of it"""
_INNER = np.arange(1, _SECTIONS)


class PathTrajectory:
    """``q(s(t))`` with the derivatives of both by the chain rule. Immutable."""

    def __init__(self, path: PiecewisePolynomial, law: PiecewisePolynomial) -> None:
        """Join them.

        Args:
            path: q(s), (n,) [rad].
            law: s(t), one coordinate, from the path's beginning to its end, over t from 0 [s].

        Raises:
            InputError: the law does not run from one end of the path to the other.
        """
        ends = law(np.array([law.low, law.high]))[:, 0]
        if (
            law.n != 1
            or law.low != 0.0
            or not np.allclose(ends, (path.low, path.high), rtol=1e-6, atol=1e-12)
        ):
            raise InputError(f"a law from {ends} does not run along a path from {path.low} to {path.high}")
        self.path = path
        self.law = law
        self._start: FloatArray = path(path.low)
        self._end: FloatArray = path(path.high)

    @classmethod
    def fastest(
        cls,
        robot: Robot,
        path: PiecewisePolynomial,
        rate_cap: float = np.inf,
        first: float = 0.0,
        last: float = 0.0,
    ) -> PathTrajectory:
        """As fast as the speed and acceleration limits allow.

        Args:
            robot: whose limits.
            path: q(s), (n,) [rad].
            rate_cap: largest ds/dt besides.
            first: ds/dt at the beginning.
            last: largest ds/dt at the end.

        Raises:
            InputError: a cap that is not positive, or a first rate that cannot be.
        """
        limits = PathLimits.of(path, robot.speed_limits, robot.acceleration_limits, rate_cap, _REGIONS)
        return cls(path, SpeedPlan.fastest(limits, first, last).law())

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.law.high

    @property
    def start(self) -> FloatArray:
        """Where it starts (n,) [rad]."""
        return self._start.copy()

    @property
    def end(self) -> FloatArray:
        """Where it ends (n,) [rad]."""
        return self._end.copy()

    def scaled(self, factor: float) -> PathTrajectory:
        """The same motion, taking ``factor`` times as long."""
        return PathTrajectory(self.path, self.law.scaled(factor))

    def slowness(self, robot: Robot) -> float:
        """How many times as long it must take to be inside the robot's limits; at most 1: it is inside."""
        peaks = self.peaks
        over_speed = float((peaks.speed / robot.speed_limits).max())
        over_push = float((peaks.acceleration / robot.acceleration_limits).max())
        return max(over_speed, over_push**0.5)

    def rates(self, t: float | FloatArray) -> FloatArray:
        """(...) ds/dt at ``t`` [s], inside the duration."""
        return self.law.derivatives(t, 1)[1, ..., 0]

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        time = np.asarray(t, dtype=np.float64)
        s, rate, push, jerk = self.law.derivatives(time, 3)
        inside = ((time >= 0.0) & (time <= self.duration))[..., None]
        rate, push, jerk = rate * inside, push * inside, jerk * inside
        q, slope, bend, twist = self.path.derivatives(s[..., 0], 3)
        arrived = (time >= self.duration)[..., None]
        q = cast("FloatArray", np.where(arrived, self._end, q))
        return Sample(
            q,
            slope * rate,
            bend * rate**2 + slope * push,
            twist * rate**3 + 3 * bend * rate * push + slope * jerk,
        )

    @cached_property
    def peaks(self) -> Peaks:
        """Extremes of the whole motion: the joint angles exact, the rest never passed.

        In each slice of time the largest ``|q'|``, ``|q''|``, ``ds/dt`` and ``d²s/dt²`` are exact; their
        products may lie a little above what is ever met at one time.
        """
        low, high = self.path.extremes()
        time = np.unique(np.concatenate([self.law.breaks, self._crossings()]))
        count = max(_SLICES, _SLICES_IN_ALL // (len(time) - 1))
        time = (time[:-1, None] + np.diff(time)[:, None] * (np.arange(count) / count)).ravel()
        s = np.clip(self.law(np.append(time, self.duration))[:, 0], self.path.low, self.path.high)
        s[0], s[-1] = self.path.low, self.path.high
        # in a slice of a rounding of time nothing happens
        moves = (np.diff(s) > 0) & (np.diff(np.append(time, self.duration)) > 0)
        begins = np.append(np.flatnonzero(moves), len(time))
        begins[0] = 0
        law = self.law.cut(np.append(time, self.duration)[begins])
        path = self.path.cut(s[begins])
        rates, slopes = law.derivative(), path.derivative()
        rate, push = rates.bound_by_piece(), rates.derivative().bound_by_piece()
        slope, bend = slopes.bound_by_piece(), slopes.derivative().bound_by_piece()
        return Peaks(low, high, (slope * rate).max(axis=0), (bend * rate**2 + slope * push).max(axis=0))

    def _crossings(self) -> FloatArray:
        """(k + 1,) when each break of the path is passed [s], the law never turns back."""
        breaks = self.path.breaks
        low, width = np.zeros(len(breaks)), self.duration
        for _ in range(_SECTIONINGS):
            width /= _SECTIONS
            inner = low[:, None] + width * _INNER
            before = self.law(inner.ravel())[:, 0].reshape(inner.shape) < breaks[:, None]
            low = low + width * np.count_nonzero(before, axis=1)
        return np.concatenate([[0.0], low[1:-1] + width, [self.duration]])


_ROUNDING = 1e-9
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


# How long an arm needs to come to rest.


def stopping_s(robot: Robot) -> float:
    """What the slowest joint needs from its full speed to rest on a straight way [s].

    On a bend the path itself takes some of the acceleration: allow for several times as much.
    """
    return float((robot.speed_limits / robot.acceleration_limits).max())
