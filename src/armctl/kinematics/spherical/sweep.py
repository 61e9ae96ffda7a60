"""The sweep of the first shoulder joint: every swivel posture on its grid."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.grid import grid_values
from armctl.kinematics.spherical.swivel import Swivel

FloatArray = NDArray[np.float64]
_CHUNK = 8192
"""values at a time: temporaries that stay in the processor's cache"""


def sweep(postures: list[tuple[float, Swivel]], step: float) -> FloatArray:
    """Every posture inside the limits with the first joint on its grid.

    Args:
        postures: elbow angles inside their limits [rad], each with its swivel.
        step: of the grid [rad].

    Returns:
        (4, k) shoulder joints and elbow [rad].

    Raises:
        InputError: see ``grid_values``.
    """
    parts: list[FloatArray] = [np.empty((4, 0))]
    for elbow, swivel in postures:
        grid = grid_values(*swivel.limits.pairs[0], step)
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
