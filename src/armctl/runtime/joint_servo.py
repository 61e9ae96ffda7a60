"""Joints that follow wanted speeds, a moving goal or a line of the tool inside every limit, tick by tick."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.chain import LinkFrames
from armctl.kinematics.velocity import damped_inverse, position_leaves_pitch, turning_speeds
from armctl.motion import Floor, Obstacles, SelfCollision
from armctl.motion.paths.tool_pitch import PitchRows, PlanePitch, pitch_rows
from armctl.robot import Robot
from armctl.runtime.commands import JogTool

BoolArray = NDArray[np.bool_]
_THERE = 1e-10
"""A joint at rest this near to its goal has arrived [rad]."""
_SLOWEST_SHARE = 1e-6
"""of its speed limit: no joint is slowed down further for the sake of arriving together"""
_BRAKING_PROBES = np.linspace(0.0, 1.0, 6)
_ROUNDING = 1e-9
_STEP_M = 5e-3
"""How much any gap may change between two looks along a way."""
_MOST_LOOKS = 400
_REFINEMENTS = 1
"""How often the rates are taken anew where the tick will end."""
_PULL_BACK_S = 0.02
"""A tool beside its line comes back to it with this time constant, or within two ticks."""
_SHARE_TO_BRAKE = 0.8
"""of the acceleration that counts on when it plans to brake along the line: the rest is for its curvature"""
_SHARE_TO_BEND = 0.3
"""of the acceleration that may go into the curvature of the joints' way"""
_ASIDE, _LOST = 0.02, 0.3
"""How far aside the tool may be led near a singular pose, as a share of its speed: on its way there, and on
its way out."""
_RANK = 1e-9
_NEAR_SECOND = 0.15
"""Singular values below this fade: what comes second must not make the joints race [rad/rad]."""
_STANDS = 0.02
"""A tool that a limit leaves no more than this share of its speed stands at the limit."""
_UPRIGHT = 0.05
"""A tool whose axis is this near to the vertical is pitched about its own x axis [rad]."""


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

    def step(self, desired: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
        """Angles and speeds (n,) after ``dt`` [s]: as near to the desired speeds (n,) as the limits allow."""
        return self._limited(desired, np.zeros(len(self.q), dtype=np.bool_), dt)

    def toward(self, goal: FloatArray, speed: float, dt: float) -> tuple[FloatArray, FloatArray]:
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
        """(k, n) angles on the way to rest from ``q``, ``v`` (n,), each joint as hard as it can."""
        a = self.acceleration_limits
        takes = np.abs(v) / a
        t = np.minimum(_BRAKING_PROBES[:, None] * takes.max(), takes)
        return q + v * t - 0.5 * np.sign(v) * a * t * t

    def _limited(self, desired: FloatArray, halts: BoolArray, dt: float) -> tuple[FloatArray, FloatArray]:
        a, v = self.acceleration_limits, self.v
        most_up, halt_up = fastest_inside(self.high - self.q, v, a, dt)
        most_down, halt_down = fastest_inside(self.q - self.low, -v, a, dt)
        after = np.clip(desired, v - a * dt, v + a * dt)
        after = np.clip(after, -most_down, most_up)
        moved = 0.5 * (v + after) * dt
        # Joints that can rest within the tick, and shall, do so together; those that must brake fully.
        can = np.abs(v) <= a * dt
        rests, halts = can & (desired == 0) & (after == 0), can & (halt_up | halt_down | halts)
        takes = np.abs(v) / a
        moved = np.where(rests, 0.5 * v * np.where(rests, takes, 0.0).max(), moved)
        moved = np.where(halts, 0.5 * v * takes, moved)
        after = np.where(rests | halts, 0.0, after)
        return np.clip(self.q + moved, self.low, self.high), after

    def _together(self, away: FloatArray, u: FloatArray, fastest: FloatArray, dt: float) -> FloatArray:
        """Cruising speeds (n,) at which all joints arrive with the one that needs longest.

        Args:
            away: (n,) distances to the goal [rad].
            u: (n,) speeds towards it [rad/s].
            fastest: (n,) speeds not to be passed [rad/s].
            dt: the tick [s]; a joint that needs as long as the slowest, but for this, is not slowed down.
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

    From ``(v + v') dt / 2 + v'² / 2a <= room``, solved for v'.

    Args:
        room: (n,) ways left [rad].
        v: (n,) present speeds that way [rad/s].
        a: (n,) accelerations to brake with [rad/s²].
        dt: the tick [s].
    """
    left = room - 0.5 * v * dt
    halt = (left <= 0) & (v > 0)
    root = np.sqrt(np.maximum(0.25 * dt * dt + 2 * left / a, 0.0))
    return np.maximum(a * (root - 0.5 * dt), 0.0), halt


class KeepClear:
    """Looks along short ways for the first configuration that may not be.

    A gap that is closed where the way begins must not close further. Immutable: any thread may use it.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        floor, obstacles, body = Floor(robot), Obstacles(robot), SelfCollision(robot)
        self._sources = tuple(
            (source, words)
            for source, words in (
                (floor, ["the floor is in the way"] * len(floor.parts)),
                (obstacles, [f"an obstacle is in the way of {part}" for part in obstacles.parts]),
                (body, [f"the arm itself is in the way of {part}" for part in body.parts]),
            )
            if len(words)
        )
        levers = [source.levers for source, _ in self._sources]
        self._levers = np.concatenate(levers) if levers else np.zeros((1, robot.n))

    def blocked(self, path: FloatArray) -> tuple[int, str] | None:
        """The first row of ``path`` (k, n) [rad] that may not be, and why; None: all may be.

        The first row is where the arm is, and always may be.
        """
        links = LinkFrames.at(self._robot.chain, path)
        first: tuple[int, str] | None = None
        for source, words in self._sources:
            gaps = source.gaps(links)
            closing = gaps < np.minimum(gaps[:, :1], 0.0) - _ROUNDING
            rows = np.flatnonzero(closing.any(axis=0))
            if len(rows) and (first is None or rows[0] < first[0]):
                row = int(rows[0])
                first = row, words[int(np.argmin(np.where(closing[:, row], gaps[:, row], np.inf)))]
        return first

    def line(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Configurations (k, n) from ``start`` to ``end`` (n,), evenly spaced.

        Near enough to each other for ``blocked``, which looks at them and not in between.
        """
        moves = float((self._levers @ np.abs(end - start)).max(initial=0.0))
        count = int(np.clip(np.ceil(moves / _STEP_M), 1, _MOST_LOOKS))
        return start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start)


