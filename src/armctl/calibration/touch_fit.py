"""What touched points say of an arm: its numbers as they most likely are, and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.apart import require_wanted
from armctl.arrays import FloatArray
from armctl.calibration.touch_model import Parameter, Touches, TouchModel, Values
from armctl.lazy_dataclass import dataclass

_TOUCH_M = 0.0005
"""standard deviation of a coordinate of a touch, before anything is measured [m]"""
NOISE_WEIGHT = 5.0
"""how many coordinates that is worth"""
_ROUNDS = 12
"""Gauss-Newton steps at most, with the noise and the weights from the one before"""
_STILL = 0.003
"""a step that changes every number by a smaller share of what is expected of it is the last one"""
OF_SHEET = ("place", "tilt", "heading")
"""where the points lie, not what the arm is"""
_CAUCHY = 3.0
"""a point that is off by so many standard deviations counts half"""


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """The most likely values of some parameters."""

    model: TouchModel
    touches: Touches
    parameters: tuple[Parameter, ...]
    x: FloatArray
    """(p,) in SI"""
    values: Values
    sd: FloatArray
    """(p,) before anything was touched"""
    covariance: FloatArray
    """(p, p) of ``x``, SI"""
    noise_m: float
    """standard deviation of a coordinate of a touch"""
    errors: FloatArray
    """(k, 3) that the fit leaves [m]"""
    left_out: FloatArray
    """(k, 3) that it would leave at each point if it were not used [m], to first order"""
    squares: float
    """Σ errors² + what the values are away from what was expected, in the noise [m²]"""

    @property
    def told(self) -> FloatArray:
        """(p,) by which share the points narrowed what is known of each parameter: 1 all, 0 nothing."""
        return 1.0 - np.sqrt(np.diag(self.covariance)) / self.sd

    def without(self, gone: Sequence[Parameter]) -> list[Parameter]:
        """Its parameters without some."""
        return [one for one in self.parameters if one not in gone]


def solve(
    model: TouchModel,
    touches: Touches,
    parameters: Sequence[Parameter],
    start: FloatArray | None = None,
    *,
    robust: bool = False,
) -> Solved:
    """The most likely values (MAP): least squares of the errors and of what the values are away from zero.

    Sag and play are not negative. The noise is estimated with them. ``robust``: points that are far off count
    less (Cauchy). ``start`` (p,) in SI.
    """
    parameters, k = list(parameters), len(touches)
    sd = np.array([model.sd(one) for one in parameters])
    expected = model.start(parameters) / sd
    u = expected if start is None else start / sd
    bounded = np.array([one.kind in ("sag", "play") for one in parameters], dtype=np.bool_)
    noise, weights = 3 * _TOUCH_M, np.ones(k)
    values = model.with_values(parameters, u * sd)
    links = model.links(values, touches.q, touches.senses)
    errors = model.errors(values, touches, links[0])
    lengths, blocks = np.sum(errors**2, axis=1), np.empty((k, 3, len(sd)))
    covariance: FloatArray = np.eye(len(sd))
    for _ in range(_ROUNDS):
        require_wanted()
        scale = (np.sqrt(weights) / noise)[:, None]
        blocks = model.slopes(values, touches, parameters, links) * sd * scale[:, :, None]
        A = blocks.reshape(3 * k, -1)
        covariance = np.asarray(np.linalg.inv(A.T @ A + np.eye(len(sd))), dtype=np.float64)
        step = _bounded_step(A, (scale * errors).ravel(), u, expected, bounded)
        u = u + step
        values = model.with_values(parameters, u * sd)
        links = model.links(values, touches.q, touches.senses)
        errors = model.errors(values, touches, links[0])
        used = float(np.einsum("ip,pq,iq->", A, covariance, A))
        lengths = np.sum(errors**2, axis=1)
        free = max(3 * float(weights.sum()) - used, 1.0)
        noise = math.sqrt((NOISE_WEIGHT * _TOUCH_M**2 + float(weights @ lengths)) / (NOISE_WEIGHT + free))
        if robust:
            weights = 1.0 / (1.0 + lengths / (_CAUCHY * noise) ** 2 / 3)
        if np.abs(step).max(initial=0.0) < _STILL:
            break
    hat = np.einsum("kip,pq,kjq->kij", blocks, covariance, blocks)
    left_out = np.asarray(np.linalg.solve(np.eye(3) - hat, errors[:, :, None]), dtype=np.float64)[:, :, 0]
    own = np.array([one.kind not in OF_SHEET for one in parameters], dtype=np.bool_)
    away = float(np.sum((u - expected)[own] ** 2))
    return Solved(
        model, touches, tuple(parameters), u * sd, values, sd, covariance * np.outer(sd, sd), noise, errors,
        left_out, float(lengths.sum()) + noise**2 * away,
    )  # fmt: skip


def _bounded_step(
    A: FloatArray, errors: FloatArray, u: FloatArray, expected: FloatArray, bounded: NDArray[np.bool_]
) -> FloatArray:
    """(p,) to the least |errors + A step|² + |u + step - expected|², u that are ``bounded`` not below 0."""
    held = np.zeros(len(u), dtype=np.bool_)
    step = np.zeros(len(u))
    for _ in range(len(u) + 1):
        free = ~held
        rest = errors - A[:, held] @ u[held]  # held at 0
        B = A[:, free]
        step[held] = -u[held]
        step[free] = np.linalg.solve(B.T @ B + np.eye(int(free.sum())), -B.T @ rest - (u - expected)[free])
        below = bounded & free & (u + step < 0.0)
        if not below.any():
            break
        held |= below
    return step


# Which single numbers explain the errors: as few as will do (forward and backward by a Bayesian criterion).

_EVIDENCE = 8.0
"""by how much the criterion must fall before one more number is blamed"""
_LIKE = 3.0
"""a number after which it is higher by less would explain the points as well"""
_FEW = 4
"""where more numbers are off than that, all of them are fitted at once"""
_TRIED = 4
"""of the numbers that seem to explain most, how many are worked out"""


def _criterion(one: Solved) -> float:
    """BIC: the logarithm of what is left, and a price for each number that is not the sheet's."""
    n = 3.0 * len(one.touches)
    left = (one.squares + NOISE_WEIGHT * _TOUCH_M**2) / (n + NOISE_WEIGHT)
    return (n + NOISE_WEIGHT) * math.log(left) + math.log(n) * len(one.parameters)


