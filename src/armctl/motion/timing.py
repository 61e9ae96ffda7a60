"""A path made a motion: q(s) with a law s(t), as fast as the limits allow or by a named profile."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics.target import as_numbers
from armctl.motion.jerk_limited import jerk_limited_law
from armctl.motion.polynomial import PiecewisePolynomial, largest_by_order, quintic
from armctl.motion.profiles import ProfileName, checked_duration, checked_profile, lasting_s, law_over
from armctl.motion.time_optimal import PathLimits, PathRates, fastest_rates, time_optimal_law
from armctl.motion.trajectory import KnowsPeaks, Peaks, Sample, Trajectory, as_times
from armctl.robot import Robot

_SAMPLED_S, _MOST_SAMPLES = 0.01, 20_000
_SLICES, _SLICES_IN_ALL = 4, 96
"""slices of time between two breaks, for the peaks, and at least in a whole motion of few breaks"""
_SECTIONS, _SECTIONINGS = 32, 6
"""where a slice begins is sought in so many parts of the duration, that often: to a billionth of it"""
_INTERVALS = 12_000
"""about so many intervals are enough for the longest path"""
_CROSSED_AT_ONCE = 1 << 10
"""breaks that are sought at once"""
_NUMBERS_AT_ONCE = 1 << 18
"""so many coefficients of polynomials q(s(t)) are in memory at once"""
_STANDS = 1e-6
"""of the largest rate: what is less counts as standing still, where the slope of a path jumps"""
_AT_BREAK = 1e-8
"""of the duration: so near a break of the law a path's break is passed at it"""
_ROUNDING = 1e-13
"""so small a share of the whole way is none"""


