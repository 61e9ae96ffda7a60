"""Joints that are led by hand, tick by tick: inside every limit, and clear of whatever is in the way."""

from __future__ import annotations

import math
from abc import abstractmethod
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.motion import Floor, Obstacles, SelfCollision
from armctl.motion.clearance import Gaps
from armctl.robot import Robot
from armctl.runtime.activity import Activity, Setpoint

BoolArray = NDArray[np.bool_]
Step = tuple[FloatArray, FloatArray]
"""angles and speeds (n,) [rad], [rad/s] after a tick"""
_THERE = 1e-10
"""A joint at rest this near to its goal has arrived [rad]."""
_SLOWEST_SHARE = 1e-6
"""of its speed limit: no joint is slowed down further for the sake of arriving together"""
_BRAKING_PROBES = np.linspace(0.0, 1.0, 6)
_ROUNDING = 1e-9
_ROOM_M, _NEAR_M = 0.02, 0.004
"""Gaps up to the one are looked at in a place, and anew where the arm may have moved on by the other."""
_TURN_ROUNDING = 1e-12
"""of an angle between links on a braking path, far below what the gate allows [rad]"""
_STEP_M = 5e-3
"""How much any gap may change between two looks along a way."""
_MOST_LOOKS = 400


class JointServo:
    """Angles ``q`` (n,) [rad] and speeds ``v`` (n,) [rad/s] of joints that can always be brought to rest.

    After each tick every joint can still brake before its limits: with a constant acceleration inside the
    tick and constant braking after it, ``(v + v') dt / 2 + v'² / 2a <= room``. ``toward`` applies the same
    rule to a goal. The ticks may be of any length.
    """

    def __init__(self, robot: Robot, q: FloatArray) -> None:
        """Stand at ``q`` (n,) [rad], inside the limits."""
        self.low, self.high = robot.limits[:, 0], robot.limits[:, 1]
        self.speed_limits, self.acceleration_limits = robot.speed_limits, robot.acceleration_limits
        self._chain = robot.chain
        self._turn_rows = robot.chain.turn_rows()
        self.q = q.copy()
        self.v = np.zeros(robot.n)

    @property
    def standing(self) -> bool:
        """All joints are at rest."""
        return not self.v.any()

    def halt(self) -> None:
        """No setpoint is sent for now, so the arm stands: go on from rest."""
        self.v = np.zeros(len(self.q))

    def take(self, q: FloatArray, v: FloatArray) -> None:
        """Go on from a step that ``step`` or ``toward`` has proposed."""
        self.q, self.v = q, v

    def step(self, desired: FloatArray, dt: float) -> Step:
        """Angles and speeds (n,) after ``dt`` [s]: as near to the desired speeds (n,) as the limits allow."""
        return self._limited(desired, np.zeros(len(self.q), dtype=np.bool_), dt)

    def toward(self, goal: FloatArray, speed: float, dt: float) -> Step:
        """Angles and speeds (n,) after ``dt`` [s] on the way to ``goal`` (n,) [rad].

        Each joint goes as fast as the share ``speed`` of its limit, its acceleration and the braking way
        allow, and no faster than it takes to arrive together with the slowest one. A goal that rests is met
        exactly and not overshot, unless it has moved to where the joints can no longer stop in time.
        """
        goal = np.clip(goal, self.low, self.high)
        away = goal - self.q
        side = np.where(away < 0.0, -1.0, 1.0)
        approach, halts = fastest_inside(np.abs(away), side * self.v, self.acceleration_limits, dt)
        cap = self._together(np.abs(away), side * self.v, speed * self.speed_limits, dt)
        q, v = self._limited(side * np.minimum(approach, cap), halts, dt)
        arrived = (v == 0.0) & (np.abs(goal - q) < _THERE)
        return np.where(arrived, goal, q), v

    def braking_path(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """(k, n) angles on the way to rest from ``q``, ``v`` (n,), each joint as hard as it can.

        Every extremum of a limited angle between links is among the rows.
        """
        takes = np.abs(v) / self.acceleration_limits
        times = np.concatenate([_BRAKING_PROBES * takes.max(), self._turning_points(v)])
        return self._braked(q, v, np.sort(times)[:, None])

    def brake(self, dt: float) -> Step:
        """Angles and speeds (n,) after ``dt`` [s] on the braking path, whatever the length of the ticks."""
        slower = np.maximum(np.abs(self.v) - self.acceleration_limits * dt, 0.0)
        return np.clip(self._braked(self.q, self.v, dt), self.low, self.high), np.sign(self.v) * slower

    def leaves_turns(self, q: FloatArray, v: FloatArray) -> bool:
        """Braking after a step to ``q``, ``v`` (n,) would take an angle between links beyond its limit."""
        if not self._chain.turn_limits:
            return False
        allowed = np.maximum(self._chain.turn_excess(self.q), 0.0)
        return bool((self._chain.turn_excess(self.braking_path(q, v)) > allowed + _TURN_ROUNDING).any())

    def _braked(self, q: FloatArray, v: FloatArray, t: FloatArray | float) -> FloatArray:
        a = self.acceleration_limits
        t = np.minimum(t, np.abs(v) / a)
        return q + v * t - 0.5 * np.sign(v) * a * t * t

    def _turning_points(self, v: FloatArray) -> FloatArray:
        """(k,) times [s] at which the rate of a limited angle between links crosses zero while braking.

        The rate is linear in time between the moments at which joints come to rest.
        """
        if not len(self._turn_rows):
            return np.empty(0)
        a = self.acceleration_limits
        knots = np.sort(np.append(np.abs(v) / a, 0.0))
        speeds = np.sign(v) * np.maximum(np.abs(v) - a * knots[:, None], 0.0)
        rates = speeds @ self._turn_rows.T
        before, after = rates[:-1], rates[1:]
        i, k = np.nonzero(before * after < 0.0)
        share = before[i, k] / (before[i, k] - after[i, k])
        return np.concatenate([knots, knots[i] + share * (knots[i + 1] - knots[i])])

    def _limited(self, desired: FloatArray, halts: BoolArray, dt: float) -> Step:
        a, v = self.acceleration_limits, self.v
        most_up, halt_up = fastest_inside(self.high - self.q, v, a, dt)
        most_down, halt_down = fastest_inside(self.q - self.low, -v, a, dt)
        # A tool that is led past a singular pose may ask for more than the joints' speed.
        after = np.clip(np.clip(desired, v - a * dt, v + a * dt), -self.speed_limits, self.speed_limits)
        after = np.clip(after, -most_down, most_up)
        moved = 0.5 * (v + after) * dt
        # Joints that can rest within the tick, if asked to, do so together; those that must brake fully.
        can = np.abs(v) <= a * dt
        rests, halts = can & (desired == 0) & (after == 0), can & (halt_up | halt_down | halts)
        takes = np.abs(v) / a
        moved = np.where(rests, 0.5 * v * np.where(rests, takes, 0.0).max(), moved)
        moved = np.where(halts, 0.5 * v * takes, moved)
        after = np.where(rests | halts, 0.0, after)
        return np.clip(self.q + moved, self.low, self.high), after

    def _together(self, away: FloatArray, u: FloatArray, fastest: FloatArray, dt: float) -> FloatArray:
        """Cruising speeds (n,) at which all joints arrive with the one that needs longest.

        ``away``, ``u`` and ``fastest`` (n,): distances to the goal [rad], speeds towards it and speeds not
        to be passed [rad/s]. A joint that needs as long as the slowest, but for ``dt``, is not slowed down.
        """
        a = self.acceleration_limits
        brakes = 0.5 * u * np.abs(u) / a
        # One that moves away from its goal, or past it, first comes to rest; from there it starts anew.
        turns = (u < 0.0) | (brakes > away)
        lost = np.where(turns, np.abs(u) / a, 0.0)
        away, u = np.where(turns, np.abs(away - brakes), away), np.where(turns, 0.0, u)
        peak = np.clip(np.sqrt(a * away + 0.5 * u * u), 1e-12, np.maximum(fastest, u))
        takes = lost + (2 * peak - u) / a + (away - (peak * peak - 0.5 * u * u) / a) / peak
        time = takes.max() - lost
        slower = takes < takes.max() - dt
        # (c - u)/a + c/a + (away - (c² - u²/2)/a) / c = time for the cruising speed c >= u.
        half = 0.5 * (a * time + u)
        quicker: FloatArray = half - np.sqrt(np.maximum(half * half - a * away - 0.5 * u * u, 0.0))
        # Below u: u/a + (away - u²/2a) / c = time.
        spare = np.maximum(time - u / a, 1e-12)
        slowed: FloatArray = np.maximum(away - 0.5 * u * u / a, 0.0) / spare
        cruise: FloatArray = np.where(quicker < u, slowed, quicker)
        return np.where(slower, np.clip(cruise, _SLOWEST_SHARE * fastest, fastest), fastest)


def fastest_inside(room: FloatArray, v: FloatArray, a: FloatArray, dt: float) -> tuple[FloatArray, BoolArray]:
    """Largest speeds (n,) after ``dt`` [s] from which joints can rest inside ``room``; which must halt.

    From ``(v + v') dt / 2 + v'² / 2a <= room``, solved for v'; ``room`` (n,) [rad] is the way left, ``v``
    (n,) [rad/s] the present speed that way, ``a`` (n,) [rad/s²] what there is to brake with.
    """
    left = room - 0.5 * v * dt
    halt = (left <= 0) & (v > 0)
    root = np.sqrt(np.maximum(0.25 * dt * dt + 2 * left / a, 0.0))
    return np.maximum(a * (root - 0.5 * dt), 0.0), halt


class KeepClear:
    """Finds what is in the way; a gap closed where a way begins must not close further. For any thread.

    To work out the gaps of an arm takes tens of milliseconds: when its jaws, or what they carry, have changed
    (``hold``), another thread does it (``work_out``). Until then jaws count at every opening; while that is
    not enough, as the arm carries another part than before, no way is clear.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._usual = _Watched(robot)
        self._now: _Watched | None = self._usual
        """None: what the arm carries is not worked out yet"""
        self._lock = Lock()

    @property
    def outdated(self) -> bool:
        """Whether ``work_out`` has something to do."""
        return self._now is None or self._now.robot is not self._robot

    def hold(self, robot: Robot) -> None:
        """The same arm, with its jaws somewhere else, or with another part, from now on."""
        with self._lock:
            self._robot = robot
            known = (one for one in (self._now, self._usual) if one is not None)
            self._now = next((one for one in known if one.robot.allows_for(robot)), None)

    def work_out(self) -> None:
        """Look at the arm as it is now."""
        robot = self._robot
        found = self._usual if robot is self._usual.robot else _Watched(robot)
        with self._lock:
            if robot is self._robot:
                self._now = found

    def blocked(self, path: FloatArray) -> tuple[int, str] | None:
        """First row of ``path`` (k, n) [rad] that may not be, and why; None: all may. Row 0 always may."""
        now = self._now
        return (1, "what the arm carries is not looked at yet") if now is None else now.blocked(path)

    def line(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """(k, n) rows from ``start`` to ``end`` (n,), evenly spaced, near enough for ``blocked``."""
        moves = float(((self._now or self._usual).levers @ np.abs(end - start)).max(initial=0.0))
        count = int(np.clip(np.ceil(moves / _STEP_M), 1, _MOST_LOOKS))
        return start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start)


class _Watched:
    """The gaps of an arm whose gripper is somewhere, and carries something."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        floor, obstacles, body = Floor(robot), Obstacles(robot), SelfCollision(robot)
        self._sources = (
            (floor, ["the floor is in the way"] * len(floor.parts)),
            (obstacles, [f"an obstacle is in the way of {part}" for part in obstacles.parts]),
            (body, [f"the arm itself is in the way of {part}" for part in body.parts]),
        )
        self.levers = np.concatenate([source.levers for source, _ in self._sources])
        self._known: dict[int, tuple[FloatArray, FloatArray]] = {}
        """of a source: where its gaps were looked at last (n,) [rad], and how far each may close (k,) [m]"""

    def blocked(self, path: FloatArray) -> tuple[int, str] | None:
        """As ``KeepClear.blocked``."""
        chain = self.robot.chain
        links = self.robot.body_frames(path)
        first: tuple[int, str] | None = None
        excess = chain.turn_excess(path)
        for k, limit in enumerate(chain.turn_limits):
            rows = np.flatnonzero(excess[:, k] > max(excess[0, k], 0.0))
            if len(rows) and (first is None or rows[0] < first[0]):
                first = int(rows[0]), f"{limit.name} is at its limit"
        for k, (source, words) in enumerate(self._sources):
            if not words:
                continue
            open_ = self._stay_open(k, source, path)
            if open_.all():
                continue
            gaps = source.gaps(links, np.where(open_, -np.inf, 0.0)[:, None])
            gaps[open_] = np.inf
            closing = gaps < np.minimum(gaps[:, :1], source.closed[:, None]) - _ROUNDING
            rows = np.flatnonzero(closing.any(axis=0))
            if len(rows) and (first is None or rows[0] < first[0]):
                row = int(rows[0])
                first = row, words[int(np.argmin(np.where(closing[:, row], gaps[:, row], np.inf)))]
        return first

    def _stay_open(self, k: int, source: Gaps, path: FloatArray) -> NDArray[np.bool_]:
        """(k,) gaps of a source that cannot close on a path, by what is known of a place near its start."""
        known = self._known.get(k)
        if known is None or (source.levers @ np.abs(path[0] - known[0])).max(initial=0.0) > _NEAR_M:
            gaps = source.gaps(self.robot.body_frames(path[:1]), _ROOM_M)[:, 0]
            known = self._known[k] = path[0].copy(), gaps - source.closed
        here, room = known
        return source.levers @ np.abs(path - here).max(axis=0) < room


class Led(Activity):
    """A jog or a live target: at each tick, the arm can still rest before limits and obstacles.

    It needs no check of its rest: it looks ahead with the gripper as it is then.
    """

    def __init__(self, robot: Robot, clear: KeepClear, q: FloatArray, speed: float) -> None:
        """Stand at ``q`` (n,) [rad]; ``speed`` is the override."""
        self._robot = robot
        self._clear = clear
        self._servo = JointServo(robot, q)
        self._speed = speed
        self._expires = -math.inf

    @property
    def standing(self) -> bool:
        """The joints are at rest."""
        return self._servo.standing

    def set_speed(self, fraction: float) -> None:
        """Go towards this speed override inside the acceleration limits."""
        self._speed = fraction

    def stop(self) -> None:
        """Slow down as hard as the limits allow."""
        self._expires = -math.inf
        self._done = self.standing

    def halt(self) -> None:
        """No setpoint is sent for now: go on from rest."""
        self._servo.halt()
        self._done = self._expires == -math.inf

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Go on by ``dt`` seconds to ``now``; None where the joints stand."""
        servo, expired = self._servo, now >= self._expires
        step, notice = self._step(expired, dt)
        q, v = self._rest(dt) if step is None else step
        if step is not None and not expired and (blocked := self._blocked_ahead(q, v)) is not None:
            notice = f"{self.label}: {blocked}"
            q, v = self._rest(dt)
        if servo.leaves_turns(q, v):
            q, v = servo.brake(dt)
        self._notice = None if expired else notice
        if not v.any() and servo.standing and np.array_equal(q, servo.q):
            self._done = expired
            return None
        acceleration = (v - servo.v) / dt
        servo.take(q, v)
        return Setpoint(q.copy(), v.copy(), acceleration)

    @abstractmethod
    def _step(self, expired: bool, dt: float) -> tuple[Step | None, str | None]:
        """What is asked for next (None: to rest), and what is not as it is asked for."""

    def _lead_on(self, expires: float) -> None:
        """Go on until the clock says ``expires``."""
        self._expires = expires
        self._done = False

    def _rest(self, dt: float) -> Step:
        return self._servo.step(np.zeros(self._robot.n), dt)

    def _blocked_ahead(self, q: FloatArray, v: FloatArray) -> str | None:
        """What is in the way from here to where the joints could rest after a step to ``q``, ``v`` (n,)."""
        servo = self._servo
        if not v.any() and np.array_equal(q, servo.q):
            return None
        found = self._clear.blocked(np.vstack([servo.q, servo.braking_path(q, v)]))
        return None if found is None else found[1]