def _promising(now: Solved, candidates: Sequence[Parameter]) -> list[tuple[float, Parameter]]:
    """By how much each of some more numbers would lower the squares, to first order; the best first."""
    model, touches = now.model, now.touches
    every = [*now.parameters, *candidates]
    sd = np.array([model.sd(one) for one in every])
    J = model.slopes(now.values, touches, every).reshape(-1, len(every)) * sd
    fixed, columns = J[:, : len(now.parameters)], J[:, len(now.parameters) :]
    e = now.errors.ravel()
    kept = np.vstack([fixed, now.noise_m * np.eye(fixed.shape[1])])
    basis = np.linalg.qr(kept)[0][: len(e)]
    columns = columns - basis @ (basis.T @ columns)
    sizes = np.sum(columns**2, axis=0) + now.noise_m**2
    gains = (columns.T @ (e - basis @ (basis.T @ e))) ** 2 / sizes
    return sorted(zip(gains.tolist(), candidates, strict=True), key=lambda one: -one[0])


def blame(now: Solved, candidates: Sequence[Parameter]) -> tuple[Solved, list[Solved]]:
    """The fewest numbers that explain the errors; and what would explain them as well with another first one.

    ``now``: with the numbers of the sheet alone. The numbers come in the order in which they were found.
    """
    sheet, likes = list(now.parameters), list[Solved]()
    for _ in range(_FEW):
        rest = [one for one in candidates if one not in now.parameters]
        tried = [
            solve(now.model, now.touches, [*now.parameters, one], np.append(now.x, now.model.start([one])))
            for gain, one in _promising(now, rest)[:_TRIED]
            if gain > 0.02 * now.squares
        ]
        tried.sort(key=_criterion)
        if not tried or _criterion(tried[0]) > _criterion(now) - _EVIDENCE:
            break
        if now.parameters == tuple(sheet):
            likes = [one for one in tried[1:] if _criterion(one) < _criterion(tried[0]) + _LIKE]
        now = tried[0]
    for one in [one for one in now.parameters if one not in sheet][:-1]:
        less = solve(now.model, now.touches, now.without([one]))
        if _criterion(less) < _criterion(now) + _EVIDENCE:
            now = less
    return now, likes
