"""Meeting goals inside joint limits: all of them from many starts, or one strictly before another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.chain import DHChain
from armctl.kinematics.numeric.descent import Effort, IndexArray, descend
from armctl.kinematics.numeric.goals import Goal
from armctl.kinematics.numeric.motion import tool_motion

FloatArray = NDArray[np.float64]
_SEARCH = Effort(iterations=80, floor=0.5e-26, progress=0.02)
_POLISH = Effort(iterations=60, floor=0.5e-28)
_NEAREST = Effort(iterations=150, indefinite=True)
_INNER = Effort(iterations=40, indefinite=True)
_STIFFNESS = 1e3
_OUTER = 8


def meet(
    chain: DHChain, goal: Goal, q: FloatArray, lower: FloatArray, upper: FloatArray, polish: bool = False
) -> FloatArray:
    """Drive a goal's residuals to zero, or to where they come no lower.

    Args:
        chain: the arm.
        goal: what to meet.
        q: (k, n) starts inside the box [rad].
        lower: (k, n) the box [rad].
        upper: (k, n) the box [rad].
        polish: True to go on to the last digit also where progress is slow.

    Returns:
        (k, n) configurations inside the box [rad].
    """

    def objective(q: FloatArray, _: IndexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        r, J = goal.rows(tool_motion(chain, q))
        transposed = np.swapaxes(J, 1, 2)
        return 0.5 * (r * r).sum(axis=1), (transposed @ r[:, :, None])[:, :, 0], transposed @ J

    return descend(objective, q, lower, upper, _POLISH if polish else _SEARCH)[0]


def come_nearest(
    chain: DHChain, goal: Goal, q: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """The local minima (k, n) of a goal's cost inside the box, from starts ``q`` (k, n) [rad]."""

    def objective(q: FloatArray, _: IndexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        return goal.cost(tool_motion(chain, q))

    return descend(objective, q, lower, upper, _NEAREST)[0]


def come_nearest_holding(
    chain: DHChain, order: Goal, wish: Goal, q: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """The local minima (k, n) of the cost of ``wish`` inside the box where ``order`` is met exactly.

    Starts should meet ``order`` already. The method of multipliers: each descent minimises the wish plus a
    stiff spring on the order, and the spring's rest length then takes up what was left of it; the last
    digits of the order are polished alone.
    """
    slack = np.zeros_like(order.rows(tool_motion(chain, q))[0])

    def objective(q: FloatArray, which: IndexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        motion = tool_motion(chain, q)
        f, g, H = wish.cost(motion)
        r, J = order.rows(motion)
        pull = _STIFFNESS * (r + slack[which])
        transposed = np.swapaxes(J, 1, 2)
        f = f + 0.5 * (pull * (r + slack[which])).sum(axis=1)
        g = g + (transposed @ pull[:, :, None])[:, :, 0]
        return f, g, H + _STIFFNESS * (transposed @ J) + order.curvature(motion, pull)

    for _ in range(_OUTER):
        q, _cost = descend(objective, q, lower, upper, _INNER)
        left = order.rows(tool_motion(chain, q))[0]
        slack += left
        if np.abs(left).max() < 1e-11:
            break
    return meet(chain, order, q, lower, upper, polish=True)
