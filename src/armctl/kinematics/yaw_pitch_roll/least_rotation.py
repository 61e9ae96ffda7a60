"""The exact least rotation: min Σ|θ| over the continuum of solutions of three pitch joints.

Between the points where a joint passes zero the sum is smooth, so a minimum lies

* where a joint is at a limit or at zero, or the elbow is straight: a lock, in closed form
  (``pitch_locks.py``), or
* where the sum is stationary along the self-motion: a curve (``live_curve.py``).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.yaw_pitch_roll.base_yaw import BaseBranch
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.joint_windows import nearest_image
from armctl.kinematics.yaw_pitch_roll.live_curve import live_curves
from armctl.kinematics.yaw_pitch_roll.lock_map import LockMap
from armctl.kinematics.yaw_pitch_roll.pitch_locks import PitchJoint, Turned, bent_lock, pitch_locks

FloatArray = NDArray[np.float64]


class LeastRotation:
    """The optimum for one arm and its limits. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self.geometry, self.lengths = geometry, geometry.lengths
        self._shoulder = geometry.shoulder.real, geometry.shoulder.imag
        self._joints = [
            PitchJoint(sense, offset, low, high)
            for sense, offset, (low, high) in zip(
                geometry.signs, geometry.offsets, limits[1:4].tolist(), strict=True
            )
        ]
        self.locks = pitch_locks(geometry, self._joints)
        self.curves = live_curves(geometry, self._joints)
        """what the second and third joint turn there at least, least first"""

    @cached_property
    def _map(self) -> LockMap:
        return LockMap(self.locks, sum(self.lengths))

    def solve(self, branches: list[BaseBranch], height: float) -> tuple[float, ...] | None:
        """The configuration of least rotation.

        Args:
            branches: base angles inside their limits.
            height: of the target above the base origin [m].

        Returns:
            The 4 base and pitch joint angles [rad], or None when no branch has a solution.
        """
        best: Turned | None = None
        base, least = 0.0, math.inf
        for _, yaw, r in branches:
            found = self._in_plane(r, height, least - abs(yaw))
            if found is not None:
                best, base, least = found, yaw, abs(yaw) + found[0]
        return None if best is None else (base, *best[1:])

    def _in_plane(self, r: float, height: float, least: float) -> Turned | None:
        """The best posture for one base angle, if it turns the pitch joints by less than ``least`` [rad]."""
        x, y = r - self._shoulder[0], height - self._shoulder[1]
        best: Turned | None = None
        for bound, lock, side in self._map.at(x, y):
            if bound >= least:
                break  # the rest turn more still
            found = bent_lock(lock, side, x, y)
            if found is not None and found[0] < least:
                best, least = found, found[0]
        if self.curves:
            square, direction = x * x + y * y, math.atan2(y, x)
            for curve in self.curves:
                if curve.spent >= least:
                    break
                if curve.nearest <= square <= curve.farthest and curve.bound(square, direction) < least:
                    angles = self.inside(curve.at(square, direction))
                    energy = math.inf if angles is None else sum(map(abs, angles))
                    if angles is not None and energy < least:
                        best, least = (energy, *angles), energy
        return best

    def inside(self, plane: tuple[float, float, float]) -> tuple[float, float, float] | None:
        """Joint angles of plane angles, if they are inside the limits."""
        angles: list[float] = []
        for t, (sense, offset, low, high) in zip(plane, self._joints, strict=True):
            angle = nearest_image(sense * (t - offset), low, high)
            if angle is None:
                return None
            angles.append(angle)
        return angles[0], angles[1], angles[2]

    def extremes(self, branch: BaseBranch, height: float) -> Iterator[tuple[float, float, float]]:
        """Pitch joint angles [rad] inside the limits with one at a limit or at zero, or the elbow straight.

        Among them are both ends of every continuum of solutions, and the points of least rotation.
        """
        x, y = branch.r - self._shoulder[0], height - self._shoulder[1]
        for lock, side in itertools.product(self.locks, (1, -1)):
            found = bent_lock(lock, side, x, y)
            if found is not None:
                yield found[1:]
        square, direction = x * x + y * y, math.atan2(y, x)
        for curve in self.curves:
            if curve.nearest <= square <= curve.farthest:
                angles = self.inside(curve.at(square, direction))
                if angles is not None:
                    yield angles
