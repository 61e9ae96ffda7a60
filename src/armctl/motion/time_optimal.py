"""The fastest law s(t) along a path that keeps the joints' speed and acceleration limits.

With the squared rate x = (ds/dt)² a joint's speed is q' √x and its acceleration q'' x + ½ q' dx/ds (Bobrow et
al. 1985). On each interval of a grid x is linear, so both limits are linear in x at the two ends of the
interval. One pass backward gives the largest rates that can be braked from, one forward takes the largest of
them that can be reached (reachability analysis: Pham and Pham, A New Approach to Time-Optimal Path
Parameterization, 2018). The limits hold for the Bernstein coefficients of these polynomials, not only at the
grid: so they are kept between its points too.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.lazy_dataclass import dataclass
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot

_FINENESS, _COARSEST, _FINEST = 40.0, 4, 80
"""intervals in a piece of a path whose slope changes by as much as it is, and in any that is curved"""
_CURVE = 0.5
"""of a joint's acceleration: what the curve of the path may take where the rate changes inside an interval"""
_MARGIN = 1e-9
_BLOCK, _BLOCKS = 1024, 4
"""intervals whose rows are made at once, and how often they are kept, so that memory stays bounded"""
_TINY = 1e-12
_MEETINGS, _HALVINGS = 12, 30


class TooFastError(InputError):
    """A path is begun faster than it can be braked on."""


