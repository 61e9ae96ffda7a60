"""The solver that an arm's own DH rows call for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.numeric.solver import NumericSolver
from armctl.kinematics.solutions import Solutions
from armctl.kinematics.spherical_shoulder.geometry import recognise_spherical
from armctl.kinematics.spherical_shoulder.solver import SphericalShoulderSolver
from armctl.kinematics.target import Target
from armctl.kinematics.yaw_pitch_roll.geometry import recognise
from armctl.kinematics.yaw_pitch_roll.solver import YawPitchRollSolver

FloatArray = NDArray[np.float64]


class InverseKinematics(Protocol):
    """A solver for one arm inside its limits; safe to use from several threads at once."""

    @property
    def family(self) -> str:
        """Name of the family, in words."""
        ...

    @property
    def pitch_joints(self) -> tuple[int, ...]:
        """Indices of the parallel pitch joints; empty where the arm has none."""
        ...

    @property
    def free_joint(self) -> int | None:
        """Index of the joint that is free (and swept) when only a position is asked for."""
        ...

    def solve(self, target: Target, step: float) -> Solutions:
        """All solutions inside the limits; ``step`` [rad] is that of a swept joint."""
        ...

    def pitch_and_roll(self, q: FloatArray) -> tuple[float | None, float | None]:
        """Tool pitch and roll [rad] at one configuration (n,); None where the arm has none."""
        ...


def inverse_kinematics(
    chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]
) -> InverseKinematics:
    """Choose the solver by the chain's geometry.

    Args:
        chain: the arm.
        limits: (n, 2) joint limits [rad].
        energy: what the energy criteria need.
        titles: (n,) what the joints are called in messages.

    Returns:
        The closed form of the family that the arm belongs to; where it belongs to none, the numeric solver,
        whose answers say that they may be incomplete.
    """
    planar = recognise(chain)
    if planar is not None:
        return YawPitchRollSolver(chain, planar, limits, energy, titles)
    spherical = recognise_spherical(chain)
    if spherical is not None:
        return SphericalShoulderSolver(chain, spherical, limits, energy, titles)
    return NumericSolver(chain, limits, energy, titles)
