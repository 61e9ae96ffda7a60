"""Third-order point-to-point motion: the papers' "planned movement", synchronised over the joints.

``q(t) = q0 + d (3 u² - 2 u³)`` with ``u = t / T``: at rest at both ends. The largest speed
``1.5 |d| / T`` is at the middle, the largest acceleration ``6 |d| / T²`` at the ends.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError, MotionRefusedError
from armctl.motion.trajectory import Sample
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_PEAK_SPEED = 1.5
_PEAK_ACCELERATION = 6.0
_ROUNDING = 1e-9


class CubicTrajectory:
    """A third-order motion from one configuration to another. Immutable."""

    def __init__(self, start: ArrayLike, end: ArrayLike, duration: float) -> None:
        """Take it as it is, without limits.

        Args:
            start: (n,) [rad].
            end: (n,) [rad].
            duration: seconds; 0 only where start and end are the same.

        Raises:
            InputError: shapes that differ, a value that is not finite, or a duration that cannot be.
        """
        self._start, self._end = checked_ends(start, end)
        self._travel = self._end - self._start
        if not math.isfinite(duration) or duration < 0 or (duration == 0 and bool(self._travel.any())):
            raise InputError(f"a motion cannot take {duration} s")
        self._duration = float(duration)

    @classmethod
    def plan(
        cls, robot: Robot, start: ArrayLike, end: ArrayLike, duration_s: float | None = None
    ) -> CubicTrajectory:
        """Plan within the robot's speed and acceleration limits.

        Args:
            robot: whose limits.
            start: (n,) [rad].
            end: (n,) [rad].
            duration_s: seconds; None: the shortest that the limits allow.

        Raises:
            InputError: a value that is not finite, or a wrong shape.
            MotionRefusedError: the duration is too short; names the joint, what it would need and the
                shortest possible duration.
        """
        start, end = checked_ends(start, end)
        if len(start) != robot.n:
            raise InputError(f"{robot.n} joint angles are needed, got {len(start)}")
        shortest = shortest_duration(end - start, robot.speed_limits, robot.acceleration_limits)
        if duration_s is None:
            return cls(start, end, shortest)
        if not math.isfinite(duration_s) or duration_s < 0:
            raise InputError(f"a motion cannot take {duration_s} s; leave it open for the shortest")
        if duration_s < shortest * (1 - _ROUNDING):
            raise MotionRefusedError(_too_short(robot, end - start, duration_s, shortest))
        return cls(start, end, max(duration_s, shortest))

    @property
    def duration(self) -> float:
        """Seconds; 0 for a motion that goes nowhere."""
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
        if self._duration == 0:
            return np.zeros(len(self._start))
        return _PEAK_SPEED * np.abs(self._travel) / self._duration

    @property
    def peak_acceleration(self) -> FloatArray:
        """(n,) largest joint accelerations [rad/s²], exact."""
        if self._duration == 0:
            return np.zeros(len(self._start))
        return _PEAK_ACCELERATION * np.abs(self._travel) / self._duration**2

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        time = np.asarray(t, dtype=np.float64)[..., None]
        duration = self._duration
        if duration == 0:
            still = np.zeros(np.broadcast_shapes(time.shape, self._start.shape))
            return Sample(self._start + still, still, still.copy(), still.copy())
        u = np.clip(time / duration, 0.0, 1.0)
        inside = (time >= 0) & (time <= duration)
        q = np.where(u <= 0.5, self._start + self._travel * (u * u * (3 - 2 * u)), self._from_end(1 - u))
        velocity = self._travel * (6 * u * (1 - u) / duration)
        acceleration = self._travel * np.where(inside, (6 - 12 * u) / duration**2, 0.0)
        jerk = self._travel * np.where(inside, -12.0 / duration**3, 0.0)
        return Sample(q, velocity, acceleration, jerk)

    def _from_end(self, w: FloatArray) -> FloatArray:
        """The second half counted from the end, so that the end itself is met exactly."""
        return self._end - self._travel * (w * w * (3 - 2 * w))


def checked_ends(start: ArrayLike, end: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Both ends (n,) [rad] as arrays that nobody else can write to.

    Raises:
        InputError: shapes that differ, text, NaN or infinity.
    """
    try:
        first, last = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
    except (TypeError, ValueError) as cause:
        raise InputError(f"joint angles must be numbers, got {start!r} and {end!r}") from cause
    if first.ndim != 1 or first.shape != last.shape or first.size == 0:
        raise InputError(
            f"start and end need the same number of joint angles, got {first.shape} and {last.shape}"
        )
    if not (np.isfinite(first).all() and np.isfinite(last).all()):
        raise InputError(f"joint angles must be finite numbers, got {first.tolist()} and {last.tolist()}")
    return first, last


def shortest_duration(travel: FloatArray, speed: FloatArray, acceleration: FloatArray) -> float:
    """Shortest duration [s] of a cubic over ``travel`` (n,) [rad] inside both limits (n,).

    From the peaks: ``T >= 1.5 |d| / v`` and ``T >= sqrt(6 |d| / a)`` for every joint.
    """
    way = np.abs(travel)
    by_speed = _PEAK_SPEED * way / speed
    by_acceleration = np.sqrt(_PEAK_ACCELERATION * way / acceleration)
    return float(max(by_speed.max(), by_acceleration.max()))


def _too_short(robot: Robot, travel: FloatArray, duration: float, shortest: float) -> str:
    way = np.abs(travel)
    # The joint that sets the shortest duration, by whichever of its limits is the tighter.
    by_speed = _PEAK_SPEED * way / robot.speed_limits
    by_acceleration = np.sqrt(_PEAK_ACCELERATION * way / robot.acceleration_limits)
    i = int(np.argmax(np.maximum(by_speed, by_acceleration)))
    joint = robot.joints[i]
    if duration == 0:
        return f"{joint.title}: cannot move in 0 s; the shortest possible duration is {shortest:.3f} s"
    if by_speed[i] >= by_acceleration[i]:
        needed, allowed, unit = _PEAK_SPEED * way[i] / duration, joint.speed, "°/s"
    else:
        needed, allowed, unit = _PEAK_ACCELERATION * way[i] / duration**2, joint.acceleration, "°/s²"
    return (
        f"{joint.title}: {np.degrees(way[i]):.2f}° in {duration:.3f} s needs "
        f"{np.degrees(needed):.1f} {unit}, its limit is {np.degrees(allowed):.1f} {unit}; "
        f"the shortest possible duration is {shortest:.3f} s"
    )
