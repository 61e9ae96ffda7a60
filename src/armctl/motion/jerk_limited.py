"""A law s(t) along a path that keeps the joints' jerk limits too, close to the fastest.

The way is written as s = φ(σ) with φ the quintic from rest to rest, so that a law that starts and ends
without acceleration is smooth in σ. With X = (dσ/dt)², a spline over σ, and q over σ,

    speed q' √X     acceleration q'' X + ½ q' X'     jerk √X (q''' X + 3/2 q'' X' + ½ q' X'')

An interior-point method (Boyd and Vandenberghe, Convex Optimization, chapter 11) makes the duration ∫ dσ/√X
short inside the limits at three places of each interval. It begins with the same X everywhere, small enough.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

import numpy as np

from armctl.arrays import FloatArray
from armctl.lazy_dataclass import dataclass
from armctl.motion.polynomial import PiecewisePolynomial, quintic
from armctl.robot import Robot

_KNOTS, _KNOTS_A_PIECE, _MOST_KNOTS = 90, 4, 2000
_BY_TIME, _BY_WAY, _BY_ENDS, _END = 0.4, 0.35, 0.25, 0.002
"""knots of the spline, and shares of them by the time of the fastest law, over σ, and near its two ends"""
_APART = 0.5
"""so much of a usual step between two knots a break of the path keeps clear around itself"""
_PLACES = np.array([0.0, 0.5, 1.0])
_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
_GAUSS, _GAUSS_WEIGHTS = 0.5 * np.array(np.polynomial.legendre.leggauss(5)) + np.array([[0.5], [0.0]])
_AT_FIRST = 0.5
"""share of a limit that the law begins with"""
_SHARPER, _GAP = 5.0, 4e-3
"""how much nearer to the limits each round may come, and how near to the shortest the last one (share)"""
_ROUNDS, _STEPS, _SHORTEST_STEP, _LEAST_GAIN = 40, 20, 1e-6, 0.1
_DONE = 1e-3
"""a step that gains less than this for each limit ends a round"""
_HALVINGS = 60


def jerk_limited_law(
    robot: Robot,
    path: PiecewisePolynomial,
    fastest: PiecewisePolynomial,
    rate_cap: float = math.inf,
    degree: int = 2,
) -> PiecewisePolynomial:
    """Quintics s(t) from rest to rest, without a jump of the acceleration, for a path q(s), (n,) [rad].

    ``fastest`` is the law under the limits of speed and acceleration alone; it places the knots. ``degree``:
    of the spline X; with 3 the jerk does not jump. The limits are kept at the knots and midway, and between
    them nearly: what is left is for the caller to measure.
    """
    knots = _knots(path, fastest)
    task = _Task.of(robot, path, knots, rate_cap, degree)
    return _law(path, knots, task.solved(), degree)


# The way over σ, and the splines over it.


def _way(sigma: FloatArray) -> FloatArray:
    """(4, ...) φ and its derivatives, for a way of 1."""
    u = sigma
    return np.array(
        [
            u**3 * (10 - 15 * u + 6 * u**2),
            30 * u**2 * (1 - u) ** 2,
            60 * u * (1 - u) * (1 - 2 * u),
            60 * (1 - 6 * u + 6 * u**2),
        ]
    )


def _knots(path: PiecewisePolynomial, fastest: PiecewisePolynomial) -> FloatArray:
    """(k + 1,) of σ: the breaks of the path, and between them as the law needs them."""
    sigma = np.linspace(0.0, 1.0, 8001)
    length = path.high - path.low
    times = np.linspace(0.0, fastest.high, len(sigma))
    gone = (fastest(times)[:, 0] - path.low) / length
    passed = _between(_way(sigma)[0], gone, times / fastest.high)
    near = np.log1p(sigma / _END)
    ends = 0.5 + 0.5 * (near - near[::-1]) / near[-1]
    count = _BY_TIME * passed + _BY_WAY * sigma + _BY_ENDS * ends
    knots = min(_KNOTS + _KNOTS_A_PIECE * (len(path.coefficients) - 1), _MOST_KNOTS)
    wished = _between(np.linspace(0.0, 1.0, knots + 1), count, sigma)
    # the third derivative of the path may jump at its breaks
    low, high = np.zeros(len(path.breaks)), np.ones(len(path.breaks))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        before = _way(middle)[0] < (path.breaks - path.low) / length
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    fixed = np.concatenate([[0.0], high[1:-1], [1.0]])
    at = _between(wished, sigma, count)
    clear = np.abs(at[:, None] - _between(fixed, sigma, count)).min(axis=1) > _APART / knots
    return np.unique(np.concatenate([fixed, wished[clear]]))


def _between(x: FloatArray, xs: FloatArray, values: FloatArray) -> FloatArray:
    """``numpy.interp`` with a type."""
    return np.asarray(np.interp(x, xs, values), dtype=np.float64)


def _basis(knots: FloatArray, degree: int, places: FloatArray, order: int) -> FloatArray:
    """(k, p, degree + 1) derivative of the B-splines at places (k, p), each in one of k intervals.

    In interval i those with the numbers i ... i + degree. De Boor, A Practical Guide to Splines, chapter X.
    """
    t = np.pad(knots, degree, mode="edge")
    at = np.arange(len(knots) - 1) + degree
    values = [np.ones_like(places)]
    for p in range(1, degree + 1):
        raised = [np.zeros_like(places) for _ in range(p + 1)]
        for j, value in enumerate(values):
            begin, end = t[at - p + 1 + j][:, None], t[at + 1 + j][:, None]
            share = value / (end - begin)
            if p <= degree - order:
                raised[j] += (end - places) * share
                raised[j + 1] += (places - begin) * share
            else:
                raised[j] -= p * share
                raised[j + 1] += p * share
        values = raised
    return np.stack(values, axis=-1)


# The duration made short inside the limits.


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """Limits at p places of each of k intervals, in units of the limits."""

    basis: FloatArray
    """(k, p, 3, degree + 1) of X, X' and X''"""
    weights: FloatArray
    """(k, p) of 1/√X in the duration"""
    speed: FloatArray
    """(k, p) times X at most 1"""
    acceleration: FloatArray
    """(2, k, p, n) times X and X': within ±1"""
    jerk: FloatArray
    """(3, k, p, n) times X, X' and X'': within ±1/√X"""

    @classmethod
    def of(cls, robot: Robot, path: PiecewisePolynomial, knots: FloatArray, cap: float, degree: int) -> _Task:
        width = np.diff(knots)[:, None]
        places = knots[:-1, None] + width * _PLACES
        s, first, second, third = (path.high - path.low) * _way(places)[..., None]
        slope, bend, twist = _on_pieces(path, s[..., 0] + path.low)
        q1 = slope * first
        q2 = bend * first**2 + slope * second
        q3 = twist * first**3 + 3 * bend * first * second + slope * third
        speed = ((q1 / robot.speed_limits) ** 2).max(axis=2)
        basis = np.stack([_basis(knots, degree, places, order) for order in range(3)], axis=2)
        return cls(
            basis,
            width * _WEIGHTS,
            np.maximum(speed, (first[..., 0] / cap) ** 2),
            np.stack([q2, 0.5 * q1]) / robot.acceleration_limits,
            np.stack([q3, 1.5 * q2, 0.5 * q1]) / robot.jerk_limits,
        )

    def solved(self) -> FloatArray:
        """Coefficients of the spline X."""
        least = max(
            float(self.speed.max()),
            float(np.abs(self.acceleration[0]).max()),
            float(np.abs(self.jerk[0]).max()) ** (2 / 3),
        )
        size = self.basis.shape[-1]
        c = np.full(len(self.basis) + size - 1, _AT_FIRST / least)
        slacks = self._slacks(c)
        count = sum(one.size for one in slacks) - slacks[0].size
        weight = count / self._duration(slacks[0])
        for _ in range(_ROUNDS):
            c, slacks = self._centred(c, slacks, weight, _DONE * count)
            sharpest = count / (_GAP * self._duration(slacks[0]))
            if weight >= sharpest:
                break
            weight = min(_SHARPER * weight, 1.01 * sharpest)
        return c

    def _centred(
        self, c: FloatArray, slacks: tuple[FloatArray, ...], weight: float, enough: float
    ) -> tuple[FloatArray, tuple[FloatArray, ...]]:
        """Newton's method with a line search that stays inside, until a step gains less than ``enough``."""
        for _ in range(_STEPS):
            value = self._value(slacks, weight)
            gradient, bands = self._model(slacks, weight)
            step = _solved(bands, -gradient)
            if step is None:
                break
            gain, length = -float(gradient @ step), 1.0
            while length > _SHORTEST_STEP:
                tried = self._slacks(c + length * step)
                inside = all((one > 0).all() for one in tried)
                if inside and self._value(tried, weight) <= value - _LEAST_GAIN * length * gain:
                    c, slacks = c + length * step, tried
                    break
                length *= 0.5
            if length <= _SHORTEST_STEP or gain < enough:
                break
        return c, slacks

    def _slacks(self, c: FloatArray) -> tuple[FloatArray, ...]:
        """X, and what is left of each limit; all positive inside."""
        size = self.basis.shape[-1]
        local = np.lib.stride_tricks.sliding_window_view(c, size)
        x, x1, x2 = np.moveaxis(np.einsum("kpol,kl->kpo", self.basis, local), 2, 0)
        push = self.acceleration[0] * x[..., None] + self.acceleration[1] * x1[..., None]
        twist = self.jerk[0] * x[..., None] + self.jerk[1] * x1[..., None] + self.jerk[2] * x2[..., None]
        root = 1.0 / np.sqrt(np.maximum(x, 1e-300))[..., None]
        return x, 1.0 - self.speed * x, 1.0 - push, 1.0 + push, root - twist, root + twist

    def _duration(self, x: FloatArray) -> float:
        return float((self.weights / np.sqrt(x)).sum())

    def _value(self, slacks: tuple[FloatArray, ...], weight: float) -> float:
        return weight * self._duration(slacks[0]) - sum(float(np.log(one).sum()) for one in slacks[1:])

    def _model(self, slacks: tuple[FloatArray, ...], weight: float) -> tuple[FloatArray, FloatArray]:
        """Gradient, and the lower bands of a Hessian without what the curve of 1/√X takes off it."""
        x, speed, *pushes, less, more = slacks
        g, h = np.zeros((3, *x.shape)), np.zeros((3, 3, *x.shape))
        g[0] = -0.5 * weight * self.weights * x**-1.5 + self.speed / speed
        h[0, 0] = 0.75 * weight * self.weights * x**-2.5 + (self.speed / speed) ** 2
        first = 1.0 / pushes[0] - 1.0 / pushes[1]
        second = pushes[0] ** -2 + pushes[1] ** -2
        root = (-0.5 * x**-1.5)[..., None]
        for i in range(2):
            g[i] += (self.acceleration[i] * first).sum(axis=2)
            for j in range(i + 1):
                h[i, j] += (self.acceleration[i] * self.acceleration[j] * second).sum(axis=2)
        for slack, sign in ((less, -1.0), (more, 1.0)):
            rows = [sign * self.jerk[0] + root, sign * self.jerk[1], sign * self.jerk[2]]
            rows = [row / slack for row in rows]
            for i in range(3):
                g[i] -= rows[i].sum(axis=2)
                for j in range(i + 1):
                    h[i, j] += (rows[i] * rows[j]).sum(axis=2)
        for i in range(3):
            for j in range(i):
                h[j, i] = h[i, j]
        local = np.einsum("okp,kpol->kl", g, self.basis)
        square = np.einsum("kpol,oqkp,kpqm->klm", self.basis, h, self.basis, optimize=True)
        count, size = local.shape
        gradient, bands = np.zeros(count + size - 1), np.zeros((size, count + size - 1))
        for i in range(size):
            gradient[i : i + count] += local[:, i]
            for j in range(i + 1):
                bands[i - j, j : j + count] += square[:, i, j]
        return gradient, bands


