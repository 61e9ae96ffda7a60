"""The registry of solver families: the solver that an arm's own joint axes call for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.numeric.solver import NumericSolver
from armctl.kinematics.solver import InverseKinematics
from armctl.kinematics.spherical_shoulder.solver import SphericalShoulderSolver
from armctl.kinematics.yaw_pitch_roll.solver import YawPitchRollSolver

FAMILIES: tuple[type[InverseKinematics], ...] = (YawPitchRollSolver, SphericalShoulderSolver, NumericSolver)
"""tried in turn; the last one takes any arm. A new family is one more entry before it."""


def inverse_kinematics(
    chain: Chain, limits: NDArray[np.float64], energy: EnergyModel, titles: Sequence[str]
) -> InverseKinematics:
    """The solver of the first family that the arm belongs to; arguments as ``InverseKinematics.of`` has them.

    Raises:
        InputError: no family takes the arm.
    """
    for family in FAMILIES:
        solver = family.of(chain, limits, energy, titles)
        if solver is not None:
            return solver
    raise InputError(f"no solver family takes an arm of {chain.n} joints")
