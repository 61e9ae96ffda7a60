"""All solutions of a position with three pitch joints: every way to face it, every turn of the joints."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI
from armctl.kinematics.yaw_pitch_roll.base_yaw import BaseBranch
from armctl.kinematics.yaw_pitch_roll.branch_names import branch_index
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.stretches import Stretch
from armctl.kinematics.yaw_pitch_roll.sweep import FreeJointSweep
from armctl.kinematics.yaw_pitch_roll.sweep_grid import SweepGrid

FloatArray = NDArray[np.float64]


class PositionSweep:
    """The sweep of one arm and its limits; immutable but for the cached grid, safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, limits: FloatArray) -> None:
        self._geometry, self._joint_count = geometry, len(limits)
        self._swept = float(limits[1, 0]), float(limits[1, 1])
        self._sweeps = [FreeJointSweep(geometry, part) for part in turns(limits)]
        self._grid: SweepGrid | None = None

    def grid(self, step: float) -> SweepGrid:
        """The grid for a step [rad]; the last one made is kept.

        Raises:
            InputError: so small a step that the grid would not fit into memory.
        """
        grid = self._grid
        if grid is None or grid.step != step:
            grid = self._grid = SweepGrid.of(self._geometry, self._swept, step)
        return grid

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
        grid = self.grid(step)
        shoulder = self._geometry.shoulder
        parts: list[tuple[BaseBranch, complex, FreeJointSweep, list[Stretch]]] = []
        count = 0
        for branch in branches:
            target = complex(branch.r - shoulder.real, z - shoulder.imag)
            for sweep in self._sweeps:
                found = sweep.stretches(target, grid)
                if found:
                    parts.append((branch, target, sweep, found))
                    count += sum([stop - start for _, _, start, stop, _, _ in found])
        q = np.empty((self._joint_count, count))
        index = np.empty(count, dtype=np.int8)
        end = 0
        for branch, target, sweep, found in parts:
            begin = end
            for bend, _, start, stop, _, _ in found:
                at, end = end, end + stop - start
                index[at:end] = branch_index(branch.front, bend)
            q[0, begin:end] = branch.angle
            sweep.fill(target, grid, found, q[1:4, begin:end])
        if self._geometry.roll_joint is not None:
            q[self._geometry.roll_joint] = roll
        return q, index


def turns(limits: FloatArray) -> list[FloatArray]:
    """Limits of the first four joints (4, 2), cut so that each of the last two spans less than a turn."""
    ranges = [_cut(float(low), float(high)) for low, high in limits[2:4]]
    return [np.array([limits[0], limits[1], *pair]) for pair in itertools.product(*ranges)]


def _cut(low: float, high: float) -> list[tuple[float, float]]:
    """Equal parts, with so much between them that no angle is inside two (``LIMIT_TOLERANCE``)."""
    count = 1 + math.floor((high - low) / TWO_PI + LIMIT_TOLERANCE)
    cuts = np.linspace(low, high, count + 1).tolist()
    return [(a if a == low else a + 2.0 * LIMIT_TOLERANCE, b) for a, b in itertools.pairwise(cuts)]
