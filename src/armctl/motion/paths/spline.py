"""A smooth path through configurations: a cubic spline, continuous in slope and curvature."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lapack

from armctl.errors import InputError
from armctl.motion.polynomial import PiecewisePolynomial

FloatArray = NDArray[np.float64]
_SAME = 1e-12


def spline_through(points: ArrayLike, weights: ArrayLike | None = None) -> PiecewisePolynomial:
    """The cubic spline through points, in the order given.

    The path variable between two points is the largest weighted way of a coordinate, so that a joint with
    a long way does not overshoot beside a short one. At both ends the third derivative is continuous
    across the second point ("not a knot"), so that samples of a smooth curve are met to fourth order.
    Points that follow on themselves count once.

    Args:
        points: (k, n), at least two that differ.
        weights: (n,) of the coordinates, positive, e.g. one over each joint's largest speed: the path
            variable is then the least time in seconds. None: all 1.

    Raises:
        InputError: a wrong shape, a value that is not finite, or fewer than two points that differ.
    """
    p = np.array(points, dtype=np.float64)
    if p.ndim != 2 or p.size == 0 or not np.isfinite(p).all():
        raise InputError(f"a spline needs points (k, n) of finite numbers, got the shape {p.shape}")
    step = p[1:] - p[:-1]
    way = np.abs(step if weights is None else step * np.asarray(weights)).max(axis=1, initial=0.0)
    moves = way > _SAME
    if not moves.all():
        p, way = p[np.append(True, moves)], way[moves]
        step = p[1:] - p[:-1]
    if len(p) < 2:
        raise InputError("a spline needs at least two points that differ")
    inverse = 1.0 / way[:, None]
    chord = step * inverse
    slope = _slopes(way, chord)
    # Hermite's form: value, slope, and what is left for the two higher powers
    c = np.empty((len(way), 4, p.shape[1]))
    c[:, 0], c[:, 1] = p[:-1], slope[:-1]
    early, late = (chord - slope[:-1]) * inverse, (slope[1:] - chord) * inverse
    c[:, 2] = 2 * early - late
    c[:, 3] = (late - early) * inverse
    return PiecewisePolynomial(np.concatenate([[0.0], way.cumsum()]), c)


def _slopes(h: FloatArray, chord: FloatArray) -> FloatArray:
    """(k, n) slopes at the points, from the widths h (k - 1,) and the slopes of the chords (k - 1, n)."""
    k = len(h) + 1
    if k == 2:
        return np.repeat(chord, 2, axis=0)
    if k == 3:  # one parabola through all three
        middle = (h[1] * chord[0] + h[0] * chord[1]) / (h[0] + h[1])
        return np.stack([2 * chord[0] - middle, middle, 2 * chord[1] - middle])
    # de Boor, A Practical Guide to Splines, chapter IV: continuous curvature at the inner points ...
    h0, h1, h2, h3 = float(h[0]), float(h[1]), float(h[-2]), float(h[-1])
    first, last = h0 + h1, h2 + h3
    lower, upper, middle = np.append(h[1:], last), np.append(first, h[:-1]), np.empty(k)
    middle[0], middle[-1] = h1, h2
    middle[1:-1] = 2 * (h[:-1] + h[1:])
    right = np.empty((k, chord.shape[1]), order="F")
    right[1:-1] = 3 * (h[1:, None] * chord[:-1] + h[:-1, None] * chord[1:])
    # ... and one cubic over the first two pieces and over the last two
    right[0] = (h0 + 2 * first) * h1 / first * chord[0] + h0**2 / first * chord[1]
    right[-1] = h3**2 / last * chord[-2] + (2 * last + h3) * h2 / last * chord[-1]
    return _tridiagonal(lower, middle, upper, right)


def _tridiagonal(lower: FloatArray, middle: FloatArray, upper: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a tridiagonal system for several right sides (k, n)."""
    dgtsv = cast("Callable[..., tuple[FloatArray, ...]]", lapack.dgtsv)  # pyright: ignore
    *_, solution, info = dgtsv(lower, middle, upper, right)
    if info:
        raise InputError("the points of a spline lie too unevenly: their distances differ too much")
    return solution
