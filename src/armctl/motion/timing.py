"""A path made a motion: how fast it may be followed, and by which law over time.

With ``q(s)`` and the rate ``r = ds/dt``, a joint's speed is ``q' r`` and its acceleration
``q'' r² + q' dr/dt``. In each region of the path the largest ``|q'|`` and ``|q''|`` give a largest rate and
the acceleration that is left along the path. One pass backward and one forward (as machine tools look ahead)
give the largest rates that can be reached and braked from. No limit is ever passed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics.target import as_numbers
from armctl.motion.polynomial import PiecewisePolynomial, quintic
from armctl.motion.profiles import ProfileName, checked_duration, lasting_s, law_over
from armctl.motion.trajectory import KnowsPeaks, Peaks, Sample, Trajectory
from armctl.robot import Robot

_CURVATURE_SHARE = 0.7
"""Of a joint's acceleration: what the curvature of the path may take. The rest is left for speeding up."""
_MARGIN = 1e-9
_SHORTEST = 1e-12
_SAMPLED_S, _MOST_SAMPLES = 0.01, 20_000
REGIONS = 4
"""regions a piece of a path, for its limits"""


class TooFastError(InputError):
    """A path is begun faster than it can be braked on."""


@dataclass(frozen=True, slots=True, eq=False)
class PathLimits:
    """Largest rate and acceleration in each of m regions of a path."""

    breaks: FloatArray
    """(m + 1,) of the path variable"""
    rate: FloatArray
    """(m,) largest rate"""
    acceleration: FloatArray
    """(m,) largest change of the rate, at any rate up to the largest"""

    @classmethod
    def of(
        cls, robot: Robot, path: PiecewisePolynomial, rate_cap: float | FloatArray = math.inf
    ) -> PathLimits:
        """Limits of a path q(s), (n,) [rad], from the joints'; each piece of it is cut into ``REGIONS``.

        ``rate_cap``: a largest rate besides, a number or (k,) one a piece of the path.
        Raises ``InputError``: a cap that is not positive.
        """
        caps = np.repeat(np.broadcast_to(rate_cap, len(path.coefficients)), REGIONS)
        if not (caps > 0).all():
            raise InputError(f"the speed along a path must be positive, got {caps.min()}")
        fine = path.refined(REGIONS)
        speed, acceleration = robot.speed_limits, robot.acceleration_limits
        slope = fine.derivative().bound_by_piece()
        bend = fine.derivative().derivative().bound_by_piece()
        with np.errstate(divide="ignore"):
            rate = np.minimum((speed / slope).min(axis=1), caps)
            rate = np.minimum(rate, np.sqrt((_CURVATURE_SHARE * acceleration / bend).min(axis=1)))
            # where nothing moves, any rate will do
            rate = np.where(np.isfinite(rate), rate, np.diff(fine.breaks) / _MARGIN)
            left = ((acceleration - bend * rate[:, None] ** 2) / slope).min(axis=1)
        most = rate * rate / np.diff(fine.breaks)
        return cls(fine.breaks, rate * (1 - _MARGIN), np.minimum(left, 1e3 * most) * (1 - _MARGIN))


def fastest_rates(limits: PathLimits, first: float = 0.0, last: float = 0.0) -> FloatArray:
    """(m + 1,) the fastest rates at the breaks of a path in m regions that its limits allow.

    ``first`` is the rate at its beginning, ``last`` the largest at its end; what can be reached is taken
    where it is less.
    Raises ``TooFastError``: ``first`` is more than the path can brake from.
    """
    gains: list[float] = (2 * limits.acceleration * np.diff(limits.breaks)).tolist()  # of the squared rate
    most: list[float] = np.minimum(np.append(limits.rate, last), np.append(math.inf, limits.rate)).tolist()
    for k in range(len(gains) - 1, -1, -1):  # backward: rates that can be braked from
        most[k] = min(most[k], math.sqrt(most[k + 1] ** 2 + gains[k]))
    if first > most[0] * (1 + 1e-6) + 1e-12:
        raise TooFastError(
            f"a path cannot be begun at the rate {first:.6g}; the most is {most[0]:.6g}: begin it slower"
        )
    rates = [min(first, most[0])]
    for k, gain in enumerate(gains):  # forward: rates that can be reached
        rates.append(min(most[k + 1], math.sqrt(rates[k] ** 2 + gain)))
    return np.array(rates)


