"""The sweep of the first shoulder joint: every swivel posture on its grid."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.kinematics.spherical_swivel import Swivel

FloatArray = NDArray[np.float64]
_MOST_VALUES = 2_000_000
_CHUNK = 8192
"""values at a time: temporaries that stay in the processor's cache"""
_SLACK = 1e-6
"""how far outside a limit a multiple of the step may lie by rounding, in steps"""


def first_joint_grid(low: float, high: float, step: float) -> FloatArray:
    """Whole multiples of ``step`` within the limits of the first joint [rad].

    Raises:
        InputError: ``step`` is not a positive angle, or so small that there are too many values.
    """
    if not (math.isfinite(step) and step > 0 and (high - low) / step <= _MOST_VALUES):
        least = math.degrees((high - low) / _MOST_VALUES)
        raise InputError(
            f"the step of the swept joint must be an angle of at least {least:.2g}°, got {step!r} rad"
        )
    first, last = math.ceil(low / step - _SLACK), math.floor(high / step + _SLACK)
    return np.clip(step * np.arange(first, last + 1, dtype=np.float64), low, high)


def sweep(postures: list[tuple[float, Swivel]], step: float) -> FloatArray:
    """Every posture inside the limits with the first joint on its grid.

    Args:
        postures: elbow angles inside their limits [rad], each with its swivel.
        step: of the grid [rad].

    Returns:
        (4, k) shoulder joints and elbow [rad].

    Raises:
        InputError: see ``first_joint_grid``.
    """
    parts: list[FloatArray] = [np.empty((4, 0))]
    for elbow, swivel in postures:
        grid = first_joint_grid(*swivel.limits.pairs[0], step)
        for at in range(0, len(grid), _CHUNK):
            for q in swivel.sheets(grid[at : at + _CHUNK]):
                parts += _inside(swivel, q, elbow)
    return np.concatenate(parts, axis=1)


def _inside(swivel: Swivel, q: FloatArray, elbow: float) -> Iterator[FloatArray]:
    """Postures (3, m) as configurations (4, k) inside the limits, one entry a whole turn of the joints."""
    for third, third_inside in swivel.limits.inside_arrays(2, q[2]):
        for second, second_inside in swivel.limits.inside_arrays(1, q[1]):
            kept = np.flatnonzero(second_inside & third_inside)
            part = np.empty((4, len(kept)))
            part[0], part[1], part[2], part[3] = q[0, kept], second[kept], third[kept], elbow
            yield part
