"""Polynomials in pieces: what paths and motions are made of. Derivatives and extremes are exact."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError

FloatArray = NDArray[np.float64]
_SECTIONS, _SECTIONINGS, _POLISHES = 16, 3, 3
"""A turning point found to 1e-8 of its piece gives a value that is exact to rounding."""
_INNER = np.arange(1.0, _SECTIONS)[:, None, None]
_FLAT = 1e-300
_MANY = 4
"""rising places that are this many times as many as the pieces are sorted into these all at once"""


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
        c = np.asarray(coefficients, dtype=np.float64)
        if x.ndim != 1 or c.ndim != 3 or len(c) == 0 or len(x) != len(c) + 1 or c.shape[1] == 0:
            raise InputError(f"{len(x)} breaks do not fit coefficients of shape {c.shape}")
        pieces, size, n = c.shape
        table = np.empty((size + 1, n, pieces))
        table[:size], table[size] = c.transpose(1, 2, 0), x[:-1]
        if not (_all(np.isfinite(table)) and math.isfinite(x.item(-1))):
            raise InputError("the breaks and coefficients of a polynomial must be finite numbers")
        if not _all(x[1:] > x[:-1]):
            raise InputError("the breaks of a polynomial must rise")
        x.flags.writeable = table.flags.writeable = False
        self.breaks = x
        """(k + 1,)"""
        self.coefficients = table[:size].transpose(2, 0, 1)
        """(k, degree + 1, n)"""
        self._inner = x[1:-1]
        # (degree + 2, n, k): coefficients, and the beginning of the piece, which so is gathered with them
        self._table = table

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
        x = np.asarray(x, dtype=np.float64)
        powers, h = self._gathered(x)
        return _coordinates_last(_horner(powers, h, 0, powers[-1]), x.ndim)

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
        powers, h = self._gathered(x)
        # the coordinates before the places, so that all that follows runs over long rows
        values = np.empty((order + 1, self.n, *x.shape))
        for k in range(order + 1):
            _horner(powers, h, k, values[k])
        return _coordinates_last(values, x.ndim)

    def _gathered(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """For each place (...) the coefficients (degree + 1, n, ...) of its piece, and how far in it lies.

        This (n, ...) is the same for all coordinates: rows without a gap are multiplied fastest.
        """
        pieces = len(self._inner) + 1
        if x.ndim == 1 and x.size > _MANY * pieces and _all(x[1:] >= x[:-1]):
            if x.item(0) < self.low or x.item(-1) > self.high:
                x = self._held(x)
            # the breaks are found among the places, which are many more
            ends = np.empty(pieces + 1, dtype=np.intp)
            ends[0], ends[-1] = 0, x.size
            ends[1:-1] = x.searchsorted(self._inner, "right")
            found = self._table.repeat(ends[1:] - ends[:-1], axis=2)
        else:
            x = self._held(x)
            found = self._table.take(self._inner.searchsorted(x), axis=2)
        return found[:-1], np.subtract(x, found[-1], out=found[-1])

    def _held(self, x: FloatArray) -> FloatArray:
        """The places beyond an end moved to it."""
        return np.minimum(np.maximum(x, self.breaks[0]), self.breaks[-1])

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
        piece = self._inner.searchsorted(0.5 * (breaks[:-1] + breaks[1:]))
        c, begins = np.split(self._table.take(piece, axis=2), [-1])
        shift = breaks[:-1] - begins[0]
        # Taylor's series about the new beginnings, by dividing again and again
        for first in range(len(c) - 1):
            for p in range(len(c) - 2, first - 1, -1):
                c[p] += shift * c[p + 1]
        return PiecewisePolynomial(breaks, c.transpose(2, 0, 1))

    def followed_by(self, *others: PiecewisePolynomial) -> PiecewisePolynomial:
        """This curve, then others of as many coordinates, over variables that follow on."""
        parts = [self, *others]
        size = max(part.coefficients.shape[1] for part in parts)
        c = np.zeros((sum(len(part.coefficients) for part in parts), size, self.n))
        breaks, at = [self.breaks[:1]], 0
        for part in parts:
            count, powers, _ = part.coefficients.shape
            c[at : at + count, :powers] = part.coefficients
            breaks.append(breaks[-1][-1] + (part.breaks[1:] - part.breaks[0]))
            at += count
        breaks[1] = self.breaks[1:]  # as they are, to the last digit
        return PiecewisePolynomial(np.concatenate(breaks), c)

    def extremes(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest values (n,) each, over the whole of it."""
        control, unit = self._control_points()
        ends = control[[0, -1]]
        # only what turns beyond all ends of pieces counts
        low, high = ends.min(axis=(0, 2)), ends.max(axis=(0, 2))
        low, high = _extremes(control, unit, low[:, None], high[:, None])
        return low.min(axis=1), high.max(axis=1)

    def extremes_by_piece(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest values (k, n) each, of every piece."""
        control, unit = self._control_points()
        begin, end = control[0], control[-1]
        low, high = _extremes(control, unit, np.minimum(begin, end), np.maximum(begin, end))
        return low.T, high.T

    def bounds_by_piece(self) -> tuple[FloatArray, FloatArray]:
        """What the values (k, n) of every piece never go below and above; cheap, and close for short pieces.

        A polynomial lies between the smallest and the largest of its Bernstein coefficients.
        """
        control, _ = self._control_points()
        return control.min(axis=0).T, control.max(axis=0).T

    def bound_by_piece(self) -> FloatArray:
        """What the values without sign (k, n) of every piece never go above."""
        control, _ = self._control_points()
        return np.abs(control).max(axis=0).T

    def _control_points(self) -> tuple[FloatArray, FloatArray]:
        """(degree + 1, n, k) Bernstein coefficients of each piece, and its powers over 0 ... 1."""
        c = self._table[:-1]
        widths = np.ones((len(c), c.shape[2]))
        widths[1:] = self.breaks[1:] - self.breaks[:-1]
        unit = c * np.multiply.accumulate(widths)[:, None]
        return (_bernstein(len(c)) @ unit.reshape(len(c), -1)).reshape(c.shape), unit


def _extremes(
    control: FloatArray, unit: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Smallest and largest values (n, k) of pieces (degree + 1, n, k), and of what is known to be met."""
    turning = ((control < low) | (control > high)).any(axis=0)
    low, high = (np.array(np.broadcast_to(known, turning.shape)) for known in (low, high))
    if turning.any():  # nowhere else can a piece go beyond what is known
        form = unit[:, turning]
        values = _horner(form, _turning_points(form), 0)
        low[turning] = np.minimum(low[turning], values.min(axis=0))
        high[turning] = np.maximum(high[turning], values.max(axis=0))
    return low, high


def _all(truths: NDArray[np.bool_]) -> bool:
    return np.count_nonzero(truths) == truths.size  # four times as quick as ``all``


def _coordinates_last(values: FloatArray, places: int) -> FloatArray:
    """Values (..., n, *places) as (..., *places, n)."""
    if places <= 1:
        return values.swapaxes(-1, -2) if places else values
    return np.moveaxis(values, -places - 1, -1)


def _horner(c: FloatArray, h: FloatArray, order: int, out: FloatArray | None = None) -> FloatArray:
    """The ``order``-th derivative; ``c`` (degree + 1, ..., n), lowest power first."""
    degree = len(c) - 1
    if order >= degree:
        value = np.empty(np.broadcast_shapes(c.shape[1:], h.shape)) if out is None else out
        value[...] = math.perm(degree, order) * c[degree]  # 0 where the order is beyond the degree
        return value
    value = np.multiply(c[degree], h, out=out)
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
    each stretch, found by cutting it into ever smaller parts, and polished. Down to a parabola, this needs
    no special case.
    """
    ends = np.stack([np.zeros_like(c[0]), np.ones_like(c[0])])
    if len(c) <= 2:
        return ends
    slope = c[1:] * np.arange(1, len(c), dtype=np.float64)[:, None]
    if len(slope) <= 3:
        return np.concatenate([ends, _parabola_roots(*slope)])
    grid = np.sort(_turning_points(slope), axis=0)
    low, width = grid[:-1], grid[1:] - grid[:-1]
    rising = _horner(slope, grid[1:], 0) >= _horner(slope, low, 0)
    for _ in range(_SECTIONINGS):
        width = width / _SECTIONS
        before = (_horner(slope, low + width * _INNER, 0) < 0) == rising
        low = low + width * np.count_nonzero(before, axis=0)
    high = low + width
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