def _on_pieces(path: PiecewisePolynomial, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(k, p, n) q', q'' and q''' at places (k, p), those of an interval on one piece of the path."""
    piece = path.breaks[1:-1].searchsorted(0.5 * (s[:, 0] + s[:, -1]))
    h = (s - path.breaks[piece][:, None])[..., None]
    found: list[FloatArray] = []
    one = path.padded(4)
    for _ in range(3):
        one = one.derivative()
        c = one.coefficients[piece]
        value = np.zeros((*s.shape, path.n))
        for power in range(c.shape[1] - 1, -1, -1):
            value = value * h + c[:, None, power]
        found.append(value)
    return found[0], found[1], found[2]


def _solved(bands: FloatArray, right: FloatArray) -> FloatArray | None:
    """None where rounding has left the bands without a solution."""
    from scipy import linalg  # half of what a start would import, and few motions need it

    solve = cast("Callable[..., FloatArray]", linalg.solveh_banded)  # pyright: ignore
    try:
        return solve(bands, right, lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        return None


def _law(path: PiecewisePolynomial, knots: FloatArray, c: FloatArray, degree: int) -> PiecewisePolynomial:
    """s(t) by quintics with the value, rate and change of the rate at the knots."""
    local = np.lib.stride_tricks.sliding_window_view(c, degree + 1)
    width = np.diff(knots)[:, None]
    inner = _basis(knots, degree, knots[:-1, None] + width * _GAUSS, 0)
    x = np.einsum("kpl,kl->kp", inner, local)
    times = (width * _GAUSS_WEIGHTS / np.sqrt(x)).sum(axis=1)
    ends = knots[:-1, None] + width * np.array([0.0, 1.0])
    x, x1 = (np.einsum("kpl,kl->kp", _basis(knots, degree, ends, order), local) for order in (0, 1))
    s, first, second, _ = (path.high - path.low) * _way(ends)
    states = np.stack([s + path.low, first * np.sqrt(x), second * x + 0.5 * first * x1])
    scale = times ** np.arange(3.0)[:, None]
    unit = quintic(*(scale[..., None] * states[:, :, k : k + 1] for k in range(2)))
    coefficients = unit.swapaxes(0, 1) / (times[:, None] ** np.arange(6.0))[..., None]
    return PiecewisePolynomial(np.append(0.0, np.cumsum(times)), coefficients)
