"""Runs trajectories with their time scaled, so that override, pause and stop keep the path; the gripper."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from typing import Final

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, StateError
from armctl.facts.commands import Superseded
from armctl.lazy_dataclass import dataclass
from armctl.motion import Sample, Trajectory, stopping_s
from armctl.motion.trajectory import RestOfTrajectory
from armctl.protocol import Ticket
from armctl.robot import CarriedPart, Gripper, Robot
from armctl.runtime.activity import Activity, Setpoint

_PROBES: Final = np.linspace(0.0, 1.0, 9)  # a trapezoid's corners lie anywhere in a tick
_HALVINGS = 12
_TOLERANCE = 1e-6
_STARVING_S = 0.4
_STOPS = 2.4
"""times what the slowest joint needs to stand"""
_SAME_OPENING = 1e-9
"""as close to its goal by rounding a gripper is there"""
_OVERRUN = (
    "the arm was stopped harder than its acceleration limits allow: what comes next was not planned "
    "in time, and there was no room left to slow down"
)


def starving_s(robot: Robot) -> float:
    """How long before the end of what is planned an arm must begin to slow down for want of more [s]."""
    return max(_STARVING_S, _STOPS * stopping_s(robot))


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """One trajectory on the path's time axis, which begins with the first one [s]."""

    trajectory: Trajectory
    tag: Hashable
    begins: float
    ends: float