def trapezoid_law(limits: PathLimits, rates: FloatArray) -> PiecewisePolynomial:
    """The path variable over time [s]: a trapezoid of the rate in each region, from ``fastest_rates``."""
    breaks, steps = [0.0], list[tuple[float, float, float]]()
    rows = np.column_stack(
        [limits.breaks[:-1], np.diff(limits.breaks), limits.rate, limits.acceleration, rates[:-1], rates[1:]]
    )
    for s, length, cap, push, first, last in rows.tolist():
        # (duration, rate at its beginning, change of the rate) of up to three phases
        if push <= 0:
            phases = [(2 * length / (first + last), first, 0.0)]
        else:
            peak = min(cap, math.sqrt(max(push * length + 0.5 * (first * first + last * last), 0.0)))
            peak = max(peak, first, last)
            up, down = (peak - first) / push, (peak - last) / push
            rest = length - 0.5 * (first + peak) * up - 0.5 * (peak + last) * down
            level = rest / peak if rest > _SHORTEST * length else 0.0
            phases = [(up, first, push), (level, peak, 0.0), (down, peak, -push)]
        for duration, rate, change in phases:
            if breaks[-1] + duration > breaks[-1]:
                breaks.append(breaks[-1] + duration)
                steps.append((s, rate, 0.5 * change))
                s += duration * (rate + 0.5 * change * duration)
    return PiecewisePolynomial(breaks, np.array(steps)[:, :, None])


_SLICES, _SLICES_IN_ALL = 4, 96
"""slices of time between two breaks, for the peaks, and at least in a whole motion of few breaks"""
_SECTIONS, _SECTIONINGS = 32, 4
"""where a slice begins is sought in so many parts of the duration, that often: to a millionth of it"""


