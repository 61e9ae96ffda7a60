"""Many motions sampled as one: their samples lie end to end in one array, so that a check is one pass."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.profiles import PointToPoint
from armctl.motion.trajectory import JoinedTrajectory, KnowsPeaks, Peaks, Sample, Trajectory, peaks_of
from armctl.robot import Robot

# Many point-to-point motions evaluated with one call each power, not one by one.

FloatArray = NDArray[np.float64]


def stacked_angles(motions: Sequence[PointToPoint], times: Sequence[FloatArray]) -> FloatArray:
    """Joint angles of many motions: what ``sample`` of each gives at its own times, end to end.

    Args:
        motions: at least one.
        times: one array (k,) a motion, rising, the last one its duration [s].

    Returns:
        (Σ k, n) [rad].
    """
    counts = np.array([len(time) for time in times])
    start, end = np.array([m.start for m in motions]), np.array([m.end for m in motions])
    owner = np.repeat(np.arange(len(motions)), counts)
    ways = [motion.way for motion in motions]
    pieces = np.cumsum([0, *(0 if way is None else len(way.coefficients) for way in ways)])
    time = np.concatenate(times)
    gone = np.zeros((len(time), start.shape[1]))
    if pieces[-1]:
        piece = np.minimum(pieces[owner], pieces[-1] - 1)
        for first, way, low in zip(pieces, ways, np.cumsum(counts) - counts, strict=False):
            if way is not None and len(way.coefficients) > 1:
                part = slice(low, low + counts[owner[low]])
                piece[part] = first + np.searchsorted(way.breaks[1:-1], time[part])
        gone = _evaluated([way for way in ways if way is not None], piece, time)
        gone[np.array([way is None for way in ways])[owner]] = 0.0
    q = np.clip(start[owner] + gone, np.minimum(start, end)[owner], np.maximum(start, end)[owner])
    q[np.cumsum(counts) - 1] = end
    return q


def _evaluated(ways: Sequence[PiecewisePolynomial], piece: NDArray[np.intp], time: FloatArray) -> FloatArray:
    """(m, n) values: sample i by the piece number ``piece[i]`` of all pieces of all ways."""
    size = max(way.coefficients.shape[1] for way in ways)
    coefficients = np.concatenate(
        [np.pad(w.coefficients, ((0, 0), (0, size - w.coefficients.shape[1]), (0, 0))) for w in ways]
        if any(way.coefficients.shape[1] != size for way in ways)
        else [way.coefficients for way in ways]
    )
    x = (time - np.concatenate([way.breaks[:-1] for way in ways])[piece])[:, None]
    out = coefficients[piece, size - 1]
    for power in reversed(range(size - 1)):
        out *= x
        out += coefficients[piece, power]
    return out


IntArray = NDArray[np.intp]
_TRAVEL = math.radians(6)
"""No joint moves farther between two samples, as far as the peaks of the motion are known."""
_MOST = 4000
_FINEST_S = 1e-3
_FEWEST = 32
_CHUNK = 8192


@dataclass(frozen=True, slots=True, eq=False)
class Leaf:
    """A motion, or one part of a joined one."""

    trajectory: Trajectory
    motion: int
    """index of the motion it belongs to"""
    begins: float
    """when, from the start of the motion [s]"""
    time: FloatArray
    """(k,) of its samples, from its own beginning [s]"""
    peaks: Peaks


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """Some neighbouring samples; the last one is also the first of the next chunk."""

    q: FloatArray
    """(m, n) [rad]"""
    time: FloatArray
    """(m,) from the start of the motion [s]"""
    motion: IntArray
    """(m,) index of the motion"""
    leaf: IntArray
    """(m,) index of the leaf; between two samples of one leaf there is an interval of the motion"""


@dataclass(frozen=True, eq=False)
class Batch:
    """The samples of many motions.

    Where a trajectory knows its peaks, no joint moves more than 6° between two samples, and a sample lies
    in the middle; another one is sampled every millisecond, or 4,000 times if it is longer.
    """

    robot: Robot
    motions: int
    leaves: tuple[Leaf, ...]
    q: FloatArray
    """(m, n) all samples, leaf by leaf [rad]"""
    end_speeds: FloatArray
    """(2, leaves, n) joint speeds at the beginning and the end of each leaf, without sign [rad/s]"""

    @classmethod
    def of(cls, robot: Robot, trajectories: Sequence[Trajectory]) -> Batch:
        """Sample trajectories.

        Raises:
            InputError: one has another number of joints, or a value that is not finite.
        """
        leaves: list[Leaf] = []
        knows: dict[type[Trajectory], bool] = {}
        for motion, trajectory in enumerate(trajectories):
            if trajectory.start.shape != (robot.n,) or trajectory.end.shape != (robot.n,):
                raise InputError(
                    f"{robot.name} has {robot.n} joints, the trajectory has {len(trajectory.start)}"
                )
            leaves += _leaves(trajectory, motion, 0.0, knows)
        return cls(robot, len(trajectories), tuple(leaves), *_samples(leaves, robot.n))

    @cached_property
    def counts(self) -> IntArray:
        """(leaves,) how many samples each leaf has."""
        return np.array([len(leaf.time) for leaf in self.leaves], dtype=np.intp)

    @cached_property
    def stops(self) -> IntArray:
        """(leaves,) index of the sample behind the last one of each leaf."""
        return np.cumsum(self.counts)

    @cached_property
    def owner(self) -> IntArray:
        """(leaves,) index of the motion that each leaf belongs to."""
        return np.array([leaf.motion for leaf in self.leaves], dtype=np.intp)

    @cached_property
    def first(self) -> IntArray:
        """(motions,) index of the first leaf of each motion."""
        return np.searchsorted(self.owner, np.arange(self.motions))

    @cached_property
    def last(self) -> IntArray:
        """(motions,) index of the last leaf of each motion."""
        return np.append(self.first[1:], len(self.leaves)) - 1

    @property
    def starts(self) -> FloatArray:
        """(motions, n) where each motion starts [rad]."""
        return self.q[(self.stops - self.counts)[self.first]]

    @property
    def ends(self) -> FloatArray:
        """(motions, n) where each motion ends [rad]."""
        return self.q[self.stops[self.last] - 1]

    @property
    def end_times(self) -> FloatArray:
        """(motions,) how long each motion takes [s]."""
        ends: list[float] = [leaf.begins + float(leaf.time[-1]) for leaf in self.leaves]
        return np.array(ends)[self.last]

    @cached_property
    def speeds(self) -> FloatArray:
        """(leaves, n) largest joint speeds [rad/s]."""
        return np.array([leaf.peaks.speed for leaf in self.leaves])

    def angles(self, leaf: int) -> FloatArray:
        """(k, n) the samples of one leaf [rad]."""
        return self.q[self.stops[leaf] - self.counts[leaf] : self.stops[leaf]]

    def chunks(self) -> Iterator[Chunk]:
        """All samples, a few thousand at a time, so that what they need stays in the cache."""
        time = np.concatenate([leaf.time + leaf.begins for leaf in self.leaves])
        leaf = np.repeat(np.arange(len(self.leaves)), self.counts)
        motion = self.owner[leaf]
        for low in range(0, max(len(self.q) - 1, 1), _CHUNK):
            part = slice(low, low + _CHUNK + 1)
            yield Chunk(self.q[part], time[part], motion[part], leaf[part])


def _leaves(
    trajectory: Trajectory, motion: int, begins: float, knows: dict[type[Trajectory], bool]
) -> Iterator[Leaf]:
    if isinstance(trajectory, JoinedTrajectory):
        for part, at in zip(trajectory.parts, trajectory.starts_at.tolist(), strict=True):
            yield from _leaves(part, motion, begins + at, knows)
        return
    duration = trajectory.duration
    if not (math.isfinite(duration) and duration >= 0):
        raise InputError(f"a trajectory cannot take {duration} s")
    kind = type(trajectory)
    if kind not in knows:  # remembered, since asking takes 20 µs
        knows[kind] = isinstance(trajectory, KnowsPeaks)
    if knows[kind]:
        peaks = cast(KnowsPeaks, trajectory).peaks
        travel = float(peaks.speed.max(initial=0.0)) * duration
        count = 2 * math.ceil(0.5 * travel / _TRAVEL) if math.isfinite(travel) else _MOST
        yield Leaf(trajectory, motion, begins, _evenly(duration, min(max(count, 2), _MOST)), peaks)
    else:
        count = min(max(math.ceil(duration / _FINEST_S), _FEWEST), _MOST)
        yield Leaf(trajectory, motion, begins, _evenly(duration, count), peaks_of(trajectory))


def _evenly(duration: float, count: int) -> FloatArray:
    if duration == 0.0:
        return np.zeros(1)
    return np.linspace(0.0, duration, count + 1)


def _samples(leaves: Sequence[Leaf], n: int) -> tuple[FloatArray, FloatArray]:
    """All joint angles (m, n), and the speeds (2, leaves, n) at the ends."""
    stops = np.cumsum([len(leaf.time) for leaf in leaves])
    q, speeds = np.empty((int(stops[-1]), n)), np.zeros((2, len(leaves), n))
    plain: list[tuple[PointToPoint, FloatArray]] = []  # from rest to rest by themselves
    places: list[IntArray] = []
    for i, (leaf, stop) in enumerate(zip(leaves, stops.tolist(), strict=True)):
        where = slice(stop - len(leaf.time), stop)
        if isinstance(leaf.trajectory, PointToPoint):
            plain.append((leaf.trajectory, leaf.time))
            places.append(np.arange(stop - len(leaf.time), stop, dtype=np.intp))
        else:
            sample = _sampled(leaf.trajectory, leaf.time)
            q[where] = sample.q
            speeds[:, i] = np.abs(sample.velocity[[0, -1]])
    if plain:
        q[np.concatenate(places)] = stacked_angles([m for m, _ in plain], [time for _, time in plain])
    return q, speeds


def _sampled(trajectory: Trajectory, time: FloatArray) -> Sample:
    sample = trajectory.sample(time)
    for what, values in (
        ("angle", sample.q),
        ("speed", sample.velocity),
        ("acceleration", sample.acceleration),
    ):
        if values.shape != (len(time), len(trajectory.start)) or not np.isfinite(values).all():
            raise InputError(f"the trajectory gives a joint {what} that is not a finite number")
    return sample


# What a check finds.

Severity = Literal["error", "warning"]
"""error: the motion is refused. warning: it is shown, and the motion may be run."""
Kind = Literal[
    "limits",
    "reach",
    "speed",
    "acceleration",
    "rest",
    "floor",
    "obstacle",
    "self-collision",
    "singularity",
    "torque",
    "program",
]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong with a trajectory."""

    time: float
    """when it is worst [s]"""
    part: str
    """the joint, or the part of the arm"""
    what: str
    """what is wrong, with numbers"""
    mend: str
    """what to do about it"""
    kind: Kind
    """which check found it"""
    severity: Severity = "error"

    def __str__(self) -> str:
        return f"{self.part}: at {self.time:.2f} s, {self.what}; {self.mend}"


