"""Inverse kinematics of *yaw + parallel pitch joints + roll* with the tool beside the roll axis.

With a roll given the arm is one of the family *yaw + parallel pitch joints*, and is solved as such. A free
roll is swept; it moves the tool point, so it is a free joint as any other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache, partial
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.facts import Reason
from armctl.facts.angles import DEGREE
from armctl.facts.targets import AtRoll, ListedAt, NoOrientationNear
from armctl.kinematics.angles import each_once, images, rest_angle, wrap
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import Criterion, EnergyModel
from armctl.kinematics.explanations import SolvedArm, by_turns
from armctl.kinematics.families.numeric.solver import NumericSolver
from armctl.kinematics.families.offset_roll.roll_sweep import (
    BaseTarget,
    OffsetRoll,
    RollSweep,
    recognise_offset_roll,
)
from armctl.kinematics.families.yaw_pitch_roll.closed_form import PlanePostures
from armctl.kinematics.families.yaw_pitch_roll.geometry import (
    BRANCHES,
    BaseBranch,
    base_branches,
    bend_sense,
    branch_index,
    is_on_axis,
    tool_points_in,
)
from armctl.kinematics.families.yaw_pitch_roll.solver import NO_PITCH, YawPitchRollSolver
from armctl.kinematics.samples import DEFAULT_STEP, checked_step
from armctl.kinematics.solutions import Further, Solutions
from armctl.kinematics.solver import InverseKinematics, held_roll
from armctl.kinematics.subproblems import circle_angles, turn
from armctl.kinematics.target import Target

_CACHED = 16
"""rolls for which what is computed once is kept"""
_ON_TARGET_RAD = 1e-7
"""how far from the way that the target calls for a rotation may turn the base, by rounding [rad]"""
_SAME = 1e-7
"""solutions that differ by less in every joint are one, split by rounding [rad]"""
_VERTICAL = 1e-9
"""how near to vertical a roll axis may point before it says nothing about the base angle (sine)"""
_LEFT, _UP, _DOWN = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
_COARSE = 25
"""rolls tried for the least of two free joints, evenly over the limits"""
_SURFACE_STEP = 0.5 * DEGREE
"""of the first pitch joint, between configurations of which a search goes on"""
_ASIDE = 1e-3
"""a roll so far from that of the start tells whether it is better there [rad]"""
_GOLDEN_ROUNDS, _GOLDEN = 32, 0.5 * (math.sqrt(5.0) - 1.0)
_Candidate = tuple[FloatArray, int]
"""a configuration (n,) [rad] and the index of its branch"""


class OffsetRollSolver(InverseKinematics):
    """One arm of the family inside its limits. Immutable; safe in several threads.

    A pitch is the angle of the approach axis above the plane across the base axis, and does not depend on
    the roll; an arm whose approach axis is not along its roll axis has none. A roll is the roll joint's own
    angle.
    """

    family = "yaw, parallel pitch joints, roll beside the tool"
    roll_moves_tip = True

    def __init__(
        self,
        chain: Chain,
        geometry: OffsetRoll,
        limits: FloatArray,
        energy: EnergyModel,
        titles: Sequence[str],
    ) -> None:
        free = 1 if geometry.pitched else geometry.joint
        free = free if limits[free, 0] < limits[free, 1] else None
        super().__init__(chain, limits, energy, titles, free_joint=free, roll_joint=geometry.joint)
        self.geometry = geometry
        self.pitch_joints = geometry.plane.pitch_joints
        self._arm = SolvedArm(
            BRANCHES, chain, energy, self.pitch_joints, limits, geometry.joint, roll_moves_tip=True,
            titles=self.titles, up=geometry.plane.frame[:, 2], solver_of=self.of,
        )  # fmt: skip
        self._sweep = RollSweep(geometry, limits)
        self._at = lru_cache(_CACHED)(self._held)
        self._rolls: tuple[float, float] = (float(limits[-1, 0]), float(limits[-1, 1]))
        self._base: tuple[float, float] = (float(limits[0, 0]), float(limits[0, 1]))

    @classmethod
    def recognises(cls, chain: Chain) -> bool:
        """See ``InverseKinematics``."""
        return recognise_offset_roll(chain) is not None

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """See ``InverseKinematics``."""
        geometry = recognise_offset_roll(chain)
        return None if geometry is None else cls(chain, geometry, limits, energy, titles)

    def pitch_and_roll(self, q: FloatArray) -> tuple[float | None, float | None]:
        """Tool pitch above the plane that the base axis stands on, and roll [rad], at ``q`` (n,)."""
        roll = float(q[self.geometry.joint])
        return self._at(0.0).pitch_and_roll(q[:-1])[0] if self._has_pitch else None, roll

    @property
    def _has_pitch(self) -> bool:
        return self.geometry.plane.tool_angle is not None

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """See ``InverseKinematics``.

        With a roll the first pitch joint is swept where no pitch is given; without one the roll is swept,
        where a pitch is given or the arm has two pitch joints. Where both are free, the roll stands as near
        to zero as the target allows and the first pitch joint is swept.
        """
        step = checked_step(step)
        if target.pitch is not None and not self._has_pitch:
            free = target._replace(pitch=None, roll=None)
            return self._refused(target, self._besides(NO_PITCH, free, step))
        if target.rotation is not None:
            return self._turned(target, target.rotation)
        refusal, held = held_roll(self._roll, target.roll)
        if refusal is not None:
            return self._refused(target, self._besides(refusal, target._replace(roll=None), step))
        if target.roll is not None or self._roll_is_held:
            given = [held] if target.roll is None else images(target.roll, *self._rolls)
            return self._with_rolls(target, given, step)
        if target.pitch is None and self.geometry.pitched:
            return self._doubly_free(target, step)
        if target.pitch is not None and not self.geometry.pitched:
            rolls = self._sweep.pitch_rolls(self._place(target), target.pitch).tolist()
            return self._with_rolls(target, rolls, step)
        return self._swept(target, step)

    def meets(self, target: Target) -> bool:
        """See ``InverseKinematics``; with a pitch and any roll, nothing is searched for."""
        swept = target.pitch is not None and target.roll is None and target.rotation is None
        if swept and self._has_pitch and self.geometry.pitched and not self._roll_is_held:
            return len(self._sweep.solve(self._place(target), DEFAULT_STEP).q) > 0
        return super().meets(target)

    @property
    def _roll_is_held(self) -> bool:
        return self._rolls[0] == self._rolls[1]

    def _held(self, roll: float) -> YawPitchRollSolver:
        """The solver of the arm without its roll joint, which is held at an angle [rad]."""
        chain, plane = self.chain.with_last_held(roll), self.geometry.at(roll)
        return YawPitchRollSolver(
            chain, plane, self.limits[:-1], self.energy, self.titles[:-1], compiled=False
        )

    def _place(self, target: Target) -> BaseTarget:
        return BaseTarget(*self.geometry.plane.local_of(*target.point), target.pitch)

    # A roll given, or several.

    def _with_rolls(self, target: Target, rolls: Sequence[float], step: float) -> Solutions:
        found = [self._rolled(target, roll, step) for roll in rolls]
        solved = [one for one in found if one.success]
        if not solved:
            return found[0] if found else self._without(target, step)
        if len(solved) == 1:
            return solved[0]
        q = np.concatenate([one.q for one in solved])
        index = np.concatenate([one.branch_index for one in solved])
        kept = each_once(q, _SAME) if solved[0].free_joint is None else np.arange(len(q))
        return Solutions(self._arm, target, q[kept], index[kept], free_joint=solved[0].free_joint)

    def _rolled(self, target: Target, roll: float, step: float) -> Solutions:
        """The answer with the roll joint held at an angle [rad]."""
        inner = self._at(roll).solve(target._replace(roll=None), step)
        least, further, nearest = inner.least_rotation, inner.further, inner.nearest_q
        return Solutions(
            self._arm,
            target,
            np.column_stack([inner.q, np.full(len(inner.q), roll)]),
            inner.branch_index,
            free_joint=inner.free_joint,
            least_rotation=None if least is None else partial(_least_with, least, roll),
            reason=inner.bare_reason,
            nearest_q=None if nearest is None else np.append(nearest, roll),
            further=None if further is None else partial(_further_with, further, roll),
        )

    # The roll is free.

    def _swept(self, target: Target, step: float) -> Solutions:
        place = self._place(target)
        rows = self._sweep.solve(place, step)
        if len(rows.q) == 0:
            return self._without(target, step)
        return Solutions(
            self._arm, target, rows.q, rows.branch, free_joint=self.geometry.joint,
            least_rotation=partial(self._swept_optimum, place, step, rows.q),
            further=partial(self._swept_travel, place, step, rows.q), incomplete=by_turns(rows.left_out),
        )  # fmt: skip

    def _swept_optimum(self, place: BaseTarget, step: float, rows: FloatArray) -> FloatArray:
        """(n,) that of least rotation, from the rows of a sweep on."""
        zero, ones = np.zeros(self.chain.n), np.ones(self.chain.n)
        found = self._sweep.candidates(place, zero, ones, step, rows)
        return found[int(np.abs(found).sum(axis=1).argmin())].copy()

    def _swept_travel(
        self, place: BaseTarget, step: float, rows: FloatArray, _: Criterion, start: FloatArray
    ) -> FloatArray:
        """(m, n) among which that of least travel is."""
        return self._sweep.candidates(place, start, 1.0 / self.energy.speed_limits, step, rows)

    def _doubly_free(self, target: Target, step: float) -> Solutions:
        """Position alone with three pitch joints: a surface of solutions, of which one roll is listed."""
        rest, tried = rest_angle(*self._rolls), np.linspace(*self._rolls, _COARSE)
        rolls: list[float] = [rest, *tried[np.argsort(np.abs(tried - rest))].tolist()]

        def reaches(roll: float) -> bool:
            return bool(np.isfinite(self._at(roll).least_rotation(target.position)).all())

        roll = next((roll for roll in rolls if reaches(roll)), None)
        if roll is None:
            return self._without(target, step)
        found, listed = self._rolled(target, roll, step), ListedAt(self.titles[-1], roll)
        return Solutions(
            self._arm, target, found.q, found.branch_index, free_joint=found.free_joint,
            least_rotation=partial(self._optimum_over_rolls, target, roll),
            further=partial(self._travel_over_rolls, target, roll), incomplete=listed,
        )  # fmt: skip

    def _optimum_over_rolls(self, target: Target, listed: float) -> FloatArray:
        """(n,) that of least rotation; ``listed`` [rad] is the roll of the list."""
        return self._least_over_rolls(target, np.zeros(self.chain.n), np.ones(self.chain.n), listed)[0]

    def _travel_over_rolls(
        self, target: Target, listed: float, criterion: Criterion, start: FloatArray
    ) -> FloatArray:
        """(m, n) among which that of least travel is; for another criterion, some of the whole surface."""
        if criterion == "least-travel":
            return self._least_over_rolls(target, start, 1.0 / self.energy.speed_limits, listed)
        rolls: list[float] = np.linspace(*self._rolls, _COARSE).tolist()
        return np.concatenate([self._rolled(target, roll, _SURFACE_STEP).q for roll in rolls])

    def _least_over_rolls(
        self, target: Target, start: FloatArray, weights: FloatArray, listed: float
    ) -> FloatArray:
        """Configurations (m, n), the one of least Σ weight · |θ - start| first, of two joints that are free.

        Exact at each roll; the roll itself is looked for from that of the start, the one that is ``listed``
        [rad] and a coarse grid on.
        """
        low, high = self._rolls
        seen: dict[float, tuple[float, FloatArray | None]] = {}

        def cost(roll: float) -> float:
            if roll not in seen:
                q = self._at(roll).least_candidates(target, start[:-1], weights[:-1])
                q = np.column_stack([q, np.full(len(q), roll)])
                energy = np.abs(q - start) @ weights
                i = int(energy.argmin()) if len(q) else -1
                seen[roll] = (float(energy[i]), q[i]) if len(q) else (math.inf, None)
            return seen[roll][0]

        begin = min(max(float(start[-1]), low), high)
        best = min(begin, listed, key=cost)
        grid: FloatArray = np.linspace(low, high, _COARSE)
        ordered: list[float] = grid[np.argsort(np.abs(grid - begin))].tolist()
        for roll in ordered:
            if weights[-1] * abs(roll - begin) >= cost(best):
                break  # the roll alone takes as much
            best = min(best, roll, key=cost)
        beside = (max(begin - _ASIDE, low), min(begin + _ASIDE, high))
        if best != begin or min(map(cost, beside)) < cost(begin):
            gap = (high - low) / (_COARSE - 1)
            a, b = max(best - gap, low), min(best + gap, high)
            left, right = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
            for _ in range(_GOLDEN_ROUNDS):
                if cost(left) <= cost(right):
                    b, right = right, left
                    left = b - _GOLDEN * (b - a)
                else:
                    a, left = left, right
                    right = a + _GOLDEN * (b - a)
        ranked = sorted(seen, key=cost)
        return np.array([q for roll in ranked if (q := seen[roll][1]) is not None])

    # A rotation: exact where the arm can take it, else the nearest that a search finds.

    def _turned(self, target: Target, rotation: FloatArray) -> Solutions:
        x, y, z = self.geometry.plane.local_of(*target.point)
        found: list[_Candidate] = []
        for base, pitch, roll in self._turns(rotation, x, y):
            for held in images(roll, *self._rolls):
                found += self._with_turns(x, y, z, base, pitch, held)
        if found:
            q = np.array([one for one, _ in found])
            kept: list[int] = each_once(q, _SAME).tolist()
            return Solutions(self._arm, target, q[kept], [found[i][1] for i in kept])
        nearest = self._numeric.approach(self._local(target), DEFAULT_STEP)
        if not nearest.success:
            return self._without(target, DEFAULT_STEP)
        index = [self._branch_of(q) for q in nearest.q]
        return Solutions(self._arm, target, nearest.q, index, incomplete=nearest.incomplete)

    def _turns(self, rotation: FloatArray, x: float, y: float) -> list[tuple[float, float, float]]:
        """What the base, all pitch joints and the roll joint turn for a rotation ``R_base_tool`` [rad].

        In forward, left, up coordinates the tool is turned by ``R_up(a) R_down(b) R_w(c)`` against the zero
        pose. The roll axis w does not see c, so the direction that it is to have gives a and b.
        """
        geometry = self.geometry
        zero = geometry.plane.frame.T @ self.chain.forward(np.zeros(self.chain.n))[:3, :3]
        M = geometry.plane.frame.T @ rotation @ zero.T
        w = geometry.roll_axis
        lean = math.atan2(w[2], w[0])
        ahead, left, up = (M @ w).tolist()
        level = math.hypot(ahead, left)

        def with_roll(base: float, pitch: float) -> tuple[float, float, float]:
            turned = (turn(_UP, base) @ turn(_DOWN, pitch)).T @ M @ _LEFT
            return base, pitch, math.atan2(float(np.cross(w, _LEFT) @ turned), float(_LEFT @ turned))

        if level > _VERTICAL:
            azimuth, rise = math.atan2(left, ahead), math.atan2(up, level)
            return [with_roll(azimuth, rise - lean), with_roll(azimuth + math.pi, math.pi - rise - lean)]
        # upright the base and the roll turn about one axis: what both turn is given, and the tip's side
        sense = math.copysign(1.0, up)
        pitch = math.copysign(0.5 * math.pi, up) - lean
        whole = with_roll(0.0, pitch)[2]  # = c + sense · a
        d0, d1, d2 = geometry.side
        c, s = math.cos(whole), math.sin(whole)
        # d(whole - sense a) = y cos a - x sin a
        b = d1 * c + d2 * s - y
        e = sense * (d1 * s - d2 * c) + x
        bases, _ = circle_angles(d0, b, e, 0.0)
        return [(base, pitch, whole - sense * base) for base in bases]

    def _with_turns(
        self, x: float, y: float, z: float, base: float, pitch: float, roll: float
    ) -> list[_Candidate]:
        """Configurations on the target, inside the limits, with all turns as given [rad]."""
        plane = self.geometry.at(roll)
        tool_angle = pitch + sum(plane.offsets) + (plane.tool_angle or 0.0)
        branches = base_branches(plane, x, y, self._base)
        if is_on_axis(plane, x, y):
            branches = [BaseBranch(True, yaw, 0.0) for yaw in images(plane.yaw_sign * base, *self._base)]
        found: list[_Candidate] = []
        for branch in branches:
            off = wrap(plane.yaw_sign * branch.angle - base)
            if abs(off) > _ON_TARGET_RAD:
                continue
            inward = tool_points_in(branch, None if plane.tool_angle is None else tool_angle)
            for angles in PlanePostures(plane, self.limits).inside(branch.r, z, tool_angle):
                index = branch_index(branch.front, bend_sense(plane.plane_angle(1, angles[1])), inward)
                found.append((np.array([branch.angle, *angles, roll]), index))
        return found

    def _branch_of(self, q: FloatArray) -> int:
        """Index of the branch that a configuration (n,) [rad] belongs to."""
        plane = self.geometry.at(float(q[-1]))
        headings = np.cumsum([plane.plane_angle(k, float(angle)) for k, angle in enumerate(q[1:-1])])
        front = float(plane.shoulder.real + np.cos(headings) @ plane.lengths) >= 0.0
        tool_angle = None if plane.tool_angle is None else float(headings[-1]) + plane.tool_angle
        inward = tool_points_in(BaseBranch(front, 0.0, 0.0), tool_angle)
        return branch_index(front, bend_sense(plane.plane_angle(1, float(q[2]))), inward)

    # No solution.

    @cached_property
    def _numeric(self) -> NumericSolver:
        """The arm in the coordinates of its base axis, in which a pitch is an elevation."""
        T = np.eye(4)
        plane = self.geometry.plane
        T[:3, :3], T[:3, 3] = plane.frame.T, -plane.frame.T @ plane.origin
        chain = Chain([T @ self.chain.segments[0], *self.chain.segments[1:]], self.chain.tail)
        return NumericSolver(chain, self.limits, self.energy, self.titles)

    def _local(self, target: Target) -> Target:
        plane = self.geometry.plane
        turned = None if target.rotation is None else plane.frame.T @ target.rotation
        return target._replace(point=plane.local_of(*target.point), rotation=turned)

    def _without(self, target: Target, step: float) -> Solutions:
        """No grid value and no interval has a solution: why, at the roll that comes nearest."""
        nearest = self._numeric.nearest(self._local(target))
        roll = float(nearest[-1])
        found = self._rolled(target._replace(rotation=None), roll, step)
        if found.success and target.rotation is None:
            return found  # a single configuration, or a sliver
        reason = AtRoll(self.titles[-1], roll, found.bare_reason or NoOrientationNear())
        return Solutions(self._arm, target, (), (), reason=reason, nearest_q=nearest)

    def _refused(self, target: Target, reason: Reason) -> Solutions:
        free = Target(target.point)
        return Solutions(
            self._arm, target, (), (), reason=reason, nearest_q=self._numeric.nearest(self._local(free))
        )


# An answer of the arm without its roll joint, which is held at an angle [rad].


def _least_with(least: Callable[[], FloatArray | None], roll: float) -> FloatArray | None:
    found = least()
    return None if found is None else np.append(found, roll)


def _further_with(further: Further, roll: float, criterion: Criterion, start: FloatArray) -> FloatArray:
    q = further(criterion, start[:-1])
    return np.column_stack([q, np.full(len(q), roll)])
