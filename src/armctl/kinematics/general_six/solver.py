"""Inverse kinematics of any arm of six joints: every whole pose, all configurations that it has."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.angles import distinct
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.general_six.pencil import Candidates, Loop
from armctl.kinematics.numeric.solver import roll_joint
from armctl.kinematics.samples import even_spread
from armctl.kinematics.solutions import BatchSolutions, Solutions
from armctl.kinematics.solver import InverseKinematics
from armctl.kinematics.target import Target
from armctl.kinematics.whole_pose import Ways, WholePoses, misses, polished

_MOST = 16
"""no arm of six joints has more isolated configurations for a pose (E. J. F. Primrose, 1986)"""
_TURN = 2.0
_NO_TURN = 1e-6
"""an isotropy below this is no turn, up to rounding"""
_SURE = 1e-3
"""what rounding may carry a candidate by, so that the Newton steps still find what it stands for [rad]"""
_REAL, _NEARLY_REAL = 1e-2, 0.3
"""imaginary parts up to which a candidate of the arm itself, or of one beside it, is taken as real [rad]"""
_BESIDE = (3e-4, 1e-3, 1e-3, 1e-4, 3e-3, 3e-4)
"""sizes of the changes that make arms beside this one"""
_UNREAL = 3.0
_STEPS, _MANY_STEPS = 8, 40
_MET = 1e-10
_EXACT, _NEAR = 1e-12, 1e-3
"""[m] or [rad]: what Newton steps leave of a pose where they are fast, and where slow ones are worth it"""
_SINGULAR = 1e-5
"""[1] a Jacobian with a smaller singular value may belong to a continuum"""
_NEARLY_SINGULAR = 1e-4
"""[1] with a smaller one, joints turn far while the tool hardly moves: a way along there may be missed"""
_TRACED, _TRACE_STEP = 40, 0.1
"""how many steps, each way, of how much a continuum is followed [rad]"""


class GeneralSixSolver(InverseKinematics):
    """Six joints in any position to each other. Immutable; safe in several threads.

    All configurations that a pose has come as eigenvectors (``pencil``), and Newton steps on the arm itself
    make them exact. How far rounding can carry an eigenvalue is known. Where that is too far, as where the
    last axis is parallel to the first, the same is done for arms beside this one, from which the Newton steps
    lead back.
    """

    family = "six joints in general"
    searches_parts = True

    def __init__(self, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> None:
        super().__init__(chain, limits, energy, titles, roll_joint=roll_joint(chain))
        self._names = tuple(f"way {i + 1}" for i in range(_MOST))
        self._answers = WholePoses(chain, limits, energy, titles, self._names)
        self._loop = Loop(chain)

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """The solver of six joints that move the tool in all ways; with two on one line they do not."""
        if chain.n != 6:
            return None
        solver = cls(chain, limits, energy, titles)
        return solver if solver._singular_values(_samples(limits)).max() > _SINGULAR else None

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """See ``InverseKinematics``."""
        return self._answers.solve(target, step, start, self._every_way)

    def solve_poses(self, poses: FloatArray) -> BatchSolutions:
        """See ``InverseKinematics``; of a continuum up to 16 configurations."""
        q = np.full((len(poses), _MOST, 6), np.nan)
        for i, pose in enumerate(poses):
            ways = self._isolated(pose)[0][:_MOST]
            q[i, : len(ways)] = ways
        return BatchSolutions(q, ~np.isnan(q[..., 0]), self._names)

    def _every_way(self, pose: FloatArray, _: FloatArray | None) -> Ways:
        q, sure = self._isolated(pose)
        least = self._singular_values(q)
        sure = sure and float(least.min(initial=1.0)) > _NEARLY_SINGULAR
        reason = (
            None if sure else "close to a singular pose: others may lie so near that they are not told apart"
        )
        lines = [self._traced(pose, one) for one in q[least < _SINGULAR]]
        curves = [line for line in lines if len(line) > 1]
        if curves:
            q = np.concatenate([q, *curves])
            q = q[distinct(q)]
            reason = (
                "singular: joints can turn here without moving the tool; a spread of that continuum is listed"
            )
        branch = np.minimum(np.arange(len(q)), _MOST - 1).astype(np.int8)
        return Ways(q, branch, reason)

    def _isolated(self, pose: FloatArray) -> tuple[FloatArray, bool]:
        """(k, 6) configurations of a pose (4, 4) [rad], and whether it is sure that there are no more."""
        found, sure = self._real(pose, self._loop.candidates(pose[None], self._hidden[0], _TURN), _REAL)
        if sure and self._paired(found):
            return found, True
        agreed = False
        for loop, hidden, turn in self._beside():
            more, sure = self._real(pose, loop.candidates(pose[None], hidden, turn), _NEARLY_REAL)
            both = np.concatenate([found, more])
            both = both[distinct(both)]
            if sure and agreed and len(both) == len(found) and self._paired(both):
                return both, True
            found, agreed = both, agreed or sure
        return found, False

    def _paired(self, q: FloatArray) -> bool:
        """Whether these can be all: of 16 roots the complex ones come in pairs, so the real ones are even.

        A double root is one singular configuration.
        """
        return len(q) % 2 == 0 or float(self._singular_values(q).min()) < _SINGULAR

    def _beside(self) -> Iterator[tuple[Loop, int, float]]:
        for i, loop in enumerate(self._loops_beside):
            yield loop, self._hidden[i % 4], _TURN + 1.3 * (i + 1)

    def _real(self, pose: FloatArray, candidates: Candidates, limit: float) -> tuple[FloatArray, bool]:
        """(k, 6) configurations that real candidates of a pose lead to, and whether rounding hid none."""
        q, isotropy, error = candidates.q[0], candidates.isotropy[0], candidates.error[0]
        turns = (isotropy > _NO_TURN) & np.isfinite(q).all(axis=1)
        near = q[turns]
        unreal = np.minimum(np.abs(near.imag).max(axis=1, initial=0.0), _UNREAL)
        sure = bool((error[turns] < np.maximum(_SURE, 0.1 * unreal)).all())
        near = near[np.abs(near.imag).max(axis=1, initial=0.0) < limit]
        starts = near.real
        if limit > _REAL:  # a pair that the arm has as a real one may be complex beside it
            starts = np.concatenate([starts, starts + near.imag, starts - near.imag])
        q = polished(self.chain, pose, starts, self._loop.unit, _STEPS)
        off = misses(self.chain, pose, q)
        slow = (off > _EXACT) & (off < _NEAR)  # where the arm is singular, steps only halve what is left
        if slow.any():
            q[slow] = polished(self.chain, pose, q[slow], self._loop.unit, _MANY_STEPS)
            off[slow] = misses(self.chain, pose, q[slow])
        q = q[off < _MET]
        return q[distinct(q)], sure

    def _traced(self, pose: FloatArray, q: FloatArray) -> FloatArray:
        """(k, 6) configurations along the curve through ``q`` (6,) on which the tool stands still, if any."""
        line = [q]
        for sign in (1.0, -1.0):
            at, ahead = q, sign * self._null(q)
            for _ in range(_TRACED):
                there = polished(self.chain, pose, (at + _TRACE_STEP * ahead)[None], self._loop.unit, _STEPS)
                moved = there[0] - at
                length = float(np.abs(moved).max())
                if misses(self.chain, pose, there)[0] > _MET or not 0.2 < length / _TRACE_STEP < 3.0:
                    break
                null = self._null(there[0])
                at, ahead = there[0], math.copysign(1.0, float(null @ moved)) * null
                line.append(at)
        return np.array(line)

    def _null(self, q: FloatArray) -> FloatArray:
        """(6,) the unit velocity that moves the tool least."""
        return np.linalg.svd(self._scaled_jacobians(q[None])[0])[2][-1].astype(np.float64)

    def _singular_values(self, q: FloatArray) -> FloatArray:
        """(k,) the least singular value of the Jacobian, lengths over the reach."""
        if len(q) == 0:
            return np.empty(0)
        return np.linalg.svd(self._scaled_jacobians(q), compute_uv=False)[:, -1].astype(np.float64)

    def _scaled_jacobians(self, q: FloatArray) -> FloatArray:
        J = self.chain.jacobian(q)
        J[:, :3] /= self._loop.unit
        return J

    @cached_property
    def _loops_beside(self) -> tuple[Loop, ...]:
        return tuple(Loop(self.chain, size, seed) for seed, size in enumerate(_BESIDE))

    @cached_property
    def _hidden(self) -> tuple[int, ...]:
        """The joints that may be hidden, the one with the least rounding first."""
        poses = self.chain.forward(_samples(np.tile([-math.pi, math.pi], (6, 1))))
        worst: list[float] = []
        for hidden in range(4):
            found = self._loop.candidates(poses, hidden, _TURN)
            worst.append(float(np.median(np.where(found.isotropy > _NO_TURN, found.error, 0.0).max(axis=1))))
        return tuple(np.argsort(worst).tolist())


def _samples(limits: FloatArray) -> FloatArray:
    """(5, 6) configurations in general position inside limits (6, 2), or nearly so [rad]."""
    low, high = limits.T
    return low + even_spread(5, np.full(6, 0.37)) * np.maximum(high - low, 1e-3)
