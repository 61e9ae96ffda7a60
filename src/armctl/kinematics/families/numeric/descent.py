"""Damped Newton descent inside a box, many starts at once, and what it is used for.

The box is an active set: a joint at a limit that is pushed against it is held; a joint that a step would
carry over its limit goes onto it, and the others are solved for again with that move known.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.chain import Chain
from armctl.kinematics.families.numeric.goals import Cost, Goal, Turns, tool_motion
from armctl.kinematics.samples import even_spread

IndexArray = NDArray[np.intp]
Objective = Callable[[FloatArray, IndexArray], Cost]
"""(k, n) configurations and which starts they belong to -> their cost with its derivatives"""
_LEAST_DAMPING, _MOST_DAMPING = 1e-12, 1e9
_PATIENCE = 8


class StoppingRule(NamedTuple):
    """When a descent stops."""

    iterations: int
    floor: float = 0.0
    """a cost that counts as zero"""
    progress: float = 0.0
    """least relative decrease in eight iterations; a start with less has come to a minimum"""
    indefinite: bool = False
    """True where the second derivatives are exact, and so may be those of a saddle"""


def descend(objective: Objective, q: FloatArray, box: FloatArray, effort: StoppingRule) -> FloatArray:
    """Where starts ``q`` (k, n) come to on the way down (k, n), never outside a ``box`` ([k,] n, 2)."""
    q, boxes = q.copy(), np.broadcast_to(box, (*q.shape, 2))
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
        trial = _step(q[live], g[live], H[live], boxes[live], damping[live], effort.indefinite)
        f_new, g_new, H_new = objective(trial, live)
        better = f_new < f[live]
        won, lost = live[better], live[~better]
        q[won], f[won], g[won], H[won] = trial[better], f_new[better], g_new[better], H_new[better]
        damping[won] = np.maximum(0.15 * damping[won], _LEAST_DAMPING)
        damping[lost] *= 6.0
        still = np.abs(trial[~better] - q[lost]).max(axis=1, initial=0.0) < 1e-15
        damping[lost[still]] = _MOST_DAMPING
    return q


def _step(
    q: FloatArray, g: FloatArray, H: FloatArray, box: FloatArray, damping: FloatArray, indefinite: bool
) -> FloatArray:
    """The minimum of the damped quadratic model inside the box, as (k, n) configurations."""
    low, high = box[..., 0], box[..., 1]
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


_COUNT = 2048


class Starts:
    """An even spread of configurations of one arm, always the same, with their tool poses. Immutable."""

    def __init__(self, chain: Chain, limits: FloatArray) -> None:
        low, high = limits.T
        self._q = low + even_spread(_COUNT, np.full(chain.n, 0.5)) * (high - low)
        self._motion = tool_motion(chain, self._q)
        upper = even_spread(_COUNT, np.full(chain.n, 0.5)) > 0.5
        self._part = upper @ 2 ** np.arange(chain.n)
        """which joints are in the upper half of their range, as bits"""

    def nearest_of_parts(self, goal: Goal, box: FloatArray) -> FloatArray:
        """(k, n) as ``nearest_first``, one for every choice of a half of each joint's range.

        Beside the base axis the nearest of all may lie on one side of it, and the minimum on the other.
        """
        rows = goal.rows(self._motion)[0]
        order = np.argsort((rows * rows).sum(axis=1), kind="stable")
        return np.clip(self._q[order[np.unique(self._part[order], return_index=True)[1]]], *box.T)

    def nearest_first(self, goal: Goal, count: int, box: FloatArray) -> FloatArray:
        """(count, n) of them [rad] with the tool nearest to a goal, best first, put into a box (n, 2)."""
        rows = goal.rows(self._motion)[0]
        return np.clip(self._q[np.argsort((rows * rows).sum(axis=1), kind="stable")[:count]], *box.T)


# Meeting goals inside joint limits: all of them from many starts, or one strictly before another.
# ``q`` are (k, n) starts inside the ``box`` (n, 2); what comes back (k, n) is inside it too [rad].

_SEARCH = StoppingRule(iterations=80, floor=0.5e-26, progress=0.02)
_POLISH = StoppingRule(iterations=60, floor=0.5e-28)
_NEAREST = StoppingRule(iterations=150, indefinite=True)
_INNER = StoppingRule(iterations=40, indefinite=True)
_STIFFNESS = 1e3
_OUTER = 8
_ROUGH, _ROUGH_OUTER = StoppingRule(iterations=8, indefinite=True), 3


def meet(chain: Chain, goal: Goal, q: FloatArray, box: FloatArray, polish: bool = False) -> FloatArray:
    """Drive a goal's residuals as low as they come; ``polish``: to the last digit, however slowly."""

    def objective(q: FloatArray, _: IndexArray) -> Cost:
        r, J = goal.rows(tool_motion(chain, q))
        transposed = np.swapaxes(J, 1, 2)
        return 0.5 * (r * r).sum(axis=1), (transposed @ r[:, :, None])[:, :, 0], transposed @ J

    return descend(objective, q, box, _POLISH if polish else _SEARCH)


def come_nearest(chain: Chain, goal: Goal, q: FloatArray, box: FloatArray) -> FloatArray:
    """The local minima of a goal's cost."""
    return descend(lambda q, _: goal.cost(tool_motion(chain, q)), q, box, _NEAREST)


def come_nearest_holding(
    chain: Chain, order: Goal, wish: Goal | Turns, q: FloatArray, box: FloatArray, *, roughly: bool = False
) -> FloatArray:
    """The local minima of the cost of ``wish`` where ``order`` is met exactly, as the starts should already.

    The method of multipliers: each descent minimises the wish plus a stiff spring on the order, and the
    spring's rest length then takes up what was left of it. ``roughly``: the order is met all the same, the
    wish only nearly.
    """
    slack = np.zeros_like(order.rows(tool_motion(chain, q))[0])

    def objective(q: FloatArray, which: IndexArray) -> Cost:
        motion = tool_motion(chain, q)
        f, g, H = wish.cost(motion)
        r, J = order.rows(motion)
        pull = _STIFFNESS * (r + slack[which])
        transposed = np.swapaxes(J, 1, 2)
        f = f + 0.5 * (pull * (r + slack[which])).sum(axis=1)
        g = g + (transposed @ pull[:, :, None])[:, :, 0]
        return f, g, H + _STIFFNESS * (transposed @ J) + order.curvature(motion, pull)

    effort, rounds = (_ROUGH, _ROUGH_OUTER) if roughly else (_INNER, _OUTER)
    for _ in range(rounds):
        q = descend(objective, q, box, effort)
        left = order.rows(tool_motion(chain, q))[0]
        slack += left
        if np.abs(left).max() < 1e-11:
            break
    return meet(chain, order, q, box, polish=True)
