"""Tool orientation at a given base angle: one pitch angle in the plane and one roll.

With a = half the pitch turn and b = half the roll, the orientation's quaternion is
``(cos a cos b, cos a sin b, sin a cos b, sin a sin b)`` in the basis 1, w, -y, -y x w  (w: roll axis at
the zero pose, y: left). Its inner product with the quaternion asked for is bilinear in the unit vectors
(cos a, sin a) and (cos b, sin b), so the nearest orientation is a 2 x 2 singular value problem: exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.rotation import quaternion_wxyz
from armctl.kinematics.yaw_pitch_roll import YawPitchRoll

FloatArray = NDArray[np.float64]

_VERTICAL = 1e-9
"""how near to vertical a roll axis may point before it says nothing about the base angle (sine)"""


@dataclass(frozen=True, slots=True)
class PlanePose:
    """Tool direction in the vertical plane and roll."""

    tool_angle: float | None
    """plane angle of the approach axis above forward [rad]; None: whatever the position gives"""
    roll: float
    """angle of the roll joint [rad]; 0 where there is none"""


def pitch_poses(pitch: float | None, roll: float) -> list[PlanePose]:
    """Plane angles that hold the tool at a pitch above the horizontal.

    A pitch within ±90° is met by a tool that points away from the base axis and by one that points back
    at it. Beyond ±90° the angle is taken as it is, in the arm's own plane: the tool points back.
    """
    if pitch is None:
        return [PlanePose(None, roll)]
    if abs(pitch) > math.pi / 2:
        return [PlanePose(pitch, roll)]
    return [PlanePose(pitch, roll), PlanePose(math.pi - pitch, roll)]


class RotationFit:
    """Fits pitch and roll to a rotation asked for."""

    def __init__(
        self, geometry: YawPitchRoll, tool_at_zero: FloatArray, roll_axis: FloatArray | None
    ) -> None:
        self._geometry = geometry
        self._zero = geometry.frame.T @ tool_at_zero  # (3, 3) tool in forward, left, up at the zero pose
        down = np.array([0.0, -1.0, 0.0])
        axis = geometry.frame.T @ roll_axis if roll_axis is not None else self._zero[:, 2]
        self._basis = np.stack([axis, down, np.cross(down, axis)])
        self._rolls = roll_axis is not None
        self._roll_axis_in_tool = self._zero.T @ axis
        self._left_in_tool = self._zero[1]
        self._zero_angle = sum(geometry.offsets) + (geometry.tool_angle or 0.0)

    def nearest(self, yaw: float, rotation: FloatArray) -> PlanePose:
        """Pitch and roll nearest to a rotation (3, 3), with the base at ``yaw`` [rad]."""
        Q = self._bilinear(yaw, rotation)
        if not self._rolls:
            return self._pose(math.atan2(Q[1, 0], Q[0, 0]), 0.0)
        u, _, vt = np.linalg.svd(Q)
        return self._pose(math.atan2(u[1, 0], u[0, 0]), math.atan2(vt[0, 1], vt[0, 0]))

    def base_angles(self, rotation: FloatArray) -> list[float]:
        """The base angles θ1 [rad] that a rotation (3, 3) itself calls for; none where any will do."""
        if self._rolls:
            axis = self._geometry.frame.T @ rotation @ self._roll_axis_in_tool
            if math.hypot(axis[0], axis[1]) < _VERTICAL:
                return []
            facing = math.atan2(axis[1], axis[0])
        else:
            left = self._geometry.frame.T @ rotation @ self._left_in_tool
            facing = math.atan2(-left[0], left[1])
        return [self._geometry.yaw_sign * facing, self._geometry.yaw_sign * facing + math.pi]

    def roll_at(self, yaw: float, tool_angle: float, rotation: FloatArray) -> float:
        """The roll nearest to a rotation with the tool's plane angle given; 0 where the arm cannot roll."""
        if not self._rolls:
            return 0.0
        a = 0.5 * (tool_angle - self._zero_angle)
        first, second = self._bilinear(yaw, rotation).T @ np.array([math.cos(a), math.sin(a)])
        return 2.0 * math.atan2(second, first)

    def pitch_at(self, yaw: float, roll: float, rotation: FloatArray) -> PlanePose:
        """The pitch nearest to a rotation with the roll given."""
        b = 0.5 * roll
        first, second = self._bilinear(yaw, rotation) @ np.array([math.cos(b), math.sin(b)])
        return self._pose(math.atan2(second, first), b)

    def _pose(self, half_pitch: float, half_roll: float) -> PlanePose:
        return PlanePose(2.0 * half_pitch + self._zero_angle, 2.0 * half_roll)

    def _bilinear(self, yaw: float, rotation: FloatArray) -> FloatArray:
        """(2, 2) matrix of the inner product over (cos a, sin a) and (cos b, sin b)."""
        c, s = math.cos(self._geometry.yaw_sign * yaw), math.sin(self._geometry.yaw_sign * yaw)
        facing = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        turn = facing.T @ self._geometry.frame.T @ rotation @ self._zero.T
        w, *vector = quaternion_wxyz(turn).tolist()
        along, down, cross = (self._basis @ np.array(vector)).tolist()
        return np.array([[w, along], [down, cross]])
