"""Inverse kinematics of *yaw + parallel pitch joints (+ roll)*: every branch, in closed form."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics.angles import LIMIT_TOLERANCE
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.samples import DEFAULT_STEP, checked_step
from armctl.kinematics.solutions import BatchSolutions, Solutions, SolvedArm
from armctl.kinematics.solver import NO_ROLL, InverseKinematics, RollJoint, held_roll, roll_angles
from armctl.kinematics.target import (
    Target,
    as_numbers,
    checked_column,
    checked_pitches,
    checked_point,
    checked_positions,
    is_point,
)
from armctl.kinematics.tool_plane import ToolPlane
from armctl.kinematics.yaw_pitch_roll.closed_form import PlanePostures, pose_function, solve_batch
from armctl.kinematics.yaw_pitch_roll.free_joint import FreeJointSweep
from armctl.kinematics.yaw_pitch_roll.geometry import (
    BRANCHES,
    BaseBranch,
    base_branches,
    bend_sense,
    branch_index,
    is_on_axis,
    recognise,
    tool_angles,
    tool_points_in,
)
from armctl.kinematics.yaw_pitch_roll.least_rotation import LeastRotation
from armctl.kinematics.yaw_pitch_roll.orientation import Candidate, NearestOrientation
from armctl.kinematics.yaw_pitch_roll.reach import Reach
from armctl.kinematics.yaw_pitch_roll.section import PlanarSection

_NO_ROLLS = (0.0,)
_NO_PITCH = "this arm's tool does not keep to its vertical plane, so it has no pitch to ask for"


class YawPitchRollSolver(InverseKinematics):
    """One arm of the family inside its limits. Immutable; safe in several threads."""

    family = "yaw, parallel pitch joints, roll"
    direct = True

    def __init__(
        self,
        chain: Chain,
        geometry: ToolPlane,
        limits: FloatArray,
        energy: EnergyModel,
        titles: Sequence[str],
    ) -> None:
        super().__init__(chain, limits, energy, titles)
        self.geometry = geometry
        self._base: tuple[float, float] = tuple(limits[0].tolist())
        k, three = geometry.roll_joint, len(geometry.lengths) == 3
        self._roll = None if k is None else RollJoint(k, titles[k], limits[k].tolist())
        self._arm = SolvedArm(BRANCHES, chain, energy, geometry.pitch_joints)
        self._planar = PlanePostures(geometry, limits)
        self._pose = pose_function(geometry, limits)
        self._sweep = FreeJointSweep(geometry, limits) if three else None
        self._least = LeastRotation(geometry, limits) if three else None
        self._orientation = NearestOrientation(chain, geometry, limits, self._planar, self._least)
        self._reach = Reach(geometry, limits, titles, self._planar, self._least)

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """See ``InverseKinematics``."""
        geometry = recognise(chain)
        return None if geometry is None else cls(chain, geometry, limits, energy, titles)

    @property
    def pitch_joints(self) -> tuple[int, ...]:
        """Indices of the parallel pitch joints."""
        return self.geometry.pitch_joints

    @property
    def free_joint(self) -> int | None:
        """The first pitch joint, where there are three and its limits do not hold it."""
        return 1 if self._sweep is not None and self.limits[1, 0] < self.limits[1, 1] else None

    @property
    def roll_joint(self) -> int | None:
        """Index of the joint that rolls the tool."""
        return self.geometry.roll_joint

    @property
    def plane(self) -> ToolPlane:
        """The tool plane."""
        return self.geometry

    def section(self) -> PlanarSection:
        """See ``InverseKinematics``; exact."""
        return PlanarSection(self.geometry, self.limits)

    def pitch_and_roll(self, q: FloatArray) -> tuple[float | None, float | None]:
        """Tool pitch above the plane that the base axis stands on, and roll [rad], at ``q`` (n,)."""
        roll = None if self.roll_joint is None else float(q[self.roll_joint])
        if self.geometry.tool_angle is None:
            return None, roll
        forward, left, up = (self.geometry.frame.T @ self.chain.forward(q)[:3, 2]).tolist()
        return math.atan2(up, math.hypot(forward, left)), roll

    def solve(self, target: Target, step: float) -> Solutions:
        """See ``InverseKinematics``; for a rotation the nearest that the arm can take at that position.

        Position alone with three pitch joints: the first one is swept in steps of ``step`` [rad], with the
        roll joint at one of its equal angles, the one nearest to zero. Else the solutions are isolated.
        """
        if step is not DEFAULT_STEP:
            step = checked_step(step)
        (x, y, z), pitch, roll, rotation = target
        if self._pose is not None and pitch is not None and (roll is None or self._roll is not None):
            rolls = _NO_ROLLS if self._roll is None else self._roll.angles(roll)
            postures = self._pose(x, y, z, pitch, rolls)
            if postures is not None and postures[0]:
                return Solutions(self._arm, target, postures[1], postures[0])
        if pitch is not None and self.geometry.tool_angle is None:
            return self._refused(target, _NO_PITCH)
        refusal, roll = held_roll(self._roll, roll)
        if refusal is not None:
            return self._refused(target, refusal)
        x, y, z = self.geometry.local_of(x, y, z)
        branches = base_branches(self.geometry, x, y, self._base)
        if self._sweep is not None and pitch is None and rotation is None:
            return self._swept(self._sweep, target, branches, z, roll, step)
        if rotation is None:
            found = self._isolated(branches, z, pitch, roll_angles(self._roll, roll))
        else:
            found = self._orientation.solve(branches, z, rotation, any_base=is_on_axis(self.geometry, x, y))
        if not found:
            return self._refused(target)
        return Solutions(self._arm, target, np.array([q for q, _ in found]), [branch for _, branch in found])

    def solve_batch(
        self, position_m: ArrayLike, pitch: ArrayLike | None, roll: ArrayLike | None
    ) -> BatchSolutions:
        """See ``InverseKinematics``."""
        position = checked_positions(position_m)
        if self._sweep is not None and pitch is None:
            raise InputError("this arm has a free joint: give a pitch, or ask for the least rotation")
        if self._sweep is None and pitch is not None:
            raise InputError("with two pitch joints the position alone decides the pitch: leave it out")
        if pitch is not None and self.geometry.tool_angle is None:
            raise InputError(_NO_PITCH)
        if roll is not None and self._roll is None:
            raise InputError(NO_ROLL)
        pitches = None if pitch is None else checked_pitches(pitch, len(position))
        rolls = None if roll is None else checked_column(roll, len(position), "the roll")
        return solve_batch(self._planar, self.limits, position, pitches, rolls)

    def least_rotation(self, position_m: ArrayLike) -> FloatArray:
        """See ``InverseKinematics``."""
        if not is_point(position_m):
            position_m = as_numbers(position_m, "the target position")
            if position_m.ndim != 1:
                return self._least_of(checked_positions(position_m))
        point = checked_point(position_m)
        if self._least is None:
            return self._least_of(np.array([point]))[0]
        return self._least_at(self._least, *point)

    def _least_of(self, points: FloatArray) -> FloatArray:
        """(k, n) for checked points (k, 3) [m]."""
        if self._least is not None:
            rows = [self._least_at(self._least, *point) for point in points.tolist()]
            return np.reshape(rows, (-1, self.chain.n))
        # two pitch joints: isolated solutions, of which the least is taken
        batch = solve_batch(self._planar, self.limits, points, None, None)
        turned = np.where(batch.found, np.abs(batch.q).sum(axis=2), np.inf)
        return batch.q[np.arange(len(points)), turned.argmin(axis=1)]

    def _least_at(self, least: LeastRotation, x: float, y: float, z: float) -> FloatArray:
        x, y, z = self.geometry.local_of(x, y, z)
        found = least.solve(base_branches(self.geometry, x, y, self._base), z)
        if found is None:
            return np.full(self.chain.n, np.nan)
        return self._with_roll(found, 0.0 if self._roll is None else self._roll.resting)

    def _swept(
        self, sweep: FreeJointSweep, target: Target, branches: list[BaseBranch],
        z: float, roll: float, step: float,
    ) -> Solutions:  # fmt: skip
        def optimum() -> FloatArray | None:
            found = None if self._least is None else self._least.solve(branches, z)
            return None if found is None else self._with_roll(found, roll)

        q, index = sweep.solve(branches, z, roll, step)
        if len(index):
            free = self.free_joint
            return Solutions(self._arm, target, q.T, index, free_joint=free, least_rotation=optimum)
        single = optimum()  # a sliver between two grid values, or a single stretched configuration
        if single is None:
            return self._refused(target)
        x, y, _ = self.geometry.local_of(*target.point)
        turn = self.geometry.yaw_sign * float(single[0])
        front = x * math.cos(turn) + y * math.sin(turn) >= 0.0
        name = branch_index(front, bend_sense(self.geometry.plane_angle(2, float(single[3]))))
        return Solutions(self._arm, target, [single.tolist()], [name], least_rotation=optimum)

    def _isolated(
        self, branches: list[BaseBranch], z: float, pitch: float | None, rolls: Sequence[float]
    ) -> list[Candidate]:
        found: list[Candidate] = []
        for branch, tool_angle in itertools.product(branches, tool_angles(pitch)):
            inward = tool_points_in(branch, tool_angle)
            for plane in self._planar.at(branch.r, z, tool_angle):
                for angles, rolled in itertools.product(self._planar.joint_images(plane), rolls):
                    q = self._with_roll((branch.angle, *angles), rolled)
                    # straight up and straight down are reached by two pitch angles that are the same
                    if not any(np.abs(q - other).max() < LIMIT_TOLERANCE for other, _ in found):
                        found.append((q, branch_index(branch.front, bend_sense(plane[1]), inward)))
        return found

    def _with_roll(self, q: Sequence[float], roll: float) -> FloatArray:
        return np.array(q if self._roll is None else (*q, roll))

    def _refused(self, target: Target, reason: str | None = None) -> Solutions:
        why, nearest = self._reach.explain(target)
        return Solutions(self._arm, target, (), (), reason=reason or why, nearest_q=nearest)
