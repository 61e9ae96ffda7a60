"""Recognition of six-joint arms with three parallel axes in a row, and the numbers of their solution."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armctl.arrays import ArrayRecord, FloatArray
from armctl.kinematics.chain import Chain

_PARALLEL = 1e-9
"""sine of the angle, or share of the reach, by which an arm may miss the family; polished away"""
_EXACT = 1e-13
"""a miss that is nothing but rounding"""
_SHORTEST = 1e-6
"""parallel axes nearer to each other than this share of the reach are one axis"""


@dataclass(frozen=True, slots=True, eq=False)
class ThreeParallel(ArrayRecord):
    """One arm, all joints at zero, in the base frame [m].

    The joints ``first``, ``first + 1`` and ``first + 2`` turn about the direction ``k``. In the closed loop
    of arm and target the others follow: ``a``, ``b`` and ``c``, where those ahead of the first come behind
    the target.
    """

    first: int
    axes: FloatArray
    """(6, 3) unit vectors"""
    points: FloatArray
    """(6, 3) one on each axis; those of two others that meet are where they meet"""
    plane: FloatArray
    """(3, 3) rows i, j, k: a right-handed frame, k along the parallel axes"""
    signs: tuple[float, float, float]
    """of each parallel axis: 1 along k, -1 against it"""
    links: FloatArray
    """(2, 2) from each parallel axis to the next in the coordinates i, j"""
    T_tool_base: FloatArray
    """(4, 4) the inverse of the tool pose at zero"""
    meet: tuple[bool, bool]
    """whether the axes a and b, b and c meet: that splits the equations"""
    exact: bool
    """False: the arm is beside the family by rounded numbers, and its ways need to be polished"""

    @property
    def straight(self) -> float:
        """The angle of the middle parallel joint at which both links are in line [rad]."""
        one, other = np.arctan2(self.links[:, 1], self.links[:, 0]).tolist()
        return one - other

    @property
    def others(self) -> tuple[int, int, int]:
        """The joints a, b and c."""
        a, b, c = ((self.first + i) % 6 for i in (3, 4, 5))
        return a, b, c


def recognise_three_parallel(chain: Chain) -> ThreeParallel | None:
    """The arm's geometry; None for an arm with other than six joints, or without three parallel axes.

    None too where four axes are parallel, or two are one line: such an arm moves without moving its tool.
    """
    if chain.n != 6:
        return None
    points, axes = chain.axes()
    tool = chain.forward(np.zeros(6))
    reach = float(np.linalg.norm(np.diff(np.vstack([points, tool[:3, 3]]), axis=0), axis=1).sum()) or 1.0
    crossed = np.linalg.norm(np.cross(axes[:-1], axes[1:]), axis=1)
    parallel = crossed < _PARALLEL
    for first in range(4):
        if parallel[first] and parallel[first + 1]:
            break
    else:
        return None
    if parallel[max(first - 1, 0) : first].any() or parallel[first + 2 : first + 3].any():
        return None
    k = axes[first]
    i = np.cross(np.eye(3)[int(np.abs(k).argmin())], k)
    i /= np.linalg.norm(i)
    plane = np.stack([i, np.cross(k, i), k])
    three = slice(first, first + 3)
    links = np.diff(points[three] @ plane[:2].T, axis=0)
    if np.linalg.norm(links, axis=1).min() < _SHORTEST * reach:
        return None
    misses = [float(crossed[first]), float(crossed[first + 1])]
    a, b, c = ((first + n) % 6 for n in (3, 4, 5))
    meet = [False, False]
    for which, (one, other) in enumerate(((a, b), (b, c))):
        if other != one + 1 or meet[0]:
            continue  # one is ahead of the parallel axes, one behind: that they meet depends on the pose
        gap, feet = _nearest_points(points[[one, other]], axes[[one, other]])
        if gap < _PARALLEL * reach and feet is not None:
            points[[one, other]] = feet
            meet[which] = True
            misses.append(gap / reach)
    sign, middle, last = (math.copysign(1.0, float(axes[n] @ k)) for n in range(first, first + 3))
    inverse = np.linalg.inv(tool).astype(np.float64)
    exact = max(misses) < _EXACT
    signs = sign, middle, last
    return ThreeParallel(first, axes, points, plane, signs, links, inverse, (meet[0], meet[1]), exact)


def _nearest_points(points: FloatArray, axes: FloatArray) -> tuple[float, FloatArray | None]:
    """How far two lines are apart [m], and the middle of the gap for both (2, 3); None where parallel."""
    normal = np.cross(*axes)
    size = float(normal @ normal)
    apart = points[1] - points[0]
    if size < _PARALLEL**2:
        return float(np.linalg.norm(np.cross(apart, axes[0]))), None
    along = [float(np.cross(apart, axis) @ normal) / size for axis in (axes[1], axes[0])]
    feet = points + np.array(along)[:, None] * axes
    return float(np.linalg.norm(feet[1] - feet[0])), np.tile(feet.mean(axis=0), (2, 1))