@dataclass(frozen=True, slots=True)
class Lead:
    """What the joints shall do next."""

    speeds: FloatArray
    """(n,) [rad/s]"""
    notice: str | None = None
    """what holds the tool back"""


@dataclass(frozen=True, slots=True)
class _Rates:
    """Joint rates in one configuration."""

    along: FloatArray
    """(n,) for the whole command [rad/s]"""
    back: FloatArray
    """(n,) back to the line [rad/s]"""
    stray: float
    """how much of the tool's speed is not as the command wants it, as a share"""


@dataclass(frozen=True, slots=True)
class _Pace:
    """How fast to go."""

    scale: float
    """share of the command"""
    speeds: FloatArray
    """(n,) [rad/s]"""
    limiting: int | None
    """the joint whose limit does not let the tool go on"""


class ToolLine:
    """One straight line of the tool, from where it is when the jog begins, and its pitch and roll.

    The position comes first. What it leaves of the joints keeps the tool's pitch and roll, or its
    orientation with six joints and more, as far as it can. All joints are scaled as one, so that the tool
    slows down on its line where one of them is at a limit.
    """

    def __init__(self, robot: Robot, q: FloatArray, command: JogTool) -> None:
        """The line of ``command`` from the tool at ``q`` (n,) [rad]."""
        self._robot = robot
        self._moving = turning_speeds(robot.limits, robot.speed_limits) > 0.0
        self._pose_kept = np.count_nonzero(self._moving) >= 6
        pose = robot.forward(q)
        self._start = pose[:3, 3]
        self._turn = pose[:3, :3] if command.frame == "tool" else np.eye(3)
        pitch, roll = robot.inverse_kinematics.pitch_and_roll(q)
        self._rolls = roll is not None  # with the last joint, in every family
        self._rows = None if pitch is None else pitch_rows(robot, q, 1.0, None)
        self._outward = _outward(robot, q, self._rows)
        self._command = command
        linear = self._turn @ command.linear
        speed = float(np.linalg.norm(linear))
        self._direction = linear / speed if speed else None
        rates = self._rates(q, _PULL_BACK_S)
        self._along, self._stray = rates.along, rates.stray
        self._bend = np.zeros(robot.n)
        """how fast the joints' share of the tool's speed changes along the line [rad/s²]"""

    def continues(self, command: JogTool) -> bool:
        """Whether a command goes on along this line, perhaps at another speed."""
        old, new = self._command.twist, command.twist
        parallel = float(old @ new) >= (1 - 1e-9) * float(np.linalg.norm(old) * np.linalg.norm(new))
        return command.frame == self._command.frame and parallel and bool(new.any())

    def lead(self, servo: JointServo, share: float, dt: float, command: JogTool | None = None) -> Lead:
        """Joint speeds after ``dt`` [s] at ``share`` (0 ... 1) of the command's speed.

        Args:
            servo: the joints.
            share: of the speed.
            dt: the tick [s].
            command: the newest one, which ``continues`` the line; None: as before.
        """
        self._command = self._command if command is None else command
        pull_back = max(_PULL_BACK_S, dt)
        rates = self._rates(self._ahead(servo, servo.v, dt), pull_back)
        for _ in range(_REFINEMENTS):  # with the rates of where the tick will end
            pace = self._pace(servo, rates, share, dt)
            rates = self._rates(self._ahead(servo, pace.speeds, dt), pull_back)
        strays = share > 0.0 and rates.stray > min(max(_ASIDE, self._stray), _LOST)
        pace = self._pace(servo, rates, 0.0 if strays else share, dt)
        self._bend = np.abs(rates.along - self._along) / max(dt * pace.scale, 1e-9)
        self._stray, self._along = rates.stray, rates.along
        if share == 0.0 and pace.scale == 0.0:
            return Lead(np.zeros(self._robot.n))
        if strays:
            text = "jog: a singular pose, the tool cannot go on this way; go back, or turn a joint"
            return Lead(pace.speeds, text)
        if share > 0.0 and not rates.along.any():
            return Lead(pace.speeds, "jog: no joint of this arm can move its tool this way from here")
        held = pace.limiting
        notice = None if held is None else f"jog: {self._robot.joints[held].title} at the limit"
        return Lead(pace.speeds, notice)

    @staticmethod
    def _ahead(servo: JointServo, speeds: FloatArray, dt: float) -> FloatArray:
        """Where a tick that ends with ``speeds`` (n,) leads."""
        return np.clip(servo.q + 0.5 * (servo.v + speeds) * dt, servo.low, servo.high)

    def _rates(self, q: FloatArray, pull_back_s: float) -> _Rates:
        """What moves the tool from ``q`` (n,)."""
        moving = self._moving
        pose, J = self._robot.forward(q), self._robot.jacobian(q)
        linear = self._turn @ self._command.linear
        off = self._start - pose[:3, 3]
        if self._direction is not None:
            off = off - self._direction * float(self._direction @ off)
        rows, second = self._second(pose, J)
        rows, null = rows[:, moving], _null_space(J[:3, moving])
        first = damped_inverse(J[:3, moving]) @ np.stack([linear, off / pull_back_s], axis=1)
        wanted = np.stack([second, np.zeros(len(second))], axis=1) - rows @ first
        rates = np.zeros((self._robot.n, 2))
        rates[moving] = first + null @ damped_inverse(rows @ null, _NEAR_SECOND, 1.0) @ wanted
        speed = float(np.linalg.norm(linear))
        stray = 0.0 if speed == 0.0 else float(np.linalg.norm(J[:3] @ rates[:, 0] - linear)) / speed
        rates[np.abs(rates) < _RANK] = 0.0
        return _Rates(rates[:, 0], rates[:, 1], stray)

    def _second(self, pose: FloatArray, J: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows (m, n) of what comes second to the position, and the rates (m,) that they shall have."""
        pitch_rate, roll_rate = self._command.pitch_rate, self._command.roll_rate
        if self._pose_kept:
            approach = pose[:3, 2]
            level = np.array([approach[1], -approach[0], 0.0])  # approach x up: to turn about it lifts
            size = float(np.linalg.norm(level))
            axis = level / size if size > _UPRIGHT else pose[:3, 0]
            return J[3:], pitch_rate * axis + roll_rate * approach
        rows = np.zeros((0, self._robot.n)) if self._rows is None else self._rows.rows(pose, J)
        wanted = np.zeros(len(rows))
        if len(rows) == 1:  # two where the tool stands upright: it keeps so
            sine_rate = 1.0 if isinstance(self._rows, PlanePitch) else math.hypot(pose[0, 2], pose[1, 2])
            wanted[0] = self._outward * pitch_rate * sine_rate
        if self._rolls:
            unit = np.zeros((1, self._robot.n))
            unit[0, -1] = 1.0
            rows, wanted = np.concatenate([rows, unit]), np.append(wanted, roll_rate)
        return rows, wanted

    def _pace(self, servo: JointServo, rates: _Rates, share: float, dt: float) -> _Pace:
        """How fast to go along the line: as near to ``share`` of the command as all joints can."""
        v, a = servo.v, servo.acceleration_limits
        back = rates.back * _share_of(np.abs(rates.back), self._room(servo, np.sign(rates.back), a, dt))
        size, sign = np.abs(rates.along), np.sign(rates.along)
        used = size > _RANK
        if not used.any():
            return _Pace(0.0, back, None)
        turns = np.where(used, size, 1.0)
        braking = np.minimum(a, size * _SHARE_TO_BRAKE * float((a / turns)[used].min()) + 1e-12)
        held = np.where(used, (self._room(servo, sign, braking, dt) - sign * back) / turns, np.inf)
        limiting = int(held.argmin())
        free = np.where(used, (servo.speed_limits - np.abs(back)) / turns, np.inf).min()
        bend = np.sqrt(_SHARE_TO_BEND * a / np.maximum(self._bend, 1e-12)).min()
        most = max(min(share, float(free), float(bend), float(held[limiting])), 0.0)
        low = float(np.where(used, (sign * (v - back) - a * dt) / turns, -np.inf).max())
        high = float(np.where(used, (sign * (v - back) + a * dt) / turns, np.inf).min())
        scale = max(min(max(most, low), high) if low <= high else 0.5 * (low + high), 0.0)
        stands = share > 0.0 and held[limiting] < _STANDS * share
        return _Pace(scale, scale * rates.along + back, limiting if stands else None)

    @staticmethod
    def _room(servo: JointServo, sign: FloatArray, braking: FloatArray, dt: float) -> FloatArray:
        """(n,) speeds in the direction of ``sign`` from which the joints can rest before their limits."""
        room = np.where(sign > 0, servo.high - servo.q, servo.q - servo.low)
        return fastest_inside(room, sign * servo.v, braking, dt)[0]


def tool_turns(robot: Robot) -> tuple[bool, bool]:
    """Whether the tool of an arm can be pitched, and rolled, while its point stays."""
    roll = robot.inverse_kinematics.roll_joint
    rolls = roll is not None and bool(robot.limits[roll, 0] < robot.limits[roll, 1])
    return position_leaves_pitch(robot.chain, robot.limits), rolls


def _share_of(wanted: FloatArray, allowed: FloatArray) -> float:
    """The largest share, up to 1, of ``wanted`` (n,) >= 0 that is nowhere more than ``allowed`` (n,)."""
    return float(np.minimum(allowed / np.maximum(wanted, 1e-12), 1.0).min())


def _outward(robot: Robot, q: FloatArray, rows: PitchRows | None) -> float:
    """The sense in which the rows grow while the tool is lifted: -1 where it points back at the base."""
    if not isinstance(rows, PlanePitch):
        return 1.0
    pose, J = robot.forward(q), robot.jacobian(q)
    gain = float(np.cross(J[3:] @ rows.senses, pose[:3, 2])[2])  # senses as rates: all pitch joints turn
    return 1.0 if gain >= -1e-9 else -1.0


def _null_space(rows: FloatArray) -> FloatArray:
    """(m, m - rank) joint motions that the rows do not see."""
    _, sizes, vt = np.linalg.svd(rows)
    return vt[int(np.count_nonzero(sizes > _RANK * max(float(sizes.max(initial=0.0)), _RANK))) :].T