class PathTrajectory(KnowsPeaks):
    """``q(s(t))`` with the derivatives of both by the chain rule. Immutable."""

    def __init__(self, path: PiecewisePolynomial, law: PiecewisePolynomial) -> None:
        """``path`` is q(s), (n,) [rad]; ``law`` s(t) over t from 0 [s], from end to end of the path."""
        self.path, self.law = path, law
        self.duration = law.high
        self.start, self.end = path(path.low), path(path.high)
        self.start.flags.writeable = self.end.flags.writeable = False

    def made_of(self) -> tuple[PiecewisePolynomial, PiecewisePolynomial]:
        """See ``ByContent``."""
        return self.path, self.law

    @classmethod
    def fastest(
        cls, robot: Robot, path: PiecewisePolynomial, rate_cap: float = np.inf, last: float = 0.0
    ) -> PathTrajectory:
        """As fast as the limits of speed and acceleration allow, from rest.

        ``rate_cap``: the largest ds/dt, ``last``: the largest at the end. ``InputError``: a cap that is not
        positive.
        """
        finest = max(min(_INTERVALS // len(path.coefficients), 80), 8)
        limits = PathLimits.of(robot, path, rate_cap, finest)
        rates = fastest_rates(limits, last=last)
        return cls(path, time_optimal_law(limits.breaks, rates, limits.cap, limits.push))

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
        if type(t) is float and 0.0 < t < self.duration:
            s, rate, push, jerk = self.law.derivatives(t, 3)
            return self._state(rate, push, jerk, self.path.derivatives(float(s[0]), 3))
        time = as_times(t)
        s, rate, push, jerk = self.law.derivatives(time, 3)
        inside = ((time >= 0.0) & (time <= self.duration))[..., None]
        rate, push, jerk = rate * inside, push * inside, jerk * inside
        state = self._state(rate, push, jerk, self.path.derivatives(s[..., 0], 3))
        arrived = (time >= self.duration)[..., None]
        return replace(state, q=np.where(arrived, self.end, state.q))

    @staticmethod
    def _state(rate: FloatArray, push: FloatArray, jerk: FloatArray, path: FloatArray) -> Sample:
        q, slope, bend, twist = path
        return Sample(
            q,
            slope * rate,
            bend * rate**2 + slope * push,
            twist * rate**3 + 3 * bend * rate * push + slope * jerk,
        )

    @cached_property
    def peaks(self) -> Peaks:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Extremes of the whole motion: the joint angles exact, the rest never passed.

        The acceleration of a joint that passes a jump of the path's slope without standing still is infinite.
        """
        low, high = self.path.extremes()
        jumps = self._turned_at_speed()
        if self.law.coefficients.shape[1] <= 3:  # d²s/dt² is constant in pieces
            speed, acceleration = self._peaks_over_the_way()
            return Peaks(low, high, speed, np.where(jumps, np.inf, acceleration), None)
        speed, acceleration, jerk = self._peaks_over_time()
        acceleration = np.where(jumps, np.inf, acceleration)
        return Peaks(low, high, speed, acceleration, jerk if self.law.is_smooth_from_rest() else None)

    def _turned_at_speed(self) -> NDArray[np.bool_]:
        """(n,) joints whose speed jumps, where the slope of the path does."""
        jumps = self.path.slope_jumps()
        if not jumps.any():
            return np.array([False] * len(self.start), dtype=np.bool_)
        time, breaks = self._crossings()[1:-1], self.law.breaks
        after = np.clip(breaks.searchsorted(time), 1, len(breaks) - 1)
        nearest = np.where(time - breaks[after - 1] <= breaks[after] - time, breaks[after - 1], breaks[after])
        time = np.where(np.abs(time - nearest) <= _AT_BREAK * self.duration, nearest, time)
        rates = np.abs(self.law.derivatives(time, 1)[1, :, 0])
        moves = rates > _STANDS * self.law.derivative().bound_by_piece().max()
        return (jumps & moves[:, None]).any(axis=0)

    def _peaks_over_the_way(self) -> tuple[FloatArray, FloatArray]:
        """Largest speeds and accelerations (n,), by the polynomials of s that ``PathLimits`` bounds."""
        at = self.law.coefficients[:, 0, 0]
        s = np.unique(np.clip(np.append(at, self.path.breaks), self.path.low, self.path.high))
        s = s[np.append(True, np.diff(s) > _ROUNDING * (self.path.high - self.path.low))]
        s[-1] = self.path.high
        piece = at[1:].searchsorted(0.5 * (s[:-1] + s[1:]))
        c = self.law.padded(3).coefficients[piece, :, 0]
        from_begin = c[:, 1] ** 2 + 4 * c[:, 2] * (s[:-1] - c[:, 0])
        from_end = c[:, 1] ** 2 + 4 * c[:, 2] * (s[1:] - c[:, 0])
        rates = PathRates.of(self.path.cut(s))
        return rates.peaks(np.maximum(from_begin, 0.0), np.maximum(from_end, 0.0), 2 * c[:, 2])

    def _peaks_over_time(self) -> list[FloatArray]:
        """Largest speeds, accelerations and jerks (n,), by the polynomials q(s(t)) in slices of time."""
        time = np.unique(np.concatenate([self.law.breaks, self._crossings()]))
        count = max(_SLICES, _SLICES_IN_ALL // (len(time) - 1))
        time = (time[:-1, None] + np.diff(time)[:, None] * (np.arange(count) / count)).ravel()
        s = np.clip(self.law(np.append(time, self.duration))[:, 0], self.path.low, self.path.high)
        s[0], s[-1] = self.path.low, self.path.high
        # in a slice of a rounding of time nothing happens
        moves = (np.diff(s) > 0) & (np.diff(np.append(time, self.duration)) > 0)
        begins = np.append(np.flatnonzero(moves), len(time))
        begins[0] = 0
        seams, places = np.append(time, self.duration)[begins], s[begins]
        found = np.zeros((3, self.path.n))
        powers = np.arange(1.0, self.law.coefficients.shape[1])
        size = (self.path.coefficients.shape[1] - 1) * len(powers) + 1
        at_once = max(_NUMBERS_AT_ONCE // (size * self.path.n), 1)
        for first in range(0, len(seams) - 1, at_once):
            slices = slice(first, first + at_once + 1)
            law, path = self.law.cut(seams[slices]), self.path.cut(places[slices])
            widths = np.diff(law.breaks)[:, None]
            inner: FloatArray = law.coefficients[:, 1:] * widths[:, :, None] ** powers[:, None]
            unit = path.coefficients[:, -1:]
            for power in range(path.coefficients.shape[1] - 2, -1, -1):  # Horner's rule
                product = np.zeros((len(unit), unit.shape[1] + inner.shape[1], path.n))
                for j in range(inner.shape[1]):
                    product[:, j + 1 : j + 1 + unit.shape[1]] += unit * inner[:, j : j + 1]
                product[:, 0] += path.coefficients[:, power]
                unit = product
            for order, largest in enumerate(largest_by_order(unit.swapaxes(0, 1), 3), 1):
                found[order - 1] = np.maximum(found[order - 1], (largest / widths**order).max(axis=0))
        return list(found)

    def _crossings(self) -> FloatArray:
        """(k + 1,) when each break of the path is passed [s], the law never turns back."""
        breaks = self.path.breaks
        passed = [np.zeros(0)]
        for first in range(1, len(breaks) - 1, _CROSSED_AT_ONCE):
            sought = breaks[first : min(first + _CROSSED_AT_ONCE, len(breaks) - 1)]
            low, width = np.zeros(len(sought)), self.duration
            for _ in range(_SECTIONINGS):
                width /= _SECTIONS
                inner = low[:, None] + width * np.arange(1, _SECTIONS)
                before = self.law(inner.ravel())[:, 0].reshape(inner.shape) < sought[:, None]
                low = low + width * np.count_nonzero(before, axis=1)
            passed.append(low + width)
        return np.concatenate([[0.0], *passed, [self.duration]])


_SPLINES: dict[ProfileName, int] = {"s-curve": 2, "quintic": 3}
"""degree of the squared rate of the laws that keep the jerk limit; with 3 the jerk does not jump"""


def timed(
    robot: Robot,
    path: PiecewisePolynomial,
    *,
    profile: ProfileName = "trapezoid",
    rate_cap: float = math.inf,
    duration_s: float | None = None,
) -> PathTrajectory:
    """Follow a path q(s), (n,) [rad], from rest to rest inside the robot's limits.

    ``trapezoid`` is as fast as the limits of speed and acceleration allow, ``s-curve`` and ``quintic`` nearly
    as fast as those of jerk allow besides; the jerk of a ``quintic`` does not jump on the way. ``cubic``
    spreads its shape over the whole path. ``rate_cap``: a largest ds/dt besides. Without ``duration_s`` [s]
    it takes the shortest: exactly that on a straight path of the joints, else a duration near it.
    A short motion takes longer by the laws that limit the jerk J, whatever the law: from rest to rest over L
    it needs 4 (L / 2J)^⅓ at least. With J = a / 50 ms that is more than 1.3 times the trapezoid's time
    2 (L / a)^½ where this is less than 0.18 s. Along a curve each further reversal of the acceleration takes
    a ramp a / J more: a spline of eight pieces in 0.55 s took half as long again with any law that was tried.
    Raises ``InputError``: a cap that is not positive, or a duration that is not a time;
    ``MotionRefusedError``: the duration is too short; names which joint and limit ask for more, and the
    shortest.
    """
    shortest = _shortest(robot, path, checked_profile(profile), rate_cap)
    if duration_s is None:
        return shortest
    lasts = lasting_s(
        duration_s,
        shortest.duration,
        lambda _, told: f"the motion cannot take {told}: {_bound(robot, shortest, profile, rate_cap)}",
        profile,
        exact=path.is_straight and profile != "quintic",
    )
    return shortest.scaled(lasts / shortest.duration)


def _shortest(
    robot: Robot, path: PiecewisePolynomial, profile: ProfileName, rate_cap: float
) -> PathTrajectory:
    fastest = PathTrajectory.fastest(robot, path, rate_cap)
    if profile == "trapezoid":
        return fastest
    if path.slope_jumps().any():
        raise InputError(
            f"a path that turns a corner cannot be followed by the profile {profile}: use trapezoid"
        )
    if profile == "s-curve" and path.is_straight:
        slope = np.maximum(np.abs(path.coefficients[0, 1]), 1e-150)  # along a straight way it is exact
        limits = (robot.speed_limits, robot.acceleration_limits, robot.jerk_limits)
        speed, acceleration, jerk = (float((most / slope).min()) for most in limits)
        law = law_over(path.high - path.low, min(speed, rate_cap), acceleration, jerk, profile)
        law = _from(path.low, law)
    elif profile in _SPLINES:
        law = jerk_limited_law(robot, path, fastest.law, rate_cap, _SPLINES[profile])
    else:
        law = law_over(path.high - path.low, 1.0, 1.0, 1.0, profile)
        law = _from(path.low, law)
    shaped = PathTrajectory(path, law)
    peaks = shaped.peaks
    needed = [  # times as long
        float((peaks.speed / robot.speed_limits).max()),
        float((peaks.acceleration / robot.acceleration_limits).max()) ** 0.5,
        float(law.derivative().bound_by_piece().max()) / rate_cap,
    ]
    if peaks.jerk is not None:
        needed.append(float((peaks.jerk / robot.jerk_limits).max()) ** (1 / 3))
    elif profile in _SPLINES:
        raise InputError(f"the profile {profile} keeps no jerk limit on this path: use trapezoid")
    return shaped.scaled(max(needed))


def _from(low: float, law: PiecewisePolynomial) -> PiecewisePolynomial:
    """A law that begins at 0, from the beginning of a path on."""
    c = law.coefficients.copy()
    c[:, 0] += low
    return PiecewisePolynomial(law.breaks, c)


_SAMPLES = 1001
_NEAR = 0.95
"""share of a limit from which on a motion counts as near it"""


def _bound(robot: Robot, motion: PathTrajectory, profile: ProfileName, rate_cap: float) -> str:
    """Which limit the motion is near for the longest time, in words."""
    times = np.linspace(0.0, motion.duration, 2 * _SAMPLES + 1)[1::2]
    state = motion.sample(times)
    limits = [
        ("speed", "°/s", state.velocity, robot.speed_limits),
        ("acceleration", "°/s²", state.acceleration, robot.acceleration_limits),
    ]
    if profile in _SPLINES:
        limits.append(("jerk", "°/s³", state.jerk, robot.jerk_limits))
    shares = [np.abs(values) / most for _, _, values, most in limits]
    shares.append(np.abs(motion.law.derivatives(times, 1)[1]) / rate_cap)
    share = np.concatenate(shares, axis=1)
    near = (share >= _NEAR).mean(axis=0)
    percent = math.floor(100 * float(near.max()))
    kind, joint = divmod(int((near if percent else share.max(axis=0)).argmax()), robot.n)
    when = f"for {percent} % of the time, longer than any other," if percent else "at one place"
    if percent > 50:
        when = "most of the time"
    if kind == len(limits):
        return f"{when} it goes at the speed that was asked for"
    what, unit, _, most = limits[kind]
    limit = robot.joints[joint].shown(float(most[joint]))
    return f"{when} {robot.joints[joint].title} is near its largest {what}, {limit:.3g} {unit}"
