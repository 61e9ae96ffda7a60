"""Which turns of base, pitch and roll bring the tool nearest to a rotation asked for.

In forward, left, up coordinates the tool's rotation is ``R_up(a) R_down(b) R_w(c) R_zero``: a turn of the
base about up, one of the pitch joints together about the downward normal of the tool plane, one of the roll
joint about its axis w in that plane. The inner product of its quaternion with the one asked for is linear in
each of the unit vectors (cos a/2, sin a/2), (cos b/2, sin b/2) and (cos c/2, sin c/2), and the angle between
the two rotations is least where the inner product's magnitude is largest. So with one turn free the nearest
is an arc tangent, with two it is the leading singular pair of a 2 x 2 matrix: exact, without a search.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.rotation import quaternion_product, quaternion_wxyz
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll

FloatArray = NDArray[np.float64]
Turns = tuple[float, float, float]
"""of base, pitch and roll from the zero pose [rad]"""
_VERTICAL = 1e-9
"""how near to vertical a roll axis may point before it says nothing about the base angle (sine)"""


class OrientationFit:
    """Fits the three turns of one arm. Immutable; safe in several threads."""

    def __init__(
        self, geometry: YawPitchRoll, tool_at_zero: FloatArray, roll_axis: FloatArray | None
    ) -> None:
        """Prepare for an arm.

        Args:
            geometry: the arm.
            tool_at_zero: (3, 3) ``R_base_tool`` with all joints at zero.
            roll_axis: (3,) direction of the roll joint's axis there, base frame; None: there is none.
        """
        self._frame = geometry.frame
        self._zero: FloatArray = geometry.frame.T @ tool_at_zero
        self._rolls = roll_axis is not None
        w = geometry.frame.T @ roll_axis if roll_axis is not None else self._zero[:, 2]
        self._axis_in_tool: FloatArray = self._zero.T @ (w if self._rolls else np.array([0.0, 1.0, 0.0]))
        one = np.array([1.0, 0.0, 0.0, 0.0])
        up, down = np.array([0.0, 0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0, 0.0])
        roll = np.array([0.0, *w])
        self._basis: FloatArray = np.array(
            [
                [[quaternion_product(quaternion_product(a, b), c) for c in (one, roll)] for b in (one, down)]
                for a in (one, up)
            ]
        )  # (2, 2, 2, 4)

    def form(self, rotation: FloatArray) -> FloatArray:
        """(2, 2, 2) trilinear form over the three unit vectors, for a rotation (3, 3) ``R_base_tool``."""
        return self._basis @ quaternion_wxyz(self._frame.T @ rotation @ self._zero.T)

    @staticmethod
    def nearest(form: FloatArray, base: float | None, pitch: float | None, roll: float | None) -> Turns:
        """The turns given, and those left free (None; two at most) as the rotation calls for."""
        turns = [base, pitch, roll]
        free = [i for i, turn in enumerate(turns) if turn is None]
        for axis, turn in reversed(list(enumerate(turns))):
            if turn is not None:
                form = np.tensordot(form, (math.cos(0.5 * turn), math.sin(0.5 * turn)), (axis, 0))
        if len(free) == 1:
            turns[free[0]] = 2.0 * math.atan2(form[1], form[0])
        elif free:
            u, _, vt = np.linalg.svd(form)
            turns[free[0]] = 2.0 * math.atan2(u[1, 0], u[0, 0])
            turns[free[1]] = 2.0 * math.atan2(vt[0, 1], vt[0, 0])
        return turns[0] or 0.0, turns[1] or 0.0, turns[2] or 0.0

    def base_turns(self, rotation: FloatArray) -> list[float]:
        """The two turns of the base [rad] that a rotation (3, 3) itself calls for; none where any will do."""
        axis = self._frame.T @ rotation @ self._axis_in_tool
        if not self._rolls:
            facing = math.atan2(-axis[0], axis[1])
        elif math.hypot(axis[0], axis[1]) < _VERTICAL:
            return []
        else:
            facing = math.atan2(axis[1], axis[0])
        return [facing, facing + math.pi]
