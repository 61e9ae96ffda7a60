"""Inverse kinematics of *yaw + parallel pitch joints (+ roll)*: every branch, in closed form."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError
from armctl.kinematics.angles import LIMIT_TOLERANCE
from armctl.kinematics.chain import DHChain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.grid import DEFAULT_STEP, checked_step
from armctl.kinematics.roll_joint import NO_ROLL, RollJoint, held_roll, roll_angles
from armctl.kinematics.solutions import BatchSolutions, Solutions, SolvedArm
from armctl.kinematics.target import Target, checked_column, checked_pitches, checked_point, checked_positions
from armctl.kinematics.yaw_pitch_roll.closed_form import PlanePostures, PoseBranches, Postures
from armctl.kinematics.yaw_pitch_roll.free_joint import PositionSweep
from armctl.kinematics.yaw_pitch_roll.geometry import (
    BRANCHES,
    BaseBranch,
    YawPitchRoll,
    base_branches,
    bend_sense,
    branch_index,
    is_on_axis,
    pitch_poses,
    tool_points_in,
)
from armctl.kinematics.yaw_pitch_roll.least_rotation import LeastRotation, LeastRotationBatch
from armctl.kinematics.yaw_pitch_roll.orientation import NearestOrientation
from armctl.kinematics.yaw_pitch_roll.pose_batch import PoseBatch
from armctl.kinematics.yaw_pitch_roll.reach import NearestReach, Reach

FloatArray = NDArray[np.float64]
_FEW = 16
"""up to so many points the scalar solver is done before the arrays are set up"""
_NO_PITCH = "this arm's tool does not keep to its vertical plane, so it has no pitch to ask for"
Optimum = Callable[[], FloatArray | None]


class YawPitchRollSolver:
    """One arm of the family inside its limits. Immutable; safe in several threads."""

    family = "yaw, parallel pitch joints, roll"

    def __init__(
        self,
        chain: DHChain,
        geometry: YawPitchRoll,
        limits: FloatArray,
        energy: EnergyModel,
        titles: Sequence[str],
    ) -> None:
        self.chain, self.geometry, self.limits, self.energy = chain, geometry, limits, energy
        self._pairs = [(float(low), float(high)) for low, high in limits]
        three, k = len(geometry.lengths) == 3, geometry.roll_joint
        self._roll_joint = None if k is None else RollJoint(k, titles[k], self._pairs[k])
        _, self._resting_roll = held_roll(self._roll_joint, None)
        self._arm = SolvedArm(BRANCHES, chain, energy, geometry.pitch_joints)
        self._sweep = PositionSweep(geometry, limits) if three else None
        self._least = LeastRotation(geometry, limits) if three else None
        self._planar = PlanePostures(geometry, limits)
        self._batch = PoseBatch(geometry, limits, self._planar)
        self._least_batch = None if self._least is None else LeastRotationBatch(geometry, limits, self._least)
        self._orientation = NearestOrientation(chain, geometry, limits, self._planar, self._least)
        self._reach = Reach(geometry, limits, titles, NearestReach(geometry, limits, self._in_plane))

    @cached_property
    def _pose_branches(self) -> PoseBranches | None:
        narrow = PoseBranches.serves(self.geometry, self.limits)
        return PoseBranches(self.geometry, self.limits) if narrow else None

    @property
    def pitch_joints(self) -> tuple[int, ...]:
        """Indices of the parallel pitch joints."""
        return self.geometry.pitch_joints

    @property
    def free_joint(self) -> int | None:
        """The first pitch joint, where there are three and its limits do not hold it."""
        return 1 if self._sweep is not None and self._pairs[1][0] < self._pairs[1][1] else None

    def pitch_and_roll(self, q: FloatArray) -> tuple[float | None, float | None]:
        """Tool pitch in [-pi/2, pi/2] and roll [rad] at one configuration (n,)."""
        geometry = self.geometry
        roll = None if geometry.roll_joint is None else float(q[geometry.roll_joint])
        if geometry.tool_angle is None:
            return None, roll
        forward, left, up = (geometry.frame.T @ self.chain.forward(q)[:3, 2]).tolist()
        return math.atan2(up, math.hypot(forward, left)), roll  # an arc sine is blind near ±90°

    def solve(self, target: Target, step: float) -> Solutions:
        """All solutions inside the limits.

        Position alone with three pitch joints: the first one is swept in steps of ``step`` [rad], with the
        roll joint at one of its equal angles, the one nearest to zero. Else
        the solutions are isolated: position and pitch (and roll), position alone with two pitch joints,
        or position and rotation (the nearest rotation that the arm can take at that position).

        Raises:
            InputError: ``step`` is not a positive number.
        """
        if step is not DEFAULT_STEP:
            step = checked_step(step)
        (x, y, z), pitch, roll, rotation = target
        found = None if pitch is None else self._written_out(x, y, z, pitch, roll)
        if found is not None and found[0]:
            return Solutions(self._arm, target, found[1], found[0])
        refusal, roll = self._roll(target)
        if refusal is not None:
            return self._refused(target, refusal)
        x, y, z = self.geometry.local_of(x, y, z)
        branches = base_branches(self.geometry, x, y, self._pairs[0])
        if rotation is not None:
            any_base = is_on_axis(self.geometry, x, y)
            found, index = self._orientation.solve(branches, z, rotation, any_base=any_base)
            return self._solutions(target, found, index) if found else self._refused(target)
        if self._sweep is not None and pitch is None:
            return self._swept(self._sweep, target, branches, z, roll, step)
        return self._isolated(target, branches, z, roll)

    def _written_out(self, x: float, y: float, z: float, pitch: float, roll: float | None) -> Postures | None:
        """What the closed form in one piece lists; None where it does not serve, or leaves it to the rest."""
        quick, joint = self._pose_branches, self._roll_joint
        if quick is None or (roll is not None and joint is None):
            return None
        return quick.at(x, y, z, pitch, roll_angles(joint, roll))

    def postures(
        self, x: float, y: float, z: float, pitch: float, roll: float | None = None
    ) -> list[tuple[float, ...]]:
        """The joint angles of every branch that ``solve`` lists for a position, pitch and roll, and no more.

        For loops that ask for one pose after the other: plain floats in, plain floats out.

        Args:
            x: tool point in the base frame [m].
            y: tool point in the base frame [m].
            z: tool point in the base frame [m].
            pitch: of the approach axis above the horizontal [rad].
            roll: the roll joint's angle [rad]; None: the one nearest to zero.

        Raises:
            InputError: a value that is not finite.
        """
        if math.isfinite(x + y + z + pitch + (roll or 0.0)):
            found = self._written_out(x, y, z, pitch, roll)
            if found is not None:
                return found[1]
        target = Target.of([x, y, z], pitch, roll)
        return list(map(tuple, self.solve(target, DEFAULT_STEP).q.tolist()))

    def solve_batch(
        self, position_m: ArrayLike, pitch: ArrayLike | None, roll: ArrayLike | None
    ) -> BatchSolutions:
        """Every branch of many poses; ``Robot.inverse_batch`` says more.

        Raises:
            InputError: a wrong shape, or an entry that is not finite; it names the row.
        """
        position = checked_positions(position_m)
        three = len(self.geometry.lengths) == 3
        if three and pitch is None:
            raise InputError("this arm has a free joint: give a pitch, or ask for the least rotation")
        if not three and pitch is not None:
            raise InputError("with two pitch joints the position alone decides the pitch: leave it out")
        if pitch is not None and self.geometry.tool_angle is None:
            raise InputError(_NO_PITCH)
        if roll is not None and self._roll_joint is None:
            raise InputError(NO_ROLL)
        count = len(position)
        return self._batch.solve(
            position,
            None if pitch is None else checked_pitches(pitch, count),
            None if roll is None else checked_column(roll, count, "the roll"),
        )

    def least_rotation_of(self, position_m: ArrayLike) -> FloatArray:
        """The exact least rotation of one point (3,) [m]: (n,); ``Robot.least_rotation`` says more.

        Raises:
            InputError: a wrong shape, or an entry that is not finite.
        """
        point, least = checked_point(position_m), self._least
        if least is None:
            return self.least_rotation_batch([point])[0]
        x, y, z = self.geometry.local_of(*point)
        found = least.solve(base_branches(self.geometry, x, y, self._pairs[0]), z)
        return np.full(self.chain.n, np.nan) if found is None else self._with_roll(found, self._resting_roll)

    def least_rotation_batch(self, position_m: ArrayLike) -> FloatArray:
        """The exact least rotation of many points; ``Robot.least_rotation`` says more.

        Raises:
            InputError: a wrong shape, or an entry that is not finite; it names the row.
        """
        position = checked_positions(position_m)
        if self._least is None or self._least_batch is None:
            # two pitch joints: isolated solutions, of which the least is taken
            branches = self._batch.solve(position, None, None)
            energy = np.where(branches.found, np.abs(branches.q).sum(axis=2), np.inf)
            return branches.q[np.arange(len(position)), energy.argmin(axis=1)]
        if len(position) <= _FEW:
            found = [self.least_rotation_of(point) for point in position]
            return np.array(found).reshape(len(position), self.chain.n)
        q = np.full((self.chain.n, len(position)), np.nan)
        q[:4] = self._least_batch.solve(position).T
        if self.geometry.roll_joint is not None:
            q[4] = np.where(np.isnan(q[0]), np.nan, self._resting_roll)
        return q.T

    def _roll(self, target: Target) -> tuple[str | None, float]:
        """Why the roll or pitch asked for cannot be, or the roll joint's angle (0 where any will do)."""
        if target.pitch is not None and self.geometry.tool_angle is None:
            return _NO_PITCH, 0.0
        return held_roll(self._roll_joint, target.roll)

    def _swept(
        self,
        sweep: PositionSweep,
        target: Target,
        branches: list[BaseBranch],
        z: float,
        roll: float,
        step: float,
    ) -> Solutions:
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
        name = branch_index(self._faces(target, single), bend_sense(self._last_plane_angle(single)))
        return self._solutions(target, [single], [name], optimum)

    def _last_plane_angle(self, q: FloatArray) -> float:
        last = len(self.geometry.lengths) - 1
        return self.geometry.plane_angle(last, float(q[1 + last]))

    def _faces(self, target: Target, q: FloatArray) -> bool:
        """True when the target lies in front of the arm."""
        x, y, _ = self.geometry.local_of(*target.point)
        turn = self.geometry.yaw_sign * float(q[0])
        return x * math.cos(turn) + y * math.sin(turn) >= 0.0

    def _isolated(self, target: Target, branches: list[BaseBranch], z: float, roll: float) -> Solutions:
        shoulder = self.geometry.shoulder
        found: list[FloatArray] = []
        index: list[int] = []
        for branch, pose in itertools.product(branches, pitch_poses(target.pitch, roll)):
            for plane in self._planar.at(branch.r - shoulder.real, z - shoulder.imag, pose.tool_angle):
                name = branch_index(branch.front, bend_sense(plane[1]), tool_points_in(branch, pose))
                for angles, rolled in itertools.product(
                    self._planar.joint_images(plane), roll_angles(self._roll_joint, pose.roll)
                ):
                    found.append(self._with_roll((branch.angle, *angles), rolled))
                    index.append(name)
        return self._solutions(target, *_distinct(found, index)) if found else self._refused(target)

    def _in_plane(self, yaw: float, r: float, z: float, last: float | None) -> FloatArray | None:
        """Base and pitch joints for a point of the tool plane, the last link's direction given or any."""
        if self._least is not None and last is None:
            least = self._least.solve([BaseBranch(True, yaw, r)], z)
            return None if least is None else np.array(least)
        angles = self._planar.inside(r, z, last)
        return None if angles is None else np.array([yaw, *angles])

    def _with_roll(self, q: Sequence[float], roll: float) -> FloatArray:
        return np.array(q if self.geometry.roll_joint is None else (*q, roll))

    def _solutions(
        self, target: Target, q: list[FloatArray], index: list[int], optimum: Optimum | None = None
    ) -> Solutions:
        return Solutions(self._arm, target, np.array(q), index, least_rotation=optimum)

    def _refused(self, target: Target, reason: str | None = None) -> Solutions:
        why, nearest = self._reach.explain(target, self._planar.at)
        return Solutions(self._arm, target, (), (), reason=reason or why, nearest_q=nearest)


def _distinct(found: list[FloatArray], index: list[int]) -> tuple[list[FloatArray], list[int]]:
    """Without copies: straight up and straight down are reached by two pitch angles that are the same."""
    kept: list[FloatArray] = []
    names: list[int] = []
    for q, i in zip(found, index, strict=True):
        if not any(np.abs(q - other).max() < LIMIT_TOLERANCE for other in kept):
            kept.append(q)
            names.append(i)
    return kept, names
