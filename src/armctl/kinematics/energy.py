"""Energy criteria: what "least" means when the program chooses among solutions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.kinematics.gravity import GravityModel

FloatArray = NDArray[np.float64]
Criterion = Literal["least-rotation", "published", "least-travel", "least-torque"]
CRITERIA: tuple[Criterion, ...] = get_args(Criterion)
CRITERION_TEXT: dict[Criterion, str] = {
    "least-rotation": "least sum of |joint angles| (the text of the paper)",
    "published": "least |sum of joint angles| with the last pitch joint ≤ 0 (the tables of the paper)",
    "least-travel": "shortest time from the present pose: least sum of |change| / joint speed",
    "least-torque": "least gravity torque, each joint against its stall torque",
}


@dataclass(frozen=True, slots=True)
class EnergyModel:
    """What the criteria need to know of an arm."""

    speed_limits: FloatArray
    """(n,) [rad/s]"""
    gravity: GravityModel
    stall_torque: FloatArray | None = None
    """(n,) [N·m]; None: not known, then torques count alike"""


def checked_criterion(name: object) -> Criterion:
    """``name`` as a criterion.

    Raises:
        InputError: there is none of that name.
    """
    for criterion in CRITERIA:
        if isinstance(name, str) and name == criterion:  # an array compares entry by entry
            return criterion
    raise InputError(f"there is no criterion {name!r}; choose one of {', '.join(CRITERIA)}")


def energies(
    criterion: Criterion,
    q: FloatArray,
    model: EnergyModel,
    pitch_joints: tuple[int, ...],
    start: FloatArray | None = None,
) -> FloatArray:
    """Energy (k,) of each configuration ``q`` (k, n) [rad]; infinite where the criterion excludes it.

    Args:
        criterion: which.
        q: (k, n) configurations [rad].
        model: speeds, masses, stall torques.
        pitch_joints: indices of the joints that are parallel to each other; ``published`` sums the
            base and these, and excludes solutions whose last pitch joint is positive.
        start: (n,) where the arm stands [rad]; needed for ``least-travel``.

    Raises:
        InputError: ``least-travel`` without a start.
    """
    choose: dict[Criterion, Callable[[], FloatArray]] = {
        "least-rotation": lambda: np.abs(q).sum(axis=1),
        "published": lambda: _published(q, pitch_joints),
        "least-travel": lambda: _travel(q, model, start),
        "least-torque": lambda: _torque(q, model),
    }
    return choose[criterion]()


def _published(q: FloatArray, pitch_joints: tuple[int, ...]) -> FloatArray:
    """How the printed tables of the uzuner paper were chosen: not as its text says."""
    summed = [0, *pitch_joints] if pitch_joints else list(range(q.shape[1]))
    energy = np.abs(q[:, summed].sum(axis=1))
    last = summed[-1]
    energy[q[:, last] > 0.0] = np.inf
    return energy


def _travel(q: FloatArray, model: EnergyModel, start: FloatArray | None) -> FloatArray:
    if start is None:
        raise InputError("least-travel needs the pose that the arm starts from")
    return (np.abs(q - start) / model.speed_limits).sum(axis=1)


def _torque(q: FloatArray, model: EnergyModel) -> FloatArray:
    """Sum of squared load factors: what a motor's copper turns into heat grows with the square."""
    torque = model.gravity.torque(q)
    if model.stall_torque is not None:
        torque = torque / model.stall_torque
    return np.einsum("kn,kn->k", torque, torque)
