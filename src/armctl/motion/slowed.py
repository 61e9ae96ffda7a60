"""The same motion, slower."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.motion.peaks import peaks_of
from armctl.motion.trajectory import Peaks, Sample, Trajectory

FloatArray = NDArray[np.float64]


class SlowedTrajectory:
    """A trajectory that takes a number of times as long, on the same way. Immutable."""

    def __init__(self, trajectory: Trajectory, factor: float) -> None:
        """Slow down.

        Args:
            trajectory: what is slowed down.
            factor: how many times as long it takes, at least 1.

        Raises:
            InputError: a factor under 1, or not finite.
        """
        if not 1.0 <= factor < np.inf:
            raise InputError(f"a motion is slowed down by a factor of 1 or more, not {factor}")
        self._trajectory = trajectory
        self._factor = factor

    @property
    def duration(self) -> float:
        """Seconds."""
        return self._factor * self._trajectory.duration

    @property
    def start(self) -> FloatArray:
        """Where it starts (n,) [rad]."""
        return self._trajectory.start

    @property
    def end(self) -> FloatArray:
        """Where it ends (n,) [rad]."""
        return self._trajectory.end

    @property
    def peaks(self) -> Peaks:
        """Extremes of the whole motion, as well known as those of the trajectory it was made of."""
        peaks, f = peaks_of(self._trajectory), self._factor
        return Peaks(peaks.low, peaks.high, peaks.speed / f, peaks.acceleration / f**2)

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        f = self._factor
        state = self._trajectory.sample(np.asarray(t, dtype=np.float64) / f)
        return Sample(state.q, state.velocity / f, state.acceleration / f**2, state.jerk / f**3)
