"""The one gate: nothing else writes a setpoint."""

from __future__ import annotations

import math

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import MotionRefusedError
from armctl.facts.commands import ShareOutside
from armctl.robot import Robot

_ROUNDING = 1e-9


class Gate:
    """Admits a setpoint, or refuses it with a reason; remembers the last one it admitted.

    A setpoint must be finite, inside the limits, and no further from the last one than the speed limit
    allows in the time since then; that time counts for no more than ``longest_s``, so that a pause does
    not earn a jump.
    """

    def __init__(self, robot: Robot, longest_s: float) -> None:
        self._longest_s = longest_s
        self.equip(robot)
        self.q: FloatArray | None = None
        """(n,) last setpoint [rad], never written into; None: nothing was sent since the pulses came on"""
        self.opening: float | None = None
        """last gripper opening 0..1; None: nothing was sent"""
        self._q_time = 0.0
        self._opening_time = 0.0

    def equip(self, robot: Robot) -> None:
        """The same arm with another tool on: the gripper may be another one."""
        self._robot = robot
        self._shape = (robot.n,)
        self._limits, self._speeds = robot.limits.tolist(), robot.speed_limits.tolist()

    def forget(self) -> None:
        """The pulses are off: the position is unknown."""
        self.q = None
        self.opening = None

    def forget_opening(self) -> None:
        """Another gripper is on, and nobody knows how far it is open."""
        self.opening = None

    def jump(self, q: FloatArray, now: float) -> None:
        """Go on from ``q`` (n,) [rad], where the arm stands with its pulses on."""
        self.q, self._q_time = self.checked(q), now

    def adopt_opening(self, opening: float, now: float) -> None:
        """The board already holds the gripper at this opening."""
        self.opening, self._opening_time = min(max(opening, 0.0), 1.0), now

    def admit(
        self, q: FloatArray | None, opening: float | None, now: float
    ) -> tuple[FloatArray | None, float | None]:
        """Admit the next setpoint, all of it or nothing; gives what to send, None for what is unchanged.

        ``q`` (n,) [rad] and the gripper's ``opening`` (0 closed ... 1 open) are None where nothing moves.
        ``MotionRefusedError``: nothing may be sent.
        """
        admitted = None if q is None else self._checked_joints(q, now)
        admitted_opening = None if opening is None else self._checked_opening(opening, now)
        if admitted is not None:
            self.q, self._q_time = admitted, now
        if admitted_opening is not None:
            self.opening, self._opening_time = admitted_opening, now
        return admitted, admitted_opening

    def _checked_joints(self, q: FloatArray, now: float) -> FloatArray | None:
        if self.q is None:
            raise MotionRefusedError("a setpoint while the pulses are off; enable first")
        q = self.checked(q)
        step = [abs(new - old) for new, old in zip(q.tolist(), self.q.tolist(), strict=True)]
        if not any(step):
            return None
        elapsed = min(max(now - self._q_time, 0.0), self._longest_s)
        allowed = [speed * elapsed for speed in self._speeds]
        over = [far - may * (1 + _ROUNDING) - _ROUNDING for far, may in zip(step, allowed, strict=True)]
        if (most := max(over)) > 0:
            i = over.index(most)
            joint = self._robot.joints[i]
            raise MotionRefusedError(
                f"{joint.title}: a step of {joint.said(step[i], 3)} in {1000 * elapsed:.1f} ms, "
                f"its speed limit allows {joint.said(allowed[i], 3)}"
            )
        return q

    def _checked_opening(self, opening: float, now: float) -> float | None:
        gripper = self._robot.gripper
        if gripper is None:
            raise MotionRefusedError(f"{self._robot.name} has no gripper")
        if not (math.isfinite(opening) and -_ROUNDING <= opening <= 1 + _ROUNDING):
            raise MotionRefusedError(ShareOutside("gripper", opening, 0, 1, gripper.title))
        opening = min(max(opening, 0.0), 1.0)
        if self.opening is None:
            raise MotionRefusedError(f"{gripper.title}: nobody knows how far open it is; enable again")
        if opening == self.opening:
            return None
        elapsed = min(max(now - self._opening_time, 0.0), self._longest_s)
        step, allowed = abs(opening - self.opening), gripper.speed * elapsed
        if step > allowed * (1 + _ROUNDING) + _ROUNDING:
            raise MotionRefusedError(
                f"{gripper.title}: a step of {100 * step:.2f} % in {1000 * elapsed:.1f} ms, "
                f"its speed limit allows {100 * allowed:.2f} %"
            )
        return opening

    def checked(self, q: FloatArray) -> FloatArray:
        """``q`` (n,) [rad] where it is finite and inside the limits; else ``MotionRefusedError``."""
        if q.shape == self._shape and not self._robot.chain.turn_limits:
            inside = zip(self._limits, q.tolist(), strict=True)
            if all([low <= value <= high for (low, high), value in inside]):
                return q.copy()  # as nearly always, in plain numbers: a tenth of the time
        if q.shape != self._shape or not np.isfinite(q).all():
            raise MotionRefusedError(f"a setpoint that is not {self._robot.n} finite angles: {q.tolist()}")
        return self._robot.check_limits(q)
