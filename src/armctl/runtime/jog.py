"""Jogging: joints that turn, or a tool that moves along a straight line, for as long as commands come."""

from __future__ import annotations

import math

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.angles import quaternion_wxyz
from armctl.kinematics.families.numeric.descent import rotation_vectors
from armctl.kinematics.subproblems import turn
from armctl.kinematics.velocity import damped_inverse, turning_speeds
from armctl.motion.paths.tool_orientation import PitchRows, PlanePitch, pitch_rows
from armctl.protocol import Command, Jog, JogTool
from armctl.robot import Robot
from armctl.runtime.joint_servo import JointServo, KeepClear, Led, Step, fastest_inside

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


class Jogger(Led):
    """Joint speeds that follow the jog commands inside every limit."""

    label = "jog"
    led_by = (Jog, JogTool)

    def __init__(self, robot: Robot, clear: KeepClear, q: FloatArray, speed: float) -> None:
        """Stand at ``q`` (n,) [rad]; ``speed`` is the override."""
        super().__init__(robot, clear, q, speed)
        self._wanted: FloatArray | JogTool = np.zeros(robot.n)
        self._line: JogLine | None = None

    def lead(self, command: Command, expires: float) -> None:
        """Move on until ``expires`` [s], by joints or by the tool."""
        if isinstance(command, Jog | JogTool):
            self._wanted = command.rate if isinstance(command, Jog) else command
            self._lead_on(expires)

    def stop(self) -> None:
        """Slow down as hard as the limits allow."""
        self._line = None
        super().stop()

    def _step(self, expired: bool, dt: float) -> tuple[Step | None, str | None]:
        servo = self._servo
        speeds, notice = self._lead(expired, dt)
        q, v = servo.step(speeds, dt)
        if notice is None and self._line is None:
            stuck = ((speeds > 0) & (q >= servo.high)) | ((speeds < 0) & (q <= servo.low))
            names = ", ".join(self._robot.joints[i].title for i in np.flatnonzero(stuck))
            notice = f"jog: {names} at the limit" if names else None
        return (q, v), notice

    def _lead(self, expired: bool, dt: float) -> tuple[FloatArray, str | None]:
        """Speeds (n,) [rad/s], what holds the tool back; a jog of another kind waits for standstill."""
        wanted, servo = self._wanted, self._servo
        going_on = isinstance(wanted, JogTool) and self._line is not None and self._line.continues(wanted)
        if self._line is not None and (expired or not going_on):
            if not servo.standing:
                speeds, notice = self._line.lead(servo, 0.0, dt)
                return (np.zeros(self._robot.n) if self._rests_later(speeds) else speeds), notice
            self._line = None
        if not expired and not isinstance(wanted, JogTool):
            return wanted * self._robot.speed_limits * self._speed, None
        if expired or not isinstance(wanted, JogTool) or (self._line is None and not servo.standing):
            return np.zeros(self._robot.n), None
        if self._line is None:
            self._line = JogLine(self._robot, servo.q, wanted)
        return self._line.lead(servo, self._speed, dt, wanted)

    def _rests_later(self, speeds: FloatArray) -> bool:
        """Whether the arm would be farther from rest at ``speeds`` (n,) than now.

        A tool that an obstacle has pushed beside its line is drawn back to it, and again aside.
        """
        servo = self._servo
        now, then = (float((np.abs(v) / servo.acceleration_limits).max()) for v in (servo.v, speeds))
        return then > now


