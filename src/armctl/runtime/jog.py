"""Jogging: joints turned by rate commands that expire."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.motion import Floor
from armctl.robot import Robot
from armctl.runtime.activity import ActivityView, Setpoint

FloatArray = NDArray[np.float64]
JOG_EXPIRY_S = 0.1
"""How long one jog command counts."""
_BRAKING_PROBES = np.linspace(0.0, 1.0, 6)
_FLOOR_ROUNDING = 1e-9


class Jogger:
    """Joint speeds that follow the commands inside every limit.

    At each tick the joints can still be brought to rest before their limits, and the arm before the
    floor: a step after which they could not is not taken.
    """

    def __init__(self, robot: Robot, floor: Floor, q: FloatArray, speed: float) -> None:
        self._robot = robot
        self._floor = floor
        self._q = q.copy()
        self._v = np.zeros(robot.n)
        self._rate = np.zeros(robot.n)
        self._expires = -math.inf
        self._speed = speed
        self._notice: str | None = None
        self._done = False

    @property
    def label(self) -> str:
        """What it is."""
        return "jog"

    @property
    def begun(self) -> bool:
        """A jog begins at once."""
        return True

    @property
    def standing(self) -> bool:
        """The joints are at rest."""
        return not self._v.any()

    @property
    def done(self) -> bool:
        """At rest, and the last command has expired."""
        return self._done

    @property
    def error(self) -> ArmctlError | None:
        """A jog does not fail by itself."""
        return None

    @property
    def pausable(self) -> bool:
        """No: let go of the key."""
        return False

    @property
    def notice(self) -> str | None:
        """Which limit or floor holds the jog back."""
        return self._notice

    def command(self, rate: FloatArray, expires: float) -> None:
        """Turn at ``rate`` (n,), -1 ... 1 of the speed limits, until the clock says ``expires``."""
        self._rate = rate.copy()
        self._expires = expires
        self._done = False

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
        self._v = np.zeros(self._robot.n)
        self._done = self._expires == -math.inf

    def view(self) -> ActivityView:
        """What is shown: a jog has no goal."""
        return ActivityView(None, 0.0, 0.0)

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Go on by ``dt`` seconds to ``now``; None where the joints stand."""
        zero = np.zeros(self._robot.n)
        expired = now >= self._expires
        desired = zero if expired else self._rate * self._robot.speed_limits * self._speed
        self._notice = None
        q, v = self._step(desired, dt)
        if not expired and not self._clear_of_floor(q, v):
            self._notice = "jog: the floor is in the way"
            q, v = self._step(zero, dt)
        elif not expired:
            self._notice = self._at_limit(q, desired)
        if not v.any() and not self._v.any():
            self._done = expired
            return None
        sample = Setpoint(q, v, (v - self._v) / dt)
        self._q, self._v = q, v
        return Setpoint(q.copy(), v.copy(), sample.acceleration)

    def _step(self, desired: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
        """Positions and speeds (n,) after ``dt``: as near to the desired speeds as the limits allow."""
        a = self._robot.acceleration_limits
        low, high = self._robot.limits[:, 0], self._robot.limits[:, 1]
        v = self._v
        most_up, halt_up = self._fastest(high - self._q, v, dt)
        most_down, halt_down = self._fastest(self._q - low, -v, dt)
        after = np.clip(desired, v - a * dt, v + a * dt)
        after = np.clip(after, -most_down, most_up)
        moved = 0.5 * (v + after) * dt
        # A joint that can rest within the tick and must (or shall) brakes fully, then stands.
        rests = (np.abs(v) <= a * dt) & (((desired == 0) & (after == 0)) | halt_up | halt_down)
        after = np.where(rests, 0.0, after)
        moved = np.where(rests, 0.5 * v * np.abs(v) / a, moved)
        return np.clip(self._q + moved, low, high), after

    def _fastest(self, room: FloatArray, v: FloatArray, dt: float) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Largest speed (n,) after ``dt`` from which a joint can rest inside ``room`` [rad]; who must halt.

        From ``(v + v') dt / 2 + v'² / 2a <= room``, solved for v'.
        """
        a = self._robot.acceleration_limits
        left = room - 0.5 * v * dt
        halt = (left <= 0) & (v > 0)
        root = np.sqrt(np.maximum(0.25 * dt * dt + 2 * left / a, 0.0))
        return np.maximum(a * (root - 0.5 * dt), 0.0), halt

    def _clear_of_floor(self, q: FloatArray, v: FloatArray) -> bool:
        """Whether the whole braking path from a step's end stays above the floor, or sinks no deeper."""
        if not v.any() and np.array_equal(q, self._q):
            return True
        a = self._robot.acceleration_limits
        takes = np.abs(v) / a
        t = np.minimum(_BRAKING_PROBES[:, None] * takes.max(), takes)
        path = q + v * t - 0.5 * np.sign(v) * a * t * t
        clearance = self._floor.clearance(np.vstack([self._q, path]))
        allowed = np.minimum(clearance[0], 0.0) - _FLOOR_ROUNDING
        return bool((clearance[1:] >= allowed).all())

    def _at_limit(self, q: FloatArray, desired: FloatArray) -> str | None:
        low, high = self._robot.limits[:, 0], self._robot.limits[:, 1]
        stuck = ((desired > 0) & (q >= high)) | ((desired < 0) & (q <= low))
        names = [joint.title for joint, held in zip(self._robot.joints, stuck, strict=True) if held]
        return f"jog: {', '.join(names)} at the limit" if names else None
