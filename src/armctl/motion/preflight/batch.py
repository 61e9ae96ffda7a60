"""Many motions sampled as one: their samples lie end to end in one array, so that a check is one pass."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.motion.joined import JoinedTrajectory
from armctl.motion.peaks import peaks_of
from armctl.motion.preflight.stacked import stacked_angles
from armctl.motion.profiles import PointToPoint
from armctl.motion.trajectory import KnowsPeaks, Peaks, Sample, Trajectory
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
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
