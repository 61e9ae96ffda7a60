"""Following a target that is dragged: the joints move toward a goal that is found anew again and again."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.kinematics import Target
from armctl.robot import Robot
from armctl.runtime.activity import ActivityView, Setpoint
from armctl.runtime.joint_servo import KeepClear
from armctl.runtime.led import Led
from armctl.runtime.planner import LiveGoal, result_of

FloatArray = NDArray[np.float64]
Solve = Callable[[FloatArray, Target, float | None], Future[LiveGoal]]
"""Begins to solve, from angles (n,) [rad], for a target, keeping a tool pitch [rad] where there is one."""
FOLLOW_EXPIRY_S = 0.5
"""How long one target counts. A page that follows repeats it five times as often."""


class Follower(Led):
    """Joints that move toward the newest target inside every limit.

    One target at a time is solved for, somewhere else; of those that come meanwhile only the newest counts.
    """

    def __init__(self, robot: Robot, clear: KeepClear, q: FloatArray, speed: float, solve: Solve) -> None:
        """Stand at ``q`` (n,) [rad]; ``speed`` is the override."""
        super().__init__(robot, clear, q, speed)
        self._solve = solve
        self._pitch = robot.inverse_kinematics.pitch_and_roll(q)[0]
        self._target: Target | None = None
        self._stale = False
        """the target is newer than what is being solved"""
        self._solving: Future[LiveGoal] | None = None
        self._goal: FloatArray | None = None
        self._note: str | None = None

    @property
    def label(self) -> str:
        """What it is."""
        return "live target"

    @property
    def q(self) -> FloatArray:
        """(n,) where the joints are [rad]."""
        return self._servo.q.copy()

    def aim(self, target: Target, expires: float) -> None:
        """Follow ``target`` until the clock says ``expires``."""
        self._lead_on(expires)
        if self._target is None or not _same(target, self._target):
            self._target = target
            self._stale = True

    @property
    def goal(self) -> FloatArray | None:
        """(n,) where the joints go [rad]; None: nowhere yet."""
        return None if self._goal is None else self._goal.copy()

    def stop(self) -> None:
        """Slow down as hard as the limits allow; the same target asked for again is a new one."""
        self._goal = self._target = None
        self._stale = False
        if self._solving is not None:  # its answer is to a target that nobody follows any more
            self._solving.cancel()
            self._solving = None
        super().stop()

    def view(self) -> ActivityView:
        """What is shown: where it goes now."""
        return ActivityView(self.goal, 0.0, 0.0)

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Go on by ``dt`` seconds to ``now``; None where the joints stand."""
        servo, expired = self._servo, now >= self._expires
        self._take_goal(expired)
        goal = None if expired else self._goal
        self._notice = None if expired or self._note is None else f"live target: {self._note}"
        q, v = self._toward_rest(dt) if goal is None else servo.toward(goal, self._speed, dt)
        if goal is not None and (blocked := self._blocked_ahead(q, v)) is not None:
            self._notice = f"live target: {blocked}"
            q, v = self._toward_rest(dt)
        if not v.any() and servo.standing and np.array_equal(q, servo.q):
            self._done = expired
            return None
        return self._take(q, v, dt)

    def _take_goal(self, expired: bool) -> None:
        """Take what has been solved, and have the newest target solved if that has not begun."""
        if self._solving is None and self._stale and self._target is not None and not expired:
            self._stale = False
            self._solving = self._solve(self._servo.q.copy(), self._target, self._pitch)
        if self._solving is None or not self._solving.done():
            return
        solving, self._solving = self._solving, None
        if expired:
            self._stale = True  # nobody waits for it: where the target is asked for again, from there
            return
        try:
            found = result_of(solving)
        except ArmctlError as error:
            self._note = str(error)
            return
        self._note = found.note
        if found.q is not None:
            self._goal = found.q


def _same(one: Target, other: Target) -> bool:
    """Whether two targets ask for the same."""
    if one.rotation is None or other.rotation is None:
        turned = one.rotation is other.rotation
    else:
        turned = np.array_equal(one.rotation, other.rotation)
    return turned and (one.point, one.pitch, one.roll) == (other.point, other.pitch, other.roll)
