"""Inverse kinematics of six-joint arms whose last three axes meet in a point, or the first three."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Self, cast

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, Range, images
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.numeric.solver import roll_joint
from armctl.kinematics.samples import DEFAULT_STEP, checked_step
from armctl.kinematics.solutions import BatchSolutions, Solutions
from armctl.kinematics.solver import InverseKinematics
from armctl.kinematics.spherical_wrist.batch import solve_poses
from armctl.kinematics.spherical_wrist.careful import CarefulSolver
from armctl.kinematics.spherical_wrist.closed_form import CLIPPED, ClosedForm, Row
from armctl.kinematics.spherical_wrist.geometry import SphericalWrist, recognise_wrist
from armctl.kinematics.target import Target
from armctl.kinematics.whole_pose import Configurations, WholePoses

_ROUNDING = 1e-13
"""how far the wrist's axes may miss each other where nothing has to be made up for [m]"""
_IN_FLOATS = 64
"""images of one configuration that are listed in plain floats"""


class SphericalWristSolver(InverseKinematics):
    """One arm of the family inside its limits. Immutable; safe in several threads.

    A pose has up to eight solutions, in closed form. A position alone, or with a pitch, is searched for.
    """

    family = "spherical wrist"
    searches_parts = True

    def __init__(
        self,
        chain: Chain,
        geometry: SphericalWrist,
        limits: FloatArray,
        energy: EnergyModel,
        titles: Sequence[str],
    ) -> None:
        super().__init__(chain, limits, energy, titles, roll_joint=roll_joint(chain))
        self.geometry = geometry
        self._closed = ClosedForm(geometry)
        self._answers = WholePoses(
            chain, limits, energy, titles, branch_names(self._closed), self._roll, self.of
        )
        self._ranges = [Range.of(low, high, CLIPPED) for low, high in geometry.order(limits.T).T.tolist()]
        self._careful = CarefulSolver(self._closed, chain, limits, titles)
        self._rough = geometry.misfit > _ROUNDING
        spans = [(k, low, high) for k, (low, high) in enumerate(limits.tolist())]
        self._turning = [span for span in spans if span[2] - span[1] > TWO_PI + LIMIT_TOLERANCE]
        """joints of which an angle may have several images, with their limits"""
        images_of_one = math.prod(1 + int((high - low) / TWO_PI) for _, low, high in self._turning)
        self._in_floats = images_of_one <= _IN_FLOATS and not self._rough

    @classmethod
    def recognises(cls, chain: Chain) -> bool:
        """See ``InverseKinematics``."""
        return recognise_wrist(chain) is not None

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """See ``InverseKinematics``."""
        geometry = recognise_wrist(chain)
        return None if geometry is None else cls(chain, geometry, limits, energy, titles)

    @cached_property
    def _unlimited(self) -> CarefulSolver:
        whole = np.tile([-math.pi, math.pi], (6, 1))
        return CarefulSolver(self._closed, self.chain, whole, self.titles)

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """All solutions inside the limits with all their images; of a continuum the one nearest to ``start``.

        A rotation that cannot be had is approached, and a position alone or with a pitch is searched for
        (``NumericSolver``). Nothing is swept, ``step`` [rad] is only looked at.
        Raises ``InputError``: ``step`` is not a positive number.
        """
        if target.rotation is not None and self._in_floats:  # most poses: twice as fast as by arrays
            if step is not DEFAULT_STEP:
                checked_step(step)
            quick = self._closed.quick(self._closed.place(target.point, target.rotation), self._ranges)
            if quick is not None and quick[0]:
                return self._with_images(target, *quick)
        return self._answers.solve(target, step, start, self._every_way)

    def _every_way(self, pose: FloatArray, start: FloatArray | None) -> Configurations:
        quick = None
        if not self._rough:
            placed = self._closed.place(pose[:3, 3].tolist(), pose[:3, :3])
            quick = self._closed.quick(placed, self._ranges)
        if quick is None:
            q, branches, continua = self._careful.solve(pose, start)
        else:
            q, branches, continua = np.array(quick[0]).reshape(-1, 6), quick[1], ()
            q = self.geometry.order(q)
        return Configurations(q, np.array(branches, dtype=np.int8), "; ".join(continua) or None)

    def _with_images(self, target: Target, rows: list[Row], branches: list[int]) -> Solutions:
        """The answer of configurations [rad] in the geometry's order, with their few images."""
        if self.geometry.backward:
            rows = [cast("Row", row[::-1]) for row in rows]
        for joint, low, high in self._turning:
            several = [images(row[joint], low, high) for row in rows]
            branches = [branch for branch, angles in zip(branches, several, strict=True) for _ in angles]
            rows = [
                cast("Row", (*row[:joint], angle, *row[joint + 1 :]))
                for row, angles in zip(rows, several, strict=True)
                for angle in angles
            ]
        return Solutions(self._answers.arm, target, rows, branches)

    def solve_poses(self, poses: FloatArray) -> BatchSolutions:
        """See ``InverseKinematics``."""
        q = solve_poses(self._closed, poses)
        for k in np.flatnonzero(np.isinf(q[:, 0, 0])).tolist():
            q[k] = self._one_pose(poses[k])
        q = self.geometry.order(q)
        return BatchSolutions(q, np.isfinite(q[:, :, 0]), self._answers.arm.branch_names)

    def _one_pose(self, pose: FloatArray) -> FloatArray:
        """(8, 6) every branch of one pose (4, 4), with care; in the order of the geometry."""
        found = self._unlimited.solve(pose, None)
        q = np.full((8, 6), math.nan)
        q[found.branches] = self.geometry.order(found.q)
        return q


def branch_names(closed: ClosedForm) -> tuple[str, ...]:
    """Names of the eight branches; index: 4 · shoulder + 2 · elbow + flip.

    Front: W is on the side of the first axis on which the second one is; where this meets the first, on the
    side on which W is at the zero pose. The elbow is up when a bend lifts it above the line from the second
    axis to W in front. These words need parallel second and third axes; without, the two roots are plus and
    minus. Four postures without such roots are numbered by rising θ1. With a flip the fifth joint is bent
    against its positive sense.
    """
    if closed.named:
        arms = ["front elbow-up", "front elbow-down", "back elbow-up", "back elbow-down"]
    elif closed.geometry.regional == "skew":
        arms = [f"posture-{k}" for k in (1, 2, 3, 4)]
    else:
        signs = itertools.product(("plus", "minus"), repeat=2)
        arms = [f"shoulder-{shoulder} elbow-{elbow}" for shoulder, elbow in signs]
    return tuple(f"{arm} {flip}" for arm in arms for flip in ("no-flip", "flip"))
