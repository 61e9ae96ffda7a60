"""Runs trajectories with their time scaled: override, pause, resume and stop on the same path."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.motion import Sample, Trajectory, stopping_s
from armctl.robot import Robot
from armctl.runtime.activity import ActivityView, Setpoint

# The trajectories that the arm still has to follow, end to end on one time axis.

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


_PROBES: Final = np.linspace(0.0, 1.0, 9)  # a trapezoid's corners lie anywhere in a tick
_HALVINGS = 12
_TOLERANCE = 1e-6
_STARVING_S = 0.4
_STOPS = 2.4
"""times what the slowest joint needs to stand"""


def starving_s(robot: Robot) -> float:
    """How long before the end of what is planned an arm must begin to slow down for want of more [s]."""
    return max(_STARVING_S, _STOPS * stopping_s(robot))


class PathMover:
    """Trajectories on their way, one after another.

    With path time s and its rate r = ds/dt, a joint's speed is ``q' r`` and its acceleration
    ``q'' r² + q' dr/dt``. A trajectory inside its limits stays inside them at every constant rate up to 1;
    a change of the rate takes what acceleration is left, and where none is left, waits.
    """

    def __init__(
        self,
        robot: Robot,
        trajectory: Trajectory,
        speed: float,
        label: str = "motion",
        *,
        tag: Hashable = None,
        goes_on: bool = False,
    ) -> None:
        """Begin with one that starts at rest; the rest as ``append``."""
        self._track = Track()
        self._track.append(trajectory, tag)
        self._limits = robot.acceleration_limits * (1 + _TOLERANCE)
        self._starving_s = starving_s(robot)
        self._label = label
        self._time = 0.0
        # At the start the joints are at rest at whatever rate, so the first rate needs no ramp.
        self._rate = speed
        self._speed = speed
        self._open = goes_on
        self._paused = False
        self._stopped = False
        self._overrun = False

    def append(self, trajectory: Trajectory, tag: Hashable, *, goes_on: bool) -> None:
        """Go on with another trajectory, which starts as the last one ends.

        Args:
            trajectory: the next one.
            tag: what ``tag`` is while it runs.
            goes_on: it does not end at rest: another one must follow. Until that is here, the arm slows
                down along the path before the end and waits.
        """
        self._track.append(trajectory, tag)
        self._track.forget(self._time)
        self._open = goes_on

    def drop_from(self, tag: Hashable) -> None:
        """Something else follows what comes before the trajectory with this tag, which has not begun."""
        self._track.drop_from(tag)
        self._open = True

    @property
    def tag(self) -> Hashable:
        """Of the trajectory that runs."""
        return self._track.tag

    @property
    def goes_on(self) -> bool:
        """What it has does not end at rest: another trajectory must follow."""
        return self._open

    @property
    def remaining_s(self) -> float:
        """What is left of all of them at full speed [s]."""
        return max(self._track.end - self._time, 0.0)

    @property
    def label(self) -> str:
        """What it is."""
        return self._label

    @property
    def begun(self) -> bool:
        """A planned motion begins at once."""
        return True

    @property
    def standing(self) -> bool:
        """The joints are at rest: at the end, or with the rate at 0."""
        return self._rate == 0.0 or self._time >= self._track.end

    @property
    def done(self) -> bool:
        """At the end, and none is to follow; or stopped and at rest."""
        return (self._time >= self._track.end and not self._open) or (self._stopped and self._rate == 0.0)

    @property
    def error(self) -> ArmctlError | None:
        """A planned motion does not fail by itself."""
        return None

    @property
    def pausable(self) -> bool:
        """Yes."""
        return True

    @property
    def notice(self) -> str | None:
        """That it came to the end of what is planned before it could slow down for want of more."""
        if not self._overrun:
            return None
        return (
            "the arm was stopped harder than its acceleration limits allow: what comes next was not planned "
            "in time, and there was no room left to slow down"
        )

    def set_speed(self, fraction: float) -> None:
        """Go towards this speed override inside the acceleration limits."""
        self._speed = fraction

    def pause(self) -> None:
        """Slow down along the path and stand."""
        self._paused = True

    def resume(self) -> None:
        """Go on along the path."""
        self._paused = False

    def stop(self) -> None:
        """Slow down as hard as the limits allow, then be done; before the first setpoint at once."""
        self._stopped = True
        if self._time == 0.0:
            self._rate = 0.0

    def end(self) -> None:
        """Nothing more will follow: where what it has does not end at rest, stop on the way."""
        if self._open:
            self.stop()

    def halt(self) -> None:
        """No setpoint is sent for now: go on from rest."""
        self._rate = 0.0

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Go on by ``dt`` seconds; None where the joints stand."""
        if self.done:
            return None
        starved = self._open and self.remaining_s < self._starving_s
        target = 0.0 if self._paused or self._stopped or starved else self._speed
        if self._rate == 0.0 and target == 0.0:
            return None
        rate = self._next_rate(target, dt)
        push = (rate - self._rate) / dt
        self._time = min(self._time + 0.5 * (self._rate + rate) * dt, self._track.end)
        if self._open and self._time >= self._track.end:
            self._overrun = self._overrun or rate > 0.0
            rate = 0.0  # what follows is begun from rest, on the way
        self._rate = rate
        state = self._track.sample(np.array([self._time]))
        self._track.forget(self._time)
        q, velocity, acceleration = state.q[0], state.velocity[0], state.acceleration[0]
        if self.standing:
            return Setpoint(q, np.zeros_like(q), np.zeros_like(q))
        return Setpoint(q, velocity * rate, acceleration * rate**2 + velocity * push)

    def view(self) -> ActivityView:
        """What is shown."""
        left = self._track.left(self._time) / self._speed
        return ActivityView(self._track.goal, self._track.progress(self._time), left)

    def _next_rate(self, target: float, dt: float) -> float:
        """The rate after ``dt`` that comes closest to the target inside the acceleration limits."""
        if target == self._rate or self._allowed(target, dt):
            return target
        # Staying at the present rate is always allowed: look for the furthest rate that is.
        good, bad = self._rate, target
        for _ in range(_HALVINGS):
            middle = 0.5 * (good + bad)
            if self._allowed(middle, dt):
                good = middle
            else:
                bad = middle
        return good

    def _allowed(self, rate: float, dt: float) -> bool:
        """Whether every joint keeps its acceleration limit all through the tick."""
        push = (rate - self._rate) / dt
        rates = self._rate + (rate - self._rate) * _PROBES
        times = self._time + 0.5 * (self._rate + rates) * _PROBES * dt
        state = self._track.sample(times)
        acceleration = state.acceleration * (rates * rates)[:, None] + state.velocity * push
        return bool((np.abs(acceleration) <= self._limits).all())
