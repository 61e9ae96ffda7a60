"""Trapezoidal speed, every joint for itself: the papers' "normal movement".

Nothing is planned between the two poses: each joint speeds up, turns at its own largest speed, slows
down and waits for the others. Short ways end before the largest speed is met (a triangle).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError
from armctl.motion.profiles.cubic import checked_ends
from armctl.motion.trajectory import Sample
from armctl.robot import Robot

FloatArray = NDArray[np.float64]


class TrapezoidTrajectory:
    """Unsynchronised motion at each joint's own speed and acceleration. Immutable."""

    def __init__(self, start: ArrayLike, end: ArrayLike, speed: ArrayLike, acceleration: ArrayLike) -> None:
        """Take the limits as given.

        Args:
            start: (n,) [rad].
            end: (n,) [rad].
            speed: (n,) largest joint speeds [rad/s], positive.
            acceleration: (n,) largest joint accelerations [rad/s²], positive.

        Raises:
            InputError: shapes that differ, a value that is not finite, or a limit that is not positive.
        """
        self._start, self._end = checked_ends(start, end)
        v = np.array(speed, dtype=np.float64)
        a = np.array(acceleration, dtype=np.float64)
        for name, limit in (("speed", v), ("acceleration", a)):
            if limit.shape != self._start.shape or not (np.isfinite(limit).all() and (limit > 0).all()):
                raise InputError(
                    f"each of {len(self._start)} joints needs a positive {name} limit, got {limit}"
                )
        way = np.abs(self._end - self._start)
        self._sign = np.sign(self._end - self._start)
        self._acceleration = a
        self._peak = np.minimum(v, np.sqrt(way * a))  # a triangle where the way is short
        self._ramp = self._peak / a
        cruise = np.divide(way, self._peak, out=np.zeros_like(way), where=self._peak > 0)
        self._time = np.where(self._peak > 0, cruise + self._ramp, 0.0)
        self._duration = float(self._time.max())

    @classmethod
    def plan(cls, robot: Robot, start: ArrayLike, end: ArrayLike) -> TrapezoidTrajectory:
        """Plan at the robot's speed and acceleration limits.

        Raises:
            InputError: a value that is not finite, or a wrong shape.
        """
        return cls(start, end, robot.speed_limits, robot.acceleration_limits)

    @property
    def duration(self) -> float:
        """Seconds until the last joint has arrived."""
        return self._duration

    @property
    def start(self) -> FloatArray:
        """Where it starts (n,) [rad]."""
        return self._start.copy()

    @property
    def end(self) -> FloatArray:
        """Where it ends (n,) [rad]."""
        return self._end.copy()

    @property
    def peak_speed(self) -> FloatArray:
        """(n,) largest joint speeds [rad/s], exact."""
        return self._peak.copy()

    @property
    def peak_acceleration(self) -> FloatArray:
        """(n,) largest joint accelerations [rad/s²], exact."""
        return np.where(self._peak > 0, self._acceleration, 0.0)

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        time = np.asarray(t, dtype=np.float64)[..., None]
        since = np.clip(time, 0.0, self._time)
        left = self._time - since
        a, peak, ramp = self._acceleration, self._peak, self._ramp
        speeding, slowing = since < ramp, left < ramp
        # From the nearer end, so that both ends are met exactly.
        early = np.where(speeding, 0.5 * a * since * since, peak * (since - 0.5 * ramp))
        late = np.where(slowing, 0.5 * a * left * left, peak * (left - 0.5 * ramp))
        first_half = since <= left
        q = np.where(first_half, self._start + self._sign * early, self._end - self._sign * late)
        velocity = self._sign * np.where(speeding, a * since, np.where(slowing, a * left, peak))
        inside = (time >= 0) & (time <= self._time) & (self._peak > 0)
        push = np.where(speeding, a, np.where(slowing, -a, 0.0))
        return Sample(q, velocity, self._sign * np.where(inside, push, 0.0), np.zeros_like(q))
