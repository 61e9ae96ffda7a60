"""Joints that are led by hand: what a jog and a live target have in common."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.robot import Robot
from armctl.runtime.activity import Setpoint
from armctl.runtime.joint_servo import JointServo
from armctl.runtime.keep_clear import KeepClear

FloatArray = NDArray[np.float64]


class Led:
    """Joints whose way is decided anew at each tick, by commands that expire.

    At each tick the joints can still be brought to rest before their limits, and the arm before the
    floor, an obstacle or itself: a step after which they could not is not taken.
    """

    def __init__(self, robot: Robot, clear: KeepClear, q: FloatArray, speed: float) -> None:
        """Stand at ``q`` (n,) [rad]; ``speed`` is the override."""
        self._robot = robot
        self._clear = clear
        self._servo = JointServo(robot, q)
        self._speed = speed
        self._expires = -math.inf
        self._notice: str | None = None
        self._done = False

    @property
    def begun(self) -> bool:
        """It begins at once."""
        return True

    @property
    def standing(self) -> bool:
        """The joints are at rest."""
        return self._servo.standing

    @property
    def done(self) -> bool:
        """At rest, and nobody leads it any more."""
        return self._done

    @property
    def error(self) -> ArmctlError | None:
        """What cannot be done is no error: the notice says why."""
        return None

    @property
    def pausable(self) -> bool:
        """No: whoever leads it lets go."""
        return False

    @property
    def notice(self) -> str | None:
        """What is not as it is asked for: a limit, the floor, a singular pose."""
        return self._notice

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
        self._done = self.standing

    def halt(self) -> None:
        """No setpoint is sent for now: go on from rest."""
        self._servo.halt()
        self._done = self._expires == -math.inf

    def _lead_on(self, expires: float) -> None:
        """Somebody leads it until the clock says ``expires``."""
        self._expires = expires
        self._done = False

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
