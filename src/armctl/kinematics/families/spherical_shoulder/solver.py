"""Inverse kinematics of *spherical shoulder + elbow (+ roll)*: exact position, every branch.

The distance of the target from the shoulder gives the elbow; the swivel is swept, or meets the orientation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.facts import Reason
from armctl.facts.targets import JointsNeeded, LimitsForbid, OutOfReach, PitchOutside
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, central_image, central_images
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import Criterion, EnergyModel
from armctl.kinematics.explanations import SolvedArm, angle_needed, angles_needed
from armctl.kinematics.families.numeric.descent import PositionGoal, Starts, come_nearest
from armctl.kinematics.families.spherical_shoulder.geometry import (
    SPHERICAL_BRANCHES,
    SphericalShoulder,
    recognise_spherical,
    spherical_branch_index,
)
from armctl.kinematics.families.spherical_shoulder.swivel import (
    Swivel,
    ToolOrientation,
    least_candidates,
    least_rotation,
    sweep,
)
from armctl.kinematics.families.whole_pose import pose_of
from armctl.kinematics.samples import checked_step
from armctl.kinematics.solutions import Further, Solutions
from armctl.kinematics.solver import InverseKinematics, held_roll, roll_angles
from armctl.kinematics.subproblems import turned
from armctl.kinematics.target import Target, elevation

_AT_SHOULDER = 1e-10
"""how near to the shoulder a tip has no direction from it [m]"""
_REACHED = 1e-10
"""a nearest point that comes this near is the target [m]"""
_TOUCHES = 1e-13
"""the same for a posture found from one beside it [m]"""
_SAME = 1e-7
"""solutions that differ by less in every joint are one, split by rounding [rad]"""
_AZIMUTHS = 16
_NEAREST_STARTS = 64
_VALUES = (1441, 401, 401, 401)
"""values in the first round of a search, a quarter of a degree apart, and in the finer ones about the best"""
_SEARCHED = 1e-8
"""how far outside a limit a search for the least leaves a joint that is on it [rad]"""


class SphericalShoulderSolver(InverseKinematics):
    """One arm of the family inside its limits. Immutable; safe in several threads.

    Postures are (k, 5) inside: shoulder, elbow and roll, which an arm of four joints leaves out at the end.
    """

    family = "spherical shoulder, elbow, roll"

    def __init__(
        self,
        chain: Chain,
        geometry: SphericalShoulder,
        limits: FloatArray,
        energy: EnergyModel,
        titles: Sequence[str],
    ) -> None:
        free = 0 if limits[0, 0] < limits[0, 1] else None
        roll = 4 if chain.n > 4 else None
        super().__init__(chain, limits, energy, titles, free_joint=free, roll_joint=roll)
        self.geometry = geometry
        self._arm = SolvedArm(
            SPHERICAL_BRANCHES, chain, energy, (), limits, roll, titles=self.titles, solver_of=self.of
        )
        roll_limits = None if self._roll is None else (self._roll.low, self._roll.high)
        self._orientation = ToolOrientation(chain, geometry, limits, roll_limits)

    @classmethod
    def recognises(cls, chain: Chain) -> bool:
        """See ``InverseKinematics``."""
        return recognise_spherical(chain) is not None

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """See ``InverseKinematics``."""
        geometry = recognise_spherical(chain)
        return None if geometry is None else cls(chain, geometry, limits, energy, titles)

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """All solutions inside the limits.

        Position alone: the first joint is swept in steps of ``step`` [rad], with the roll joint at the one of
        its equal angles nearest to zero. With a pitch the solutions are isolated; where no roll is given the
        roll joint stands as near to zero as it may. With a rotation they are the nearest that can be had.
        Raises ``InputError``: ``step`` is not a positive number.
        """
        step = checked_step(step)
        refusal, roll = held_roll(self._roll, target.roll)
        if refusal is not None:
            besides = self._besides(refusal, target._replace(roll=None), step)
            return self._refused(target, besides, partial(self._nearest, target))
        swivels = self._swivels(target, roll)
        if target.rotation is not None:
            found = self._orientation.nearest(swivels, pose_of(target.position, target.rotation))
        elif target.pitch is not None:
            rolls = roll_angles(self._roll, roll)
            held = [self._orientation.at_pitch(swivels, target.pitch, image) for image in rolls]
            found = np.concatenate(held)
        else:
            return self._swept(target, swivels, roll, step)
        kept: list[FloatArray] = []
        for q in found:
            if not any(np.abs(q - other).max() < _SAME for other in kept):
                kept.append(q)
        return self._solved(target, np.array(kept)) if kept else self._without(target, swivels, roll)

    def _swivels(self, target: Target, roll: float) -> list[Swivel]:
        """Those of the elbow angles inside their limits that hold the tip at the target's distance."""
        aim = target.position - self.geometry.centre
        distance = float(np.linalg.norm(aim))
        elbows = self.geometry.elbow_angles(distance, *self.limits[3].tolist())
        if distance < _AT_SHOULDER:
            return [
                Swivel.of(self.geometry, self.limits, elbow, *pair)
                for elbow in elbows
                for pair in self._at_shoulder(target, elbow, roll)
            ]
        swivels = [self._swivel(elbow, aim) for elbow in elbows]
        for swivel in tuple(swivels):
            # distance tells a nearly straight elbow's angle poorly, but shoulder joints at their limits do
            if self.geometry.is_straight(swivel.elbow):
                q = self._polished(swivel, target, roll)
                touching = q[self._misses(q, target) < _TOUCHES]
                swivels += [self._swivel(elbow, aim) for elbow in touching[:, 3].tolist()]
        return swivels

    def _swivel(self, elbow: float, aim: FloatArray) -> Swivel:
        return Swivel.of(self.geometry, self.limits, elbow, self.geometry.hand(elbow), aim)

    def _at_shoulder(self, target: Target, elbow: float, roll: float) -> list[tuple[FloatArray, FloatArray]]:
        """Directions to align with a tip in the shoulder itself, which leaves all three joints free."""
        beyond, tool = self.geometry.beyond(elbow, roll), self.geometry.tool
        axes = self.geometry.axes[:3]
        if target.rotation is not None:
            turn = target.rotation @ tool.T @ beyond.T
            return [(axis, turn @ axis) for axis in axes]
        approach = beyond @ tool[:, 2]
        if target.pitch is None:
            aim = approach
            for joint in (2, 1, 0):
                aim = turned(aim, axes[joint], float(np.clip(0.0, *self.limits[joint])))
            return [(approach, aim)]
        level, rise = math.cos(target.pitch), math.sin(target.pitch)
        ways = np.linspace(0.0, TWO_PI, _AZIMUTHS, endpoint=False)
        return [(approach, np.array([level * np.cos(way), level * np.sin(way), rise])) for way in ways]

    def _swept(self, target: Target, swivels: Sequence[Swivel], roll: float, step: float) -> Solutions:
        q = self._with_roll(sweep(swivels, step), roll)

        optimum, further = partial(self._optimum, swivels, roll), partial(self._travel, swivels, roll)
        if len(q):
            return self._solved(target, q, optimum, further, free=self.free_joint)
        single = optimum()  # a sliver between two grid values, or a single configuration
        if single is None:
            return self._without(target, swivels, roll)
        return self._solved(target, single[None], optimum, further)

    def _optimum(self, swivels: Sequence[Swivel], roll: float) -> FloatArray | None:
        """(n,) that of least rotation."""
        found = least_rotation(swivels)
        return None if found is None else self._with_roll(found[None], roll)[0]

    def _travel(self, swivels: Sequence[Swivel], roll: float, _: Criterion, start: FloatArray) -> FloatArray:
        """(m, n) among which that of least travel is."""
        weights = (1.0 / self.energy.speed_limits[:3]).tolist()
        return self._with_roll(least_candidates(swivels, start[:3].tolist(), weights), roll)

    def _without(self, target: Target, swivels: Sequence[Swivel], roll: float) -> Solutions:
        """Refuses, unless the nearest point is the target after all."""
        if target.pitch is not None:
            ends = self._orientation.pitch_ends(swivels, roll)
            if len(ends):
                return self._refused_pitch(target, target.pitch, ends, roll)
            return self._refused(target, partial(self._why_not, target), partial(self._nearest, target))
        ways = [self._nearest(target), *(q for one in swivels for q in self._polished(one, target, roll))]
        misses = self._misses(np.array(ways), target)
        nearest = ways[int(misses.argmin())]
        if misses.min() < _REACHED:
            return self._solved(target, self._with_roll(nearest[None], roll))
        return self._refused(target, partial(self._why_not, target), lambda: nearest)

    # The nearest point, and a posture that nearly meets the target brought onto it.

    @cached_property
    def _starts(self) -> Starts:
        return Starts(self.chain, self.limits)

    def _nearest(self, target: Target) -> FloatArray:
        """The configuration (n,) inside the limits whose tip comes nearest to the target [rad]."""
        starts = self._starts.nearest_first(self._goal(target), _NEAREST_STARTS, self.limits)
        q = self._descended(starts, target)
        return q[int(self._misses(q, target).argmin())]

    def _polished(self, swivel: Swivel, target: Target, roll: float) -> FloatArray:
        """Configurations (k, n) inside the limits as near to the target as those lead to that brush them."""
        return self._descended(self._with_roll(swivel.with_elbow(swivel.brushing()), roll), target)

    def _descended(self, q: FloatArray, target: Target) -> FloatArray:
        """Where configurations (k, n) come to inside the limits on the way to the target."""
        return come_nearest(self.chain, self._goal(target), q, self.limits)

    def _goal(self, target: Target) -> PositionGoal:
        return PositionGoal(target.position, self.geometry.reach[1])

    def _misses(self, q: FloatArray, target: Target) -> FloatArray:
        """Distance (k,) of the tip from the target [m] in configurations (k, n)."""
        return np.linalg.norm(self.chain.forward(q)[:, :3, 3] - target.position, axis=1)

    def _with_roll(self, q: FloatArray, roll: float) -> FloatArray:
        """Configurations (k, n) with the shoulder and elbow of others (k, 4 or more)."""
        return np.column_stack([q[:, :4], np.full(len(q), roll)])[:, : self.chain.n]

    # Answers.

    def _solved(
        self,
        target: Target,
        q: FloatArray,
        optimum: Callable[[], FloatArray | None] | None = None,
        further: Further | None = None,
        free: int | None = None,
    ) -> Solutions:
        q = q[:, : self.chain.n]
        index = spherical_branch_index(self.geometry, q)
        return Solutions(
            self._arm, target, q, index, free_joint=free, least_rotation=optimum, further=further
        )

    def _refused(
        self, target: Target, reason: Reason | Callable[[], Reason], nearest: Callable[[], FloatArray]
    ) -> Solutions:
        """With the roll joint as near as its limits allow to what was asked for."""

        def rolled() -> FloatArray:
            return self._with_roll(nearest()[None], held_roll(self._roll, target.roll)[1])[0]

        return Solutions(self._arm, target, (), (), reason=reason, nearest_q=rolled)

    def _refused_pitch(self, target: Target, pitch: float, ends: FloatArray, roll: float) -> Solutions:
        """A pitch that has no solution at a position that has some: ``ends`` of the pitches held there."""
        pitches = self._orientation.pitches(ends)
        best = int(np.abs(pitches - elevation(pitch)).argmin())
        reason = PitchOutside(float(pitches.min()), float(pitches.max()), float(pitches[best]))
        if self.geometry.roll_swings_the_tool:
            reason = replace(reason, joint=self.titles[4], held=roll)
        return self._refused(target, reason, lambda: ends[best])

    def _why_not(self, target: Target) -> Reason:
        """Why a position has no solution."""
        distance = float(np.linalg.norm(target.position - self.geometry.centre))
        least, most = self.geometry.reach
        bends = self.geometry.bends(distance)
        if not bends and distance > most:
            return OutOfReach(far=True, miss_m=distance - most, length_m=most, distance_m=distance)
        if not bends:
            return OutOfReach(far=False, miss_m=least - distance, length_m=least, distance_m=distance)
        needed = self._needed(bends, target.position - self.geometry.centre)
        return LimitsForbid((self._easiest(needed),) if needed else ())

    def _needed(self, bends: Sequence[float], aim: FloatArray) -> list[list[tuple[int, float]]]:
        """For each bend the joints that would have to leave their limits and what they need [rad]."""
        ways: list[list[tuple[int, float]]] = []
        low, high = self.limits[3].tolist()
        for bend in bends:
            elbow = central_image(bend - self.geometry.offset, low, high)
            way = []
            if np.linalg.norm(aim) > _AT_SHOULDER:
                shoulder = self._least_excess(self._swivel(elbow, aim))
                if shoulder is None:
                    continue
                way = shoulder
            if not low - LIMIT_TOLERANCE <= elbow <= high + LIMIT_TOLERANCE:
                way = [*way, (3, elbow)]
            if way:
                ways.append(way)
        return ways

    def _easiest(self, ways: Sequence[list[tuple[int, float]]]) -> JointsNeeded:
        """The bends that ask only for another elbow; else the one that asks for least, by the sum."""
        alone = [way[0][1] for way in ways if len(way) == 1 and way[0][0] == 3]
        if alone:
            return JointsNeeded((angle_needed(self.titles[3], self.limits[3], *alone),))
        least = min(ways, key=self._excess)
        return JointsNeeded(angles_needed(self.titles, self.limits, least), least=True)

    def _excess(self, way: Sequence[tuple[int, float]]) -> float:
        low, high = self.limits.T
        return sum(max(low[joint] - angle, angle - high[joint]) for joint, angle in way)

    def _least_excess(self, swivel: Swivel) -> list[tuple[int, float]] | None:
        """Shoulder joints outside their limits, and what they need [rad], where the sum of it is least.

        None: the shoulder joints cannot point the hand there at all.
        """
        low, high = self.limits[:3].T
        best, least = None, math.inf
        # by the swivel, and by θ1: where one of them hardly changes the other does
        for by in (swivel.by_angle, swivel.by_first):
            centre, reach = 0.0, math.pi
            for count in _VALUES:
                value, q = by(np.linspace(centre - reach, centre + reach, count))
                reach *= 2.0 / (count - 1)
                near = central_images(q, low, high)
                excess = np.maximum(0.0, np.maximum(low - near, near - high)).sum(axis=1)
                if not len(excess):
                    break
                i = int(excess.argmin())
                centre = float(value[i])
                if excess[i] < least:
                    best, least = near[i], float(excess[i])
        if best is None:
            return None
        outside = (best < low - _SEARCHED) | (best > high + _SEARCHED)
        return [(joint, float(best[joint])) for joint in np.flatnonzero(outside).tolist()]
