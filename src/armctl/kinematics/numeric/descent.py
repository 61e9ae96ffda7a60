"""Damped Newton descent inside a box, many starts at once.

Levenberg–Marquardt where the second derivatives are those of Gauss and Newton. The box is an active set:
a joint that stands at a limit and is pushed against it is held; a joint that a step would carry over its
limit goes onto it, and the others are solved for again with that move known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]
Objective = Callable[[FloatArray, IndexArray], tuple[FloatArray, FloatArray, FloatArray]]
"""(k, n) configurations and which starts they belong to -> cost (k,), gradient (k, n), Hessian (k, n, n)"""
_LEAST_DAMPING, _MOST_DAMPING = 1e-12, 1e9
_PATIENCE = 8


@dataclass(frozen=True, slots=True)
class Effort:
    """When a descent stops."""

    iterations: int
    floor: float = 0.0
    """a cost that counts as zero"""
    progress: float = 0.0
    """least relative decrease in eight iterations; a start with less has come to a minimum"""
    indefinite: bool = False
    """True where the second derivatives are exact, and so may be those of a saddle"""


def descend(
    objective: Objective, q: FloatArray, lower: FloatArray, upper: FloatArray, effort: Effort
) -> tuple[FloatArray, FloatArray]:
    """Minimise from every start.

    Args:
        objective: cost with its derivatives.
        q: (k, n) starts inside the box [rad].
        lower: (k, n) the box [rad].
        upper: (k, n) the box [rad].
        effort: when to stop.

    Returns:
        (k, n) where each start ended, never outside the box, and (k,) the cost there.
    """
    q = q.copy()
    live: IndexArray = np.arange(len(q))
    f, g, H = objective(q, live)
    damping = np.full(len(q), 1e-2)
    before = f.copy()
    for iteration in range(1, effort.iterations + 1):
        live = live[(f[live] > effort.floor) & (damping[live] < _MOST_DAMPING)]
        if effort.progress > 0.0 and iteration % _PATIENCE == 0:
            live = live[f[live] < (1.0 - effort.progress) * before[live]]
            before[live] = f[live]
        if len(live) == 0:
            break
        low, high = lower[live], upper[live]
        trial = _step(q[live], g[live], H[live], low, high, damping[live], effort.indefinite)
        f_new, g_new, H_new = objective(trial, live)
        better = f_new < f[live]
        won, lost = live[better], live[~better]
        q[won], f[won], g[won], H[won] = trial[better], f_new[better], g_new[better], H_new[better]
        damping[won] = np.maximum(0.15 * damping[won], _LEAST_DAMPING)
        damping[lost] *= 6.0
        still = np.abs(trial[~better] - q[lost]).max(axis=1, initial=0.0) < 1e-15
        damping[lost[still]] = _MOST_DAMPING
    return q, f


def _step(
    q: FloatArray, g: FloatArray, H: FloatArray, low: FloatArray, high: FloatArray,
    damping: FloatArray, indefinite: bool,
) -> FloatArray:  # fmt: skip
    """The minimum of the damped quadratic model inside the box, as (k, n) configurations."""
    n = q.shape[1]
    held = ((q <= low) & (g >= 0.0)) | ((q >= high) & (g <= 0.0))
    move = np.zeros(q.shape)
    if indefinite:
        curvature = np.linalg.eigvalsh(np.where(held[:, :, None] | held[:, None, :], 0.0, H))[:, 0]
        damping = damping + np.maximum(0.0, -1.5 * curvature)
    largest = np.maximum(1.0, np.abs(np.diagonal(H, axis1=1, axis2=2)).max(axis=1))
    damped = H + (damping * largest)[:, None, None] * np.eye(n)  # never singular: joints may share an axis
    for _ in range(n + 1):
        free = ~held
        matrix = np.where(free[:, :, None] & free[:, None, :], damped, 0.0)
        matrix += held[:, :, None] * np.eye(n)
        known = (H @ np.where(held, move, 0.0)[:, :, None])[:, :, 0]
        right = np.where(free, -g - known, move)
        move = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
        over = free & ((q + move < low) | (q + move > high))
        if not over.any():
            break
        held = held | over
        move = np.where(over, np.clip(q + move, low, high) - q, move)
    return np.clip(q + move, low, high)