# The worst of each motion, kept while its samples go by.


class Worst:
    """For each of N motions how bad it gets, when, and what goes with it; badness up to 0 does not count."""

    def __init__(self, motions: int) -> None:
        self.badness = np.zeros(motions)
        """(N,); 0 where nothing was found"""
        self.time = np.zeros(motions)
        """(N,) [s]"""
        self.which = np.zeros(motions, dtype=np.intp)
        """(N,) index of the part"""
        self.figure = np.zeros(motions)
        """(N,) what is to be told"""

    @property
    def found(self) -> IntArray:
        """Indices of the motions that something was found in."""
        return np.flatnonzero(self.badness > 0.0)

    def look(
        self, motion: IntArray, time: FloatArray, badness: FloatArray, which: IntArray, figure: FloatArray
    ) -> None:
        """Take in samples, (m,) each; of samples that are equally bad the earliest counts."""
        bad = np.flatnonzero(badness > self.badness[motion])
        if not len(bad):
            return
        # With an index that comes again the last assignment stands: the worst go last, of equals the first.
        bad = bad[np.lexsort((-time[bad], badness[bad]))]
        at = motion[bad]
        self.badness[at], self.time[at] = badness[bad], time[bad]
        self.which[at], self.figure[at] = which[bad], figure[bad]
