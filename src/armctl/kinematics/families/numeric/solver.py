"""Inverse kinematics of any chain, by numeric search inside the limits: where no closed form is known."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import combinations, islice
from typing import Self

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.facts import Reason, Several
from armctl.facts.targets import (
    JointsNeeded,
    MayExist,
    NoneWithoutLimits,
    NoSuchAngle,
    NotFound,
    OutOfBound,
    PitchNotFound,
    Searched,
)
from armctl.kinematics.angles import all_images, distinct, each_once, whole_turns
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel, OnTarget
from armctl.kinematics.explanations import SolvedArm, all_of, angles_needed, by_turns
from armctl.kinematics.families.numeric.descent import (
    Goal,
    LimitsGoal,
    PositionGoal,
    RotationGoal,
    Starts,
    Together,
    Turns,
    come_nearest,
    come_nearest_holding,
    meet,
    pitch_goal,
    tool_motion,
)
from armctl.kinematics.samples import DEFAULT_STEP, checked_step
from armctl.kinematics.solutions import THERE_M, Solutions
from armctl.kinematics.solver import InverseKinematics, held_roll
from armctl.kinematics.target import Target

# How far and how near any arm can reach by its links alone: bounds that hold whatever the limits.

_ROUNDING = 1e-9
_ROUNDS = 60
_ARMS = 16
"""whose bounds are kept"""


class LinkBound:
    """A shell about a fixed point of the first joint's axis that the tool point can never leave.

    One point is chosen on each joint axis; neighbours keep their distance. So the tool point is no farther
    from the first than the sum of the distances, and no nearer than the longest less all others.
    """

    def __init__(self, chain: Chain) -> None:
        points, axes = chain.axes()
        nodes = _shortest_polyline(points, axes, chain.forward(np.zeros(chain.n))[:3, 3])
        links = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
        self.centre: FloatArray = nodes[0]
        """(3,) the point of the first axis, base frame [m]"""
        self.outer = float(links.sum())
        """[m]"""
        self.inner = max(0.0, 2.0 * float(links.max()) - self.outer)
        """[m]"""

    def violation(self, point: FloatArray, first_joint: str) -> OutOfBound | None:
        """Why a point (3,) [m] cannot be reached; None where the links alone do not forbid it."""
        distance = float(np.linalg.norm(point - self.centre))
        x, y, z = map(float, self.centre)
        for far, length in ((True, self.outer), (False, self.inner)):
            miss = distance - length if far else length - distance
            if miss > _ROUNDING:
                return OutOfBound(far, miss, length, distance, (x, y, z), first_joint)
        return None


@lru_cache(_ARMS)
def link_bound(chain: Chain) -> LinkBound:
    """That of an arm: each refused line asks for it twice, and it takes 2 ms."""
    return LinkBound(chain)


def _shortest_polyline(points: FloatArray, axes: FloatArray, tip: FloatArray) -> FloatArray:
    """(n + 1, 3) a point on each axis and the tip, joined by the shortest way (to about 1e-6 m)."""
    # Weiszfeld's method: least squares of the segments, each weighted by one over its last length.
    n = len(points)
    offsets = np.diff(np.vstack([points, tip]), axis=0)
    moves = np.zeros((n, 3, n))  # of each segment, as a point slides along its axis
    for k, axis in enumerate(axes):
        moves[k, :, k] = -axis
        if k > 0:
            moves[k - 1, :, k] = axis
    segments: FloatArray = offsets
    for _ in range(_ROUNDS):
        weights = 1.0 / np.maximum(np.linalg.norm(segments, axis=1), 1e-6)
        weighted: FloatArray = (moves * weights[:, None, None]).reshape(-1, n).T
        A: FloatArray = weighted @ moves.reshape(-1, n)
        b: FloatArray = -weighted @ offsets.ravel()
        along = np.linalg.lstsq(A, b, rcond=1e-12)[0]  # parallel axes may slide together
        segments = offsets + moves @ along
    return tip - np.vstack([np.cumsum(segments[::-1], axis=0)[::-1], np.zeros(3)])


_ALIGNED = 1e-9
"""how far from each other roll axis, approach axis and tool point may be (sine of the angle; [m])"""
_WAVE, _WAVES = 64, 4
_REFINED = 48
"""how many of the best are refined where the goal can only be approached"""
_FEW = 4
"""how many are refined of those that meet a goal"""
_ONE_WAY = 0.05
"""configurations this near to each other lead to one nearest orientation [rad]"""
_BEGUN, _HELD = 12, 64
"""from how many of a continuum a least sum of turns is looked for; and choices of joints that are held"""
_DOWNHILL, _ROUNDED, _STANDS = 3, 0.01, 0.03
"""how many are led to a least sum of turns; how far turns are rounded off there, which stand still [rad]"""
_MET_M, _MET_RAD = 5e-10, 1e-8
_ALIKE = 1e-7
"""orientations this near to the best are as good [rad]"""
_SAME_NEAR = 1e-3
"""configurations this near to each other are one minimum: as good orientations lie so far around one [rad]"""
_BEYOND = 1e-6
"""a joint that a search leaves so far outside its limits stands at its limit [rad]"""


class NumericSolver(InverseKinematics):
    """Any chain of revolute joints inside its limits. Immutable; safe in several threads.

    What it lists are solutions, but there may be more; of a continuum it lists a spread. The same target
    and start always have the same answer. A ``box`` (n, 2) is the limits of one request, with the roll joint
    held [rad].
    """

    family = "numeric"
    complete = False
    searches_parts = True

    def __init__(self, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> None:
        super().__init__(chain, limits, energy, titles, roll_joint=roll_joint(chain))
        self._arm = SolvedArm(("numeric",), chain, energy, (), limits, self.roll_joint, titles=self.titles)
        self._bound = link_bound(chain)
        self._reach = max(self._bound.outer, 1e-3)
        self._starts = Starts(chain, limits)

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self:
        """Any arm is of this family."""
        return cls(chain, limits, energy, titles)

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """Solutions inside the limits with all their images; the search begins at ``start`` (n,) [rad].

        Nothing is swept, ``step`` [rad] is only looked at. A rotation that cannot be had where the position
        can is approached: the position is met exactly and the orientation as nearly as the search finds.
        Raises ``InputError``: ``step`` is not a positive number.
        """
        checked_step(step)
        return self._answer(target, start, sought=True)

    def approach(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """As ``solve``, for a rotation that nothing inside the limits has: it is not searched for."""
        checked_step(step)
        return self._answer(target, start, sought=False)

    def _answer(self, target: Target, start: FloatArray | None, *, sought: bool) -> Solutions:
        refusal, box = self._box(target)
        if refusal is not None:
            refusal = self._besides(refusal, target._replace(roll=None), DEFAULT_STEP, start)
        position = PositionGoal(target.position, self._reach)
        turned = None if target.rotation is None else RotationGoal(target.rotation)
        if target.pitch is not None:
            turned = pitch_goal(target.pitch)
        refusal = refusal or self._bound.violation(target.position, self.titles[0])
        if refusal is None and target.pitch is not None and turned is None:
            refusal = NoSuchAngle("elevation")
        if refusal is not None:
            return self._refused(target, refusal, self._nearest(position, turned, box))
        goal = position if turned is None else Together(position, turned)
        found = self._search(goal, box, start) if sought else np.empty((0, self.chain.n))
        if len(found) == 0 and isinstance(turned, RotationGoal):
            near = self._approached(position, turned, box)
            cost = turned.cost(tool_motion(self.chain, near))[0]
            angle = 2.0 * np.arcsin(np.sqrt(np.clip(cost / 2.0, 0.0, 1.0)))
            order = np.argsort(angle, kind="stable")
            near = near[order[angle[order] <= angle.min(initial=math.inf) + _ALIKE]]
            near = near[distinct(near, _SAME_NEAR)]
            exact = self._met(goal, meet(self.chain, goal, near, box, polish=True))
            found = exact if len(exact) else near
        if len(found) == 0:
            return self._unmet(target, position, turned, box)
        return self._solved(target, goal, found, start, box)

    def _solved(
        self, target: Target, goal: Goal, found: FloatArray, start: FloatArray | None, box: FloatArray
    ) -> Solutions:
        """With all images of isolated solutions; of a spread the nearest ones to zero and to the start."""
        moving = np.count_nonzero(self.limits[:, 0] < self.limits[:, 1])
        if self._rows(goal, found[:1]).shape[1] >= moving:
            q, _, left_out = all_images(found, self.limits, start)
            why = all_of(Searched(), by_turns(left_out))
        else:
            of_parts = meet(self.chain, goal, self._starts.nearest_of_parts(goal, box), box)
            found = np.vstack([found, self._met(goal, of_parts)])
            speed = self._arm.energy.speed_limits
            begins = [(np.zeros(self.chain.n), np.ones(self.chain.n))]
            begins += [] if start is None else [(start, speed.min() / speed)]
            near = [all_images(found, self.limits, at, most=1).q for at, _ in begins]
            near += [self._least(goal, q, *begin, box) for q, begin in zip(near, begins, strict=True)]
            q, why = np.vstack(near), Searched(continuum=True)
            q = q[each_once(q)]
        rotation: FloatArray = np.abs(q).sum(axis=1)
        q = q[np.argsort(rotation.round(9), kind="stable")]
        return Solutions(self._arm, target, q, np.zeros(len(q), dtype=np.int8), incomplete=why)

    def _least(
        self, goal: Goal, q: FloatArray, at: FloatArray, weights: FloatArray, box: FloatArray
    ) -> FloatArray:
        """(k, n) of a continuum, found from some of it ``q`` (m, n), that turn least from ``at`` (n,) [rad].

        What is least is the sum of turns by their ``weights`` (n,). Usually as many joints as are free stand
        at these angles, or at the limits next to them; such are found first. From the best of them the sum
        leads on downhill.
        """
        moving: list[int] = np.flatnonzero(box[:, 0] < box[:, 1]).tolist()
        spare = len(moving) - int(self._rows(goal, q[:1]).shape[1])
        begin = q[np.argsort(np.abs(q - at) @ weights, kind="stable")[:_BEGUN]]
        skip = math.ceil(math.comb(len(moving), spare) / _HELD)
        choices = np.array(list(islice(combinations(moving, spare), 0, None, skip)), dtype=np.intp)
        held = (choices[:, :, None] == np.arange(self.chain.n)).any(axis=1)
        boxes = np.where(held[:, :, None], np.clip(at, *box.T)[:, None], box).repeat(len(begin), axis=0)
        starts = np.clip(np.tile(begin, (len(held), 1)), boxes[..., 0], boxes[..., 1])
        found = self._met(goal, meet(self.chain, goal, starts, boxes))
        if spare < 1:  # by the rows alone; straight up or down they are one more than needed
            return found
        each = (one[np.argsort(np.abs(one - at) @ weights, kind="stable")[:_DOWNHILL]] for one in (found, q))
        best = np.vstack(list(each))
        best = come_nearest_holding(self.chain, goal, Turns(at, weights, _ROUNDED), best, box, roughly=True)
        stand = np.clip(at, *box.T)
        away = np.where(box[:, 0] < box[:, 1], np.abs(best - stand), math.inf)
        held = (away < _STANDS) & (away <= np.sort(away, axis=1)[:, spare - 1 : spare])
        boxes = np.where(held[:, :, None], stand[:, None], box)
        best = np.where(held, stand, best)
        return np.vstack([found, self._met(goal, meet(self.chain, goal, best, boxes, polish=True))])

    def nearest(self, target: Target) -> FloatArray:
        """(n,) the configuration nearest to a position [rad], with the pitch kept if any pose has it."""
        turned = None if target.pitch is None else pitch_goal(target.pitch)
        return self._nearest(PositionGoal(target.position, self._reach), turned, self._box(target)[1])

    def _box(self, target: Target) -> tuple[Reason | None, FloatArray]:
        """Why the roll asked for cannot be; the limits with the roll joint held at it, or near 0."""
        box = self.limits.copy()
        if self._roll is not None and target.rotation is not None:
            return None, box
        refused, held = held_roll(self._roll, target.roll)
        if self._roll is not None:
            box[self._roll.index] = held
        return refused, box

    def _search(self, goal: Goal, box: FloatArray, start: FloatArray | None = None) -> FloatArray:
        """(k, n) configurations that meet a goal, from wave after wave of starts until there are any.

        Those of ``start`` (n,), if given, are the first one.
        """
        starts = self._starts.nearest_first(goal, _WAVE * _WAVES, box)
        if start is not None:
            starts = np.vstack([np.clip(start, *box.T), starts])
        for at in range(0, len(starts), _WAVE):
            found = self._met(goal, self._polished(goal, starts[at : at + _WAVE], box))
            if len(found):
                return found
        return np.empty((0, self.chain.n))

    def _polished(self, goal: Goal, q: FloatArray, box: FloatArray) -> FloatArray:
        """Where starts come to, those near the goal to the last digit (slow at singular configurations)."""
        q = meet(self.chain, goal, q, box)
        square = (self._rows(goal, q) ** 2).sum(axis=1)
        slow = (square > 1e-26) & (square < 1e-6)
        if slow.any():
            q[slow] = meet(self.chain, goal, q[slow], box, polish=True)
        return q

    def _met(self, goal: Goal, q: FloatArray) -> FloatArray:
        """Those of ``q`` (k, n) that meet a goal, each once."""
        rows = self._rows(goal, q)
        off = np.linalg.norm(rows[:, :3], axis=1) * self._reach
        turned = np.linalg.norm(rows[:, 3:], axis=1)
        return _distinct(q[(off < _MET_M) & (turned < _MET_RAD)])

    def _rows(self, goal: Goal, q: FloatArray) -> FloatArray:
        return goal.rows(tool_motion(self.chain, q))[0]

    def _approached(self, order: Goal, wish: Goal, box: FloatArray) -> FloatArray:
        """(k, n) configurations that meet ``order``, if any, at the local minima of ``wish``."""
        both = Together(order, wish)
        q = meet(self.chain, both, self._starts.nearest_first(both, _WAVE, box), box)
        q = self._holding(order, np.vstack([self._polished(order, q, box), self._search(order, box)]))
        if len(q) == 0:
            return q
        best = q[np.argsort(wish.cost(tool_motion(self.chain, q))[0], kind="stable")[:_REFINED]]
        if not (isinstance(order, PositionGoal) and isinstance(wish, RotationGoal)):
            return self._holding(order, come_nearest_holding(self.chain, order, wish, best, box))
        near = come_nearest_holding(self.chain, order, wish, best, box, roughly=True)
        near = near[np.argsort(wish.cost(tool_motion(self.chain, near))[0], kind="stable")]
        near = near[distinct(near, _ONE_WAY)[:_FEW]]
        on_point = OnTarget(self.chain, box, Target.of(order.point), np.array([0.0, 0.0, 1.0]))
        return self._holding(order, np.vstack([best, on_point.nearest_rotation(near, wish.rotation)]))

    def _holding(self, order: Goal, q: FloatArray) -> FloatArray:
        """Those of ``q`` that meet an order, each once."""
        scale = self._reach if isinstance(order, PositionGoal) else _MET_M / _MET_RAD
        return _distinct(q[np.linalg.norm(self._rows(order, q), axis=1) * scale < _MET_M])

    def _nearest(self, position: PositionGoal, turned: Goal | None, box: FloatArray) -> FloatArray:
        """(n,) the configuration nearest to the position, with the pitch kept if any pose has it."""
        if turned is not None and not isinstance(turned, RotationGoal):
            kept = self._approached(turned, position, box)
            if len(kept):
                return self._best(position, kept)
        nearest = self._starts.nearest_first(position, _WAVE, box)
        starts = np.vstack([nearest, self._starts.nearest_of_parts(position, box)])
        return self._best(position, come_nearest(self.chain, position, starts, box))

    def _best(self, goal: Goal, q: FloatArray) -> FloatArray:
        return q[int(np.argmin(goal.cost(tool_motion(self.chain, q))[0]))]

    def _unmet(
        self, target: Target, position: PositionGoal, turned: Goal | None, box: FloatArray
    ) -> Solutions:
        """Refused after a search: without a proof, and the reason says so."""
        nearest = self._nearest(position, turned, box)
        away = float(np.linalg.norm(self.chain.forward(nearest)[:3, 3] - target.position))
        goal = position if target.pitch is None or turned is None else Together(position, turned)
        why: Reason = NotFound(_WAVE * _WAVES, away, turned=target.rotation is not None)
        if target.pitch is not None and turned is not None:
            there = self._approached(position, turned, box)
            if len(there):
                closest = self._best(turned, there)
                pitch, _ = self.pitch_and_roll(closest)
                why = PitchNotFound(_WAVE * _WAVES, target.pitch, pitch or 0.0)
                nearest = closest if away < THERE_M else nearest
        return self._refused(target, lambda: Several((why, self._by_limits(goal, box))), nearest)

    def _by_limits(self, goal: Goal, box: FloatArray) -> Reason:
        """What keeps the arm from a goal: joints that would have to leave their limits together, or links.

        None of the joints named could stay inside its limits while the others leave theirs, as far as the
        search goes.
        """
        starts = self._starts.nearest_first(goal, _WAVE, box)
        widened = whole_turns(box)
        met = self._met(goal, self._polished(goal, starts, widened))
        if len(met) == 0:
            return NoneWithoutLimits(_WAVE)
        q = self._least_beyond(goal, met, box, widened)
        for joint in np.argsort(self._beyond(q, box)).tolist():
            others = self._beyond(q, box) > 0.0
            if others[joint]:
                others[joint] = False
                fewer = np.where(others[:, None], widened, box)
                met = self._met(goal, self._polished(goal, np.vstack([np.clip(q, *fewer.T), starts]), fewer))
                q = self._least_beyond(goal, met, box, fewer) if len(met) else q
        leaving = [(k, float(q[k])) for k in np.flatnonzero(self._beyond(q, box)).tolist()]
        if not leaving:
            return MayExist()
        return JointsNeeded(angles_needed(self.titles, self.limits, leaving), least=True)

    def _least_beyond(self, goal: Goal, met: FloatArray, box: FloatArray, widened: FloatArray) -> FloatArray:
        """(n,) of what meets a goal inside ``widened`` limits, beyond those of the ``box`` by the least sum.

        From the best of some ``met`` (k, n) on.
        """
        best = met[np.argsort(self._beyond(met, box).sum(axis=1))[:_FEW]]
        least = come_nearest_holding(self.chain, goal, LimitsGoal(box), best, widened)
        q = np.vstack([best, self._holding(goal, least)])
        return q[int(self._beyond(q, box).sum(axis=1).argmin())]

    @staticmethod
    def _beyond(q: FloatArray, box: FloatArray) -> FloatArray:
        """(..., n) how far joints are outside limits [rad]."""
        beyond = np.abs(q - np.clip(q, *box.T))
        return np.where(beyond > _BEYOND, beyond, 0.0)

    def _refused(
        self, target: Target, reason: Reason | Callable[[], Reason], nearest: FloatArray
    ) -> Solutions:
        return Solutions(self._arm, target, (), (), reason=reason, nearest_q=nearest, incomplete=Searched())


def roll_joint(chain: Chain) -> int | None:
    """Index of the last joint, where it turns the tool about its approach axis through the tool point."""
    points, axes = chain.axes()
    tool = chain.forward(np.zeros(chain.n))
    swung = np.linalg.norm(np.cross(axes[-1], tool[:3, 2]))
    lever = np.linalg.norm(np.cross(tool[:3, 3] - points[-1], axes[-1]))
    return chain.n - 1 if swung < _ALIGNED and lever < _ALIGNED else None


def _distinct(q: FloatArray) -> FloatArray:
    """Each configuration once, whole turns not counted; least rotation first."""
    keys = np.round(np.column_stack([q, np.abs(q).sum(axis=1)]), 9)
    order: NDArray[np.intp] = np.lexsort(keys.T)  # the last key counts first
    return q[order][distinct(q[order])]
