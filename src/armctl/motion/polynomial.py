"""Piecewise polynomials, of which paths and motions are made. Derivatives and extremes are exact."""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import cache
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import ByContent, FloatArray
from armctl.errors import InputError
from armctl.kinematics.target import as_numbers

_NEGLIGIBLE = 1e-14
"""A coefficient that is a smaller share of the largest one counts as 0."""
_JUMP = 1e-6
"""A smaller share of the largest value is no jump."""
_FEW = 256
"""points, of which value and derivatives are worked out in one pass"""
MOST_COEFFICIENTS = 12
"""of a piece: a spline has 4, a law of least jerk 6; extremes of one of degree 1,000 take minutes"""


class PiecewisePolynomial(ByContent):
    """n coordinates, ``sum_p coefficients[i, p] * (x - breaks[i]) ** p`` in piece i. Immutable.

    Outside the breaks it holds the nearer end.
    """

    def __init__(self, breaks: ArrayLike, coefficients: ArrayLike) -> None:
        """Copies breaks (k + 1,), rising, and coefficients (k, degree + 1, n), lowest power first.

        ``InputError``: they do not fit, are not finite, or a piece has more than ``MOST_COEFFICIENTS``.
        """
        x, c = as_numbers(breaks, "breaks"), as_numbers(coefficients, "coefficients")
        if x.ndim != 1 or c.ndim != 3 or len(c) == 0 or len(x) != len(c) + 1 or c.shape[1] == 0:
            raise InputError(f"breaks of shape {x.shape} do not fit coefficients of shape {c.shape}")
        if c.shape[1] > MOST_COEFFICIENTS:
            raise InputError(
                f"a piece of a polynomial has {c.shape[1]} coefficients, {MOST_COEFFICIENTS} at most; "
                "make it of more pieces of a lower degree"
            )
        if not (np.isfinite(c).all() and np.isfinite(x).all()):
            raise InputError("the breaks and coefficients of a polynomial must be finite numbers")
        if not (x[1:] > x[:-1]).all():
            raise InputError("the breaks of a polynomial must rise")
        x.flags.writeable = c.flags.writeable = False
        self.breaks = x
        """(k + 1,)"""
        self.coefficients = c
        """(k, degree + 1, n)"""
        self.low, self.high = float(x[0]), float(x[-1])
        """where it begins and ends"""
        self._breaks: list[float] = x.tolist()
        self._known: tuple[int, int, list[FloatArray]] = (-1, -1, [])
        """of the piece that was asked for last: which, up to which derivative, and their coefficients"""
        self.n = c.shape[2]
        """number of coordinates"""

    def made_of(self) -> tuple[FloatArray, FloatArray]:
        """See ``ByContent``."""
        return self.breaks, self.coefficients

    def __repr__(self) -> str:
        pieces, size, n = self.coefficients.shape
        what = f"{pieces} piece{'' if pieces == 1 else 's'} of degree {size - 1}"
        return f"PiecewisePolynomial({what} over {self.low:.6g} … {self.high:.6g}, {n} coordinates)"

    def __call__(self, x: ArrayLike) -> FloatArray:
        """Values (..., n) at ``x`` (...)."""
        return self.derivatives(x, 0)[0]

    def derivatives(self, x: ArrayLike, order: int) -> FloatArray:
        """(order + 1, ..., n) value and derivatives at ``x`` (...); beyond an end, those of the end.

        At a break the piece before it counts, at the very beginning the first piece.
        """
        if type(x) is float:
            return self._derivatives_at(min(max(x, self.low), self.high), order)
        x = np.minimum(np.maximum(np.asarray(x, dtype=np.float64), self.low), self.high)
        piece = self.breaks[1:-1].searchsorted(x)
        c = self.coefficients.swapaxes(0, 1)[:, piece]  # (degree + 1, ..., n)
        h = (x - self.breaks[piece])[..., None]
        if x.size <= _FEW:
            return _together(c, h, order)
        values = np.zeros((order + 1, *x.shape, self.n))
        for k in range(min(order + 1, len(c))):
            values[k] = _horner(c, h)
            c = _derived(c)
        return values

    def _derivatives_at(self, x: float, order: int) -> FloatArray:
        """(order + 1, n) at one place: a tick asks for it, in the same piece as the one before."""
        places, known = self._breaks, self._known
        piece = bisect_left(places, x, 1, len(places) - 1) - 1
        if known[:2] != (piece, order):
            which, factors = _derivations(self.coefficients.shape[1], order)
            known = piece, order, [*(self.coefficients[piece][which] * factors[..., None])[::-1]]
            self._known = known
        (highest, *lower), h = known[2], x - places[piece]
        value: FloatArray = highest + 0.0
        for power in lower:
            value *= h
            value += power
        return value

    def derivative(self) -> PiecewisePolynomial:
        """The derivative as a polynomial of its own."""
        c = _derived(self.coefficients.swapaxes(0, 1)).swapaxes(0, 1)
        return PiecewisePolynomial(self.breaks, c if c.shape[1] else np.zeros_like(self.coefficients))

    def scaled(self, factor: float) -> PiecewisePolynomial:
        """The same curve over a variable that is ``factor`` times as long; positive."""
        powers = factor ** -np.arange(self.coefficients.shape[1], dtype=np.float64)
        breaks = self.breaks * factor
        rises = np.diff(breaks) > 0  # rounding may make a very short piece vanish
        return PiecewisePolynomial(
            np.append(breaks[:-1][rises], breaks[-1]), self.coefficients[rises] * powers[:, None]
        )

    def cut(self, breaks: FloatArray) -> PiecewisePolynomial:
        """The same curve over rising breaks (m + 1,) within it, which hold all of its own between them."""
        if breaks[0] < self.low or breaks[-1] > self.high:
            raise InputError(f"a polynomial over {self.low} … {self.high} cannot be cut at {breaks}")
        piece = self.breaks[1:-1].searchsorted(0.5 * (breaks[:-1] + breaks[1:]))
        c = self.coefficients[piece]
        shift = (breaks[:-1] - self.breaks[piece])[:, None]
        # Taylor's series about the new beginnings, by repeated synthetic division
        for first in range(c.shape[1] - 1):
            for p in range(c.shape[1] - 2, first - 1, -1):
                c[:, p] += shift * c[:, p + 1]
        return PiecewisePolynomial(breaks, c)

    def followed_by(self, *others: PiecewisePolynomial) -> PiecewisePolynomial:
        """This curve, then others of as many coordinates, over variables that follow on."""
        parts = [self, *others]
        size = max(part.coefficients.shape[1] for part in parts)
        c = [
            np.pad(part.coefficients, ((0, 0), (0, size - part.coefficients.shape[1]), (0, 0)))
            for part in parts
        ]
        breaks = [self.breaks]
        for part in others:
            breaks.append(breaks[-1][-1] + (part.breaks[1:] - part.low))
        return PiecewisePolynomial(np.concatenate(breaks), np.concatenate(c))

    def extremes(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest values (n,) each, over the whole of it."""
        low, high = self.extremes_by_piece()
        return low.min(axis=0), high.max(axis=0)

    def extremes_by_piece(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest values (k, n) each, of every piece."""
        control, unit = self._control_and_unit()
        ends = control[:, [0, -1]]
        low, high = ends.min(axis=1), ends.max(axis=1)
        # a piece can pass its ends only where a control point does
        i, j = np.nonzero((control.min(axis=1) < low) | (control.max(axis=1) > high))
        if len(i):
            inside = unit[i, :, j].T
            values = _horner(inside[:, None], _level_places(inside))
            low[i, j] = np.minimum(low[i, j], values.min(axis=0))
            high[i, j] = np.maximum(high[i, j], values.max(axis=0))
        return low, high

    def bounds_by_piece(self) -> tuple[FloatArray, FloatArray]:
        """What the values (k, n) of every piece never go below and above: Bernstein's; close if short."""
        control = self.control_points()
        return control.min(axis=1), control.max(axis=1)

    def bound_by_piece(self) -> FloatArray:
        """What the values without sign (k, n) of every piece never go above."""
        return np.abs(self.control_points()).max(axis=1)

    def is_smooth_from_rest(self) -> bool:
        """Whether its first two derivatives begin and end at 0, and the second never jumps."""
        rate = self.derivative()
        rates, pushes = rate.control_points(), rate.derivative().control_points()
        still = np.zeros((1, self.n))
        jumps = np.concatenate([pushes[:, 0], still]) - np.concatenate([still, pushes[:, -1]])
        ends = np.abs([rates[0, 0], rates[-1, -1]]).max()
        return bool(
            np.abs(jumps).max() <= _JUMP * np.abs(pushes).max() and ends <= _JUMP * np.abs(rates).max()
        )

    @property
    def is_straight(self) -> bool:
        """Whether it is one straight line."""
        return len(self.coefficients) == 1 and not self.coefficients[0, 2:].any()

    def slope_jumps(self) -> NDArray[np.bool_]:
        """(k - 1, n) whether the first derivative jumps at each inner break."""
        slope = self.derivative().control_points()
        return np.abs(slope[1:, 0] - slope[:-1, -1]) > _JUMP * np.abs(slope).max()

    def control_points(self) -> FloatArray:
        """(k, degree + 1, n) Bernstein coefficients: each piece lies between its least and its largest."""
        return self._control_and_unit()[0]

    def padded(self, size: int) -> PiecewisePolynomial:
        """The same curve with at least ``size`` coefficients a piece."""
        missing = max(size - self.coefficients.shape[1], 0)
        return PiecewisePolynomial(self.breaks, np.pad(self.coefficients, ((0, 0), (0, missing), (0, 0))))

    def _control_and_unit(self) -> tuple[FloatArray, FloatArray]:
        """(k, degree + 1, n) Bernstein coefficients of each piece, and its powers over 0 ... 1."""
        size = self.coefficients.shape[1]
        widths = np.power(np.diff(self.breaks)[:, None], np.arange(float(size)))
        unit = self.coefficients * widths[:, :, None]
        return _bernstein(size) @ unit, unit


def largest_by_order(c: FloatArray, orders: int) -> list[FloatArray]:
    """What the derivatives 1 … ``orders`` of polynomials over 0 … 1 never go above, without sign.

    ``c``: (degree + 1, ...) coefficients, lowest power first; a bound (...) for each order, Bernstein's.
    """
    found: list[FloatArray] = []
    for _ in range(orders):
        c = _derived(c) if len(c) > 1 else np.zeros_like(c)
        found.append(np.abs(np.tensordot(_bernstein(len(c)), c, axes=1)).max(axis=0))
    return found


def _level_places(c: FloatArray) -> FloatArray:
    """Where (p, m) in 0..1 polynomials with the coefficients ``c`` (degree + 1, m) may be level."""
    slope = _derived(c)
    slope[np.abs(slope) <= _NEGLIGIBLE * np.abs(slope).max(axis=0)] = 0.0
    if len(slope) > 3:
        places = np.zeros((len(slope) - 1, slope.shape[1]))
        for k, one in enumerate(slope.T):
            found = np.roots(one[::-1]).real
            places[: len(found), k] = found
    else:
        constant, once, twice = np.concatenate([slope, np.zeros((3 - len(slope), slope.shape[1]))])
        # the two roots without the difference of nearly equal numbers; of complex ones their real part
        q = -0.5 * (once + np.copysign(np.sqrt(np.maximum(once * once - 4 * twice * constant, 0.0)), once))
        with np.errstate(divide="ignore", invalid="ignore"):
            places = np.nan_to_num(np.stack([q / twice, constant / q]), posinf=0.0, neginf=0.0)
    return np.clip(places, 0.0, 1.0)


def _derived(c: FloatArray) -> FloatArray:
    """Coefficients of the derivative: (degree + 1, ...), lowest power first, to (degree, ...)."""
    return c[1:] * np.arange(1.0, len(c)).reshape(-1, *[1] * (c.ndim - 1))


def _together(c: FloatArray, x: FloatArray, order: int) -> FloatArray:
    """(order + 1, ...) values and derivatives: of few, the calls take longer than the numbers."""
    which, factors = _derivations(len(c), order)
    return _horner(c[which] * factors.reshape(*factors.shape, *[1] * (c.ndim - 1)), x)


@cache
def _derivations(size: int, order: int) -> tuple[NDArray[np.intp], FloatArray]:
    """Each (size, order + 1): from which power that of a derivative comes, and with which factor."""
    power, derived = np.ogrid[:size, : order + 1]
    factors = [[math.perm(p + k, k) * (p + k < size) for k in range(order + 1)] for p in range(size)]
    return np.minimum(power + derived, size - 1), np.array(factors, dtype=np.float64)


def _horner(c: FloatArray, x: FloatArray) -> FloatArray:
    """Values of polynomials with the coefficients ``c`` (degree + 1, ...), lowest power first."""
    value = c[-1] + np.zeros_like(x)
    for power in c[-2::-1]:
        value *= x
        value += power
    return value


@cache
def _bernstein(size: int) -> FloatArray:
    """(size, size) from powers over 0 ... 1 to Bernstein coefficients."""
    degree = size - 1
    rows = [[math.comb(i, p) / math.comb(degree, p) for p in range(size)] for i in range(size)]
    matrix = np.array(rows)
    matrix.flags.writeable = False
    return matrix


# Polynomials with given values.


def quintic(start: FloatArray, end: FloatArray) -> FloatArray:
    """(6, ..., n) the polynomial of fifth degree over 0 ... 1, lowest power first.

    ``start`` and ``end`` (3, ..., n): value, slope and curvature at 0 and at 1.
    """
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


_APART = 1e-6
"""a shorter way between two points of a spline is none, in its path variable: seconds, or radians"""


def points_apart(points: FloatArray, weights: ArrayLike | None = None) -> FloatArray:
    """(m, n) of points (k, n) those that a spline goes through, each apart from the one before it.

    ``weights`` as of ``spline_through``. The first and the last one are kept.
    """
    scale = 1.0 if weights is None else np.asarray(weights)
    last, kept = len(points) - 1, [0]

    def is_apart(k: int) -> bool:
        return float((np.abs(points[k] - points[kept[-1]]) * scale).max()) > _APART

    for k in range(1, last):
        if is_apart(k):
            kept.append(k)
    while len(kept) > 1 and not is_apart(last):
        kept.pop()
    if is_apart(last):
        kept.append(last)
    return points[kept]


def spline_through(points: ArrayLike, weights: ArrayLike | None = None) -> PiecewisePolynomial:
    """The cubic spline through points (k, n), in the order given; ``cubic_spline`` tells its ends.

    The path variable between two points is the largest way of a coordinate times its weight; ``weights`` (n,)
    of one over each joint's largest speed make it the least time [s]. Of points less than 1e-6 of it apart
    one counts (``points_apart``): a curve between them would be all rounding.
    Raises ``InputError``: a wrong shape, a value that is not finite, fewer than two points that differ.
    """
    p = as_numbers(points, "the points of a spline")
    if p.ndim != 2 or p.size == 0 or not np.isfinite(p).all():
        raise InputError(f"a spline needs points (k, n) of finite numbers, got the shape {p.shape}")
    p = points_apart(p, weights)
    if len(p) < 2:
        raise InputError("a spline needs at least two points that differ")
    way = (np.abs(np.diff(p, axis=0)) * (1.0 if weights is None else np.asarray(weights))).max(axis=1)
    return cubic_spline(np.append(0.0, np.cumsum(way)), p)


def cubic_spline(breaks: FloatArray, points: FloatArray) -> PiecewisePolynomial:
    """The cubic spline with the values ``points`` (k, n) at ``breaks`` (k,), k at least 2.

    At both ends the third derivative is continuous across the second point ("not a knot"), so samples of a
    smooth curve are met to fourth order. De Boor, A Practical Guide to Splines, chapter IV.
    """
    h, k = np.diff(breaks), len(breaks)
    chord = np.diff(points, axis=0) / h[:, None]
    if k == 2:
        sixth = np.zeros_like(points)
    elif k == 3:  # one parabola through all three
        sixth = np.repeat((chord[1:] - chord[:1]) / (3.0 * (h[0] + h[1])), 3, axis=0)
    else:
        # unknown is a sixth of the second derivative; continuous slope at the inner points ...
        bands, right = np.zeros((3, k)), np.zeros_like(points)
        bands[0, 1:], bands[1, 1:-1], bands[2, :-1] = h, 2.0 * (h[1:] + h[:-1]), h
        right[1:-1] = np.diff(chord, axis=0)
        # ... and one cubic over the first two pieces and over the last two, less a multiple of the next row
        bands[1, 0], bands[0, 1] = h[1] - h[0], -(2.0 * h[0] + h[1])
        bands[1, -1], bands[2, -2] = h[-2] - h[-1], -(2.0 * h[-1] + h[-2])
        right[0] = -h[0] / (h[0] + h[1]) * right[1]
        right[-1] = -h[-1] / (h[-1] + h[-2]) * right[-2]
        from scipy import linalg  # half of what a start would import, and few motions need it

        try:
            sixth = cast("FloatArray", linalg.solve_banded((1, 1), bands, right))  # pyright: ignore
        except np.linalg.LinAlgError as cause:
            raise InputError("the points of a spline lie too unevenly") from cause
    early, late, width = sixth[:-1], sixth[1:], h[:, None]
    c = [points[:-1], chord - width * (2.0 * early + late), 3.0 * early, (late - early) / width]
    return PiecewisePolynomial(breaks, np.stack(c, axis=1))


def first_crossing(path: PiecewisePolynomial, bounds: FloatArray) -> tuple[float, int] | None:
    """Where a joint first leaves its bounds (n, 2) [rad], exact, and which joint; None: none ever does."""
    least, most = path.bounds_by_piece()
    if (least >= bounds[:, 0]).all() and (most <= bounds[:, 1]).all():  # most paths: no exact extremes needed
        return None
    low, high = path.extremes_by_piece()
    outside = (low < bounds[:, 0]) | (high > bounds[:, 1])
    if not outside.any():
        return None
    piece = int(outside.any(axis=1).argmax())
    begin, width = float(path.breaks[piece]), float(path.breaks[piece + 1] - path.breaks[piece])
    unit = path.coefficients[piece]
    unit = unit * width ** np.arange(len(unit), dtype=np.float64)[:, None]
    found: list[tuple[float, int]] = []
    for joint in map(int, np.flatnonzero(outside[piece])):
        lower, upper = bounds[joint].tolist()
        for bound, is_passed in ((lower, low[piece, joint] < lower), (upper, high[piece, joint] > upper)):
            if is_passed:
                share = _first_root(unit[:, joint], bound) if lower <= unit[0, joint] <= upper else 0.0
                found.append((begin + share * width, joint))
    return min(found, key=lambda crossing: crossing[0])


def _first_root(c: FloatArray, bound: float) -> float:
    """Where a polynomial over 0 … 1 (lowest power first) first reaches a bound that it passes."""
    shifted = c.copy()
    shifted[0] -= bound
    largest = np.abs(shifted).max()
    roots = np.roots(shifted[::-1] / largest)
    inside = roots.real[(np.abs(roots.imag) < 1e-6) & (roots.real > -1e-9) & (roots.real < 1 + 1e-9)]
    return float(np.clip(inside, 0.0, 1.0).min(initial=1.0))
