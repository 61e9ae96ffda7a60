"""Many point-to-point motions evaluated with one call each power, not one by one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.profiles import PointToPoint

FloatArray = NDArray[np.float64]


def stacked_angles(motions: Sequence[PointToPoint], times: Sequence[FloatArray]) -> FloatArray:
    """Joint angles of many motions: what ``sample`` of each gives at its own times, end to end.

    Args:
        motions: at least one.
        times: one array (k,) a motion, rising, the last one its duration [s].

    Returns:
        (Σ k, n) [rad].
    """
    counts = np.array([len(time) for time in times])
    start, end = np.array([m.start for m in motions]), np.array([m.end for m in motions])
    owner = np.repeat(np.arange(len(motions)), counts)
    ways = [motion.way for motion in motions]
    pieces = np.cumsum([0, *(0 if way is None else len(way.coefficients) for way in ways)])
    time = np.concatenate(times)
    gone = np.zeros((len(time), start.shape[1]))
    if pieces[-1]:
        piece = np.minimum(pieces[owner], pieces[-1] - 1)
        for first, way, low in zip(pieces, ways, np.cumsum(counts) - counts, strict=False):
            if way is not None and len(way.coefficients) > 1:
                part = slice(low, low + counts[owner[low]])
                piece[part] = first + np.searchsorted(way.breaks[1:-1], time[part])
        gone = _evaluated([way for way in ways if way is not None], piece, time)
        gone[np.array([way is None for way in ways])[owner]] = 0.0
    q = np.clip(start[owner] + gone, np.minimum(start, end)[owner], np.maximum(start, end)[owner])
    q[np.cumsum(counts) - 1] = end
    return q


def _evaluated(ways: Sequence[PiecewisePolynomial], piece: NDArray[np.intp], time: FloatArray) -> FloatArray:
    """(m, n) values: sample i by the piece number ``piece[i]`` of all pieces of all ways."""
    size = max(way.coefficients.shape[1] for way in ways)
    coefficients = np.concatenate(
        [np.pad(w.coefficients, ((0, 0), (0, size - w.coefficients.shape[1]), (0, 0))) for w in ways]
        if any(way.coefficients.shape[1] != size for way in ways)
        else [way.coefficients for way in ways]
    )
    x = (time - np.concatenate([way.breaks[:-1] for way in ways])[piece])[:, None]
    out = coefficients[piece, size - 1]
    for power in reversed(range(size - 1)):
        out *= x
        out += coefficients[piece, power]
    return out
