"""Inverse kinematics of arms with three parallel axes in a row: every whole pose in closed form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.facts import Reason
from armctl.facts.targets import MayBeHidden, TurnTogether
from armctl.kinematics.angles import distinct, wrapped
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.families.numeric.solver import roll_joint
from armctl.kinematics.families.three_parallel.closed_form import (
    BRANCHES,
    ThreeParallel,
    all_ways,
    recognise_three_parallel,
    with_pair,
    with_shoulder,
    with_wrist,
)
from armctl.kinematics.families.whole_pose import Configurations, WholePoses, misses, polished
from armctl.kinematics.solutions import BatchSolutions, Solutions
from armctl.kinematics.solver import InverseKinematics
from armctl.kinematics.subproblems import circle_angles, cross
from armctl.kinematics.target import Target

# All ways of one pose in plain floats, for arms like Universal Robots'; arrays take thirty times as long.

_Circle = tuple[float, float, float]
_DOUBTFUL = 1e-6
"""closer than this to a singularity nothing is answered: sines and squared lengths over the longest"""


class OnePose:
    """The constants of one arm. Immutable."""

    def __init__(self, arm: ThreeParallel) -> None:
        i, j, k = arm.plane
        w1, w5, w6 = arm.axes[0], arm.axes[4], arm.axes[5]
        x, first = arm.points[4], arm.points[0]
        self._T = arm.T_tool_base.tolist()
        self._first, self._x = first.tolist(), x.tolist()
        self._ahead = [_turns(w1, v) for v in (i, j, k)]
        """of the plane's axes, turned by the first joint"""
        u = np.cross(w6, np.eye(3)[int(np.abs(w6).argmin())])
        u /= np.linalg.norm(u)
        self._last = [v.tolist() for v in (w6, u)]
        self._behind = [[_along(_turns(w5, v), axis) for axis in (i, j, k)] for v in (w6, u, np.cross(w6, u))]
        """of the last axis and of two across it, turned by joint 5: along the plane's axes"""
        self._height = float(k @ (x - first))
        self._shoulder = (float(i @ (first - arm.points[1])), float(j @ (first - arm.points[1])))
        self._wrist = (float(i @ (arm.points[3] - x)), float(j @ (arm.points[3] - x)))
        (self._x1, self._y1), (self._x2, self._y2) = arm.links.tolist()
        self._lengths = math.hypot(self._x1, self._y1), math.hypot(self._x2, self._y2)
        self._straight, self._signs = arm.straight, arm.signs

    def ways(self, pose: Sequence[Sequence[float]]) -> tuple[list[list[float]], list[int]] | None:
        """Rows of six angles [rad] of a tool pose (4 rows), and their columns in ``closed_form.all_ways``.

        None so close to a singularity that arrays have to look more carefully.
        """
        rows: list[list[float]] = []
        columns: list[int] = []
        R = [_row(row, self._T) for row in pose[:3]]
        p, x, (w6, u) = self._first, self._x, self._last
        wrist = [row[0] * x[0] + row[1] * x[1] + row[2] * x[2] + row[3] - p[n] for n, row in enumerate(R)]
        axis = [row[0] * w6[0] + row[1] * w6[1] + row[2] * w6[2] for row in R]
        side = [row[0] * u[0] + row[1] * u[1] + row[2] * u[2] for row in R]
        at_wrist, at_axis, at_side = (
            [_circle(turns, v) for turns in self._ahead] for v in (wrist, axis, side)
        )
        size = math.hypot(at_wrist[2][1], at_wrist[2][2])
        firsts, missed = circle_angles(*at_wrist[2], self._height)
        if abs(missed) > 0.0 or len(firsts) == 1:
            return None if missed < _DOUBTFUL else (rows, columns)
        if size - abs(self._height - at_wrist[2][0]) < _DOUBTFUL * size:
            return None
        for n, q1 in enumerate(firsts):
            c1, s1 = math.cos(q1), math.sin(q1)
            px, py = (a + b * c1 + c * s1 for a, b, c in at_wrist[:2])
            gi, gj, gk = (a + b * c1 + c * s1 for a, b, c in at_axis)
            ui, uj, uk = (a + b * c1 + c * s1 for a, b, c in at_side)
            a, b, c = self._behind[0][2]
            size = math.hypot(b, c)
            fifths, missed = circle_angles(a, b, c, gk)
            if missed > _DOUBTFUL:
                continue
            if missed > 0.0 or size - abs(gk - a) < _DOUBTFUL * size or gi * gi + gj * gj < _DOUBTFUL:
                return None
            for m, q5 in enumerate(fifths):
                c5, s5 = math.cos(q5), math.sin(q5)
                (mi, mj), (vi, vj, vk), (wi, wj, wk) = (
                    [a + b * c5 + c * s5 for a, b, c in part]
                    for part in (self._behind[0][:2], self._behind[1], self._behind[2])
                )
                cosine, sine = mi * gi + mj * gj, mi * gj - mj * gi
                norm = math.hypot(cosine, sine)
                cosine, sine = cosine / norm, sine / norm
                ti, tj = cosine * ui + sine * uj, cosine * uj - sine * ui
                q6 = math.atan2(wi * ti + wj * tj + wk * uk, vi * ti + vj * tj + vk * uk)
                ei, ej = self._wrist
                dx = px + self._shoulder[0] + cosine * ei - sine * ej
                dy = py + self._shoulder[1] + sine * ei + cosine * ej
                if not self._elbows(
                    rows, columns, (q1, q5, q6), (dx, dy), math.atan2(sine, cosine), 2 * m + n
                ):
                    return None
        return rows, columns

    def _elbows(
        self,
        rows: list[list[float]],
        columns: list[int],
        others: tuple[float, float, float],
        reached: tuple[float, float],
        turn: float,
        column: int,
    ) -> bool:
        """Add both ways of the parallel joints; False where they are singular."""
        one, other = self._lengths
        squared = reached[0] ** 2 + reached[1] ** 2
        longest = (one + other) ** 2
        out, folded = longest - squared, squared - (one - other) ** 2
        if min(abs(out), abs(folded)) < _DOUBTFUL * longest or squared < _DOUBTFUL * longest:
            return False
        if out < 0.0 or folded < 0.0:
            return True
        q1, q5, q6 = others
        bend, facing = 2.0 * math.atan2(math.sqrt(out), math.sqrt(folded)), math.atan2(reached[1], reached[0])
        s2, s3, s4 = self._signs
        for way, q3 in enumerate((self._straight + bend, self._straight - bend)):
            c, s = math.cos(q3), math.sin(q3)
            q2 = facing - math.atan2(
                self._y1 + s * self._x2 + c * self._y2, self._x1 + c * self._x2 - s * self._y2
            )
            rows.append([q1, s2 * q2, s3 * q3, s4 * (turn - q2 - q3), q5, q6])
            columns.append(4 * way + column)
        return True


