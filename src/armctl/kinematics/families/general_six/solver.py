"""Inverse kinematics of any arm of six joints: every whole pose, all configurations that it has."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.facts import Reason
from armctl.facts.targets import MayBeHidden, TurnTogether
from armctl.kinematics.angles import distinct, wrapped
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.families.general_six.pencil import (
    ArmPencil,
    Beside,
    Candidates,
    ComplexArray,
    followed,
    meeting,
    unreal,
)
from armctl.kinematics.families.numeric.descent import rotation_vectors
from armctl.kinematics.families.numeric.solver import roll_joint
from armctl.kinematics.families.whole_pose import Configurations, WholePoses, misses, polished
from armctl.kinematics.newton import newton
from armctl.kinematics.samples import even_spread
from armctl.kinematics.solutions import BatchSolutions, Solutions
from armctl.kinematics.solver import InverseKinematics
from armctl.kinematics.target import Target

_MOST = 16
"""no arm of six joints has more isolated configurations for a pose (E. J. F. Primrose, 1986)"""
_TURN = 2.0
_NO_TURN = 1e-6
"""an isotropy below this is no turn, up to rounding"""
_SURE = 1e-3
"""what rounding may carry a candidate by, so that the Newton steps still find what it stands for [rad]"""
_REAL, _NEARLY_REAL = 1e-2, 0.3
"""[rad] imaginary parts up to which an eigenvalue, or the end of a path, is tried as a real configuration"""
_UNREAL = 3.0
_BESIDE, _TRIES = 0.05, 4
"""[rad] how far off the complex pose is, and how many are tried"""
_STEPS, _MANY_STEPS = 8, 40
_MET = 1e-10
_EXACT, _NEAR = 1e-12, 1e-3
"""[m] or [rad]: what Newton steps leave of a pose where they are fast, and where slow ones are worth it"""
_SINGULAR = 1e-5
"""[1] a Jacobian with a smaller singular value may belong to a continuum"""
_NEARLY_SINGULAR = 1e-4
"""[1] with a smaller one, joints turn far while the tool hardly moves: a way along there may be missed"""
_FOLD, _SAME_FOLD = 1e-4, 1e-2
"""[1] a configuration with a smaller singular value may stand for a singular one; [rad] that is so near"""
_FLAT, _ROUNDING = 1e-9, 3e-15
"""[1] a slope of a singular value that counts as none; [m] or [rad] what rounding leaves of a pose"""
_JOINTS = np.arange(6)
_CURVES, _TRACED, _TRACE_STEP = 8, 40, 0.1
"""how many continua are followed, by how many steps each way, of how much [rad]"""


class GeneralSixSolver(InverseKinematics):
    """Six joints in any position to each other. Immutable; safe in several threads.

    All configurations that a pose has come as eigenvectors (``pencil``), and Newton steps on the arm itself
    make them exact. How far rounding can carry an eigenvalue is known. Where that is too far, as where the
    last axis is parallel to the first, and in singular poses they are followed from those of a complex pose
    beside this one (``paths``).
    """

    family = "six joints in general"
    searches_parts = True

    def __init__(self, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> None:
        super().__init__(chain, limits, energy, titles, roll_joint=roll_joint(chain))
        self._names = tuple(f"way {i + 1}" for i in range(_MOST))
        self._answers = WholePoses(chain, limits, energy, titles, self._names, self._roll, self.of)
        self._loop = ArmPencil(chain)

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

    def _every_way(self, pose: FloatArray, _: FloatArray | None) -> Configurations:
        q, sure = self._isolated(pose)
        least = self._singular_values(q)
        why: Reason | None = None if sure else MayBeHidden()
        curves: list[FloatArray] = []
        for one in q[least < _SINGULAR]:
            if len(curves) < _CURVES and all(apart(curve, one).min() > _TRACE_STEP for curve in curves):
                line = self._traced(pose, one)
                curves += [line] if len(line) > 1 else []
        if curves:
            q = np.concatenate([q, *curves])
            q = q[distinct(q)]
            why = TurnTogether(())
        branch = np.minimum(np.arange(len(q)), _MOST - 1).astype(np.int8)
        return Configurations(q, branch, why)

    def _isolated(self, pose: FloatArray) -> tuple[FloatArray, bool]:
        """(k, 6) configurations of a pose (4, 4) [rad], and whether it is sure that there are no more."""
        found, sure = self._real(pose, self._loop.candidates(pose[None], self._hidden[0], _TURN))
        least = float(self._singular_values(found).min(initial=1.0))
        if sure and len(found) % 2 == 0 and least > _NEARLY_SINGULAR:
            return found, True  # of 16 roots the complex ones come in pairs, so the real ones are even
        rng = np.random.default_rng(0)
        known: bool | None = None
        for _ in range(_TRIES):
            more, known = self._followed(pose, Beside.of(rng, _BESIDE, self._loop.unit))
            found = np.concatenate([found, more])
            if known is not None:
                break
        folds = self._folds(pose, found[self._singular_values(found) < _FOLD])
        least = self._singular_values(found)
        alone = [
            least[i] > _FOLD or apart(folds, one).min(initial=math.inf) > _SAME_FOLD
            for i, one in enumerate(found)
        ]
        found = np.concatenate([folds, found[alone]])
        return found[distinct(found)], bool(known)

    def _followed(self, pose: FloatArray, beside: Beside) -> tuple[FloatArray, bool | None]:
        """As ``_isolated``, from the configurations of a complex pose; None: it is not known, try another."""
        candidates = self._loop.candidates(beside.poses(pose, np.ones(1)), self._hidden[0], _TURN)
        starts, known = self._known(candidates)
        ends = followed(self.chain, pose, beside, starts, self._loop.unit)
        away = unreal(ends.q)
        near = ends.q[away < _NEARLY_REAL].real
        q = np.concatenate(
            [
                self._polished(pose, near),
                self._folds(pose, np.concatenate([meeting(ends), ends.q[ends.singular].real])),
            ]
        )
        if not (known and ends.all):
            return q, None
        # a path may end at a complex point of a continuum, which has real ones, too
        hidden = [
            away[i] > _NEARLY_REAL or apart(q, ends.q[i].real).min(initial=math.inf) > _NEARLY_REAL
            for i in np.flatnonzero(ends.singular)
        ]
        return q, not any(hidden)

    def _real(self, pose: FloatArray, candidates: Candidates) -> tuple[FloatArray, bool]:
        """(k, 6) configurations that real candidates of a pose lead to, and whether rounding hid none."""
        q, sure = self._known(candidates)
        return self._polished(pose, q[unreal(q) < _REAL].real), sure

    def _known(self, candidates: Candidates) -> tuple[ComplexArray, bool]:
        """(k, 6) those candidates of a pose that are turns, and whether rounding leaves each recognisable."""
        q, isotropy, error = candidates.q[0], candidates.isotropy[0], candidates.error[0]
        turns = (isotropy > _NO_TURN) & np.isfinite(q).all(axis=1)
        away = np.minimum(unreal(q[turns]), _UNREAL)
        return q[turns], bool((error[turns] < np.maximum(_SURE, 0.1 * away)).all())

    def _polished(self, pose: FloatArray, starts: FloatArray) -> FloatArray:
        """(k, 6) configurations that Newton steps lead to, each once."""
        q = polished(self.chain, pose, starts, self._loop.unit, _STEPS)
        off = misses(self.chain, pose, q)
        slow = (off > _EXACT) & (off < _NEAR)  # where the arm is singular, steps only halve what is left
        if slow.any():
            q[slow] = polished(self.chain, pose, q[slow], self._loop.unit, _MANY_STEPS)
            off[slow] = misses(self.chain, pose, q[slow])
        q = q[off < _MET]
        return q[distinct(q)]

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

    def _folds(self, pose: FloatArray, starts: FloatArray) -> FloatArray:
        """(k, 6) singular configurations of a pose near ``starts`` (m, 6), to all digits.

        Newton steps find a double root to half of the digits, if at all. It is an ordinary root of
        off(q) = λ u and σ(q) = 0, with σ, u and v the least singular value of the Jacobian and its vectors;
        the other vectors U leave λ out of it: U off(q) = 0.
        """

        def rows(q: FloatArray) -> tuple[FloatArray, FloatArray]:
            J = self._scaled_jacobians(q)
            u, sigma, vt = np.linalg.svd(J)
            U = u[:, :-1].T
            off = np.append(U @ self._off(pose, q), sigma[-1])
            return off, np.vstack([U @ J, _slopes(J, u[:, -1], vt[-1])])

        found = [np.empty((0, 6))]
        for q in starts:
            q, _ = newton(rows, q, _STEPS, rank=_FLAT, still=_ROUNDING / 3.0, longest=_NEARLY_REAL)
            if misses(self.chain, pose, q[None])[0] < _ROUNDING:
                found.append(q[None])
        return np.concatenate(found)

    def _off(self, pose: FloatArray, q: FloatArray) -> FloatArray:
        T = self.chain.forward(q)
        turned = rotation_vectors((T[:3, :3] @ pose[:3, :3].T)[None])[0]
        return np.append((T[:3, 3] - pose[:3, 3]) / self._loop.unit, turned)

    def _null(self, q: FloatArray) -> FloatArray:
        """(6,) the unit velocity that moves the tool least."""
        return np.linalg.svd(self._scaled_jacobians(q))[2][-1].astype(np.float64)

    def _singular_values(self, q: FloatArray) -> FloatArray:
        """(k,) the least singular value of the Jacobian, lengths over the reach."""
        if len(q) == 0:
            return np.empty(0)
        return np.linalg.svd(self._scaled_jacobians(q), compute_uv=False)[:, -1].astype(np.float64)

    def _scaled_jacobians(self, q: FloatArray) -> FloatArray:
        # one by one in plain floats: for so few, a tenth of the time of arrays
        J = np.array([self.chain.jacobian(one) for one in q.reshape(-1, 6)]).reshape(*q.shape, 6)
        J[..., :3, :] /= self._loop.unit
        return J

    @cached_property
    def _hidden(self) -> tuple[int, ...]:
        """The joints that may be hidden, the one with the least rounding first."""
        poses = self.chain.forward(_samples(np.tile([-math.pi, math.pi], (6, 1))))
        worst: list[float] = []
        for hidden in range(4):
            found = self._loop.candidates(poses, hidden, _TURN)
            worst.append(float(np.median(np.where(found.isotropy > _NO_TURN, found.error, 0.0).max(axis=1))))
        return tuple(np.argsort(worst).tolist())


def _slopes(J: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """(6,) how u J v grows with each joint angle, of a Jacobian (6, 6) and vectors (6,).

    Joint k turns the columns behind it, and moves the point that those ahead of it move.
    """
    linear, axes = J[:3].T, J[3:].T
    first, last = np.minimum.outer(_JOINTS, _JOINTS), np.maximum.outer(_JOINTS, _JOINTS)
    moved = np.cross(axes[first], linear[last]) @ u[:3]
    turned = np.triu(np.cross(axes[:, None], axes[None]) @ u[3:])
    return np.asarray((moved + turned) @ v)


def apart(q: FloatArray, one: FloatArray) -> FloatArray:
    """(k,) how far configurations (k, 6) are from one (6,), whole turns not counted [rad]."""
    return np.asarray(np.abs(wrapped(q - one)).max(axis=1))


def _samples(limits: FloatArray) -> FloatArray:
    """(5, 6) configurations in general position inside limits (6, 2), or nearly so [rad]."""
    low, high = limits.T
    return low + even_spread(5, np.full(6, 0.37)) * np.maximum(high - low, 1e-3)
