"""Configurations that put the tool on a point and turn it as nearly as can be to a rotation asked for.

The position is an order, the rotation a wish. Position and limits leave a box: the base angle is one of two
(any, over the base axis), the pitch lies in intervals whose ends have a joint at a limit or the links
stretched, the roll between its limits. The best turns lie inside it or on a face of it.

In forward, left, up coordinates the tool's rotation is ``R_up(a) R_down(b) R_w(c) R_zero``: turns of the base
about up, of the pitch joints together about the downward normal of the tool plane, of the roll joint about
its axis w. The inner product of its quaternion with the one asked for is linear in each of (cos a/2, sin
a/2), (cos b/2, sin b/2) and (cos c/2, sin c/2), and the nearest rotation has the largest. So with one turn
free the nearest is an arc tangent, with two the leading singular pair of a 2 x 2 matrix: exact.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.angles import images, quaternion_product, quaternion_wxyz, rotation_angle
from armctl.kinematics.chain import Chain
from armctl.kinematics.tool_plane import ToolPlane
from armctl.kinematics.yaw_pitch_roll.closed_form import PlanePostures
from armctl.kinematics.yaw_pitch_roll.geometry import BaseBranch, bend_sense, branch_index, tool_points_in
from armctl.kinematics.yaw_pitch_roll.least_rotation import LeastRotation

_VERTICAL = 1e-9
"""how near to vertical a roll axis may point before it says nothing about the base angle (sine)"""
_ALIKE = 1e-6
"""how much farther from the rotation asked for than the nearest one a solution may be [rad]"""
Candidate = tuple[FloatArray, int]
"""a configuration (n,) [rad] and the index of its branch"""
_Posture = tuple[float, ...]
"""pitch joint angles inside the limits that bring the tip to the target [rad]"""


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
        self, branches: list[BaseBranch], z: float, rotation: FloatArray, *, any_base: bool
    ) -> list[Candidate]:
        """None when the position has no solution.

        For base angles inside the limits, or ``any_base`` for a target on the base axis, the height z of the
        target above the base origin [m] and ``R_base_tool`` (3, 3).
        """
        # (2, 2, 2) trilinear form over the three unit vectors
        form = self._basis @ quaternion_wxyz(self._geometry.frame.T @ rotation @ self._zero.T)
        joint, sign = self._geometry.roll_joint, self._geometry.yaw_sign
        rolls = (None, *(() if joint is None else self._limits[joint]))
        found: list[Candidate] = []
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
        tools = self._chain.forward(np.array([q for q, _ in found]))[:, :3, :3]
        misses = rotation_angle(tools.swapaxes(1, 2) @ rotation)
        nearest: list[Candidate] = []  # without copies
        for (q, branch), near in zip(found, misses <= misses.min() + _ALIKE, strict=True):
            if near and all(np.abs(q - other).max() >= _ALIKE for other, _ in nearest):
                nearest.append((q, branch))
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
    ) -> Iterator[Candidate]:  # fmt: skip
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
