"""One motion as the checks of the pre-flight see it, and what a check finds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.motion.trajectory import JoinedTrajectory, KnowsPeaks, Peaks, Trajectory, peaks_of
from armctl.robot import Robot

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
        parts = trajectory.leaves() if isinstance(trajectory, JoinedTrajectory) else [(trajectory, 0.0)]
        times: list[FloatArray] = []
        speeds: list[FloatArray] = []
        states: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        for part, begins in parts:
            duration, speed = part.duration, peaks_of(part).speed
            if not (math.isfinite(duration) and duration >= 0):
                raise InputError(f"a trajectory cannot take {duration} s")
            if isinstance(part, KnowsPeaks):
                travel = min(float(speed.max()) * duration / _TRAVEL, _MOST)
                count = max(2 * math.ceil(0.5 * travel), 2)
            else:
                count = min(max(math.ceil(duration / _FINEST_S), _FEWEST), _MOST)
            time = np.linspace(0.0, duration, count + 1) if duration else np.zeros(1)
            state = part.sample(time)
            times.append(begins + time)
            speeds.append(np.broadcast_to(speed, (len(time), robot.n)))
            states.append((state.q, state.velocity, state.acceleration))
            for what, values in zip(("angle", "speed", "acceleration"), states[-1], strict=True):
                if values.shape != (len(time), robot.n) or not np.isfinite(values).all():
                    raise InputError(f"the trajectory gives a joint {what} that is not a finite number")
        q, velocity, acceleration = map(np.concatenate, zip(*states, strict=True))
        return cls(
            robot,
            trajectory,
            np.concatenate(times),
            q,
            velocity,
            acceleration,
            np.concatenate(speeds),
            peaks_of(trajectory),
        )
