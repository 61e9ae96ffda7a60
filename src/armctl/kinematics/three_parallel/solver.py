"""Inverse kinematics of arms with three parallel axes in a row: every whole pose in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.angles import distinct, wrapped
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.numeric.solver import roll_joint
from armctl.kinematics.solutions import BatchSolutions, Solutions
from armctl.kinematics.solver import InverseKinematics
from armctl.kinematics.target import Target
from armctl.kinematics.three_parallel.closed_form import (
    BRANCHES,
    all_ways,
    with_pair,
    with_shoulder,
    with_wrist,
)
from armctl.kinematics.three_parallel.geometry import ThreeParallel, recognise_three_parallel
from armctl.kinematics.three_parallel.one_pose import OnePose
from armctl.kinematics.whole_pose import HIDDEN, Configurations, WholePoses, misses, polished

_NEAR = 1e-12
"""[m] and [rad]; farther ways are polished"""
_MET, _NEARLY_MET = 1e-9, 4e-9
"""a way that is left with more is none; where wrist and elbow are singular at once it may be one after all"""
_POLISH = 4
_SAME = 1e-6
"""ways of a batch this near to each other are one [rad]"""


class ThreeParallelSolver(InverseKinematics):
    """Six joints, three of them in a row on parallel axes. Immutable; safe in several threads.

    A whole pose is solved in closed form, all else is searched for.
    """

    family = "three parallel axes"
    searches_parts = True

    def __init__(
        self,
        chain: Chain,
        geometry: ThreeParallel,
        limits: FloatArray,
        energy: EnergyModel,
        titles: Sequence[str],
    ) -> None:
        super().__init__(chain, limits, energy, titles, roll_joint=roll_joint(chain))
        self.geometry = geometry
        self._names = branch_names(geometry)
        usual = geometry.exact and geometry.first == 1 and geometry.meet[0]
        self._one_pose = OnePose(geometry) if usual else None
        self._answers = WholePoses(chain, limits, energy, titles, self._names, self._roll, self.of)
        self._reach = float(np.abs(geometry.points).max() + np.linalg.norm(geometry.links, axis=1).sum())

    @classmethod
    def recognises(cls, chain: Chain) -> bool:
        """See ``InverseKinematics``."""
        return recognise_three_parallel(chain) is not None

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """The solver where three axes in a row are parallel."""
        geometry = recognise_three_parallel(chain)
        return None if geometry is None else cls(chain, geometry, limits, energy, titles)

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """See ``InverseKinematics``; a continuum is listed with its free joint as at ``start``, too."""
        return self._answers.solve(target, step, start, self._every_way)

    def solve_poses(self, poses: FloatArray) -> BatchSolutions:
        """See ``InverseKinematics``; a joint that may be anywhere is at 0, or else where the links reach."""
        ways = all_ways(self.geometry, poses)
        arm, elbow = self.geometry, BRANCHES // 2
        missing = ways.wrist_free & np.isnan(ways.q[..., 0])
        for row, way in np.argwhere(missing[:, :elbow]):
            more = with_wrist(arm, poses[row], way, self._answers.spread(arm.others[1], None))
            reaching = more[~np.isnan(more[:, 0, 0])]
            if len(reaching):
                ways.q[row, [way, way + elbow]] = reaching[0]
        doubtful = ways.doubtful if self.geometry.exact else ~np.isnan(ways.q[..., 0])
        row, column = np.nonzero(doubtful)
        q = ways.q
        q[row, column] = self._sound(poses[row], q[row, column])
        close = np.flatnonzero(ways.doubtful.any(axis=1))
        same = np.abs(wrapped(q[close, :, None] - q[close, None])).max(axis=3) < _SAME
        again = np.tril(same, -1).any(axis=2)
        q[close[:, None], np.arange(BRANCHES)] = np.where(again[..., None], np.nan, q[close])
        return BatchSolutions(q, ~np.isnan(q[..., 0]), self._names)

    def _every_way(self, pose: FloatArray, start: FloatArray | None) -> Configurations:
        arm = self.geometry
        if self._one_pose is not None:
            few = self._one_pose.ways(pose.tolist())
            if few is not None:
                return Configurations(np.array(few[0]).reshape(-1, 6), np.array(few[1], dtype=np.int8))
        ways = all_ways(arm, pose[None])
        index = np.arange(BRANCHES, dtype=np.int8)
        reason: str | None = None
        if ways.pairs_free[0]:
            lists: list[FloatArray] = []
            for joint in (arm.others[0], arm.others[2]):
                lists.extend(with_pair(arm, pose, self._answers.spread(joint, start)))
            q, branch = np.concatenate(lists), np.tile(index, len(lists))
            reason = self._continuum(arm.others[0], arm.others[2])
        else:
            q, branch = ways.q[0], index
            for i in np.flatnonzero(ways.wrist_free[0]).tolist():
                if i < BRANCHES // 2:
                    more = with_wrist(arm, pose, i, self._answers.spread(arm.others[1], start))
                    q = np.concatenate([q, *more])
                    branch = np.append(branch, np.tile(index[[i, i + BRANCHES // 2]], len(more)))
                reason = self._continuum(arm.others[1], arm.first)
            for i in np.flatnonzero(ways.shoulder_free[0]).tolist():
                more = with_shoulder(arm, q[i], self._answers.spread(arm.first, start))
                q, branch = np.concatenate([q, more]), np.append(branch, np.tile(index[i], len(more)))
                reason = self._continuum(arm.first, arm.first + 2)
        there = np.flatnonzero(~np.isnan(q[:, 0]))
        q, branch = q[there], branch[there]
        rough, q = q, self._sound(np.broadcast_to(pose, (len(q), 4, 4)), q)
        lost = rough[np.isnan(q[:, 0])]
        if reason is None and len(lost):
            lost = polished(self.chain, pose, lost, self._reach, _POLISH)
            reason = HIDDEN if misses(self.chain, pose, lost).min() < _NEARLY_MET else None
        there = np.flatnonzero(~np.isnan(q[:, 0]))
        there = there[distinct(q[there])]
        return Configurations(q[there], branch[there], reason, double=True)

    def _sound(self, poses: FloatArray, q: FloatArray) -> FloatArray:
        """Ways (k, 6) of poses (k, 4, 4), polished where they miss them; NaN where that does not help."""
        if len(q) == 0:
            return q
        far = np.flatnonzero(misses(self.chain, poses, q) > _NEAR)
        if len(far):
            q = q.copy()
            q[far] = polished(self.chain, poses[far], q[far], self._reach, _POLISH)
            q[far[misses(self.chain, poses[far], q[far]) > _MET]] = np.nan
        return q

    def _continuum(self, one: int, other: int) -> str:
        return (
            f"singular: {self.titles[one]} and {self.titles[other]} can turn against each other here "
            "without moving the tool; a spread of that continuum is listed"
        )


def branch_names(arm: ThreeParallel) -> tuple[str, ...]:
    """The names of the columns of ``closed_form.all_ways``."""
    if arm.first != 1 or not arm.meet[0]:
        return tuple(f"way {i + 1}" for i in range(BRANCHES))
    # ahead is where the first joint, turning, carries the parallel axes to
    ahead = float(np.cross(arm.axes[0], arm.plane[2]) @ (arm.points[arm.others[1]] - arm.points[0]))
    names: list[str] = []
    for column in range(BRANCHES):
        bent_back, flipped, against = column < 4, column // 2 % 2 == 1, column % 2 == 0
        base = "back" if against == (ahead >= 0.0) else "front"
        elbow = "up" if bent_back == against else "down"
        names.append(f"{base} elbow-{elbow}{' wrist-flipped' if flipped else ''}")
    return tuple(names)
