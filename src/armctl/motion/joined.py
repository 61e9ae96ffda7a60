"""Several motions one after the other, as one trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.motion.trajectory import Sample, Trajectory

FloatArray = NDArray[np.float64]
JOINT_TOLERANCE = 1e-9
"""How far the start of a part may lie from the end of the part before it [rad]."""


class JoinedTrajectory:
    """Parts run in order. Immutable."""

    def __init__(self, parts: Sequence[Trajectory]) -> None:
        """Join.

        Args:
            parts: at least one; each starts where the one before it ends.

        Raises:
            InputError: no part, or parts that do not meet.
        """
        if not parts:
            raise InputError("a trajectory needs at least one part")
        for k, (before, after) in enumerate(pairwise(parts), 2):
            if before.end.shape != after.start.shape:
                raise InputError(f"part {k} has {len(after.start)} joints, the one before {len(before.end)}")
            gap = float(np.abs(before.end - after.start).max())
            if not gap <= JOINT_TOLERANCE:
                raise InputError(
                    f"part {k} starts {np.degrees(gap):.4f}° away from where the one before it ends"
                )
        self.parts = tuple(parts)
        self._ends = np.cumsum([part.duration for part in parts])

    @property
    def duration(self) -> float:
        """Seconds, over all parts."""
        return float(self._ends[-1])

    @property
    def start(self) -> FloatArray:
        """Where the first part starts (n,) [rad]."""
        return self.parts[0].start

    @property
    def end(self) -> FloatArray:
        """Where the last part ends (n,) [rad]."""
        return self.parts[-1].end

    @property
    def starts_at(self) -> FloatArray:
        """(k,) when each part starts [s]."""
        return np.concatenate([[0.0], self._ends[:-1]])

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        time = np.asarray(t, dtype=np.float64)
        which = np.minimum(np.searchsorted(self._ends, time, side="left"), len(self.parts) - 1)
        starts = self.starts_at
        if time.ndim == 0:
            k = int(which)
            return self.parts[k].sample(self._local(k, time - starts[k]))
        shape = (*time.shape, len(self.start))
        q, velocity, acceleration, jerk = (np.empty(shape) for _ in range(4))
        for k, part_trajectory in enumerate(self.parts):
            here = which == k
            if not here.any():
                continue
            part = part_trajectory.sample(self._local(k, time[here] - starts[k]))
            q[here], velocity[here] = part.q, part.velocity
            acceleration[here], jerk[here] = part.acceleration, part.jerk
        return Sample(q, velocity, acceleration, jerk)

    def _local(self, k: int, time: FloatArray) -> FloatArray:
        """Time within a part; a rounding must not carry it over a seam: beyond, a part stands."""
        low = -np.inf if k == 0 else 0.0
        high = np.inf if k == len(self.parts) - 1 else self.parts[k].duration
        return np.clip(time, low, high)
