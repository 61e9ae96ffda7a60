"""The extremes of any trajectory: exact where it knows them, sampled where it does not."""

from __future__ import annotations

import numpy as np

from armctl.motion.joined import JoinedTrajectory
from armctl.motion.trajectory import KnowsPeaks, Peaks, Trajectory

_SAMPLES = 4001


def knows_peaks(trajectory: Trajectory) -> bool:
    """Whether ``peaks_of`` needs no samples."""
    if isinstance(trajectory, JoinedTrajectory):
        return all(knows_peaks(part) for part in trajectory.parts)
    return isinstance(trajectory, KnowsPeaks)


def peaks_of(trajectory: Trajectory) -> Peaks:
    """Extremes of a whole motion.

    Those of somebody else's trajectory are taken from 4,001 samples, the steps between them included: it
    may not be what it says of itself.
    """
    if isinstance(trajectory, JoinedTrajectory):
        return _over([peaks_of(part) for part in trajectory.parts])
    if isinstance(trajectory, KnowsPeaks):
        return trajectory.peaks
    time = np.linspace(0.0, trajectory.duration, _SAMPLES)
    state = trajectory.sample(time)
    speed = np.abs(state.velocity).max(axis=0)
    if trajectory.duration > 0:
        speed = np.maximum(speed, (np.abs(np.diff(state.q, axis=0)) / np.diff(time)[:, None]).max(axis=0))
    return Peaks(state.q.min(axis=0), state.q.max(axis=0), speed, np.abs(state.acceleration).max(axis=0))


def _over(peaks: list[Peaks]) -> Peaks:
    return Peaks(
        np.min([p.low for p in peaks], axis=0),
        np.max([p.high for p in peaks], axis=0),
        np.max([p.speed for p in peaks], axis=0),
        np.max([p.acceleration for p in peaks], axis=0),
    )