class PathTrajectory(KnowsPeaks):
    """``q(s(t))`` with the derivatives of both by the chain rule. Immutable."""

    def __init__(self, path: PiecewisePolynomial, law: PiecewisePolynomial) -> None:
        """``path`` is q(s), (n,) [rad]; ``law`` s(t) over t from 0 [s], from end to end of the path."""
        self.path, self.law = path, law
        self.duration = law.high
        self.start, self.end = path(path.low), path(path.high)
        self.start.flags.writeable = self.end.flags.writeable = False

    def __reduce__(self) -> tuple[type[PathTrajectory], tuple[PiecewisePolynomial, PiecewisePolynomial]]:
        return PathTrajectory, (self.path, self.law)

    @classmethod
    def fastest(
        cls, robot: Robot, path: PiecewisePolynomial, rate_cap: float = np.inf, last: float = 0.0
    ) -> PathTrajectory:
        """As fast as ``PathLimits.of`` allows, from rest; ``last``: the largest ds/dt at the end."""
        limits = PathLimits.of(robot, path, rate_cap)
        return cls(path, trapezoid_law(limits, fastest_rates(limits, last=last)))

    @classmethod
    def sampled(cls, trajectory: Trajectory) -> PathTrajectory:
        """A trajectory of a caller's own, sampled every 10 ms with its speed and acceleration.

        ``InputError``: it breaks, whatever it raises, or gives other than finite states (k, n) of its joints.
        """
        try:
            duration = max(checked_duration(trajectory.duration), _SAMPLED_S)
            times = np.linspace(0.0, duration, int(min(duration / _SAMPLED_S, _MOST_SAMPLES)) + 1)
            state = trajectory.sample(times)
            values = [as_numbers(one, "its states") for one in (state.q, state.velocity, state.acceleration)]
            if values[0].ndim != 2 or any(one.shape != (len(times), values[0].shape[1]) for one in values):
                raise InputError(
                    f"{len(times)} times need states (k, n), got {[one.shape for one in values]}"
                )
        except (Exception, SystemExit) as cause:
            what = str(cause) if isinstance(cause, InputError) else f"{type(cause).__name__}: {cause}"
            raise InputError(f"the trajectory cannot be sampled: {what}") from cause
        width = duration / (len(times) - 1)
        rows = np.stack(values) * width ** np.arange(3.0)[:, None, None]
        powers = width ** -np.arange(6.0)
        coefficients = quintic(rows[:, :-1], rows[:, 1:]) * powers[:, None, None]
        path = PiecewisePolynomial(times, coefficients.transpose(1, 0, 2))
        return cls(path, PiecewisePolynomial([0.0, duration], [[[0.0], [1.0]]]))

    def scaled(self, factor: float) -> PathTrajectory:
        """The same motion, taking ``factor`` times as long."""
        return PathTrajectory(self.path, self.law.scaled(factor))

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        time = np.asarray(t, dtype=np.float64)
        s, rate, push, jerk = self.law.derivatives(time, 3)
        inside = ((time >= 0.0) & (time <= self.duration))[..., None]
        rate, push, jerk = rate * inside, push * inside, jerk * inside
        q, slope, bend, twist = self.path.derivatives(s[..., 0], 3)
        arrived = (time >= self.duration)[..., None]
        return Sample(
            np.where(arrived, self.end, q),
            slope * rate,
            bend * rate**2 + slope * push,
            twist * rate**3 + 3 * bend * rate * push + slope * jerk,
        )

    @cached_property
    def peaks(self) -> Peaks:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Extremes of the whole motion: the joint angles exact, the rest never passed."""
        # in each short slice of time the products of the bounds of |q'|, |q''|, ds/dt and d²s/dt² are close
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
            inner = low[:, None] + width * np.arange(1, _SECTIONS)
            before = self.law(inner.ravel())[:, 0].reshape(inner.shape) < breaks[:, None]
            low = low + width * np.count_nonzero(before, axis=1)
        return np.concatenate([[0.0], low[1:-1] + width, [self.duration]])


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
    """Follow a path q(s), (n,) [rad], from rest to rest inside the robot's limits.

    ``trapezoid`` is as fast as the limits allow at every place; the others spread their own shape over the
    whole path. ``rate_cap``: a largest ds/dt besides. Without ``duration_s`` [s] it takes the shortest.
    Raises ``InputError``: a cap that is not positive, or a duration that is not a time;
    ``MotionRefusedError``: the duration is too short; names which joint and limit ask for more, and the
    shortest.
    """
    if profile == "trapezoid":
        shortest = PathTrajectory.fastest(robot, path, rate_cap)
    else:
        shortest = _shaped(robot, path, profile, rate_cap)
    if duration_s is None:
        return shortest
    lasts = lasting_s(
        duration_s,
        shortest.duration,
        lambda asked: f"the motion cannot take {asked:g} s: {_bound(robot, shortest, profile, rate_cap)}",
    )
    return shortest.scaled(lasts / shortest.duration)


def _shaped(robot: Robot, path: PiecewisePolynomial, profile: ProfileName, rate_cap: float) -> PathTrajectory:
    """The caps of the middle of a path from 0 give the law its shape; the scale makes all of it fit."""
    limits = PathLimits.of(robot, path, rate_cap)
    slope = path.derivative().bound_by_piece().max(axis=0)
    moving = slope > 0
    jerk = float((robot.jerk_limits[moving] / slope[moving]).min()) if moving.any() else math.inf
    rate, push = float(np.median(limits.rate)), float(np.median(limits.acceleration))
    law = law_over(path.high, rate, push, jerk, profile)
    shaped = PathTrajectory(path, law)
    peaks = shaped.peaks
    needed = [  # times as long
        float((peaks.speed / robot.speed_limits).max()),
        float((peaks.acceleration / robot.acceleration_limits).max()) ** 0.5,
        float(law.derivative().bound_by_piece().max()) / rate_cap,
    ]
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
    shares.append(np.abs(motion.law.derivatives(times, 1)[1]) / rate_cap)
    nearest = np.concatenate(shares, axis=1).argmax(axis=1)
    kind, joint = divmod(int(np.bincount(nearest).argmax()), robot.n)
    if kind == len(limits):
        return "most of the time it goes at the speed that was asked for"
    what, unit, _, most = limits[kind]
    limit = math.degrees(float(most[joint]))
    return f"most of the time {robot.joints[joint].title} is near its largest {what}, {limit:.3g} {unit}"