class JogLine:
    """One straight line of the tool, from where it is when the jog begins, and its pitch and roll.

    The position comes first. What it leaves of the joints keeps the tool's pitch and roll, or the orientation
    of an arm that orients its tool, as far as it can; or turns it about one axis of the base frame. All
    joints are scaled as one, so that the tool slows down on its line where one of them is at a limit.
    """

    def __init__(self, robot: Robot, q: FloatArray, command: JogTool) -> None:
        """The line of ``command`` from the tool at ``q`` (n,) [rad]."""
        self._robot = robot
        self._moving = turning_speeds(robot.limits, robot.speed_limits) > 0.0
        self._pose_kept = robot.orients_tool
        pose = robot.forward(q)
        self._start, self._rotation = pose[:3, 3], pose[:3, :3]
        self._lift = _lift_axis(pose)
        self._turn = pose[:3, :3] if command.frame == "tool" else np.eye(3)
        pitch, _ = robot.inverse_kinematics.pitch_and_roll(q)
        self._rows = None if pitch is None else pitch_rows(robot, q, 1.0, None)
        self._outward = _outward(robot, q, self._rows)
        self._command = command
        linear = self._turn @ command.linear
        speed = float(np.linalg.norm(linear))
        self._direction = linear / speed if speed else None
        self._along, _, self._stray = self._rates(q, _PULL_BACK_S)
        self._bend = np.zeros(robot.n)
        """how fast the joints' share of the tool's speed changes along the line [rad/s²]"""

    def continues(self, command: JogTool) -> bool:
        """Whether a command goes on along this line, perhaps at another speed."""
        old, new = self._command.twist, command.twist
        parallel = float(old @ new) >= (1 - 1e-9) * float(np.linalg.norm(old) * np.linalg.norm(new))
        return command.frame == self._command.frame and parallel and bool(new.any())

    def lead(
        self, servo: JointServo, share: float, dt: float, command: JogTool | None = None
    ) -> tuple[FloatArray, str | None]:
        """Joint speeds (n,) [rad/s] after ``dt`` [s] at a ``share`` 0 ... 1, and what holds the tool back."""
        self._command = self._command if command is None else command
        pull_back = max(_PULL_BACK_S, dt)
        along, back, stray = self._rates(self._ahead(servo, servo.v, dt), pull_back)
        _, speeds, _ = self._pace(servo, along, back, share, dt)
        along, back, stray = self._rates(self._ahead(servo, speeds, dt), pull_back)  # where the tick will end
        strays = share > 0.0 and stray > min(max(_ASIDE, self._stray), _LOST)
        scale, speeds, held = self._pace(servo, along, back, 0.0 if strays else share, dt)
        self._bend = np.abs(along - self._along) / max(dt * scale, 1e-9)
        self._stray, self._along = stray, along
        if share == 0.0 and scale == 0.0:
            return np.zeros(self._robot.n), None
        if strays:
            return speeds, "jog: a singular pose, the tool cannot go on this way; go back, or turn a joint"
        if share > 0.0 and not along.any():
            return speeds, "jog: no joint of this arm can move its tool this way from here"
        return speeds, None if held is None else f"jog: {self._robot.joints[held].title} at the limit"

    @staticmethod
    def _ahead(servo: JointServo, speeds: FloatArray, dt: float) -> FloatArray:
        """Where a tick that ends with ``speeds`` (n,) leads."""
        return np.clip(servo.q + 0.5 * (servo.v + speeds) * dt, servo.low, servo.high)

    def _rates(self, q: FloatArray, pull_back_s: float) -> tuple[FloatArray, FloatArray, float]:
        """Joint rates (n,) along the command and back to the line; the share of speed that strays."""
        moving = self._moving
        pose, J = self._robot.forward(q), self._robot.jacobian(q)
        linear = self._turn @ self._command.linear
        off = self._start - pose[:3, 3]
        if self._direction is not None:
            off = off - self._direction * float(self._direction @ off)
        rows, second, restoring = self._second(pose, J)
        rows, null = rows[:, moving], _null_space(J[:3, moving])
        first = damped_inverse(J[:3, moving]) @ np.stack([linear, off / pull_back_s], axis=1)
        wanted = np.stack([second, restoring / pull_back_s], axis=1) - rows @ first
        rates = np.zeros((self._robot.n, 2))
        rates[moving] = first + null @ damped_inverse(rows @ null, _NEAR_SECOND, 1.0) @ wanted
        speed = float(np.linalg.norm(linear))
        stray = 0.0 if speed == 0.0 else float(np.linalg.norm(J[:3] @ rates[:, 0] - linear)) / speed
        rates[np.abs(rates) < _RANK] = 0.0
        return rates[:, 0], rates[:, 1], stray

    def _second(self, pose: FloatArray, J: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rows (m, n) of what comes second to the position, rates (m,) wanted of them, what they are off."""
        pitch_rate, roll_rate = self._command.pitch_rate, self._command.roll_rate
        if self._pose_kept:
            spin = pitch_rate * self._lift + roll_rate * self._rotation[:, 2]
            if self._command.angular is not None:
                spin = spin + self._turn @ self._command.angular
            return J[3:], spin, -self._turned_aside(pose[:3, :3], spin)
        rows = np.zeros((0, self._robot.n)) if self._rows is None else self._rows.rows(pose, J)
        wanted = np.zeros(len(rows))
        if len(rows) == 1:  # two where the tool stands upright: it keeps so
            sine_rate = 1.0 if isinstance(self._rows, PlanePitch) else math.hypot(pose[0, 2], pose[1, 2])
            wanted[0] = self._outward * pitch_rate * sine_rate
        roll = self._robot.inverse_kinematics.roll_joint
        if roll is not None:
            rows = np.concatenate([rows, np.eye(self._robot.n)[[roll]]])
            wanted = np.append(wanted, roll_rate)
        return rows, wanted, np.zeros(len(rows))

    def _turned_aside(self, rotation: FloatArray, spin: FloatArray) -> FloatArray:
        """(3,) how far a rotation (3, 3) is off the first one, however far turned about a spin (3,) [rad]."""
        off = rotation @ self._rotation.T
        size = float(np.linalg.norm(spin))
        if size > 0.0:
            axis = spin / size
            w, *v = quaternion_wxyz(off)
            off = off @ turn(axis, -2.0 * math.atan2(float(axis @ v), float(w)))
        return rotation_vectors(off[None])[0]

    def _pace(
        self, servo: JointServo, along: FloatArray, back: FloatArray, share: float, dt: float
    ) -> tuple[float, FloatArray, int | None]:
        """Share of the command that all joints can, joint speeds (n,) [rad/s], the joint at its limit."""
        v, a = servo.v, servo.acceleration_limits
        rests_s = self._command.rests_s
        fastest = servo.speed_limits if rests_s is None else np.minimum(servo.speed_limits, rests_s * a)
        room = self._room(servo, np.sign(back), a, dt)
        back = back * float(np.minimum(room / np.maximum(np.abs(back), 1e-12), 1.0).min())
        size, sign = np.abs(along), np.sign(along)
        used = size > _RANK
        if not used.any():
            return 0.0, back, None
        turns = np.where(used, size, 1.0)
        braking = np.minimum(a, size * _SHARE_TO_BRAKE * float((a / turns)[used].min()) + 1e-12)
        held = np.where(used, (self._room(servo, sign, braking, dt) - sign * back) / turns, np.inf)
        limiting = int(held.argmin())
        free = np.where(used, (fastest - np.abs(back)) / turns, np.inf).min()
        bend = np.sqrt(_SHARE_TO_BEND * a / np.maximum(self._bend, 1e-12)).min()
        most = max(min(share, float(free), float(bend), float(held[limiting])), 0.0)
        low = float(np.where(used, (sign * (v - back) - a * dt) / turns, -np.inf).max())
        high = float(np.where(used, (sign * (v - back) + a * dt) / turns, np.inf).min())
        scale = max(min(max(most, low), high) if low <= high else 0.5 * (low + high), 0.0)
        stands = share > 0.0 and held[limiting] < _STANDS * share
        return scale, scale * along + back, limiting if stands else None

    @staticmethod
    def _room(servo: JointServo, sign: FloatArray, braking: FloatArray, dt: float) -> FloatArray:
        """(n,) speeds in the direction of ``sign`` from which the joints can rest before their limits."""
        room = np.where(sign > 0, servo.high - servo.q, servo.q - servo.low)
        return fastest_inside(room, sign * servo.v, braking, dt)[0]


def _lift_axis(pose: FloatArray) -> FloatArray:
    """(3,) the level axis about which a turn lifts the tool; upright its own x axis."""
    level = np.array([pose[1, 2], -pose[0, 2], 0.0])  # approach x up
    size = float(np.linalg.norm(level))
    return level / size if size > _UPRIGHT else pose[:3, 0]


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
