"""A smooth path through configurations: a cubic spline, continuous in slope and curvature."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lapack

from armctl.errors import InputError
from armctl.motion.polynomial import PiecewisePolynomial

FloatArray = NDArray[np.float64]
_SAME = 1e-12
_EVEN = 1e-12
"""widths that differ by no larger share than this count as one: far below any other rounding of a path"""
_EVEN_POINTS = 128
"""most points for which the spline through evenly spread ones is kept as a matrix of up to 0.5 MB"""
_TOO_FEW = "a spline needs at least two points that differ"


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
    p = np.asarray(points, dtype=np.float64)
    if p.ndim != 2 or p.size == 0 or np.count_nonzero(np.isfinite(p)) < p.size:
        raise InputError(f"a spline needs points (k, n) of finite numbers, got the shape {p.shape}")
    if len(p) < 2:
        raise InputError(_TOO_FEW)
    p = p.T  # coordinates first, so that all that follows runs over long rows
    ways = np.abs(p[:, 1:] - p[:, :-1])
    if weights is not None:
        ways *= _checked_weights(weights, len(p))[:, None]
    way = np.maximum.reduce(ways)
    least, most = _range(way)
    if least <= _SAME:
        moves = way > _SAME
        p, way = p[:, np.append(True, moves)], way[moves]
        if not len(way):
            raise InputError(_TOO_FEW)
        least, most = _range(way)
    breaks = np.zeros(len(way) + 1)
    np.add.accumulate(way, out=breaks[1:])
    even = most - least <= _EVEN * most and len(way) < _EVEN_POINTS
    c = _coefficients_even(most, p) if even else _coefficients(way, p)
    return PiecewisePolynomial(breaks, c.transpose(2, 0, 1))


def _checked_weights(weights: ArrayLike, count: int) -> FloatArray:
    """One positive number a coordinate (count,)."""
    checked = np.asarray(weights, dtype=np.float64)
    if checked.shape != (count,) or not ((checked > 0.0) & (checked < np.inf)).all():
        raise InputError(f"a spline of {count} coordinates needs {count} positive weights, got {weights!r}")
    return checked


def _range(values: FloatArray) -> tuple[float, float]:
    return np.minimum.reduce(values).item(), np.maximum.reduce(values).item()


def _coefficients_even(h: float, p: FloatArray) -> FloatArray:
    """As ``_coefficients`` where all widths are the same: they hang together linearly with the points."""
    c = p @ _even(p.shape[1])
    c *= np.array([[[1.0]], [[1.0 / h]], [[h**-2]], [[h**-3]]])
    return c


@lru_cache(maxsize=4)
def _even(k: int) -> FloatArray:
    """(4, k, k - 1) the coefficients that each of k points brings with it where all widths are 1."""
    matrix = _coefficients(np.ones(k - 1), np.eye(k))
    matrix.flags.writeable = False
    return matrix


def _coefficients(h: FloatArray, p: FloatArray) -> FloatArray:
    """(4, n, k - 1), lowest power first, from the widths h (k - 1,) between the points p (n, k).

    With a sixth of the curvature, ``early`` and ``late``, at its two ends, a piece is
    ``p + x (chord - h (2 early + late)) + 3 x² early + x³ (late - early) / h``.
    """
    inverse = 1.0 / h
    chord = (p[:, 1:] - p[:, :-1]) * inverse
    sixth = _sixths_of_curvature(h, chord)
    early, late = sixth[:, :-1], sixth[:, 1:]
    c = np.empty((4, *chord.shape))
    c[0] = p[:, :-1]
    slope = np.add(early, early, out=c[1])
    slope += late
    slope *= h
    np.subtract(chord, slope, out=slope)
    np.multiply(early, 3.0, out=c[2])
    cube = np.subtract(late, early, out=c[3])
    cube *= inverse
    return c


def _sixths_of_curvature(h: FloatArray, chord: FloatArray) -> FloatArray:
    """A sixth of the second derivative (n, k) at the points; h (k - 1,) widths, chord (n, k - 1) slopes."""
    n, k = len(chord), len(h) + 1
    if k == 2:
        return np.zeros((n, k))
    if k == 3:  # one parabola through all three
        return np.repeat((chord[:, 1:] - chord[:, :1]) / (3.0 * (h[0] + h[1])), 3, axis=1)
    # de Boor, A Practical Guide to Splines, chapter IV: continuous slope at the inner points ...
    lower, upper, middle, right = h.copy(), h.copy(), np.empty(k), np.empty((n, k))
    inner = np.add(h[1:], h[:-1], out=middle[1:-1])
    inner += inner
    np.subtract(chord[:, 1:], chord[:, :-1], out=right[:, 1:-1])
    # ... and one cubic over the first two pieces and over the last two, less a multiple of the row beside
    first, second, before, last = h.item(0), h.item(1), h.item(-2), h.item(-1)
    middle[0], upper[0] = second - first, -(2.0 * first + second)
    middle[-1], lower[-1] = before - last, -(2.0 * last + before)
    np.multiply(right[:, 1], -first / (first + second), out=right[:, 0])
    np.multiply(right[:, -2], -last / (last + before), out=right[:, -1])
    return _tridiagonal(lower, middle, upper, right.T).T


def _tridiagonal(lower: FloatArray, middle: FloatArray, upper: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a tridiagonal system for several right sides (k, n); all four are used up."""
    dgtsv = cast("Callable[..., tuple[FloatArray, ...]]", lapack.dgtsv)  # pyright: ignore
    *_, solution, info = dgtsv(lower, middle, upper, right, 1, 1, 1, 1)
    if info:
        raise InputError("the points of a spline lie too unevenly: their distances differ too much")
    return solution


# The one polynomial of fifth degree with value, slope and curvature given at both ends.


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
