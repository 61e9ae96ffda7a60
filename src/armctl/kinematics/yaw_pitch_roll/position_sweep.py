"""All solutions of a position with three pitch joints: every way to face it, every turn of the joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.yaw_pitch_roll.base_yaw import BaseBranch
from armctl.kinematics.yaw_pitch_roll.branch_names import branch_index
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.sweep import FreeJointSweep, turns

FloatArray = NDArray[np.float64]


class PositionSweep:
    """The sweeps of one arm and its limits. Safe in several threads, as ``FreeJointSweep`` is."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self._geometry, self._joints = geometry, len(limits)
        self._sweeps = [FreeJointSweep(geometry, cut) for cut in turns(limits)]

    def solve(
        self, branches: list[BaseBranch], z: float, roll: float, step: float
    ) -> tuple[FloatArray, NDArray[np.int8]]:
        """Solutions on the grid of the first pitch joint.

        Args:
            branches: base angles inside their limits.
            z: height of the target above the base origin [m].
            roll: the roll joint's angle [rad], where there is one.
            step: of the grid [rad].

        Returns:
            (n, k) joint angles [rad], joint by joint in memory, and (k,) their branch indices.

        Raises:
            InputError: so small a step that the grid would not fit into memory.
        """
        shoulder = self._geometry.shoulder
        height = z - shoulder.imag
        parts = [
            (sweep, branch, sweep.stretches(branch.r - shoulder.real, height, step))
            for branch in branches
            for sweep in self._sweeps
        ]
        count = sum(stretch.size for _, _, stretches in parts for stretch in stretches)
        q = np.empty((self._joints, count))
        index = np.empty(count, dtype=np.int8)
        at = 0
        for sweep, branch, stretches in parts:
            begin = at
            for stretch in stretches:
                index[at : at + stretch.size] = branch_index(branch.front, stretch.bend)
                at += stretch.size
            q[0, begin:at] = branch.angle
            sweep.fill(branch.r - shoulder.real, height, step, stretches, q[1:4, begin:at])
        if self._geometry.roll_joint is not None:
            q[self._geometry.roll_joint] = roll
        return q, index
