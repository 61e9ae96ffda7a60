"""Polynomials in pieces: what paths and motions are made of. Derivatives and extremes are exact."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError

FloatArray = NDArray[np.float64]
_BISECTIONS, _POLISHES = 12, 3
"""A turning point found to 1e-8 of its piece gives a value that is exact to rounding."""
_FLAT = 1e-300


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
        if not (x[1:] > x[:-1]).all():
            raise InputError("the breaks of a polynomial must rise")
        x.flags.writeable = c.flags.writeable = False
        self.breaks = x
        """(k + 1,)"""
        self.coefficients = c
        """(k, degree + 1, n)"""
        self._inner = x[1:-1]
        self._powers = np.ascontiguousarray(c.transpose(1, 0, 2))

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
        x = np.asarray(x, dtype=np.float64)
        x = np.minimum(np.maximum(x, self.breaks[0]), self.breaks[-1])
        piece = self._inner.searchsorted(x)
        powers = self._powers.take(piece, axis=1)
        # once for each coordinate, so that all that follows runs over whole arrays
        h = (x - self.breaks.take(piece))[..., None].repeat(self.n, axis=-1)
        values = np.empty((order + 1, *h.shape))
        for k in range(order + 1):
            _horner(powers, h, k, values[k])
        return values

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
        control = np.einsum("ip,kpn->ikn", _bernstein(unit.shape[1]), unit)
        low, high = np.minimum(control[0], control[-1]), np.maximum(control[0], control[-1])
        # only where a control point lies beyond both ends can the curve turn within the piece
        turning = ((control < low) | (control > high)).any(axis=0)
        if turning.any():
            form = unit.transpose(1, 0, 2)[:, turning]
            values = _horner(form, _turning_points(form), 0)
            low[turning] = np.minimum(low[turning], values.min(axis=0))
            high[turning] = np.maximum(high[turning], values.max(axis=0))
        return low, high

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


def _horner(c: FloatArray, h: FloatArray, order: int, out: FloatArray | None = None) -> FloatArray:
    """The ``order``-th derivative; ``c`` (degree + 1, ..., n), lowest power first."""
    degree = len(c) - 1
    value = np.empty(np.broadcast_shapes(c.shape[1:], h.shape)) if out is None else out
    if order >= degree:
        value[...] = math.perm(degree, order) * c[degree]  # 0 where the order is beyond the degree
        return value
    np.multiply(c[degree], h, out=value)
    if order == 0:
        for p in range(degree - 1, 0, -1):
            value += c[p]
            value *= h
        value += c[0]
        return value
    value *= math.perm(degree, order)
    for p in range(degree - 1, order, -1):
        value += math.perm(p, order) * c[p]
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
    """(m, k) where polynomials (degree + 1, k) on 0 ... 1 can be largest or smallest: the ends and between.

    Between the turning points of the derivative, the derivative is monotonous: one sign change at most in
    each stretch, found by bisection and polished. Down to a parabola, this needs no special case.
    """
    ends = np.stack([np.zeros_like(c[0]), np.ones_like(c[0])])
    if len(c) <= 2:
        return ends
    slope = c[1:] * np.arange(1, len(c), dtype=np.float64)[:, None]
    if len(slope) <= 3:
        return np.concatenate([ends, _parabola_roots(*slope)])
    grid = np.sort(_turning_points(slope), axis=0)
    low, high = grid[:-1].copy(), grid[1:].copy()
    rising = _horner(slope, high, 0) >= _horner(slope, low, 0)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        left = (_horner(slope, middle, 0) >= 0) == rising
        high = np.where(left, middle, high)
        low = np.where(left, low, middle)
    root = 0.5 * (low + high)
    for _ in range(_POLISHES):
        rise = _horner(slope, root, 1)
        step = np.divide(_horner(slope, root, 0), rise, out=np.zeros_like(root), where=np.abs(rise) > _FLAT)
        root = np.clip(root - step, low, high)
    return np.concatenate([ends, root])


def _parabola_roots(c0: FloatArray, c1: FloatArray, c2: FloatArray | None = None) -> FloatArray:
    """(2, k) where ``c0 + c1 x + c2 x²`` changes its sign on 0 ... 1; an end where it does not."""
    a = np.zeros_like(c1) if c2 is None else c2
    square = c1 * c1 - 4 * a * c0
    far = -0.5 * (c1 + np.copysign(np.sqrt(np.maximum(square, 0.0)), c1))  # no two alike are subtracted
    roots: list[FloatArray] = []
    for above, below in ((far, a), (c0, far)):
        inside = (square >= 0) & (np.abs(above) <= np.abs(below)) & (below != 0.0)
        roots.append(np.clip(np.divide(above, below, out=np.zeros_like(c1), where=inside), 0.0, 1.0))
    return np.stack(roots)
