"""Polynomials in pieces: what paths and motions are made of. Derivatives and extremes are exact."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError

FloatArray = NDArray[np.float64]
_BISECTIONS = 30
"""A turning point found to 1e-9 of its piece gives a value that is exact to rounding."""


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
        self._inner = x[1:-1]
        self._powers = np.ascontiguousarray(np.moveaxis(c, 1, 0))

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
            powers = self._powers[:, 0]
            h = x - self.breaks[0]
        else:
            piece = np.searchsorted(self._inner, x, side="left")
            powers = self._powers.take(piece, axis=1)
            h = x - self.breaks[piece]
        h = h[..., None]
        return np.stack([_horner(powers, h, k) for k in range(order + 1)])

    def derivative(self) -> PiecewisePolynomial:
        """The derivative as a polynomial of its own."""
        return PiecewisePolynomial(self.breaks, _derived(self.coefficients))

    def scaled(self, factor: float) -> PiecewisePolynomial:
        """The same curve over a variable that is ``factor`` times as long; positive."""
        powers = factor ** -np.arange(self.coefficients.shape[1], dtype=np.float64)
        breaks = self.breaks * factor
        rises = np.diff(breaks) > 0  # a piece of a rounding may vanish
        return PiecewisePolynomial(
            np.append(breaks[:-1][rises], breaks[-1]), self.coefficients[rises] * powers[:, None]
        )

    def refined(self, parts: int) -> PiecewisePolynomial:
        """The same curve with each piece cut into equal parts."""
        if parts == 1:
            return self
        shares = np.arange(parts) / parts
        widths = np.diff(self.breaks)
        inner = (self.breaks[:-1, None] + widths[:, None] * shares).ravel()
        return self.cut(np.append(inner, self.breaks[-1]))

    def cut(self, breaks: FloatArray) -> PiecewisePolynomial:
        """The same curve over other breaks: inside its own ones, and holding all of its own between them.

        Args:
            breaks: (m + 1,), rising, within ``low ... high``.

        Raises:
            InputError: a break outside.
        """
        if breaks[0] < self.breaks[0] or breaks[-1] > self.breaks[-1]:
            raise InputError(f"a polynomial over {self.low} … {self.high} cannot be cut at {breaks}")
        middle = 0.5 * (breaks[:-1] + breaks[1:])
        piece = np.searchsorted(self.breaks[1:-1], middle, side="left")
        c = np.moveaxis(self.coefficients[piece], 1, 0)
        shift = (breaks[:-1] - self.breaks[piece])[:, None]
        # Taylor's series about the new beginnings
        shifted = [_horner(c, shift, k) / math.factorial(k) for k in range(len(c))]
        return PiecewisePolynomial(breaks, np.stack(shifted, axis=1))

    def followed_by(self, other: PiecewisePolynomial) -> PiecewisePolynomial:
        """This curve, then another of as many coordinates, over variables that follow on."""
        degree = max(self.coefficients.shape[1], other.coefficients.shape[1])
        parts = [
            np.pad(c, ((0, 0), (0, degree - c.shape[1]), (0, 0)))
            for c in (self.coefficients, other.coefficients)
        ]
        breaks = np.append(self.breaks, self.breaks[-1] + (other.breaks[1:] - other.breaks[0]))
        return PiecewisePolynomial(breaks, np.concatenate(parts))

    def extremes(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest values (n,) each, over the whole of it."""
        low, high = self.extremes_by_piece()
        return low.min(axis=0), high.max(axis=0)

    def extremes_by_piece(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest values (k, n) each, of every piece."""
        unit = self._unit()
        at = _turning_points(unit)
        values = _horner(np.moveaxis(unit, 1, 0), at, 0)
        return values.min(axis=0), values.max(axis=0)

    def bounds_by_piece(self) -> tuple[FloatArray, FloatArray]:
        """What the values (k, n) of every piece never go below and above; cheap, and close for short pieces.

        A polynomial lies between the smallest and the largest of its Bernstein coefficients.
        """
        control = np.einsum("ip,kpn->ikn", _bernstein(self.coefficients.shape[1]), self._unit())
        return control.min(axis=0), control.max(axis=0)

    def bound_by_piece(self) -> FloatArray:
        """What the values without sign (k, n) of every piece never go above."""
        low, high = self.bounds_by_piece()
        return np.maximum(-low, high)

    def _unit(self) -> FloatArray:
        """Coefficients (k, degree + 1, n) over 0 ... 1 in each piece."""
        powers: FloatArray = np.diff(self.breaks)[:, None] ** np.arange(
            self.coefficients.shape[1], dtype=np.float64
        )
        return self.coefficients * powers[:, :, None]


def _horner(c: FloatArray, h: FloatArray, order: int) -> FloatArray:
    """The ``order``-th derivative; ``c`` (degree + 1, ..., n), lowest power first."""
    degree = len(c) - 1
    if order >= degree:
        flat = np.zeros(np.broadcast_shapes(c.shape[1:], h.shape))
        return flat + math.perm(degree, order) * c[degree] if order == degree else flat
    value = h * c[degree] if order == 0 else h * (math.perm(degree, order) * c[degree])
    for p in range(degree - 1, order, -1):
        value += c[p] if order == 0 else math.perm(p, order) * c[p]
        value *= h
    value += math.perm(order, order) * c[order]
    return value


@cache
def _bernstein(size: int) -> FloatArray:
    """(size, size) from powers over 0 ... 1 to Bernstein coefficients."""
    degree = size - 1
    rows = [[math.comb(i, p) / math.comb(degree, p) for p in range(size)] for i in range(size)]
    matrix = np.array(rows)
    matrix.flags.writeable = False
    return matrix


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
        inside = (np.abs(slope[:, 0]) <= np.abs(slope[:, 1])) & (slope[:, 1] != 0.0)
        turn = np.divide(-slope[:, 0], slope[:, 1], out=np.zeros_like(c[:, 0]), where=inside)
        return np.concatenate([ends, np.clip(turn, 0.0, 1.0)[None]])
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
