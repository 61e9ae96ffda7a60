"""The trajectories that the arm still has to follow, end to end on one time axis."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.motion import Sample, Trajectory

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    trajectory: Trajectory
    tag: Hashable
    begins: float
    ends: float


class Track:
    """A queue of trajectories; what lies behind is forgotten. Owned by one thread."""

    def __init__(self) -> None:
        self._stretches: deque[_Stretch] = deque()
        self._end = 0.0

    @property
    def end(self) -> float:
        """Time at which the last trajectory ends [s]."""
        return self._end

    @property
    def goal(self) -> FloatArray:
        """(n,) where the present trajectory ends [rad]."""
        return self._stretches[0].trajectory.end

    @property
    def tag(self) -> Hashable:
        """What the present trajectory was given."""
        return self._stretches[0].tag

    def append(self, trajectory: Trajectory, tag: Hashable = None) -> None:
        """Put a trajectory at the end; it starts where the one before it ends, as fast."""
        self._stretches.append(_Stretch(trajectory, tag, self._end, self._end + trajectory.duration))
        self._end += trajectory.duration

    def drop_from(self, tag: Hashable) -> None:
        """Drop the trajectory with this tag, which must not have begun, and all behind it."""
        while self._stretches[-1].tag != tag:
            self._stretches.pop()
        self._end = self._stretches.pop().begins

    def forget(self, time: float) -> None:
        """Drop what ends before ``time`` [s]; the last trajectory stays."""
        while len(self._stretches) > 1 and self._stretches[0].ends <= time:
            self._stretches.popleft()

    def progress(self, time: float) -> float:
        """0..1 of the present trajectory."""
        here = self._stretches[0]
        length = here.ends - here.begins
        return 1.0 if length == 0 else min(max((time - here.begins) / length, 0.0), 1.0)

    def left(self, time: float) -> float:
        """Of the present trajectory [s]."""
        return max(self._stretches[0].ends - time, 0.0)

    def sample(self, times: FloatArray) -> Sample:
        """State at rising times (k,) [s]; at a seam, that of the trajectory before it."""
        first = self._stretches[0]
        if len(self._stretches) == 1 or times[-1] <= first.ends:
            local = np.maximum(times - first.begins, 0.0)
            if len(self._stretches) > 1:
                local = np.minimum(local, first.trajectory.duration)
            return first.trajectory.sample(local)
        parts: list[Sample] = []
        done = 0
        for number, stretch in enumerate(self._stretches, 1):
            if number == len(self._stretches):
                count = len(times)
            else:
                count = int(np.searchsorted(times, stretch.ends, side="right"))
            if count > done:
                local = times[done:count] - stretch.begins
                if number < len(self._stretches):  # a rounding must not carry it over the seam
                    local = np.minimum(local, stretch.trajectory.duration)
                parts.append(stretch.trajectory.sample(np.maximum(local, 0.0)))
                done = count
            if done == len(times):
                break
        return Sample(
            np.concatenate([part.q for part in parts]),
            np.concatenate([part.velocity for part in parts]),
            np.concatenate([part.acceleration for part in parts]),
            np.concatenate([part.jerk for part in parts]),
        )
