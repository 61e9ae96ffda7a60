"""Where a numeric search starts: configurations spread over the joint limits, nearest to the goal first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.chain import DHChain
from armctl.kinematics.numeric.goals import Goal
from armctl.kinematics.numeric.motion import tool_motion

FloatArray = NDArray[np.float64]
_COUNT = 2048


class Starts:
    """An even spread of configurations of one arm, with their tool poses. Immutable.

    The spread is an additive recurrence with irrational steps, not random numbers: the same arm has the
    same starts in every process and every thread.
    """

    def __init__(self, chain: DHChain, limits: FloatArray) -> None:
        self._q = limits[:, 0] + _even_spread(_COUNT, chain.n) * (limits[:, 1] - limits[:, 0])
        self._motion = tool_motion(chain, self._q)

    def nearest_first(self, goal: Goal, count: int) -> FloatArray:
        """(count, n) configurations [rad] whose tool poses come nearest to the goal, the nearest first."""
        rows = goal.rows(self._motion)[0]
        return self._q[np.argsort((rows * rows).sum(axis=1), kind="stable")[:count]]


def _even_spread(count: int, dimensions: int) -> FloatArray:
    """(count, dimensions) points of the unit cube: multiples of powers of a generalised golden ratio.

    The ratio is the positive root of x^(d+1) = x + 1 (M. Roberts, "The unreasonable effectiveness of
    quasirandom sequences", 2018).
    """
    ratio = 1.5
    for _ in range(64):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    return (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0
