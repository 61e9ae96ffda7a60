"""Jogging: joints or the tool moved by commands that expire."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.robot import Robot
from armctl.runtime.activity import ActivityView, Setpoint
from armctl.runtime.commands import JogTool
from armctl.runtime.keep_clear import KeepClear
from armctl.runtime.led import Led
from armctl.runtime.tool_line import Lead, ToolLine

FloatArray = NDArray[np.float64]
JOG_EXPIRY_S = 0.1
"""How long one jog command counts."""


class Jogger(Led):
    """Joint speeds that follow the commands inside every limit."""

    def __init__(self, robot: Robot, clear: KeepClear, q: FloatArray, speed: float) -> None:
        """Stand at ``q`` (n,) [rad]; ``speed`` is the override."""
        super().__init__(robot, clear, q, speed)
        self._wanted: FloatArray | JogTool = np.zeros(robot.n)
        self._line: ToolLine | None = None

    @property
    def label(self) -> str:
        """What it is."""
        return "jog"

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
        self._notice = None if expired else lead.notice
        q, v = servo.step(lead.speeds, dt)
        if not expired and (blocked := self._blocked_ahead(q, v)) is not None:
            self._notice = f"jog: {blocked}"
            q, v = self._toward_rest(dt)
        elif not expired and self._notice is None and self._line is None:
            self._notice = self._at_limit(q, lead.speeds)
        if not v.any() and servo.standing:
            self._done = expired
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
        self._line.command = wanted
        return self._line.lead(servo, self._speed, dt)

    def _at_limit(self, q: FloatArray, desired: FloatArray) -> str | None:
        low, high = self._robot.limits[:, 0], self._robot.limits[:, 1]
        stuck = ((desired > 0) & (q >= high)) | ((desired < 0) & (q <= low))
        names = [joint.title for joint, held in zip(self._robot.joints, stuck, strict=True) if held]
        return f"jog: {', '.join(names)} at the limit" if names else None