def _turns(axis: FloatArray, v: FloatArray) -> list[list[float]]:
    """Vectors a, b, c of ``a + b cos q + c sin q``: v turned about an axis by q."""
    level = axis * (axis @ v)
    return [level.tolist(), (v - level).tolist(), list(cross(axis.tolist(), v.tolist()))]


def _along(turns: list[list[float]], direction: FloatArray) -> _Circle:
    a, b, c = (float(direction @ np.array(v)) for v in turns)
    return a, b, c


def _circle(turns: list[list[float]], v: list[float]) -> _Circle:
    x, y, z = v
    (a, b, c), (d, e, f), (g, h, i) = turns
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def _row(row: Sequence[float], T: list[list[float]]) -> tuple[float, float, float, float]:
    """A row of a pose times another pose."""
    a, b, c, d = row
    (e, f, g, h), (i, j, k, m), (n, o, p, q), _ = T
    return a * e + b * i + c * n, a * f + b * j + c * o, a * g + b * k + c * p, a * h + b * m + c * q + d


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
        why: Reason | None = None
        if ways.pairs_free[0]:
            lists: list[FloatArray] = []
            for joint in (arm.others[0], arm.others[2]):
                lists.extend(with_pair(arm, pose, self._answers.spread(joint, start)))
            q, branch = np.concatenate(lists), np.tile(index, len(lists))
            why = self._continuum(arm.others[0], arm.others[2])
        else:
            q, branch = ways.q[0], index
            for i in np.flatnonzero(ways.wrist_free[0]).tolist():
                if i < BRANCHES // 2:
                    more = with_wrist(arm, pose, i, self._answers.spread(arm.others[1], start))
                    q = np.concatenate([q, *more])
                    branch = np.append(branch, np.tile(index[[i, i + BRANCHES // 2]], len(more)))
                why = self._continuum(arm.others[1], arm.first)
            for i in np.flatnonzero(ways.shoulder_free[0]).tolist():
                more = with_shoulder(arm, q[i], self._answers.spread(arm.first, start))
                q, branch = np.concatenate([q, more]), np.append(branch, np.tile(index[i], len(more)))
                why = self._continuum(arm.first, arm.first + 2)
        there = np.flatnonzero(~np.isnan(q[:, 0]))
        q, branch = q[there], branch[there]
        rough, q = q, self._sound(np.broadcast_to(pose, (len(q), 4, 4)), q)
        lost = rough[np.isnan(q[:, 0])]
        if why is None and len(lost):
            lost = polished(self.chain, pose, lost, self._reach, _POLISH)
            why = MayBeHidden() if misses(self.chain, pose, lost).min() < _NEARLY_MET else None
        there = np.flatnonzero(~np.isnan(q[:, 0]))
        there = there[distinct(q[there])]
        return Configurations(q[there], branch[there], why, double=True)

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

    def _continuum(self, one: int, other: int) -> TurnTogether:
        return TurnTogether((self.titles[one], self.titles[other]))


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
