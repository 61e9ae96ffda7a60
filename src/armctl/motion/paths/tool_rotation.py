"""The tool's whole orientation along a path: kept, or turned evenly to another about one axis (slerp).

It enters the equations of a path as three rows: the angular velocity ``Σ z_i q_i'`` of the tool over the way.
Together with its point these are six equations. Six joints have one way to meet them, and seven a continuum.
Fewer joints meet them only where the equations happen to agree: yaw, pitch joints and roll along a line in
the arm's own vertical plane, or with the tool upright, where the roll joint turns against the base.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.angles import rotation_angle
from armctl.kinematics.families.numeric.descent import crossed, rotation_vectors
from armctl.motion.paths.tool_pitch import PitchRows


@dataclass(frozen=True, slots=True, eq=False)
class ToolRotation:
    """An orientation that turns at one rate about one axis. Three rows."""

    start: FloatArray
    """(3, 3) ``R_base_tool`` where the path begins"""
    rate: FloatArray
    """(3,) rotation vector a metre of the way, base frame [rad/m]; zeros: it is kept"""
    count: ClassVar[int] = 3
    _sine: FloatArray = field(init=False)
    _rise: FloatArray = field(init=False)
    """(3, 3) each: Rodrigues' formula, times ``start``"""
    _angle: float = field(init=False)
    """turn a metre [rad/m]"""

    def __post_init__(self) -> None:
        angle = float(np.linalg.norm(self.rate))
        x, y, z = (self.rate / angle if angle else self.rate).tolist()
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        object.__setattr__(self, "_angle", angle)
        object.__setattr__(self, "_sine", across @ self.start)
        object.__setattr__(self, "_rise", across @ across @ self.start)

    @classmethod
    def between(cls, start: FloatArray, end: FloatArray | None, length: float) -> ToolRotation:
        """From ``start`` (3, 3) the shorter way to ``end`` over ``length`` [m]; None: kept.

        Of half a turn, either way is the shorter; one of them is taken.
        """
        if end is None:
            return cls(start, np.zeros(3))
        return cls(start, rotation_vectors((end @ start.T)[None])[0] / length)

    def at(self, s: float | FloatArray) -> FloatArray:
        """The rotation ``R_base_tool`` (..., 3, 3) that is asked for at ``s`` (...) [m]."""
        angle = self._angle * np.asarray(s, dtype=np.float64)[..., None, None]
        return self.start + np.sin(angle) * self._sine + 2.0 * np.sin(0.5 * angle) ** 2 * self._rise

    def missing(self, q: FloatArray, pose: FloatArray, s: float) -> FloatArray:
        """(count,) turn from the tool pose (4, 4) to that asked for at ``s``, base frame: axis times sine."""
        if self._angle:
            angle = self._angle * s
            wanted = self.start + math.sin(angle) * self._sine + 2.0 * math.sin(0.5 * angle) ** 2 * self._rise
        else:
            wanted = self.start
        (_, b, c), (d, _, f), (g, h, _) = (wanted @ pose[:3, :3].T).tolist()
        return np.array([0.5 * (h - f), 0.5 * (c - g), 0.5 * (d - b)])

    def rates(self, s: float) -> FloatArray:
        """(2, count) angular velocity over the way that is asked for, and its derivative."""
        return np.array([self.rate, np.zeros(3)])

    def tilt(self, q: FloatArray, poses: FloatArray, s: FloatArray) -> FloatArray:
        """(k,) by what angle tool poses (k, 4, 4) are off at ``s`` (k,) [rad]."""
        wanted = self.at(s).swapaxes(1, 2) if self._angle else self.start.T
        return rotation_angle(poses[:, :3, :3] @ wanted)

    def rows(self, pose: FloatArray, jacobian: FloatArray) -> FloatArray:
        """(count, n) the angular velocity of the tool for each joint's rate."""
        return jacobian[3:]

    def turned(self, pose: FloatArray, jacobian: FloatArray, rates: FloatArray) -> FloatArray:
        """(count, m) derivative of ``rows`` along links' rates (m,): axes turn with the links before them."""
        axes = jacobian[3:]
        return crossed(np.add.accumulate(axes * rates, axis=1)[None], axes[None])[0]


TurnRows = PitchRows | ToolRotation
"""what is asked of the tool's pitch, or of its orientation, on the way"""
