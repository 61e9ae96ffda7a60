"""Inverse kinematics of *yaw + parallel pitch joints (+ roll)*: every branch, in closed form."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.facts import Reason
from armctl.facts.targets import NoSuchAngle
from armctl.kinematics.angles import (
    LIMIT_TOLERANCE,
    images,
    quaternion_product,
    quaternion_wxyz,
    wrap,
)
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import Criterion, EnergyModel
from armctl.kinematics.explanations import SolvedArm
from armctl.kinematics.families.whole_pose import pose_of, turned_onto
from armctl.kinematics.families.yaw_pitch_roll.closed_form import PlanePostures, pose_function, solve_batch
from armctl.kinematics.families.yaw_pitch_roll.free_joint import FreeJointSweep
from armctl.kinematics.families.yaw_pitch_roll.geometry import (
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
from armctl.kinematics.families.yaw_pitch_roll.least_rotation import LeastRotation
from armctl.kinematics.families.yaw_pitch_roll.reach import Reach
from armctl.kinematics.families.yaw_pitch_roll.section import PlanarSection
from armctl.kinematics.samples import DEFAULT_STEP, checked_step
from armctl.kinematics.solutions import BatchSolutions, Solutions
from armctl.kinematics.solver import NO_ROLL, InverseKinematics, held_roll, roll_angles
from armctl.kinematics.subproblems import ToolPlane
from armctl.kinematics.target import (
    Target,
    as_numbers,
    checked_column,
    checked_pitches,
    checked_point,
    checked_positions,
    is_point,
)

_NO_ROLLS = (0.0,)
NO_PITCH = NoSuchAngle("pitch")
_Candidate = tuple[FloatArray, int]
"""a configuration (n,) [rad] and the index of its branch"""


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
        *,
        compiled: bool = True,
    ) -> None:
        """Prepare for an arm; not ``compiled``, which takes some milliseconds, for a few poses only."""
        three = len(geometry.lengths) == 3
        super().__init__(
            chain,
            limits,
            energy,
            titles,
            plane=geometry,
            free_joint=1 if three and limits[1, 0] < limits[1, 1] else None,
            roll_joint=geometry.roll_joint,
        )
        self.geometry, self._compiled = geometry, compiled
        self._base: tuple[float, float] = tuple(limits[0].tolist())
        self._arm = SolvedArm(
            BRANCHES, chain, energy, geometry.pitch_joints, limits, geometry.roll_joint,
            titles=self.titles, up=geometry.frame[:, 2], solver_of=self.of,
        )  # fmt: skip
        self._planar = PlanePostures(geometry, limits)
        self._pose = pose_function(geometry, limits) if compiled else None
        self._sweep = FreeJointSweep(geometry, limits) if three else None
        self._least = LeastRotation(geometry, limits) if three else None

    @classmethod
    def recognises(cls, chain: Chain) -> bool:
        """See ``InverseKinematics``."""
        return recognise(chain) is not None

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """See ``InverseKinematics``."""
        geometry = recognise(chain)
        return None if geometry is None else cls(chain, geometry, limits, energy, titles)

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        """Of its own geometry: that of an arm with a joint held is not recognised again to the last digit."""
        make = partial(type(self), compiled=self._compiled)
        return make, (self.chain, self.geometry, self.limits, self.energy, self.titles)

    @cached_property
    def _orientation(self) -> _NearestOrientation:
        return _NearestOrientation(self.chain, self.geometry, self.limits, self._planar, self._least)

    @cached_property
    def _reach(self) -> Reach:
        return Reach(self.geometry, self.limits, self.titles, self._planar, self._least)

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

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
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
            return self._refused(target, NO_PITCH)
        refusal, roll = held_roll(self._roll, roll)
        if refusal is not None:
            return self._refused(target, self._besides(refusal, target._replace(roll=None), step))
        x, y, z = self.geometry.local_of(x, y, z)
        branches = base_branches(self.geometry, x, y, self._base)
        if self._sweep is not None and pitch is None and rotation is None:
            return self._swept(self._sweep, target, branches, z, roll, step)
        if rotation is None:
            found = self._isolated(branches, z, pitch, roll_angles(self._roll, roll))
        else:
            found = self._orientation.solve(
                branches, z, pose_of(target.position, rotation), any_base=is_on_axis(self.geometry, x, y)
            )
        if not found:
            return self._refused(target)
        return Solutions(self._arm, target, np.array([q for q, _ in found]), [branch for _, branch in found])

    def solve_batch(
        self,
        position_m: ArrayLike,
        pitch: ArrayLike | None,
        roll: ArrayLike | None,
        rotation: ArrayLike | None = None,
    ) -> BatchSolutions:
        """See ``InverseKinematics``."""
        if rotation is not None:
            raise self._has_no("batch of rotations")
        position = checked_positions(position_m)
        if self._sweep is not None and pitch is None:
            raise InputError("this arm has a free joint: give a pitch, or ask for the least rotation")
        if self._sweep is None and pitch is not None:
            raise InputError("with two pitch joints the position alone decides the pitch: leave it out")
        if pitch is not None and self.geometry.tool_angle is None:
            raise InputError(NO_PITCH)
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
        optimum = partial(self._optimum, branches, z, roll)
        further = partial(self._travel, target, roll)
        q, index = sweep.solve(branches, z, roll, step)
        if len(index):
            free = self.free_joint
            return Solutions(
                self._arm, target, q.T, index, free_joint=free, least_rotation=optimum, further=further
            )
        single = optimum()  # a sliver between two grid values, or a single stretched configuration
        if single is None:
            return self._refused(target)
        x, y, _ = self.geometry.local_of(*target.point)
        turn = self.geometry.yaw_sign * float(single[0])
        front = x * math.cos(turn) + y * math.sin(turn) >= 0.0
        name = branch_index(front, bend_sense(self.geometry.plane_angle(2, float(single[3]))))
        return Solutions(
            self._arm, target, [single.tolist()], [name], least_rotation=optimum, further=further
        )

    def _optimum(self, branches: list[BaseBranch], z: float, roll: float) -> FloatArray | None:
        """(n,) that of least rotation."""
        found = None if self._least is None else self._least.solve(branches, z)
        return None if found is None else self._with_roll(found, roll)

    def _travel(self, target: Target, roll: float, _: Criterion, start: FloatArray) -> FloatArray:
        """(m, n) among which that of least travel is."""
        q = self.least_candidates(target, start, 1.0 / self.energy.speed_limits)
        q[:, 4:] = roll
        return q

    def least_candidates(self, target: Target, start: FloatArray, weights: FloatArray) -> FloatArray:
        """Configurations (m, n) on a position among which Σ weight · |θ - start| is least, exact.

        Of an arm with three pitch joints: ``start`` (n,) [rad], positive ``weights`` (n,); a roll joint
        stands as at the start. Seen from there it is a least rotation.
        """
        geometry, four = self.geometry, start[:4]
        offsets = (geometry.plane_angle(k, float(start[1 + k])) for k in range(3))
        least = LeastRotation(replace(geometry, offsets=tuple(offsets)), self.limits[:4] - four[:, None])
        x, y, z = geometry.local_of(*target.point)
        branches = base_branches(geometry, x, y, self._base)
        if is_on_axis(geometry, x, y):  # any base angle serves, so the base stays
            branches.append(BaseBranch(True, float(np.clip(four[0], *self._base)), 0.0))
        seen = [branch._replace(angle=branch.angle - float(four[0])) for branch in branches]
        found = least.candidates(seen, z, weights[:4].tolist())
        q = np.tile(np.clip(start, *self.limits.T), (len(found), 1))
        q[:, :4] = np.clip(np.reshape(found, (-1, 4)) + four, *self.limits[:4].T)
        return q

    def _isolated(
        self, branches: list[BaseBranch], z: float, pitch: float | None, rolls: Sequence[float]
    ) -> list[_Candidate]:
        found: list[_Candidate] = []
        seen: list[tuple[float, ...]] = []
        for branch, tool_angle in itertools.product(branches, tool_angles(pitch)):
            inward = tool_points_in(branch, tool_angle)
            for plane in self._planar.at(branch.r, z, tool_angle):
                # straight up and straight down are reached by two pitch angles that are the same
                turns = (branch.angle, *plane)
                if any(_apart(turns, other) < LIMIT_TOLERANCE for other in seen):
                    continue
                seen.append(turns)
                index = branch_index(branch.front, bend_sense(plane[1]), inward)
                for angles, rolled in itertools.product(self._planar.joint_images(plane), rolls):
                    found.append((self._with_roll((branch.angle, *angles), rolled), index))
        return found

    def _with_roll(self, q: Sequence[float], roll: float) -> FloatArray:
        return np.array(q if self._roll is None else (*q, roll))

    def _refused(self, target: Target, reason: Reason | None = None) -> Solutions:
        why, nearest = self._reach.explain(target)
        return Solutions(self._arm, target, (), (), reason=reason or why, nearest_q=nearest)


def _apart(one: Sequence[float], other: Sequence[float]) -> float:
    """The largest difference of two angles of postures, whole turns of all but the first not counted."""
    first, *rest = (a - b for a, b in zip(one, other, strict=True))
    return max(abs(first), *(abs(wrap(angle)) for angle in rest))


# Configurations that put the tool on a point and turn it as nearly as can be to a rotation asked for.
#
# The position is an order, the rotation a wish. Position and limits leave a box: the base angle is one of two
# (any, over the base axis), the pitch lies in intervals whose ends have a joint at a limit or the links
# stretched, the roll between its limits. The best turns lie inside it or on a face of it.
#
# In forward, left, up coordinates the tool's rotation is ``R_up(a) R_down(b) R_w(c) R_zero``: turns of the
# base about up, of the pitch joints together about the downward normal of the tool plane, of the roll joint
# about its axis w. The inner product of its quaternion with the one asked for is linear in each of
# (cos a/2, sin a/2), (cos b/2, sin b/2) and (cos c/2, sin c/2), and the nearest rotation has the largest. So
# with one turn free the nearest is an arc tangent, with two the leading singular pair of a 2 x 2 matrix.

_VERTICAL = 1e-9
"""how near to vertical a roll axis may point before it says nothing about the base angle (sine)"""
_AS_GOOD, _ALIKE = 5e-10, 1e-6
"""how much farther from a rotation than the nearest one a solution may be, and which are one [rad]"""
_Posture = tuple[float, ...]
"""pitch joint angles inside the limits that bring the tip to the target [rad]"""


class _NearestOrientation:
    """Pose targets of one arm inside its limits. Immutable; safe in several threads."""

    def __init__(
        self,
        chain: Chain,
        geometry: ToolPlane,
        limits: FloatArray,
        planar: PlanePostures,
        least: LeastRotation | None,
    ) -> None:
        """Prepare for an arm; ``least`` where it has three pitch joints, None where it has two."""
        self._chain, self._geometry, self._planar, self._least = chain, geometry, planar, least
        self._limits: list[tuple[float, float]] = [(low, high) for low, high in limits.tolist()]
        self._zero: FloatArray = geometry.frame.T @ chain.forward(np.zeros(chain.n))[:3, :3]
        self._zero_heading = sum(geometry.offsets)
        joint = geometry.roll_joint
        w = self._zero[:, 2] if joint is None else geometry.frame.T @ chain.axes()[1][joint]
        self._axis_in_tool: FloatArray = self._zero.T @ (np.array([0.0, 1.0, 0.0]) if joint is None else w)
        one, up = np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])
        down, roll = np.array([0.0, 0.0, -1.0, 0.0]), np.array([0.0, *w])
        ways = itertools.product((one, up), (one, down), (one, roll))
        self._basis: FloatArray = np.array(
            [quaternion_product(quaternion_product(a, b), c) for a, b, c in ways]
        ).reshape(2, 2, 2, 4)

    def solve(
        self, branches: list[BaseBranch], z: float, pose: FloatArray, *, any_base: bool
    ) -> list[_Candidate]:
        """None when the position has no solution."""
        # For base angles inside the limits, or ``any_base`` for a target on the base axis, the height z of
        # the target above the base origin [m] and ``T_base_tool`` (4, 4).
        rotation = pose[:3, :3]
        # (2, 2, 2) trilinear form over the three unit vectors
        form = self._basis @ quaternion_wxyz(self._geometry.frame.T @ rotation @ self._zero.T)
        joint, sign = self._geometry.roll_joint, self._geometry.yaw_sign
        rolls = (None, *(() if joint is None else self._limits[joint]))
        found: list[_Candidate] = []
        for branch in [BaseBranch(True, 0.0, 0.0)] if any_base else branches:
            called_for = bases = [sign * branch.angle]
            if any_base:
                called_for, bases = self._base_turns(rotation), [None, *(sign * v for v in self._limits[0])]
            inside = [c for base in called_for for c in self._on_face(branch, z, form, base, None, None)]
            found += inside
            if not inside or self._least is None:
                for base, posture, roll in itertools.product(bases, (None, *self._ends(branch, z)), rolls):
                    if base is not None or posture is not None or roll is not None:
                        found += self._on_face(branch, z, form, base, posture, roll)
        if not found:
            return []
        limits, every = np.array(self._limits), np.array([q for q, _ in found])
        rows, misses = turned_onto(self._chain, limits, pose, every)
        nearest: list[_Candidate] = []  # without copies
        for i in np.flatnonzero(misses <= misses.min() + _AS_GOOD):
            if all(np.abs(rows[i] - other).max() >= _ALIKE for other, _ in nearest):
                nearest.append((rows[i], found[i][1]))
        return nearest

    def _base_turns(self, rotation: FloatArray) -> list[float]:
        """The two turns of the base [rad] that a rotation (3, 3) itself calls for; none where any will do."""
        x, y, _ = (self._geometry.frame.T @ rotation @ self._axis_in_tool).tolist()
        if self._geometry.roll_joint is None:
            x, y = y, -x
        elif math.hypot(x, y) < _VERTICAL:
            return []
        facing = math.atan2(y, x)
        return [facing, facing + math.pi]

    def _on_face(
        self, branch: BaseBranch, z: float, form: FloatArray,
        base: float | None, posture: _Posture | None, roll: float | None,
    ) -> Iterator[_Candidate]:  # fmt: skip
        """The nearest with some turns held, if what is free comes out inside the limits."""
        geometry, joint = self._geometry, self._geometry.roll_joint
        if joint is None:
            roll = 0.0
        pitch = None if posture is None else self._heading(posture) - self._zero_heading
        base_turn, pitch_turn, roll_turn = _nearest_turns(form, base, pitch, roll)
        rolls = [roll] if roll is not None or joint is None else images(roll_turn, *self._limits[joint])
        if not rolls:
            return
        tool_angle = pitch_turn + self._zero_heading + (geometry.tool_angle or 0.0)
        postures = [posture] if posture is not None else self._planar.inside(branch.r, z, tool_angle)
        yaws = images(geometry.yaw_sign * base_turn, *self._limits[0])
        inward = geometry.tool_angle is not None and tool_points_in(branch, tool_angle)
        for angles, yaw, rolled in itertools.product(postures, yaws, rolls):
            bend = bend_sense(geometry.plane_angle(1, angles[1]))
            q = np.array([yaw, *angles, rolled][: self._chain.n])
            yield q, branch_index(branch.front, bend, inward)

    def _heading(self, posture: _Posture) -> float:
        """Plane angle of the last link [rad]."""
        return sum(itertools.starmap(self._geometry.plane_angle, enumerate(posture)))

    def _ends(self, branch: BaseBranch, z: float) -> Sequence[_Posture]:
        """Two pitch joints: all that reach the point. Three: those at the ends of the pitch's intervals."""
        if self._least is None:
            return self._planar.inside(branch.r, z, None)
        return self._least.extremes(branch, z)


def _nearest_turns(
    form: FloatArray, base: float | None, pitch: float | None, roll: float | None
) -> tuple[float, float, float]:
    """The turns given [rad], and those left free (None; two at most) as the rotation calls for."""
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
