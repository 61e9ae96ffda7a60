"""The registry of solver families: the solver that an arm's own joint axes call for, and all its branches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armctl.arrays import ArrayRecord, FloatArray
from armctl.errors import InputError
from armctl.facts import AngleNeeded, Reason, say
from armctl.facts.targets import JointsNeeded, OrientationImpossible, OrientationNeeds
from armctl.kinematics.angles import LIMIT_TOLERANCE, distinct, rest_angle, whole_turns
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.explanations import angle_needed, angles_needed
from armctl.kinematics.families.general_six.solver import GeneralSixSolver
from armctl.kinematics.families.numeric.solver import NumericSolver
from armctl.kinematics.families.offset_roll.solver import OffsetRollSolver
from armctl.kinematics.families.parallel_linkage.solver import ParallelLinkageSolver
from armctl.kinematics.families.redundant.solver import RedundantSolver
from armctl.kinematics.families.spherical_shoulder.solver import SphericalShoulderSolver
from armctl.kinematics.families.spherical_wrist.solver import SphericalWristSolver
from armctl.kinematics.families.three_parallel.solver import ThreeParallelSolver
from armctl.kinematics.families.yaw_pitch_roll.solver import YawPitchRollSolver
from armctl.kinematics.samples import DEFAULT_STEP
from armctl.kinematics.solver import InverseKinematics
from armctl.kinematics.target import Target
from armctl.lazy_dataclass import dataclass

FAMILIES: tuple[type[InverseKinematics], ...] = (
    YawPitchRollSolver,
    OffsetRollSolver,
    SphericalShoulderSolver,
    SphericalWristSolver,
    ThreeParallelSolver,
    GeneralSixSolver,
    RedundantSolver,
    ParallelLinkageSolver,
    NumericSolver,
)
"""tried in turn; the last one takes any serial arm. A new family is one more entry before it."""


def inverse_kinematics(
    chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]
) -> InverseKinematics:
    """The solver of the first family that the arm belongs to; arguments as of ``InverseKinematics.of``."""
    for family in FAMILIES:
        if chain.coupling is not None and not family.takes_linkages:
            continue
        solver = family.of(chain, limits, energy, titles)
        if solver is not None:
            return solver
    raise InputError(
        "no solver takes this parallel linkage; a palletiser has a yaw joint, two parallel pitch joints, a "
        "link that follows them so that it stays level, and at most a joint that turns it about the vertical"
    )


def has_closed_form(chain: Chain) -> bool:
    """Whether a serial arm belongs to a family that needs no search for a whole pose."""
    return any(family.recognises(chain) for family in FAMILIES)


# Every closed-form branch of a target, those that the joint limits forbid too, with what forbids them.

_MET = 1e-6
"""how far what meets a target may be off it [m], [rad]: some families list what is nearest to a rotation"""


@dataclass(frozen=True, slots=True, eq=False)
class Branch(ArrayRecord):
    """One way to meet a target."""

    name: str
    q: FloatArray
    """(n,) [rad]; each joint at the image nearest to the middle of its limits"""
    needs: tuple[AngleNeeded, ...]
    """each joint that would have to leave its limits; empty where the arm can stand so"""

    @property
    def forbidden(self) -> tuple[str, ...]:
        """A sentence for each of these."""
        return tuple(map(say, self.needs))


class BranchFinder:
    """The branches of one arm. Immutable; safe in several threads.

    The arm's own solver, given a whole turn about the middle of each joint's limits, lists every branch once.
    """

    def __init__(self, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> None:
        self._limits, self._titles = limits, tuple(titles)
        self._chain = chain
        self._solver = inverse_kinematics(chain.without_turn_limits(), whole_turns(limits), energy, titles)

    def forbids(self, target: Target) -> Reason | None:
        """What keeps the arm from a target as it is asked for; None where that is not known."""
        if self._solver.is_swept(target):
            return None
        branches = self.find(target)
        if not branches:
            return OrientationImpossible(proven=self._solver.complete)
        if not all(branch.needs for branch in branches):
            return None
        away = [np.abs(branch.q - np.clip(branch.q, *self._limits.T)).sum() for branch in branches]
        least = branches[int(np.argmin(away))].needs
        return OrientationNeeds(JointsNeeded(least, least=len(branches) > 1))

    def find(self, target: Target) -> tuple[Branch, ...]:
        """All branches by order of their names; none where nothing meets the target, or a joint is free."""
        if self._solver.is_swept(target):
            return ()  # a continuum, not branches
        if self._solver.complete and self._solver.searches_parts and target.rotation is not None:
            pose = np.eye(4)  # a list would search for the nearest orientation where there is none
            pose[:3, :3], pose[:3, 3] = target.rotation, target.point
            if not self._solver.solve_poses(pose[None]).found.any():
                return ()
        joint = self._solver.roll_joint
        if target.roll is None and target.rotation is None and joint is not None:
            # any roll will do: the one at which the arm itself answers, not one of the widened joint
            low, high = self._limits[joint].tolist()
            target = target._replace(roll=rest_angle(low, high))
        solutions = self._solver.solve(target, DEFAULT_STEP)
        meets = np.maximum(solutions.residual_m, solutions.residual_rad) <= _MET
        named = np.argsort(solutions.branch_index, kind="stable")
        named = named[meets[named]]
        found: list[Branch] = []
        for i in named[distinct(solutions.q[named])].tolist():  # whole turns are one branch
            q = solutions.q[i]
            inside = np.clip(q, *self._limits.T)  # takes rounding off the joints that are inside
            outside = np.abs(inside - q) > LIMIT_TOLERANCE
            beyond = [(k, float(q[k])) for k in np.flatnonzero(outside).tolist()]
            needs = list(angles_needed(self._titles, self._limits, beyond))
            q = np.where(outside, q, inside)
            for limit, turn in self._chain.turns_beyond(q):
                needs.append(angle_needed(limit.name, (limit.lower, limit.upper), turn))
            found.append(Branch(str(solutions.branch[i]), q, tuple(needs)))
        return tuple(found)
