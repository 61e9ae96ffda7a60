"""One motion as the checks of the pre-flight see it, and what a check finds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.motion.trajectory import (
    JoinedTrajectory,
    Peaks,
    Sample,
    Trajectory,
    combined,
    knows_peaks,
    peaks_of,
)
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_TRAVEL = math.radians(6)
"""No joint moves farther between two samples, as far as the peaks of the motion are known."""
_MOST = 4000
_FINEST_S = 1e-3
_FEWEST = 32

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


@dataclass(frozen=True, slots=True, eq=False)
class SampledMotion:
    """The m samples of a motion, and its extremes between them.

    Where a trajectory knows its peaks, no joint moves more than 6° between two samples, and a sample lies
    in the middle; another one is sampled every millisecond, or 4,000 times if it is longer. Each part of a
    joined trajectory is sampled alone, so the instant between two parts has two samples.
    """

    robot: Robot
    trajectory: Trajectory
    time: FloatArray
    """(m,) rising [s]"""
    q: FloatArray
    """(m, n) [rad]"""
    velocity: FloatArray
    """(m, n) [rad/s]"""
    acceleration: FloatArray
    """(m, n) [rad/s²]"""
    speed: FloatArray
    """(m, n) largest joint speeds of the part that each sample belongs to [rad/s]"""
    peaks: Peaks

    @classmethod
    def of(cls, robot: Robot, trajectory: Trajectory) -> SampledMotion:
        """Sample a trajectory.

        Raises:
            InputError: another number of joints, or a value that is not finite.
        """
        if trajectory.start.shape != (robot.n,) or trajectory.end.shape != (robot.n,):
            raise InputError(f"{robot.name} has {robot.n} joints, the trajectory has {len(trajectory.start)}")
        times: list[FloatArray] = []
        samples: list[Sample] = []
        peaks: list[Peaks] = []
        for part, begins in _parts(trajectory, 0.0):
            peaks.append(peaks_of(part))
            time = _sample_times(part, peaks[-1])
            times.append(time + begins)
            samples.append(part.sample(time))
        counts = [len(time) for time in times]
        return cls(
            robot,
            trajectory,
            np.concatenate(times),
            _joined("angle", [sample.q for sample in samples], counts, robot.n),
            _joined("speed", [sample.velocity for sample in samples], counts, robot.n),
            _joined("acceleration", [sample.acceleration for sample in samples], counts, robot.n),
            np.repeat([peak.speed for peak in peaks], counts, axis=0),
            combined(peaks),
        )


def _parts(trajectory: Trajectory, begins: float) -> Iterator[tuple[Trajectory, float]]:
    """The parts of a joined trajectory, or the trajectory itself, and when each begins [s]."""
    if isinstance(trajectory, JoinedTrajectory):
        for part, at in zip(trajectory.parts, trajectory.starts_at.tolist(), strict=True):
            yield from _parts(part, begins + at)
    else:
        yield trajectory, begins


def _sample_times(part: Trajectory, peaks: Peaks) -> FloatArray:
    duration = part.duration
    if not (math.isfinite(duration) and duration >= 0):
        raise InputError(f"a trajectory cannot take {duration} s")
    if duration == 0.0:
        return np.zeros(1)
    if knows_peaks(part):
        travel = float(peaks.speed.max()) * duration
        count = max(2 * math.ceil(0.5 * min(travel / _TRAVEL, _MOST)), 2)
    else:
        count = min(max(math.ceil(duration / _FINEST_S), _FEWEST), _MOST)
    return np.linspace(0.0, duration, count + 1)


def _joined(what: str, values: list[FloatArray], counts: list[int], n: int) -> FloatArray:
    shapes = [value.shape for value in values]
    joined = np.concatenate(values) if shapes == [(count, n) for count in counts] else np.array(np.nan)
    if not np.isfinite(joined).all():
        raise InputError(f"the trajectory gives a joint {what} that is not a finite number")
    return joined
