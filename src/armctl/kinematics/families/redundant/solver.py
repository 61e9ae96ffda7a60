"""Inverse kinematics of seven joints: a whole tool pose leaves one of them free, which is swept."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Self

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.facts import Reason
from armctl.facts.angles import DEGREE
from armctl.facts.targets import ListedInSteps
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, all_images, images, images_toward, wrapped
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import Criterion, EnergyModel, energies
from armctl.kinematics.explanations import SolvedArm, all_of, by_turns
from armctl.kinematics.families.numeric.solver import NumericSolver
from armctl.kinematics.families.redundant.locked import JOINTS, IndexArray, LockedArm, LockedSolutions
from armctl.kinematics.samples import DEFAULT_STEP, checked_step, grid_values
from armctl.kinematics.solutions import Solutions
from armctl.kinematics.solver import InverseKinematics
from armctl.kinematics.target import Target

_END, _SAME = 1e-9, 1e-6
"""how near to the end of a run of solutions its last one is, and which angles of the sweep are one [rad]"""
_ANY = np.tile([-math.pi, math.pi], (JOINTS, 1))
_EVERY_DEGREE = DEGREE * np.arange(-180.0, 180.0)
_BETWEEN = np.linspace(0.0, 1.0, 9)[1:-1]
_BESIDE = np.linspace(-1.0, 1.0, 33)
"""angles about one that a search has found, in steps of the sweep"""
_STEEP = 64.0
"""a joint turns by no more than this times the free joint where a short run is looked for"""
_FAR, _HALVINGS = 1.1, 16
"""how many steps a joint may turn from a row to the next one, and how often a step is halved for that"""
_HALVED_AT_ONCE = 3
"""steps of a bisection that are solved in one call: a third of the calls for ends, with the same result"""
_LISTED = 0.2 * DEGREE
"""the step of a list where none is asked for, and the least one by which short runs are looked for: rows lie
within 2 mrad of what is between them [rad]"""
_MET_M, _MET_RAD = 1e-10, 1e-9
"""what rounding may leave of a pose; what misses more is no solution"""
_MOST_ROWS = 100_000
"""images by whole turns are listed up to so many configurations"""
_TURNED_OVER = 0, 1, 2, 4
"""the branch itself, and those with another wrist, shoulder or elbow"""
_MOST_MAXIMA = 256
"""so many are looked at more closely: that bounds the time of any pose"""
_MINIMA, _SECTIONS, _FINEST = 32, 8, 1e-13
"""how many minima of the list are refined, into how many parts each way, how fine [rad]"""


class RedundantSolver(InverseKinematics):
    """One arm of seven joints inside its limits. Immutable; safe in several threads.

    The joint at one end is swept, as the others are closed form once it is locked (``LockedArm``). A position
    without an orientation leaves four joints free: it is searched for, as for any arm.
    """

    family = "seven joints: one swept, six in closed form"
    complete = False

    def __init__(
        self, chain: Chain, locked: LockedArm, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]
    ) -> None:
        self._search = NumericSolver(chain, limits, energy, titles)
        super().__init__(chain, limits, energy, titles, roll_joint=self._search.roll_joint)
        self._locked = locked
        self._arm = SolvedArm(LockedArm.branch_names, chain, energy, (), limits, titles=self.titles)

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """See ``InverseKinematics``."""
        locked = LockedArm.of(chain)
        return None if locked is None else cls(chain, locked, limits, energy, titles)

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """All solutions of a whole pose, the free joint in steps of ``step`` [rad], and as ``start`` has it.

        The ends of each run of solutions are listed, too, and more where another joint turns farther in a
        step. ``DEFAULT_STEP``, which is made for quicker families, stands for 0.2°. A pose that has none is
        approached by search: the position is met exactly, and the orientation as nearly as the search finds.
        Raises ``InputError``: ``step`` is not a positive number, or too small for a list.
        """
        step = _LISTED if step == DEFAULT_STEP else checked_step(step)
        if target.rotation is None:
            return self._search.solve(target, step, start)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = target.rotation, target.position
        angles = self._grid(step, start)
        coarse = angles if step >= _LISTED else self._grid(_LISTED, start)
        short = self._short_runs(pose, coarse, max(step, _LISTED))
        found = self._listed(pose, np.append(angles, short), step)
        if start is not None:
            found = self._with(pose, found, start)
        if len(found.q) == 0:  # none, or all of them between two angles of the sweep
            searched = self._search.solve(target, step, start)
            about = searched.q[:, self._locked.joint, None] + step * _BESIDE
            if searched.success:
                found = self._listed(pose, np.append(angles, self._in_turn(about.ravel(), angles[0])), step)
            if len(found.q) == 0:
                return searched
        why: Reason | None = ListedInSteps(self.titles[self._locked.joint], step)
        q, branch = found.q, found.branch
        if (np.ptp(self.limits, axis=1) >= TWO_PI).any():
            q, source, left_out = all_images(q, self.limits, start, max(_MOST_ROWS, len(q)))
            branch = branch[source]
            why = all_of(why, by_turns(left_out))
        return Solutions(
            self._arm, target, q, branch.astype(np.int8), free_joint=self._locked.joint,
            least_rotation=partial(self._least_rotation, pose, found, step), incomplete=why,
            further=partial(self._further, pose, found, step),
        )  # fmt: skip

    def reaches(self, pose: FloatArray) -> bool | None:
        """See ``InverseKinematics``; by the free joint in steps of a degree."""
        return len(self._locked.solve(pose, _EVERY_DEGREE, _ANY).q) > 0

    def _with(self, pose: FloatArray, found: LockedSolutions, q: FloatArray) -> LockedSolutions:
        """With a configuration (7,) among them that meets the pose: of a singular one not all are listed."""
        low, high = self.limits.T
        if ((q < low) | (q > high)).any() or not self._meets(pose, q[None])[0]:
            return found
        apart = np.abs(images_toward(found.q, self.limits, q) - q).max(axis=1)
        nearest = 0 if len(apart) == 0 else int(apart.argmin())
        if len(apart) and apart[nearest] < _SAME:
            return found
        lane = found.branch[nearest] if len(apart) else 0
        rows, branch = self._along(np.vstack([found.q, q]), np.append(found.branch, lane))
        return LockedSolutions(np.arange(len(rows)), branch, rows)

    def _grid(self, step: float, start: FloatArray | None) -> FloatArray:
        """The angles of the sweep (k,) [rad], rising: no more than a turn, its images are added later."""
        low, high = self.limits[self._locked.joint].tolist()
        if high - low >= TWO_PI:
            low = min(max(-math.pi, low), high - TWO_PI)
            high = low + TWO_PI - 2.0 * _SAME
        angles = grid_values(low, high, step)
        here = [] if start is None else images(float(start[self._locked.joint]), low, high)
        for angle in (low, high, *here):
            angles = np.sort(np.append(angles[np.abs(angles - angle) > _SAME], angle))
        return angles

    def _listed(self, pose: FloatArray, angles: FloatArray, step: float) -> LockedSolutions:
        """What the angles (k,) have, and the ends between them; along each branch."""
        angles = np.unique(angles)
        found = self._locked.solve(pose, angles, self.limits)
        has = np.zeros((len(LockedArm.branch_names), len(angles)), dtype=np.bool_)
        has[found.branch, found.row] = True
        branch, left = np.nonzero(has[:, 1:] != has[:, :-1])
        inside, outside = angles[left + ~has[branch, left]], angles[left + has[branch, left]]
        grid = inside
        inside = self._ends(pose, inside, outside, branch, max(1, math.ceil(math.log2(step / _END))))
        new = np.abs(inside - grid) > _SAME
        which, q = self._on(pose, inside[new], branch[new])
        q = np.concatenate([found.q, q])
        branch = np.concatenate([found.branch, branch[new][which]])
        q, branch = self._along(q, branch)
        middle, lane = self._between(pose, q, branch, step)
        q, branch = self._along(np.concatenate([q, middle]), np.concatenate([branch, lane]))
        met = np.flatnonzero(self._meets(pose, q) & ~_repeated(q))
        return LockedSolutions(met, branch[met], q[met])

    def _ends(
        self, pose: FloatArray, inside: FloatArray, outside: FloatArray, branch: IndexArray, halvings: int
    ) -> FloatArray:
        """Where the branches (k,) end between angles that have them and that have not: the last that has.

        By bisection; the angles that its next steps may ask for are solved at once: most of the time is that
        of a call.
        """
        each = np.arange(len(branch))
        while halvings > 0 and len(branch):
            levels = min(_HALVED_AT_ONCE, halvings)
            halvings -= levels
            parts = 1 << levels
            tried, has = (
                np.empty((len(branch), parts + 1)),
                np.zeros((len(branch), parts + 1), dtype=np.bool_),
            )
            tried[:, 0], tried[:, -1] = inside, outside
            for step in (parts >> level for level in range(levels)):
                tried[:, step // 2 :: step] = 0.5 * (tried[:, :-1:step] + tried[:, step::step])
            found, _ = self._on(pose, tried[:, 1:-1].ravel(), branch.repeat(parts - 1))
            has[found // (parts - 1), 1 + found % (parts - 1)] = True
            at = np.zeros_like(each)
            for step in (parts >> level for level in range(1, levels + 1)):
                at += step * has[each, at + step]
            inside, outside = tried[each, at], tried[each, at + 1]
        return inside

    def _short_runs(self, pose: FloatArray, angles: FloatArray, step: float) -> FloatArray:
        """Angles (m,) between those of the sweep (k,) where a run shorter than a step keeps the limits.

        A pose of several joints at their limits has a run of one angle. There, what is left to the nearest
        limit has a maximum over the free joint: those of the sweep are searched for in ever finer parts.
        """
        low, high = self.limits[self._locked.joint].tolist()
        branch, centre = self._maxima_of_room(pose, angles)
        parts = np.linspace(-1.0, 1.0, 2 * _SECTIONS + 1)
        inside = [np.empty(0)]
        while step > _FINEST and len(centre):
            tried = np.clip(centre[:, None] + step * parts, low, high)
            room = np.full(tried.size, -np.inf)
            _, row, left = self._room(pose, tried.ravel(), branch.repeat(len(parts)))
            room[row] = left.min(axis=1)
            room = room.reshape(tried.shape)
            best = np.arange(len(centre)), room.argmax(axis=1)
            centre, most = tried[best], room[best]
            step /= _SECTIONS
            # of a run of one angle, to the last digit: what is clipped at a limit misses the pose
            there = (most >= 0.0) | ((step <= _FINEST) & (most >= -LIMIT_TOLERANCE))
            inside.append(centre[there])
            on = ~there & (most > -_STEEP * step)
            branch, centre = branch[on], centre[on]
        return self._in_turn(np.concatenate(inside), angles[0])

    def _in_turn(self, angles: FloatArray, first: float) -> FloatArray:
        """Angles of the free joint [rad] inside its limits, those beyond the turn from ``first`` on in it."""
        angles = np.clip(angles, *self.limits[self._locked.joint])
        turns = np.floor((angles - first) / TWO_PI)
        return np.where(turns == 0.0, angles, angles - TWO_PI * turns)

    def _maxima_of_room(self, pose: FloatArray, angles: FloatArray) -> tuple[IndexArray, FloatArray]:
        """Branches and angles (m,) [rad], to a step, where most is left to the limits, and may be enough."""
        branch, row, left = self._room(pose, angles)
        room = np.full((len(LockedArm.branch_names), len(angles), JOINTS), -np.inf)
        room[branch, row] = left
        least = room.min(axis=2)
        ahead, behind = (np.pad(least, ((0, 0), side), constant_values=-np.inf) for side in ((1, 0), (0, 1)))
        exists = np.isfinite(least)
        peak = exists & (least >= ahead[:, :-1]) & (least >= behind[:, 1:]) & (least < -LIMIT_TOLERANCE)
        branch, row = np.nonzero(peak)
        # where one joint comes and another goes, most is left between two angles, or where a branch ends
        edge, last = np.nonzero(exists[:, :-1] != exists[:, 1:])
        lane, first = np.nonzero(exists[:, :-1] & exists[:, 1:])
        beside = np.stack([least[lane, first], least[lane, first + 1]])
        outside = beside.min(axis=0) < -LIMIT_TOLERANCE
        lane, first, most = lane[outside], first[outside], beside.max(axis=0)[outside]
        one, other = room[lane, first], room[lane, first + 1]
        between = np.max([((1.0 - s) * one + s * other).min(axis=1) for s in _BETWEEN], axis=0)
        hidden = between > most
        beside = np.maximum(least[edge, last], least[edge, last + 1])
        # where a branch ends another begins, and may end within the step
        beside, last = np.tile(beside, len(_TURNED_OVER)), np.tile(last, len(_TURNED_OVER))
        edge = np.concatenate([edge ^ other for other in _TURNED_OVER])
        room = np.concatenate([least[branch, row], between[hidden], beside])
        lane, first = np.append(lane[hidden], edge), np.append(first[hidden], last)
        centres = angles[row], 0.5 * (angles[first] + angles[first + 1])
        most = np.argsort(-room, kind="stable")[:_MOST_MAXIMA]
        return np.concatenate([branch, lane])[most], np.concatenate(centres)[most]

    def _room(
        self, pose: FloatArray, angles: FloatArray, only: IndexArray | None = None
    ) -> tuple[IndexArray, IndexArray, FloatArray]:
        """Of all solutions for angles (k,): branch, index of the angle (m,), and what is left to the limits.

        That of each joint (m, 7) [rad], negative outside. ``only``: of each angle this branch (k,).
        """
        middle, half = self.limits.mean(axis=1), 0.5 * np.ptp(self.limits, axis=1)
        found = self._locked.solve(pose, angles, _ANY, only)
        return found.branch, found.row, half - np.abs(wrapped(found.q - middle))

    def _along(self, q: FloatArray, branch: IndexArray) -> tuple[FloatArray, IndexArray]:
        """Configurations (m, 7) and their branches (m,), along each branch."""
        order = np.lexsort((q[:, self._locked.joint], branch))
        return q[order], branch[order]

    def _between(
        self, pose: FloatArray, q: FloatArray, branch: IndexArray, step: float
    ) -> tuple[FloatArray, IndexArray]:
        """Solutions (k, 7) between neighbours of a list where a joint turns far, and their branches (k,).

        Where a run ends the others turn without bound against the free joint.
        """
        free = self._locked.joint
        near = (branch[1:] == branch[:-1]) & (q[1:, free] - q[:-1, free] < (1.0 + _SAME) * step)
        left, right, lane = q[:-1][near], q[1:][near], branch[1:][near]
        found, lanes = [np.empty((0, q.shape[1]))], [np.empty(0, dtype=np.intp)]
        for _ in range(_HALVINGS):
            gap = right - left
            turned = np.abs(wrapped(gap)).max(axis=1, initial=0.0)
            far = (turned > _FAR * step) & (gap[:, free] > 2.0 * _END)
            left, right, lane = left[far], right[far], lane[far]
            if len(lane) == 0:
                break
            which, middle = self._on(pose, 0.5 * (left[:, free] + right[:, free]), lane)
            left, right = np.concatenate([left[which], middle]), np.concatenate([middle, right[which]])
            lane = lane[which]
            found.append(middle)
            lanes.append(lane)
            lane = np.concatenate([lane, lane])
        return np.concatenate(found), np.concatenate(lanes)

    def _on(self, pose: FloatArray, angles: FloatArray, branch: IndexArray) -> tuple[IndexArray, FloatArray]:
        """Solutions of one branch for each of the angles (k,): indices of those that have it, and (m, 7).

        What is clipped at a limit may miss the pose: a run ends before that.
        """
        has, _, q = self._locked.solve(pose, angles, self.limits, branch)
        at_limit = np.flatnonzero(((q == self.limits[:, 0]) | (q == self.limits[:, 1])).any(axis=1))
        missed = at_limit[~self._meets(pose, q[at_limit])]
        return np.delete(has, missed), np.delete(q, missed, axis=0)

    def _meets(self, pose: FloatArray, q: FloatArray) -> NDArray[np.bool_]:
        """Which configurations (m, 7) meet a pose: near a singular one rounding may take it off."""
        off = self.chain.forward(q).transpose(1, 2, 0)[:3] - pose[:3, :, None]  # as it lies in memory
        off *= off
        # of two rotations that are near to each other the angle is 1/√2 of the distance
        turned = off[:, :3].sum(axis=(0, 1))
        return (off[:, 3].sum(axis=0) < _MET_M * _MET_M) & (turned < 2.0 * _MET_RAD * _MET_RAD)

    def _least_rotation(self, pose: FloatArray, found: LockedSolutions, step: float) -> FloatArray | None:
        """The configuration (7,) of least Σ|θ| over the continuum: the least of the list, refined."""
        q = self._refined(pose, found, step, lambda q: np.abs(q).sum(axis=1))
        turned = np.abs(q).sum(axis=1)
        least = turned.min(initial=np.inf)
        return q[int(turned.argmin())] if least <= np.abs(found.q).sum(axis=1).min() else None

    def _further(
        self, pose: FloatArray, found: LockedSolutions, step: float, criterion: Criterion, start: FloatArray
    ) -> FloatArray:
        """(m, 7) the best by a criterion from ``start`` (7,), as near to it as whole turns allow [rad]."""

        def cost(q: FloatArray) -> FloatArray:
            return energies(criterion, images_toward(q, self.limits, start), self.energy, (), start)

        return images_toward(self._refined(pose, found, step, cost), self.limits, start)

    def _refined(
        self, pose: FloatArray, found: LockedSolutions, step: float, cost: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """(m, 7) local minima of a cost over the continuum: those of the list, searched for in between."""
        listed = cost(found.q)
        before, behind = np.full(len(listed), np.inf), np.full(len(listed), np.inf)
        same = found.branch[1:] == found.branch[:-1]
        before[1:][same], behind[:-1][same] = listed[:-1][same], listed[1:][same]
        minima = np.flatnonzero((listed <= before) & (listed <= behind))
        minima = minima[np.argsort(listed[minima], kind="stable")[:_MINIMA]]
        branch, centre = found.branch[minima], found.q[minima, self._locked.joint]
        low, high = self.limits[self._locked.joint].tolist()
        parts = np.linspace(-1.0, 1.0, 2 * _SECTIONS + 1)
        while step > _FINEST:
            tried = np.clip(centre[:, None] + step * parts, low, high)
            costs = np.full(tried.size, np.inf)
            which, q = self._on(pose, tried.ravel(), branch.repeat(len(parts)))
            costs[which] = cost(q)
            best: IndexArray = np.argmin(costs.reshape(tried.shape), axis=1)
            centre = tried[np.arange(len(centre)), best]
            step /= _SECTIONS
        _, q = self._on(pose, centre, branch)
        return q[self._meets(pose, q)]


def _repeated(q: FloatArray) -> NDArray[np.bool_]:
    """Which of configurations (m, 7) are there already, whole turns aside: where two branches meet."""
    weights = np.sqrt(np.arange(2.0, 2.0 + q.shape[1]))
    place = np.cos(q) @ weights + np.sin(q) @ weights[::-1]  # the same for the same ones
    order = np.argsort(place, kind="stable")
    place, repeated = place[order], np.zeros(len(q), dtype=np.bool_)
    for lag in range(1, len(q)):  # others may stand between two that are the same
        near = np.flatnonzero(place[lag:] - place[:-lag] < 32.0 * _SAME)
        if len(near) == 0:
            break
        first, second = order[near], order[near + lag]
        same = np.abs(wrapped(q[second] - q[first])).max(axis=1) < _SAME
        repeated[second[same]] = True
    return repeated
