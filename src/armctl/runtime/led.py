"""Joints that are led by hand: what a jog and a live target have in common, and the jog."""

from __future__ import annotations

import math

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.robot import Robot
from armctl.runtime.activity import ActivityView, Setpoint
from armctl.runtime.commands import JogTool
from armctl.runtime.joint_servo import JointServo, KeepClear, Lead, ToolLine

JOG_EXPIRY_S = 0.1
"""How long one jog command counts."""


class Led:
    """Joints whose way is decided anew at each tick, by commands that expire.

    At each tick the joints can still be brought to rest before their limits, and the arm before the
    floor, an obstacle or itself: a step after which they could not is not taken.
    """

    begun = True
    pausable = False  # whoever leads it lets go
    error: ArmctlError | None = None  # what cannot be done is no error: the notice says why

    def __init__(self, robot: Robot, clear: KeepClear, q: FloatArray, speed: float) -> None:
        """Stand at ``q`` (n,) [rad]; ``speed`` is the override."""
        self._robot = robot
        self._clear = clear
        self._servo = JointServo(robot, q)
        self._speed = speed
        self._expires = -math.inf
        self.notice: str | None = None
        """what is not as it is asked for: a limit, the floor, a singular pose"""
        self.done = False
        """at rest, and nobody leads it any more"""

    @property
    def standing(self) -> bool:
        """The joints are at rest."""
        return self._servo.standing

    def set_speed(self, fraction: float) -> None:
        """Go towards this speed override inside the acceleration limits."""
        self._speed = fraction

    def pause(self) -> None:
        """The same as letting go."""
        self.stop()

    def resume(self) -> None:
        """Nothing to resume."""

    def stop(self) -> None:
        """Slow down as hard as the limits allow."""
        self._expires = -math.inf
        self.done = self.standing

    def halt(self) -> None:
        """No setpoint is sent for now: go on from rest."""
        self._servo.halt()
        self.done = self._expires == -math.inf

    def _lead_on(self, expires: float) -> None:
        """Somebody leads it until the clock says ``expires``."""
        self._expires = expires
        self.done = False

    def _toward_rest(self, dt: float) -> tuple[FloatArray, FloatArray]:
        """Angles and speeds (n,) after ``dt`` [s] of braking."""
        return self._servo.step(np.zeros(self._robot.n), dt)

    def _blocked_ahead(self, q: FloatArray, v: FloatArray) -> str | None:
        """What is in the way from here to where the joints could rest after a step to ``q``, ``v`` (n,)."""
        servo = self._servo
        if not v.any() and np.array_equal(q, servo.q):
            return None
        found = self._clear.blocked(np.vstack([servo.q, servo.braking_path(q, v)]))
        return None if found is None else found[1]

    def _take(self, q: FloatArray, v: FloatArray, dt: float) -> Setpoint:
        """Take a step to ``q``, ``v`` (n,), and the setpoint that says so."""
        acceleration = (v - self._servo.v) / dt
        self._servo.take(q, v)
        return Setpoint(q.copy(), v.copy(), acceleration)


class Jogger(Led):
    """Joint speeds that follow the jog commands inside every limit."""

    label = "jog"

    def __init__(self, robot: Robot, clear: KeepClear, q: FloatArray, speed: float) -> None:
        """Stand at ``q`` (n,) [rad]; ``speed`` is the override."""
        super().__init__(robot, clear, q, speed)
        self._wanted: FloatArray | JogTool = np.zeros(robot.n)
        self._line: ToolLine | None = None

    def command(self, wanted: FloatArray | JogTool, expires: float) -> None:
        """Move on until the clock says ``expires``.

        Args:
            wanted: (n,) joint rates, -1 ... 1 of the speed limits, or how to move the tool.
            expires: controller clock [s].
        """
        self._wanted = wanted.copy() if isinstance(wanted, np.ndarray) else wanted
        self._lead_on(expires)

    def stop(self) -> None:
        """Slow down as hard as the limits allow."""
        self._line = None
        super().stop()

    def view(self) -> ActivityView:
        """What is shown: a jog has no goal."""
        return ActivityView(None, 0.0, 0.0)

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Go on by ``dt`` seconds to ``now``; None where the joints stand."""
        servo, expired = self._servo, now >= self._expires
        lead = self._lead(expired, dt)
        self.notice = None if expired else lead.notice
        q, v = servo.step(lead.speeds, dt)
        if not expired and (blocked := self._blocked_ahead(q, v)) is not None:
            self.notice = f"jog: {blocked}"
            q, v = self._toward_rest(dt)
        elif not expired and self.notice is None and self._line is None:
            self.notice = self._at_limit(q, lead.speeds)
        if not v.any() and servo.standing:
            self.done = expired
            if expired:
                self._line = None
            return None
        return self._take(q, v, dt)

    def _lead(self, expired: bool, dt: float) -> Lead:
        """Speeds to go for; a jog of another kind or direction waits until the arm stands."""
        wanted, servo = self._wanted, self._servo
        going_on = isinstance(wanted, JogTool) and self._line is not None and self._line.continues(wanted)
        if self._line is not None and (expired or not going_on):
            if not servo.standing:
                return self._line.lead(servo, 0.0, dt)
            self._line = None
        if expired:
            return Lead(np.zeros(self._robot.n))
        if not isinstance(wanted, JogTool):
            return Lead(wanted * self._robot.speed_limits * self._speed)
        if self._line is None:
            if not servo.standing:
                return Lead(np.zeros(self._robot.n))
            self._line = ToolLine(self._robot, servo.q, wanted)
        return self._line.lead(servo, self._speed, dt, wanted)

    def _at_limit(self, q: FloatArray, desired: FloatArray) -> str | None:
        low, high = self._robot.limits[:, 0], self._robot.limits[:, 1]
        stuck = ((desired > 0) & (q >= high)) | ((desired < 0) & (q <= low))
        names = [joint.title for joint, held in zip(self._robot.joints, stuck, strict=True) if held]
        return f"jog: {', '.join(names)} at the limit" if names else None
