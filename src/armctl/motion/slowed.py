"""A motion that takes longer: what a speed below 100 % makes of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.motion.peaks import peaks_of
from armctl.motion.trajectory import Peaks, Sample, Trajectory

FloatArray = NDArray[np.float64]


class SlowedTrajectory:
    """Another trajectory on the same path at a constant share of its speed. Immutable."""

    def __init__(self, trajectory: Trajectory, speed: float) -> None:
        """Slow down.

        Args:
            trajectory: the motion at full speed.
            speed: share of it, above 0, at most 1.

        Raises:
            InputError: a share that cannot be.
        """
        if not 0 < speed <= 1:
            raise InputError(f"a motion cannot run at {100 * speed:g} % of its speed")
        self._fast, self._speed = trajectory, speed

    @property
    def duration(self) -> float:
        """Seconds."""
        return self._fast.duration / self._speed

    @property
    def start(self) -> FloatArray:
        """Where it starts (n,) [rad]."""
        return self._fast.start

    @property
    def end(self) -> FloatArray:
        """Where it ends (n,) [rad]."""
        return self._fast.end

    @property
    def peaks(self) -> Peaks:
        """Extremes of the whole motion."""
        fast = peaks_of(self._fast)
        return Peaks(fast.low, fast.high, fast.speed * self._speed, fast.acceleration * self._speed**2)

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        state, speed = self._fast.sample(np.asarray(t, dtype=np.float64) * self._speed), self._speed
        return Sample(
            state.q, state.velocity * speed, state.acceleration * speed**2, state.jerk * speed**3
        )
