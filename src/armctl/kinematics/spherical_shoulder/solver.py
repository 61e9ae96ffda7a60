"""Inverse kinematics of *spherical shoulder + elbow (+ roll)*: exact position, every branch.

The distance of the target from the shoulder gives the elbow; what is left is the swivel, one free
parameter: swept, or spent on the orientation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.roll_joint import RollJoint, held_roll, roll_angles
from armctl.kinematics.samples import checked_step
from armctl.kinematics.solutions import Solutions, SolvedArm
from armctl.kinematics.solver import InverseKinematics
from armctl.kinematics.spherical_shoulder.geometry import (
    SPHERICAL_BRANCHES,
    SphericalShoulder,
    Vector,
    about,
    conjugate,
    norm,
    product,
    recognise_spherical,
    rotated,
    spherical_branch_index,
    turned,
    vector,
)
from armctl.kinematics.spherical_shoulder.orientation import ToolOrientation, ToolPosture
from armctl.kinematics.spherical_shoulder.reach import SphericalNearest, SphericalReach
from armctl.kinematics.spherical_shoulder.swivel import ShoulderLimits, Swivel, least_rotation, sweep
from armctl.kinematics.target import Target

_AT_SHOULDER = 1e-10
"""how near to the shoulder a tip has no direction from it [m]"""
_REACHED = 1e-10
"""a nearest point that comes this near is the target [m]"""
_TOUCHES = 1e-13
"""the same for a posture found from one beside it [m]"""
_SAME = 1e-7
"""solutions that differ by less in every joint are one, split by rounding [rad]"""
_AZIMUTHS = 16


class SphericalShoulderSolver(InverseKinematics):
    """One arm of the family inside its limits. Immutable; safe in several threads."""

    family = "spherical shoulder, elbow, roll"

    def __init__(
        self,
        chain: Chain,
        geometry: SphericalShoulder,
        limits: FloatArray,
        energy: EnergyModel,
        titles: Sequence[str],
    ) -> None:
        super().__init__(chain, limits, energy, titles)
        self.geometry = geometry
        self._arm = SolvedArm(SPHERICAL_BRANCHES, chain, energy)
        self._shoulder = ShoulderLimits.of(limits)
        self._elbow = (float(limits[3, 0]), float(limits[3, 1]))
        joint = None if geometry.roll_axis is None else RollJoint(4, titles[4], limits[4].tolist())
        self._roll = joint
        self._orientation = ToolOrientation(geometry, None if joint is None else (joint.low, joint.high))
        self._reach = SphericalReach(geometry, limits, titles)
        self._nearest = SphericalNearest(geometry, limits)

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """See ``InverseKinematics``."""
        geometry = recognise_spherical(chain)
        return None if geometry is None else cls(chain, geometry, limits, energy, titles)

    @property
    def free_joint(self) -> int | None:
        """The first shoulder joint, where its limits do not hold it."""
        low, high = self._shoulder.pairs[0]
        return 0 if low < high else None

    @property
    def roll_joint(self) -> int | None:
        """Index of the joint behind the elbow."""
        return None if self._roll is None else 4

    def solve(self, target: Target, step: float) -> Solutions:
        """All solutions inside the limits.

        Position alone: the first joint is swept in steps of ``step`` [rad], with the roll joint at the one of
        its equal angles nearest to zero. With a pitch the solutions are isolated; where no roll is given the
        roll joint stands as near to zero as it may. With a rotation they are the nearest that can be had.

        Raises:
            InputError: ``step`` is not a positive number.
        """
        step = checked_step(step)
        refusal, roll = held_roll(self._roll, target.roll)
        if refusal is not None:
            return self._refused(target, refusal, self._nearest.solve(target.position))
        postures = self._postures(target, roll)
        if target.rotation is not None:
            wanted = self._orientation.wanted(target.rotation)
            found = self._orientation.nearest(postures, wanted)
        elif target.pitch is not None:
            found = [
                posture
                for image in roll_angles(self._roll, roll)
                for posture in self._orientation.at_pitch(postures, target.pitch, image)
            ]
        else:
            return self._swept(target, postures, roll, step)
        if found:
            return self._isolated(target, found)
        return self._without(target, postures, roll)

    def _postures(self, target: Target, roll: float) -> list[tuple[float, Swivel]]:
        """Elbow angles inside their limits that hold the tip at the target's distance, with their swivels."""
        aim = vector(target.position - np.array(self.geometry.centre))
        elbows = self.geometry.elbow_angles(norm(aim), *self._elbow)
        if norm(aim) < _AT_SHOULDER:
            return [
                (elbow, Swivel.of(self.geometry, self._shoulder, *pair))
                for elbow in elbows
                for pair in self._at_shoulder(target, elbow, roll)
            ]
        postures = [(elbow, self._swivel(elbow, aim)) for elbow in elbows]
        for elbow in elbows:
            if self.geometry.is_straight(elbow):
                postures += self._touching(elbow, aim, target)
        return postures

    def _swivel(self, elbow: float, aim: Vector) -> Swivel:
        return Swivel.of(self.geometry, self._shoulder, self.geometry.hand(elbow), aim)

    def _touching(self, elbow: float, aim: Vector, target: Target) -> list[tuple[float, Swivel]]:
        """Elbow angles near a straight one that bring postures onto their limits.

        The distance tells a nearly straight elbow's angle poorly, but shoulder joints at their limits do.
        """
        return [
            (float(q[3]), self._swivel(float(q[3]), aim))
            for q in self._polished(elbow, self._swivel(elbow, aim), target)
            if self._nearest.miss(q, target.position) < _TOUCHES
        ]

    def _polished(self, elbow: float, swivel: Swivel, target: Target) -> list[FloatArray]:
        """Configurations (4,) inside the limits as near to the target as one leads to that brushes them."""
        starts = [np.array([*angles, elbow]) for angles in swivel.brushing()]
        return [self._nearest.descend(q, target.position) for q in starts]

    def _at_shoulder(self, target: Target, elbow: float, roll: float) -> list[tuple[Vector, Vector]]:
        """Directions to align with a tip in the shoulder itself, which leaves all three joints free."""
        beyond = about(self.geometry.elbow_axis, elbow)
        if self.geometry.roll_axis is not None:
            beyond = product(beyond, about(self.geometry.roll_axis, roll))
        axes = self.geometry.axes
        if target.rotation is not None:
            turn = product(self._orientation.wanted(target.rotation), conjugate(beyond))
            return [(axis, rotated(turn, axis)) for axis in axes]
        approach = rotated(beyond, self.geometry.tool_axis)
        if target.pitch is None:
            aim = approach
            for joint in (2, 1, 0):
                aim = turned(aim, axes[joint], self._shoulder.rest(joint))
            return [(approach, aim)]
        level, rise = math.cos(target.pitch), math.sin(target.pitch)
        ways = np.linspace(0.0, 2.0 * math.pi, _AZIMUTHS, endpoint=False).tolist()
        return [(approach, (level * math.cos(way), level * math.sin(way), rise)) for way in ways]

    def _swept(
        self, target: Target, postures: list[tuple[float, Swivel]], roll: float, step: float
    ) -> Solutions:
        q = self._with_roll(sweep(postures, step), roll)

        def optimum() -> FloatArray | None:
            found = least_rotation(postures)
            return None if found is None else self._with_roll(found, roll)

        if q.shape[1]:
            return self._solved(target, q.T, optimum, free=self.free_joint)
        single = optimum()  # a sliver between two grid values, or a single configuration
        if single is None:
            return self._without(target, postures, roll)
        return self._solved(target, single[None], optimum)

    def _without(self, target: Target, postures: list[tuple[float, Swivel]], roll: float) -> Solutions:
        """Refuses, unless the nearest point is the target after all."""
        if target.pitch is not None:
            ends = self._orientation.pitches(postures, target.pitch, roll)
            if ends:
                nearest = min(ends, key=lambda end: end[1].miss)[1]
                q = np.array([*nearest.shoulder, nearest.elbow])
                return self._refused(
                    target,
                    self._reach.of_pitch(ends, roll if self.geometry.roll_swings_the_tool else None),
                    q,
                )
        nearest_q = self._nearest.solve(target.position)
        if target.pitch is None:
            ways = [
                nearest_q,
                *(q for elbow, swivel in postures for q in self._polished(elbow, swivel, target)),
            ]
            nearest_q = min(ways, key=lambda q: self._nearest.miss(q, target.position))
            if self._nearest.miss(nearest_q, target.position) < _REACHED:
                return self._solved(target, self._with_roll(nearest_q, roll)[None])
        distance = float(np.linalg.norm(target.position - np.array(self.geometry.centre)))
        return self._refused(target, self._reach.of_position(distance, postures), nearest_q)

    def _isolated(self, target: Target, found: list[ToolPosture]) -> Solutions:
        kept: list[FloatArray] = []
        for posture in sorted(found, key=lambda posture: posture.miss):
            q = self._with_roll(np.array([*posture.shoulder, posture.elbow]), posture.roll)
            if not any(np.abs(q - other).max() < _SAME for other in kept):
                kept.append(q)
        return self._solved(target, np.array(kept))

    def _with_roll(self, q: FloatArray, roll: float) -> FloatArray:
        """(4, …) shoulder and elbow, and the roll joint where there is one."""
        return q if self._roll is None else np.concatenate([q, np.full((1, *q.shape[1:]), roll)])

    def _solved(
        self,
        target: Target,
        q: FloatArray,
        optimum: Callable[[], FloatArray | None] | None = None,
        free: int | None = None,
    ) -> Solutions:
        index = spherical_branch_index(self.geometry, q)
        return Solutions(self._arm, target, q, index, free_joint=free, least_rotation=optimum)

    def _refused(self, target: Target, reason: str, nearest: FloatArray) -> Solutions:
        """With the roll joint as near as its limits allow to what was asked for."""
        if self._roll is not None:
            nearest = np.append(nearest, held_roll(self._roll, target.roll)[1])
        return Solutions(self._arm, target, (), (), reason=reason, nearest_q=nearest)