class PathMover(Activity):
    """Follows trajectories, one after another.

    With path time s and its rate r = ds/dt, a joint's speed is ``q' r`` and its acceleration
    ``q'' r² + q' dr/dt``. A trajectory inside its limits stays inside them at every constant rate up to 1;
    a change of the rate takes what acceleration is left, and where none is left, waits.
    """

    pausable = True

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
        self.label = label
        self.goes_on = goes_on
        """what it has does not end at rest: another trajectory must follow"""
        self._notice = None
        self._stretches = deque([_Stretch(trajectory, tag, 0.0, trajectory.duration)])
        self._end = trajectory.duration
        self._limits = robot.acceleration_limits * (1 + _TOLERANCE)
        self._starving_s = starving_s(robot) if goes_on else 0.0
        self._robot = robot
        self._time = 0.0
        # At the start the joints are at rest at whatever rate, so the first rate needs no ramp.
        self._rate = speed
        self._speed = speed
        self._paused = False
        self._stopped = False

    def append(self, trajectory: Trajectory, tag: Hashable, *, goes_on: bool) -> None:
        """Go on with another; ``goes_on``: it ends in motion, and the arm slows down until one follows."""
        self._stretches.append(_Stretch(trajectory, tag, self._end, self._end + trajectory.duration))
        self._end += trajectory.duration
        self.goes_on = goes_on
        if goes_on:
            self._starving_s = starving_s(self._robot)

    @property
    def tag(self) -> Hashable:
        """Of the trajectory that runs."""
        return self._stretches[0].tag

    @property
    def position(self) -> FloatArray:
        """(n,) where it is on the path [rad]."""
        return self._sample_at(self._time).q

    @property
    def rest(self) -> Trajectory:
        """What is left of the trajectory that runs."""
        runs = self._stretches[0]
        return RestOfTrajectory(runs.trajectory, self._time - runs.begins)

    @property
    def remaining_s(self) -> float:
        """What is left of all of them at full speed [s]."""
        return max(self._end - self._time, 0.0)

    @property
    def progress(self) -> float:
        """Share of the time of the trajectory that runs that is over, 0 ... 1."""
        runs = self._stretches[0]
        lasts = runs.ends - runs.begins
        return 1.0 if lasts == 0.0 else min((self._time - runs.begins) / lasts, 1.0)

    @property
    def standing(self) -> bool:
        """The joints are at rest: at the end, or with the rate at 0."""
        return self._rate == 0.0 or self._time >= self._end

    @property
    def done(self) -> bool:
        """At the end, and none is to follow; or stopped and at rest."""
        return (self._time >= self._end and not self.goes_on) or (self._stopped and self._rate == 0.0)

    def set_speed(self, fraction: float) -> None:
        """Go towards this speed override inside the acceleration limits."""
        self._speed = fraction

    def pause(self, paused: bool) -> None:
        """Slow down along the path and stand, or go on along it."""
        self._paused = paused

    def stop(self) -> None:
        """Slow down as hard as the limits allow, then be done; before the first setpoint at once."""
        self._stopped = True
        if self._time == 0.0:
            self._rate = 0.0

    def end(self) -> None:
        """Nothing more will follow: where what it has does not end at rest, stop on the way."""
        if self.goes_on:
            self.stop()

    def halt(self) -> None:
        """No setpoint is sent for now: go on from rest."""
        self._rate = 0.0

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Go on by ``dt`` seconds; None where the joints stand."""
        if self.done:
            return None
        starved = self.goes_on and self._end - self._time <= self._starving_s
        target = 0.0 if self._paused or self._stopped or starved else self._speed
        if self._rate == 0.0 and target == 0.0:
            return None
        rate = self._next_rate(target, dt)
        push = (rate - self._rate) / dt
        self._time = min(self._time + 0.5 * (self._rate + rate) * dt, self._end)
        if self.goes_on and self._time >= self._end:
            if rate > 0.0:
                self._notice = _OVERRUN
            rate = 0.0  # what follows is begun from rest, on the way
        self._rate = rate
        state = self._sample_at(self._time)
        while len(self._stretches) > 1 and self._stretches[0].ends <= self._time:
            self._stretches.popleft()  # it is over
        q, velocity, acceleration = state.q, state.velocity, state.acceleration
        if self.standing:
            return Setpoint(q, np.zeros_like(q), np.zeros_like(q))
        if rate == 1.0 and push == 0.0:
            return Setpoint(q, velocity, acceleration)
        return Setpoint(q, velocity * rate, acceleration * rate**2 + velocity * push)

    def _sample_at(self, time: float) -> Sample:
        """State (n,) at a time [s]; at a seam, that of the trajectory before it."""
        last = self._stretches[-1]
        for stretch in self._stretches:
            local = time - stretch.begins
            if stretch is not last and time > stretch.ends:
                continue
            if stretch is not last:  # a rounding must not carry it over the seam
                local = min(local, stretch.trajectory.duration)
            return stretch.trajectory.sample(max(local, 0.0))
        raise AssertionError("there is always a trajectory")

    def _sample(self, times: FloatArray) -> Sample:
        """State at rising times (k,) [s]; at a seam, that of the trajectory before it."""
        parts: list[Sample] = []
        for stretch in self._stretches:
            local = times - stretch.begins
            if stretch is not self._stretches[-1]:
                count = int(np.searchsorted(times, stretch.ends, side="right"))
                # a rounding must not carry it over the seam
                local = np.minimum(local[:count], stretch.trajectory.duration)
                times = times[count:]
            if len(local):
                parts.append(stretch.trajectory.sample(np.maximum(local, 0.0)))
            if not len(times):
                break
        if len(parts) == 1:
            return parts[0]
        fields = zip(*((part.q, part.velocity, part.acceleration, part.jerk) for part in parts), strict=True)
        return Sample(*map(np.concatenate, fields))

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
        state = self._sample(times)
        acceleration = state.acceleration * (rates * rates)[:, None] + state.velocity * push
        return bool((np.abs(acceleration) <= self._limits).all())


class GripperMover:
    """Moves the opening to a goal at the gripper's speed."""

    def __init__(self, gripper: Gripper | None) -> None:
        self.goal: float | None = None
        """opening 0..1 that it moves to; None: it stands"""
        self.part: CarriedPart | None = None
        """what is between its jaws; None: nothing"""
        self.motion = ""
        """name of the command that moves it"""
        self._gripper = gripper
        self._ticket: Ticket | None = None
        self._held = False

    def equip(self, gripper: Gripper | None) -> None:
        """Another tool is on, with this gripper; it carries what it carried."""
        self._gripper = gripper

    def move_to(
        self, goal: float, part: CarriedPart | None = None, ticket: Ticket | None = None, motion: str = ""
    ) -> None:
        """Go to ``goal`` 0..1 instead of wherever it was going; ``ticket`` is answered at the end.

        It carries ``part`` from now on: what it carried before is put down, or is named again.
        """
        self._answer(StateError(Superseded("gripper")))
        self.goal, self.part, self._ticket, self.motion = goal, part, ticket, motion

    def forget(self) -> None:
        """Nobody knows any more what it carries."""
        self.part = None

    def hold(self, held: bool) -> None:
        """Stand still for as long as it is held (pause)."""
        self._held = held

    def stop(self, error: ArmctlError) -> None:
        """Stand where it is; ``error`` refuses the command that moved it."""
        self.goal = None
        self._held = False
        self._answer(error)

    @property
    def arrived(self) -> bool:
        """The goal of a command is reached, and it is not answered yet."""
        return self.goal is None and self._ticket is not None

    def settle(self) -> None:
        """Answer the command that has ``arrived``."""
        self._answer(None)

    def advance(self, opening: float | None, dt: float, speed: float) -> float | None:
        """Where it is ``dt`` seconds after ``opening`` at a speed override; None where it stands."""
        goal = self.goal
        if goal is None or self._gripper is None or self._held:
            return None
        most = self._gripper.speed * speed * dt
        # where it is not known the gate says so
        opening = goal if opening is None else opening + min(max(goal - opening, -most), most)
        if abs(opening - goal) > _SAME_OPENING:
            return opening
        self.goal = None
        return goal

    def _answer(self, error: ArmctlError | None) -> None:
        if self._ticket is not None:
            self._ticket.end(error)
            self._ticket = None
