"""Configurations that put the tool on a point and turn it as nearly as can be to a rotation asked for.

The position is an order, the rotation a wish. Position and limits leave a box: the base angle is one of two
(any, over the base axis), the pitch lies in intervals whose ends have a joint at a limit or the links
stretched, the roll between its limits. Where the best turns lie inside it they are taken; where they do not,
the best lies on a face of the box, and on each face it is closed form again.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.angles import images
from armctl.kinematics.chain import Chain
from armctl.kinematics.rotation import quaternion_product, quaternion_wxyz, rotation_angle
from armctl.kinematics.tool_plane import ToolPlane
from armctl.kinematics.yaw_pitch_roll.closed_form import PlanePostures
from armctl.kinematics.yaw_pitch_roll.geometry import (
    BaseBranch,
    PlanePose,
    bend_sense,
    branch_index,
    tool_points_in,
)
from armctl.kinematics.yaw_pitch_roll.least_rotation import LeastRotation

# Which turns of base, pitch and roll bring the tool nearest to a rotation asked for.
#
# In forward, left, up coordinates the tool's rotation is ``R_up(a) R_down(b) R_w(c) R_zero``: a turn of the
# base about up, one of the pitch joints together about the downward normal of the tool plane, one of the roll
# joint about its axis w in that plane. The inner product of its quaternion with the one asked for is linear
# in each of the unit vectors (cos a/2, sin a/2), (cos b/2, sin b/2) and (cos c/2, sin c/2), and the angle
# between the two rotations is least where the inner product's magnitude is largest. So with one turn free the
# nearest is an arc tangent, with two it is the leading singular pair of a 2 x 2 matrix: exact, without a
# search.

Turns = tuple[float, float, float]
"""of base, pitch and roll from the zero pose [rad]"""
_VERTICAL = 1e-9
"""how near to vertical a roll axis may point before it says nothing about the base angle (sine)"""


class OrientationFit:
    """Fits the three turns of one arm. Immutable; safe in several threads."""

    def __init__(self, geometry: ToolPlane, tool_at_zero: FloatArray, roll_axis: FloatArray | None) -> None:
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


_ALIKE = 1e-6
"""how much farther from the rotation asked for than the nearest one a solution may be [rad]"""


@dataclass(frozen=True, slots=True)
class _Posture:
    """Pitch joints that bring the tip to the target, and where the tool points then."""

    angles: tuple[float, ...]
    """joint angles inside the limits [rad]"""
    turn: float
    """of the tool from the zero pose, in its plane [rad]"""


@dataclass(frozen=True, slots=True)
class _Candidate:
    """One configuration, and its branch."""

    q: FloatArray
    branch: int


class NearestOrientation:
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
        self._limits = [(float(low), float(high)) for low, high in limits]
        roll = geometry.roll_joint
        axis = None if roll is None else chain.axes()[1][roll]
        self._fit = OrientationFit(geometry, chain.forward(np.zeros(chain.n))[:3, :3], axis)
        self._zero_angle = sum(geometry.offsets)

    def solve(
        self, branches: list[BaseBranch], z: float, rotation: FloatArray, *, any_base: bool
    ) -> tuple[list[FloatArray], list[int]]:
        """Configurations (n,) [rad] and their branch indices; none when the position has no solution.

        Args:
            branches: base angles for the position, inside the limits.
            z: height of the target above the base origin [m].
            rotation: (3, 3) ``R_base_tool``.
            any_base: the target lies on the base axis, so that the base may take any angle.
        """
        form = self._fit.form(rotation)
        if any_base:
            found = self._over_the_axis(form, rotation, z)
        else:
            found = [one for branch in branches for one in self._facing(branch, form, z)]
        return self._nearest_of(found, rotation)

    def _facing(self, branch: BaseBranch, form: FloatArray, z: float) -> list[_Candidate]:
        """With the base angle given by the position."""
        turn = self._geometry.yaw_sign * branch.angle
        rolls = self._roll_limits()
        if self._least is None:
            # None: folded onto its shoulder the arm may point anywhere; else it is one of the postures
            faces = itertools.product((None, *self._postures(branch, z)), (None, *rolls))
            return [c for posture, roll in faces for c in self._on_face(branch, form, z, turn, posture, roll)]
        found = list(self._on_face(branch, form, z, turn, None, None))
        if not found:
            for posture, roll in itertools.product((None, *self._postures(branch, z)), (None, *rolls)):
                found += self._on_face(branch, form, z, turn, posture, roll)
        return found

    def _over_the_axis(self, form: FloatArray, rotation: FloatArray, z: float) -> list[_Candidate]:
        """With the base free: as the rotation calls for, else on a face of base, pitch and roll limits."""
        branch = BaseBranch(True, 0.0, 0.0)
        postures: list[_Posture | None] = [None, *self._postures(branch, z)]
        found: list[_Candidate] = []
        for turn in self._fit.base_turns(rotation):
            if self._base_angles(turn):
                found += self._on_face(branch, form, z, turn, None, None)
        if found and self._least is not None:
            return found
        bases = (None, *(self._geometry.yaw_sign * limit for limit in self._limits[0]))
        for base, posture, roll in itertools.product(bases, postures, (None, *self._roll_limits())):
            if base is not None or posture is not None or roll is not None:
                found += self._on_face(branch, form, z, base, posture, roll)
        return found

    def _on_face(
        self, branch: BaseBranch, form: FloatArray, z: float,
        base: float | None, posture: _Posture | None, roll: float | None,
    ) -> Iterator[_Candidate]:  # fmt: skip
        """The nearest with some turns held, if what is free comes out inside the limits."""
        joint = self._geometry.roll_joint
        if joint is None:
            roll = 0.0
        held = None if posture is None else posture.turn
        base_turn, pitch_turn, roll_turn = self._fit.nearest(form, base, held, roll)
        if self._geometry.roll_joint is None:
            rolls = [0.0]
        else:
            rolls = (
                [roll] if roll is not None else images(roll_turn, *self._limits[self._geometry.roll_joint])
            )
        if not rolls:
            return
        postures = [posture] if posture is not None else self._at(branch, z, pitch_turn)
        for one, yaw, rolled in itertools.product(postures, self._base_angles(base_turn), rolls):
            q = np.array([yaw, *one.angles, rolled][: self._chain.n])
            yield _Candidate(q, self._branch(branch, one))

    def _base_angles(self, turn: float) -> list[float]:
        return images(self._geometry.yaw_sign * turn, *self._limits[0])

    def _roll_limits(self) -> tuple[float, ...]:
        joint = self._geometry.roll_joint
        return () if joint is None else self._limits[joint]

    def _at(self, branch: BaseBranch, z: float, pitch_turn: float) -> list[_Posture]:
        """Postures at a given turn of the tool in its plane."""
        shoulder = self._geometry.shoulder
        tool_angle = pitch_turn + self._zero_angle + (self._geometry.tool_angle or 0.0)
        planes = self._planar.at(branch.r - shoulder.real, z - shoulder.imag, tool_angle)
        return [
            _Posture(angles, pitch_turn) for plane in planes for angles in self._planar.joint_images(plane)
        ]

    def _postures(self, branch: BaseBranch, z: float) -> list[_Posture]:
        """Two pitch joints: all that reach the point. Three: those at the ends of the pitch's intervals."""
        shoulder = self._geometry.shoulder
        if self._least is not None:
            joints = self._least.extremes(branch, z)
        else:
            planes = self._planar.at(branch.r - shoulder.real, z - shoulder.imag, None)
            joints = (angles for plane in planes for angles in self._planar.joint_images(plane))
        return [_Posture(angles, self._direction(angles) - self._zero_angle) for angles in joints]

    def _direction(self, angles: tuple[float, ...]) -> float:
        """Plane angle of the last link [rad]."""
        return sum(self._geometry.plane_angle(k, angle) for k, angle in enumerate(angles))

    def _branch(self, branch: BaseBranch, posture: _Posture) -> int:
        geometry = self._geometry
        angle = None if geometry.tool_angle is None else self._direction(posture.angles) + geometry.tool_angle
        bend = bend_sense(geometry.plane_angle(1, posture.angles[1]))
        return branch_index(branch.front, bend, tool_points_in(branch, PlanePose(angle, 0.0)))

    def _nearest_of(
        self, found: list[_Candidate], rotation: FloatArray
    ) -> tuple[list[FloatArray], list[int]]:
        """Those that come nearest to the rotation, without copies."""
        if not found:
            return [], []
        turned = np.swapaxes(self._chain.forward(np.array([c.q for c in found]))[:, :3, :3], 1, 2) @ rotation
        misses = [rotation_angle(R) for R in turned]
        bound = min(misses) + _ALIKE
        kept: list[_Candidate] = []
        for candidate, miss in zip(found, misses, strict=True):
            if miss <= bound and not any(np.abs(candidate.q - other.q).max() < _ALIKE for other in kept):
                kept.append(candidate)
        return [c.q for c in kept], [c.branch for c in kept]
