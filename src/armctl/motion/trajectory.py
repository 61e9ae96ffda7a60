"""What every timed motion is: a function of time that can be sampled and checked before it is run."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import ArrayRecord, ByContent, FloatArray
from armctl.errors import InputError
from armctl.facts.angles import DEGREE, in_degrees
from armctl.kinematics.target import as_numbers, checked_number
from armctl.lazy_dataclass import dataclass
from armctl.robot import Robot


@dataclass(frozen=True, slots=True, eq=False)
class Sample(ByContent):
    """Joint state at one time, or at many: (..., n) rad, rad/s, rad/s², rad/s³; its arrays are no copies."""

    q: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray

    def made_of(self) -> tuple[FloatArray, ...]:
        """See ``ByContent``."""
        return self.q, self.velocity, self.acceleration, self.jerk


@dataclass(frozen=True, slots=True, eq=False)
class Peaks(ArrayRecord):
    """The extremes of a whole motion, exact or never passed: (n,) each."""

    low: FloatArray
    """smallest joint angles [rad]"""
    high: FloatArray
    """largest joint angles [rad]"""
    speed: FloatArray
    """largest joint speeds [rad/s]"""
    acceleration: FloatArray
    """largest joint accelerations, without sign [rad/s²]"""
    jerk: FloatArray | None = None
    """largest joint jerks, without sign [rad/s³]; None where the motion does not promise to limit them"""


@runtime_checkable
class Trajectory(Protocol):
    """A motion of all joints over ``0 ... duration`` seconds. Immutable.

    A motion that is given to the arm starts and ends at rest. The pieces of a blended program do not.
    """

    @property
    def duration(self) -> float:
        """Seconds; 0 for a motion that goes nowhere."""
        ...

    @property
    def start(self) -> FloatArray:
        """Where it starts (n,) [rad]."""
        ...

    @property
    def end(self) -> FloatArray:
        """Where it ends (n,) [rad]."""
        ...

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        ...


def as_times(t: ArrayLike) -> FloatArray:
    """Times (...) [s] at which a trajectory is sampled; ``InputError`` for what is none."""
    times = as_numbers(t, "the times of a trajectory")
    if np.isnan(times).any():
        raise InputError("the times of a trajectory must be numbers, got NaN")
    return times


class KnowsPeaks(ByContent):
    """Base of the trajectories that know their extremes without being sampled."""

    __slots__ = ()
    duration: float
    start: FloatArray
    end: FloatArray

    def __repr__(self) -> str:
        ends = " to ".join(
            f"({', '.join(f'{angle:z.1f}' for angle in q / DEGREE)})°" for q in (self.start, self.end)
        )
        return f"{type(self).__name__}({self.duration:.3f} s, from {ends})"

    @property
    def peaks(self) -> Peaks:
        """Extremes of the whole motion."""
        raise NotImplementedError


# Several motions one after the other, as one trajectory.

JOINT_TOLERANCE = 1e-9
"""How far the start of a part may lie from the end of the part before it [rad]."""


class JoinedTrajectory(KnowsPeaks):
    """Parts run in order. Immutable."""

    def __init__(self, parts: Sequence[Trajectory]) -> None:
        """At least one part, each starting where the one before it ends; else ``InputError``."""
        listed = isinstance(parts, Sequence)  # pyright: ignore[reportUnnecessaryIsInstance]
        if not (listed and all(isinstance(part, Trajectory) for part in parts)):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"a trajectory is joined of trajectories, not of {parts!r}")
        if not parts:
            raise InputError("a trajectory needs at least one part")
        for k, (before, after) in enumerate(pairwise(parts), 2):
            if before.end.shape != after.start.shape:
                raise InputError(f"part {k} has {len(after.start)} joints, the one before {len(before.end)}")
            gap = float(np.abs(before.end - after.start).max())
            if not gap <= JOINT_TOLERANCE:
                raise InputError(
                    f"part {k} starts {in_degrees(gap, '.4f')} away from where the one before it ends"
                )
        self.parts: tuple[Trajectory, ...] = tuple(parts)
        self.start, self.end = parts[0].start, parts[-1].end
        self._ends = np.cumsum([part.duration for part in parts])
        self.starts_at = np.concatenate([[0.0], self._ends[:-1]])
        """(k,) when each part starts [s]"""
        self.duration = float(self._ends[-1])
        last = len(parts) - 1
        self._own_times: list[tuple[float, float]] = [
            (-np.inf if k == 0 else 0.0, np.inf if k == last else part.duration)
            for k, part in enumerate(parts)
        ]
        """between which of its own times each part is sampled: no rounding may carry it over a seam"""

    def made_of(self) -> tuple[tuple[Trajectory, ...]]:
        """See ``ByContent``."""
        return (self.parts,)

    @property
    def peaks(self) -> Peaks:
        """As well known as those of its parts; the jerk of those that limit it."""
        return joined_peaks([peaks_of(part) for part in self.parts])

    def leaves(self) -> list[tuple[Trajectory, float]]:
        """The parts, joined ones taken apart, and when each begins [s]."""
        found: list[tuple[Trajectory, float]] = []
        for part, begins in zip(self.parts, self.starts_at.tolist(), strict=True):
            inner = part.leaves() if isinstance(part, JoinedTrajectory) else [(part, 0.0)]
            found += [(leaf, begins + at) for leaf, at in inner]
        return found

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        if type(t) is float and math.isfinite(t):
            k = min(int(self._ends.searchsorted(t)), len(self.parts) - 1)
            low, high = self._own_times[k]
            return self.parts[k].sample(min(max(t - float(self.starts_at[k]), low), high))
        time = as_times(t)
        which = np.minimum(np.searchsorted(self._ends, time, side="left"), len(self.parts) - 1)
        q, velocity, acceleration, jerk = np.empty((4, *time.shape, len(self.start)))
        for k in map(int, np.unique(which)):
            here, (low, high) = which == k, self._own_times[k]
            part = self.parts[k].sample(np.clip(time[here] - self.starts_at[k], low, high))
            q[here], velocity[here] = part.q, part.velocity
            acceleration[here], jerk[here] = part.acceleration, part.jerk
        return Sample(q, velocity, acceleration, jerk)


def joined_peaks(peaks: Sequence[Peaks]) -> Peaks:
    """Extremes of motions one after the other, from those of each."""
    low, high = np.min([one.low for one in peaks], axis=0), np.max([one.high for one in peaks], axis=0)
    speed, acceleration = np.max([(one.speed, one.acceleration) for one in peaks], axis=0)
    jerks = [one.jerk for one in peaks if one.jerk is not None]
    return Peaks(low, high, speed, acceleration, np.max(jerks, axis=0) if jerks else None)


_SAMPLES = 4001


def peaks_of(trajectory: Trajectory) -> Peaks:
    """Extremes of a whole motion: exact where it knows them, else of 4,001 samples and the steps between."""
    if isinstance(trajectory, KnowsPeaks):
        return trajectory.peaks
    time = np.linspace(0.0, trajectory.duration, _SAMPLES)
    state = trajectory.sample(time)
    speed = np.abs(state.velocity).max(axis=0)
    if trajectory.duration > 0:
        speed = np.maximum(speed, (np.abs(np.diff(state.q, axis=0)) / np.diff(time)[:, None]).max(axis=0))
    return Peaks(state.q.min(axis=0), state.q.max(axis=0), speed, np.abs(state.acceleration).max(axis=0))


class RestOfTrajectory(KnowsPeaks):
    """What is left of a trajectory from some time on; it may begin in motion. Immutable."""

    def __init__(self, trajectory: Trajectory, begins: float) -> None:
        """``begins``: within its duration [s]; outside it is taken as the nearer end."""
        self.inner, self.begins = trajectory, min(max(begins, 0.0), trajectory.duration)
        self.duration = trajectory.duration - self.begins
        self.start, self.end = trajectory.sample(self.begins).q, trajectory.end

    def made_of(self) -> tuple[Trajectory, float]:
        """See ``ByContent``."""
        return self.inner, self.begins

    @property
    def peaks(self) -> Peaks:
        """Those of the whole trajectory, which are never passed."""
        return peaks_of(self.inner)

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        return self.inner.sample(np.maximum(as_times(t), 0.0) + self.begins)


class SlowedTrajectory(KnowsPeaks):
    """A trajectory that takes a number of times as long, on the same way. Immutable."""

    def __init__(self, trajectory: Trajectory, factor: float) -> None:
        """``factor`` times as long: at least 1 and finite, else ``InputError``."""
        factor = checked_number(factor, "how many times as long a motion takes")
        if not 1.0 <= factor < np.inf:
            raise InputError(f"a motion is slowed down by a factor of 1 or more, not {factor}")
        self.inner, self.factor = trajectory, factor
        self.duration = factor * trajectory.duration
        self.start, self.end = trajectory.start, trajectory.end

    def made_of(self) -> tuple[Trajectory, float]:
        """See ``ByContent``."""
        return self.inner, self.factor

    @property
    def peaks(self) -> Peaks:
        """As well known as those of the trajectory it was made of."""
        peaks, f = peaks_of(self.inner), self.factor
        jerk = None if peaks.jerk is None else peaks.jerk / f**3
        return Peaks(peaks.low, peaks.high, peaks.speed / f, peaks.acceleration / f**2, jerk)

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        f = self.factor
        state = self.inner.sample(as_times(t) / f)
        return Sample(state.q, state.velocity / f, state.acceleration / f**2, state.jerk / f**3)


# A motion looked at: samples so near to each other that what lies between is bounded.

_TRAVEL = 6 * DEGREE
"""No joint moves farther between two samples, as far as the peaks of the motion are known."""
_MOST, _MOST_IN_ALL = 4000, 40_000
_FINEST_S = 1e-3
_FEWEST = 32
LOOKS, _NARROWED = 17, 3
"""times that are looked at, and how often, to find the worst place between two samples"""


class SampledMotion:
    """The m samples of a motion, and its extremes between them.

    Where a trajectory knows its peaks, no joint moves more than 6° between two samples; another one is
    sampled every millisecond, at most 4,000 times. Each part of a joined trajectory is sampled alone.
    """

    def __init__(self, robot: Robot, trajectory: Trajectory) -> None:
        """InputError: another number of joints, or a value that is not finite."""
        if not isinstance(trajectory, Trajectory):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"a motion is a trajectory, not {trajectory!r}")
        if trajectory.start.shape != (robot.n,) or trajectory.end.shape != (robot.n,):
            raise InputError(f"{robot.name} has {robot.n} joints, the trajectory has {len(trajectory.start)}")
        parts = trajectory.leaves() if isinstance(trajectory, JoinedTrajectory) else [(trajectory, 0.0)]
        times, speeds = list[FloatArray](), list[FloatArray]()
        states: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        left, peaks = _MOST_IN_ALL, [peaks_of(part) for part, _ in parts]
        for (part, begins), speed in zip(parts, [one.speed for one in peaks], strict=True):
            duration = part.duration
            if not (math.isfinite(duration) and duration >= 0):
                raise InputError(f"a trajectory cannot take {duration} s")
            if isinstance(part, KnowsPeaks):
                travel = min(float(speed.max()) * duration / _TRAVEL, _MOST)
                count = max(2 * math.ceil(0.5 * travel), 2)
            else:
                count = min(max(math.ceil(duration / _FINEST_S), _FEWEST), _MOST)
            left -= count - 2  # the fewest
            if left < 0:
                raise InputError(
                    f"a motion of {len(parts)} parts that needs more than {_MOST_IN_ALL} samples is too long "
                    "to check; join fewer"
                )
            time = np.linspace(0.0, duration, count + 1) if duration else np.zeros(1)
            state = part.sample(time)
            times.append(begins + time)
            speeds.append(np.broadcast_to(speed, (len(time), robot.n)))
            states.append((state.q, state.velocity, state.acceleration))
            for name, values in zip(("angle", "speed", "acceleration"), states[-1], strict=True):
                if values.shape != (len(time), robot.n) or not np.isfinite(values).all():
                    raise InputError(f"the trajectory gives a joint {name} that is not a finite number")
        self.robot, self.trajectory = robot, trajectory
        self.time = np.concatenate(times)
        """(m,) rising [s]"""
        self.q, self.velocity, self.acceleration = map(np.concatenate, zip(*states, strict=True))
        """(m, n) [rad], [rad/s], [rad/s²]"""
        self.speed = np.concatenate(speeds)
        """(m, n) largest joint speeds of the part that each sample belongs to [rad/s]"""
        self.peaks = joined_peaks(peaks)
        ends = [
            (begins, state[1]) for (_, begins), state in zip(parts, states, strict=True) if len(state[1]) > 1
        ]
        self.seams = [(at, after[0] - before[-1]) for (_, before), (at, after) in pairwise(ends)]
        """when each part but the first begins [s], and how far the joint speeds jump there (n,) [rad/s]"""

    def told(self, time: float, holds: Callable[[float], bool]) -> tuple[float, int]:
        """A time as a text says it [s], and its decimals: hundredths, if it holds there, or finer."""
        for digits in (2, 3, 4):
            rounded = min(round(time, digits), float(self.time[-1]))
            if holds(rounded):
                return rounded, digits
        return time, 4

    def beside(self, at: int) -> tuple[float, float]:
        """The times of the samples before and behind one [s]."""
        return float(self.time[max(at - 1, 0)]), float(self.time[min(at + 1, len(self.time) - 1)])

    def least_at(self, measure: Callable[[FloatArray], FloatArray], begin: float, end: float) -> float:
        """When a measure of the motion at times (m,) [s] is least between two samples [s]."""
        when = begin
        for _ in range(_NARROWED):
            times = np.linspace(begin, end, LOOKS)
            at = int(measure(times).argmin())
            begin, when, end = times[[max(at - 1, 0), at, min(at + 1, LOOKS - 1)]].tolist()
        return when

    def rates(self, time: FloatArray, order: int) -> FloatArray:
        """(m, n) size of one of ``_RATES`` of the joints [rad/s], [rad/s²], [rad/s³] at times (m,) [s]."""
        state = self.trajectory.sample(time)
        return np.abs((state.velocity, state.acceleration, state.jerk)[order])
