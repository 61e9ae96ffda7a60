"""The one polynomial of fifth degree with value, slope and curvature given at both ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def quintic(start: FloatArray, end: FloatArray) -> FloatArray:
    """Powers (6, ..., n) over 0 ... 1, lowest first; value, slope and curvature (3, ..., n) at both ends."""
    c = np.empty((6, *start.shape[1:]))
    c[:3] = start
    c[2] *= 0.5
    q, v, a = c[:3]
    # what the three lower powers leave over at the far end
    way = end[0] - q - v - a
    turn = end[1] - v - start[2]
    bend = 0.5 * (end[2] - start[2])
    c[3] = 10.0 * way - 4.0 * turn + bend
    c[4] = 7.0 * turn - 15.0 * way - 2.0 * bend
    c[5] = 6.0 * way - 3.0 * turn + bend
    return c
