"""Polynomials in pieces: what paths and motions are made of. Derivatives and extremes are exact."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError

FloatArray = NDArray[np.float64]
_BISECTIONS = 52


class PiecewisePolynomial:
    """n coordinates as polynomials of one variable, with the same breaks for all. Immutable.

    Between ``breaks[i]`` and ``breaks[i + 1]`` the coordinates are
    ``sum_p coefficients[i, p] * (x - breaks[i]) ** p``. Outside the breaks it holds the nearer end.
    """

    def __init__(self, breaks: ArrayLike, coefficients: ArrayLike) -> None:
        """Take both as they are.

        Args:
            breaks: (k + 1,), rising.
            coefficients: (k, degree + 1, n), lowest power first.

        Raises:
            InputError: shapes that do not match, breaks that do not rise, or a value that is not finite.
        """
        x = np.array(breaks, dtype=np.float64)
        c = np.array(coefficients, dtype=np.float64)
        if x.ndim != 1 or c.ndim != 3 or len(c) == 0 or len(x) != len(c) + 1 or c.shape[1] == 0:
            raise InputError(f"{len(x)} breaks do not fit coefficients of shape {c.shape}")
        if not (np.isfinite(x).all() and np.isfinite(c).all()):
            raise InputError("the breaks and coefficients of a polynomial must be finite numbers")
        if not (np.diff(x) > 0).all():
            raise InputError("the breaks of a polynomial must rise")
        x.flags.writeable = c.flags.writeable = False
        self.breaks = x
        """(k + 1,)"""
        self.coefficients = c
        """(k, degree + 1, n)"""

    @property
    def low(self) -> float:
        """Where it begins."""
        return float(self.breaks[0])

    @property
    def high(self) -> float:
        """Where it ends."""
        return float(self.breaks[-1])

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return self.coefficients.shape[2]

    def __call__(self, x: ArrayLike) -> FloatArray:
        """Values (..., n) at ``x`` (...)."""
        return self.derivatives(x, 0)[0]

    def derivatives(self, x: ArrayLike, order: int) -> FloatArray:
        """Value and derivatives.

        At a break the piece before it counts, at the very beginning the first piece.

        Args:
            x: (...) where; beyond an end, the end.
            order: the highest derivative, 0 for the value alone.

        Returns:
            (order + 1, ..., n).
        """
        x = np.clip(np.asarray(x, dtype=np.float64), self.breaks[0], self.breaks[-1])
        if len(self.coefficients) == 1:
            c = self.coefficients[0]
            h = x - self.breaks[0]
        else:
            piece = np.searchsorted(self.breaks[1:-1], x, side="left")
            c = np.moveaxis(self.coefficients[piece], -2, 0)
            h = x - self.breaks[piece]
        h = h[..., None]
        return np.stack([_horner(c, h, k) for k in range(order + 1)])

    def derivative(self) -> PiecewisePolynomial:
        """The derivative as a polynomial of its own."""
        return PiecewisePolynomial(self.breaks, _derived(self.coefficients))

    def scaled(self, factor: float) -> PiecewisePolynomial:
        """The same curve over a variable that is ``factor`` times as long; positive."""
        powers = factor ** -np.arange(self.coefficients.shape[1], dtype=np.float64)
        return PiecewisePolynomial(self.breaks * factor, self.coefficients * powers[:, None])

    def extremes(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest values (n,) each, over the whole of it."""
        low, high = self.extremes_by_piece()
        return low.min(axis=0), high.max(axis=0)

    def extremes_by_piece(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest values (k, n) each, of every piece."""
        widths = np.diff(self.breaks)
        # on 0 ... 1 in each piece, so that all pieces are alike
        unit = self.coefficients * widths[:, None, None] ** np.arange(self.coefficients.shape[1])[:, None]
        at = _turning_points(unit)
        values = _horner(np.moveaxis(unit, 1, 0), at, 0)
        return values.min(axis=0), values.max(axis=0)


def _horner(c: FloatArray, h: FloatArray, order: int) -> FloatArray:
    """The ``order``-th derivative; ``c`` (degree + 1, ..., n), lowest power first."""
    degree = len(c) - 1
    value = np.zeros(np.broadcast_shapes(c.shape[1:], h.shape))
    for p in range(degree, order - 1, -1):
        falling = 1.0
        for k in range(order):
            falling *= p - k
        value = value * h + falling * c[p]
    return value


def _derived(c: FloatArray) -> FloatArray:
    """Coefficients of the derivative; (k, degree + 1, n) to (k, max(degree, 1), n)."""
    if c.shape[1] == 1:
        return np.zeros_like(c)
    return c[:, 1:] * np.arange(1, c.shape[1], dtype=np.float64)[:, None]


def _turning_points(c: FloatArray) -> FloatArray:
    """(m, k, n) where polynomials on 0 ... 1 can be largest or smallest: the ends and between.

    Between the turning points of the derivative, the derivative is monotonous: one sign change at most in
    each stretch, found by bisection. Down to a straight line, this needs no special case.
    """
    ends = np.stack([np.zeros_like(c[:, 0]), np.ones_like(c[:, 0])])
    slope = _derived(c)
    if c.shape[1] <= 2:
        return ends
    if slope.shape[1] == 2:
        bend = np.where(slope[:, 1] == 0, 1.0, slope[:, 1])
        return np.concatenate([ends, np.clip(-slope[:, 0] / bend, 0.0, 1.0)[None]])
    grid = np.sort(_turning_points(slope), axis=0)
    low, high = grid[:-1].copy(), grid[1:].copy()
    form = np.moveaxis(slope, 1, 0)
    rising = _horner(form, high, 0) >= _horner(form, low, 0)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        left = (_horner(form, middle, 0) >= 0) == rising
        high = np.where(left, middle, high)
        low = np.where(left, low, middle)
    return np.concatenate([ends, 0.5 * (low + high)])