@dataclass(frozen=True, slots=True, eq=False)
class PathRates:
    """Joint speeds and accelerations on the k pieces of a path, each under a law with constant d²s/dt².

    Bernstein coefficients: never below what they bound, and close to it where a piece is short.
    """

    slope: FloatArray
    """(k, d, n) of q'"""
    bend_begin: FloatArray
    bend_end: FloatArray
    """(k, d, n) of q'' x, a unit of x at the beginning and at the end of the piece"""
    speed: FloatArray
    """(2, k, n) at both ends a line that |q'| never passes"""

    @classmethod
    def of(cls, path: PiecewisePolynomial) -> PathRates:
        """Of a path q(s), (n,)."""
        first = path.padded(3).derivative()
        slope, bend = first.control_points(), first.derivative().control_points()
        none = np.zeros_like(bend[:, :1])
        share = np.linspace(0.0, 1.0, slope.shape[1])[:, None]
        begin, end = np.abs(slope[:, 0]), np.abs(slope[:, -1])
        beyond = np.abs(slope) - (begin[:, None] + share * (end - begin)[:, None])
        beyond = np.maximum(beyond.max(axis=1), 0.0)
        return cls(
            slope,
            (1.0 - share) * np.concatenate([bend, none], axis=1),
            share * np.concatenate([none, bend], axis=1),
            np.stack([begin + beyond, end + beyond]),
        )

    def peaks(self, begin: FloatArray, end: FloatArray, push: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Largest joint speeds and accelerations (n,) with x ``begin``, ``end`` and d²s/dt² ``push`` (k,)."""
        x, y = begin[:, None, None], end[:, None, None]
        acceleration = self.bend_begin * x + self.bend_end * y + self.slope * push[:, None, None]
        (early, late), (x, y) = self.speed, (begin[:, None], end[:, None])
        squares = [
            early**2 * x,
            (2 * early * late * x + early**2 * y) / 3,
            (late**2 * x + 2 * early * late * y) / 3,
            late**2 * y,
        ]
        flat = np.abs(self.slope).max(axis=1) ** 2 * np.maximum(x, y)
        square = np.minimum(np.max(squares, axis=0), flat).max(axis=0)
        return np.sqrt(square), np.abs(acceleration).max(axis=(0, 1))


@dataclass(frozen=True, slots=True, eq=False)
class PathLimits:
    """What a robot's limits leave on the k intervals of a path's grid; x and y are x at their two ends."""

    robot: Robot
    breaks: FloatArray
    """(k + 1,) the grid"""
    rates: PathRates
    first: NDArray[np.intp]
    """(p + 1,) the interval at which each piece of the path begins"""
    most: FloatArray
    """(k + 1,) largest x at the points of the grid"""
    cap: FloatArray
    """(k,) largest ds/dt, and"""
    push: FloatArray
    """(k,) d²s/dt², with which an interval may also be gone along; on a straight one all that there is"""

    @classmethod
    def of(
        cls,
        robot: Robot,
        path: PiecewisePolynomial,
        rate_cap: float | FloatArray = math.inf,
        finest: int = _FINEST,
    ) -> PathLimits:
        """Limits of a path q(s), (n,) [rad], from the joints'.

        ``rate_cap``: a largest ds/dt besides, a number or (p,) one a piece of the path; ``finest``: most
        intervals of a piece. The grid of a piece depends on that piece alone: so what was planned to be
        braked on can be braked on when more is known.
        Where the slope of the path jumps the rate is 0: the arm stops.
        Raises ``InputError``: a cap that is not positive.
        """
        caps = np.broadcast_to(np.asarray(rate_cap, dtype=np.float64), len(path.coefficients))
        if not (caps > 0).all():
            raise InputError(f"the speed along a path must be positive, got {caps.min()}")
        counts = _counts(robot, path, finest)
        first = np.concatenate([[0], np.cumsum(counts)])
        starts, widths = np.repeat(path.breaks[:-1], counts), np.repeat(np.diff(path.breaks), counts)
        share: FloatArray = (np.arange(len(starts)) - np.repeat(first[:-1], counts)) / np.repeat(
            counts, counts
        )
        grid = np.append(starts + widths * share, path.breaks[-1])
        rates, width = PathRates.of(path.cut(grid)), np.diff(grid)
        slope = np.abs(rates.slope).max(axis=1)
        bend = np.maximum(np.abs(rates.bend_begin), np.abs(rates.bend_end)).max(axis=1)
        with np.errstate(divide="ignore"):
            at_ends = (robot.speed_limits / rates.speed).min(axis=2)
            curve = np.sqrt((_CURVE * robot.acceleration_limits / bend).min(axis=1))
        # where nothing moves, any rate will do
        at_ends = np.minimum(np.minimum(at_ends, np.repeat(caps, counts)), width / _MARGIN) * (1 - _MARGIN)
        most = np.minimum(np.append(at_ends[0], np.inf), np.append(np.inf, at_ends[1])) ** 2
        most[first[1:-1][path.slope_jumps().any(axis=1)]] = 0.0
        cap = np.minimum(at_ends.min(axis=0), curve)
        with np.errstate(divide="ignore"):
            left = robot.acceleration_limits - bend * cap[:, None] ** 2
            push = np.minimum((left / slope).min(axis=1), 1e3 * cap**2 / width)
        return cls(robot, grid, rates, first, most, cap, push * (1 - _MARGIN))

    def blocks(self) -> list[slice]:
        """The intervals, as many at once as memory shall hold."""
        count = len(self.push)
        return [slice(k, min(k + _BLOCK, count)) for k in range(0, count, _BLOCK)]

    def rows(self, block: slice) -> tuple[FloatArray, FloatArray]:
        """(m, r) each, a and b of the inequalities a x + b y ≤ 1 in m intervals."""
        slope = self.rates.slope[block]
        push = slope / (2 * np.diff(self.breaks[block.start : block.stop + 1]))[:, None, None]
        limits = self.robot.acceleration_limits * (1 - _MARGIN)
        a = (self.rates.bend_begin[block] - push) / limits
        b = (self.rates.bend_end[block] + push) / limits
        early, late = self.rates.speed[:, block] / (self.robot.speed_limits * (1 - _MARGIN))
        speed_a = np.stack([2 * early * late, late**2], axis=1) / 3
        speed_b = np.stack([early**2, 2 * early * late], axis=1) / 3
        return (
            np.concatenate([a, -a, speed_a], axis=1).reshape(len(slope), -1),
            np.concatenate([b, -b, speed_b], axis=1).reshape(len(slope), -1),
        )


def _counts(robot: Robot, path: PiecewisePolynomial, finest: int) -> NDArray[np.intp]:
    """(p,) intervals of each piece: 1 where it is straight, else the more the slope and the bend change."""
    first = path.padded(3).derivative()
    width = np.diff(path.breaks)[:, None]
    slope = first.control_points() / robot.speed_limits
    bend = first.derivative().control_points() / robot.speed_limits
    change = np.ptp(slope, axis=1) + 0.5 * width * np.ptp(bend, axis=1)
    size = np.abs(slope).max(axis=(1, 2))
    curved = np.abs(bend).max(axis=(1, 2)) > 0
    turn = change.max(axis=1) / np.where(size > 0, size, 1.0)
    counts = np.clip(np.ceil(_FINENESS * turn), _COARSEST, finest)
    return np.where(curved, counts, 1).astype(np.intp)


def fastest_rates(limits: PathLimits, first: float = 0.0, last: float = 0.0) -> FloatArray:
    """(k + 1,) the fastest rates at the points of a path's grid that its limits allow.

    ``first`` is the rate at its beginning, ``last`` the largest at its end; what can be reached is taken
    where it is less.
    Raises ``TooFastError``: ``first`` is more than the path can brake from.
    """
    blocks = limits.blocks()

    @lru_cache(maxsize=_BLOCKS)
    def lines(number: int) -> _IntervalBounds:
        return _IntervalBounds.of(limits, blocks[number])

    x = min(last * last, float(limits.most[-1]))
    most = [x]
    for number in range(len(blocks) - 1, -1, -1):  # backward: rates that can be braked from
        block = lines(number)
        for above, slope, turn in zip(block.c[::-1], block.d[::-1], block.turns[::-1].tolist(), strict=True):
            x = float(np.minimum.reduce(above + slope * min(x, turn)))
            most.append(x)
    most.reverse()
    fastest = math.sqrt(most[0])
    if first > fastest * (1 + 1e-6) + 1e-12:
        raise TooFastError(
            f"a path cannot be begun at the rate {first:.6g}; the most is {fastest:.6g}: begin it slower"
        )
    x = min(first * first, most[0])
    squares = [x]
    for number, part in enumerate(blocks):  # forward: rates that can be reached
        block = lines(number)
        for above, slope, braked in zip(block.e, block.f, most[part.start + 1 : part.stop + 1], strict=True):
            x = min(max(float(np.minimum.reduce(above + slope * x)), 0.0), braked)
            squares.append(x)
    return np.sqrt(squares)


@dataclass(frozen=True, slots=True, eq=False)
class _IntervalBounds:
    """The limits of m intervals as lines: x is at most the least of c + d y, y that of e + f x."""

    c: FloatArray
    d: FloatArray
    e: FloatArray
    f: FloatArray
    """(m, r) each"""
    turns: FloatArray
    """(m,) the y at which x may be largest"""

    @classmethod
    def of(cls, limits: PathLimits, block: slice) -> _IntervalBounds:
        a, b = limits.rows(block)
        most = limits.most[block.start : block.stop + 1]
        c, d = _ceilings(a, b)
        c, d = np.column_stack([c, most[:-1]]), np.column_stack([d, np.zeros(len(d))])
        e, f = _ceilings(b, a)
        return cls(c, d, e, f, _turning(c, d, e, f, most[1:]))


def _ceilings(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of rows a x + b y ≤ 1: lines c + d y (m, r) of which the least is the largest x at y."""
    bounds = a > _TINY * np.abs(b)
    safe = np.where(bounds, a, 1.0)
    return np.where(bounds, 1.0 / safe, np.inf), np.where(bounds, -b / safe, 0.0)


def _turning(c: FloatArray, d: FloatArray, e: FloatArray, f: FloatArray, most: FloatArray) -> FloatArray:
    """(m,) the y, at most ``most``, at which x may be largest.

    The least of the lines over y is concave: the line on its left and the one on its right are brought to
    meet until no other lies below. What they give must also be possible for y.
    """
    row = np.arange(len(c))

    def lowest(y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        lines = c + d * y[:, None]
        which = lines.argmin(axis=1)
        return lines[row, which], c[row, which], d[row, which]

    def possible(y: FloatArray) -> NDArray[np.bool_]:
        return (e + f * lowest(y)[0][:, None]).min(axis=1) >= y * (1 - _TINY)

    (_, left_c, left_d), (_, right_c, right_d) = lowest(np.zeros(len(c))), lowest(most)
    y = np.where(left_d > 0, most, 0.0)
    rises = (left_d > 0) & (right_d <= 0)
    for _ in range(_MEETINGS):
        if not rises.any():
            break
        slope = np.where(rises, left_d - right_d, 1.0)
        y = np.where(rises, np.clip((right_c - left_c) / slope, 0.0, most), y)
        x, new_c, new_d = lowest(y)
        rises &= x < (left_c + left_d * y) * (1 - _MARGIN)
        on_left = rises & (new_d > 0)
        left_c, left_d = np.where(on_left, new_c, left_c), np.where(on_left, new_d, left_d)
        on_right = rises & (new_d <= 0)
        right_c, right_d = np.where(on_right, new_c, right_c), np.where(on_right, new_d, right_d)
    if possible(y).all():
        return y
    low, high = np.where(possible(y), y, 0.0), y
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        holds = possible(middle)
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    return low


def time_optimal_law(
    breaks: FloatArray, rates: FloatArray, cap: FloatArray, push: FloatArray
) -> PiecewisePolynomial:
    """The path variable over time [s], from ``fastest_rates`` at ``breaks`` (k + 1,).

    The rate changes evenly on each interval, or by ``push`` (k,) up towards ``cap`` (k,) and down again where
    that is faster.
    """
    times, steps = [0.0], list[tuple[float, float, float]]()
    rows = np.column_stack([breaks[:-1], np.diff(breaks), rates[:-1], rates[1:], cap, push])
    for s, length, first, last, most, up in rows.tolist():
        # (duration, rate at its beginning, change of the rate) of up to three phases
        change = (last - first) * (last + first) / (2 * length)
        phases: list[tuple[float, float, float]] = (
            [(2 * length / (first + last), first, change)] if first + last > 0 else []
        )
        if up > abs(change) * (1 + _MARGIN) and max(first, last) <= most * (1 + _TINY):
            peak = max(min(most, math.sqrt(up * length + 0.5 * (first * first + last * last))), first, last)
            rise, fall = (peak - first) / up, (peak - last) / up
            rest = length - 0.5 * (first + peak) * rise - 0.5 * (peak + last) * fall
            level = rest / peak if rest > _TINY * length else 0.0
            phases = [(rise, first, up), (level, peak, 0.0), (fall, peak, -up)]
        for duration, rate, changed in phases:
            if times[-1] + duration > times[-1]:
                times.append(times[-1] + duration)
                steps.append((s, rate, 0.5 * changed))
                s += duration * (rate + 0.5 * changed * duration)
    return PiecewisePolynomial(times, np.array(steps)[:, :, None])
