"""How far a point of an arm can move a radian of a joint."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import DHChain

FloatArray = NDArray[np.float64]


def lever_bounds(chain: DHChain, link: int, points: FloatArray) -> FloatArray:
    """How far points of a link move a radian of each joint, at most: (n,) [m/rad].

    Args:
        chain: the arm.
        link: index of the joint that moves the points; -1: the base.
        points: (p, 3) in the link's frame [m].
    """
    levers = np.zeros(chain.n)
    aside = float(np.hypot(points[:, 0], points[:, 1]).max())
    away = float(np.linalg.norm(points, axis=1).max())
    for j in reversed(range(link + 1)):
        levers[j] = aside
        x, y, z = chain.segments[j][:3, 3].tolist()
        aside, away = math.hypot(x, y) + away, math.hypot(x, y, z) + away
    return levers
