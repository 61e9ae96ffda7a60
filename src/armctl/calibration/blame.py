"""Which parameters of an arm explain where its tool went, as far as the touched points can tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.calibration.geometry import Geometry

FloatArray = NDArray[np.float64]
TOUCH_M = 0.0005
"""standard deviation of a coordinate of a touch, before anything is measured [m]"""
TOUCH_WEIGHT = 5.0
"""how many coordinates that is worth"""
UNSEEN_M = 0.00005
"""what moves the tool by less than this for a unit of error cannot be seen [m]"""
_FALSE_ALARM = 0.01
_MOST_BLAMED = 3
_ROUNDS = 12
_SHARE = 0.1
"""of a movement of the tool; what has less part in it is not named"""
_PROMISING = 0.25
"""of the best drop that the first derivatives foresee; candidates below it are not looked at closer"""


@dataclass(frozen=True, slots=True)
class Correction:
    """Errors of some parameters that explain the touches best."""

    chosen: tuple[int, ...]
    amounts: FloatArray
    """of each chosen parameter, in its unit"""
    left: FloatArray
    """(k, 3) what they leave [m]"""
    columns: FloatArray
    """(k, 3, p) derivatives by all parameters there [m a unit]"""

    @property
    def squares(self) -> float:
        """Summed squares of what is left [m²]."""
        return float(np.sum(self.left**2))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of ``variance``."""
        return TOUCH_WEIGHT + self.left.size - len(self.chosen)

    @property
    def variance(self) -> float:
        """Of one coordinate [m²], from what is left and from what a touch is known for."""
        return (TOUCH_WEIGHT * TOUCH_M**2 + self.squares) / self.freedom

    @property
    def standard_errors(self) -> FloatArray:
        """Of each amount, in its unit."""
        seen = self.columns[..., list(self.chosen)].reshape(-1, len(self.chosen))
        return np.sqrt(self.variance * np.diag(np.linalg.inv(seen.T @ seen)))


@dataclass(frozen=True, slots=True)
class Step:
    """One parameter that was blamed, and those that would have explained as much."""

    parameter: int
    or_else: tuple[int, ...]


def find_blame(geometry: Geometry, points: FloatArray) -> tuple[Correction, tuple[Step, ...]]:
    """Blame one parameter after another, while each makes the touches fit better than chance would.

    Chance: at the level of 1 % over all the parameters that could have been blamed (Bonferroni).

    Args:
        geometry: the arm at the configurations (k, n) in which it touched.
        points: (k, 3) what it touched [m].
    """
    now = solve(geometry, points, ())
    steps: list[Step] = []
    for _ in range(_MOST_BLAMED):
        tried = _tried(geometry, points, now)
        if not tried:
            break
        least = min(one.squares for one in tried)
        best = next(one for one in tried if one.squares - least <= 1e-6 * one.variance)
        limit = _quantile(1 - _FALSE_ALARM / (2 * len(geometry.parameters)), best.freedom)
        if now.squares - best.squares <= limit**2 * best.variance:
            break
        doubt = _quantile(1 - _FALSE_ALARM / 2, best.freedom) ** 2 * best.variance
        like = [one.chosen[-1] for one in tried if one is not best and one.squares - least <= doubt]
        steps.append(Step(best.chosen[-1], tuple(like)))
        now = best
    return now, tuple(steps)


def solve(
    geometry: Geometry, points: FloatArray, chosen: Sequence[int], start: FloatArray | None = None
) -> Correction:
    """The errors of the chosen parameters that explain the points best (Gauss-Newton)."""
    picked = list(chosen)
    amounts = np.zeros(len(picked)) if start is None else start.copy()
    errors = np.zeros(len(geometry.parameters))
    errors[picked] = amounts
    tips, columns = geometry.tips(errors)
    left = points - tips
    for _ in range(_ROUNDS if picked else 0):
        step = np.linalg.lstsq(columns[..., picked].reshape(-1, len(picked)), left.ravel(), rcond=None)[0]
        if np.abs(step).max() < 1e-9:
            break
        errors[picked] = amounts = amounts + step
        tips, columns = geometry.tips(errors)
        left = points - tips
    return Correction(tuple(picked), amounts, left, columns)


def unseen(columns: FloatArray) -> tuple[tuple[int, ...], tuple[tuple[int, ...], ...]]:
    """What the touches cannot tell: parameters without effect, and sets of which any one could be the others.

    Args:
        columns: (k, 3, p) derivatives of the tool points [m a unit].

    Returns:
        The parameters without effect, and the sets that depend on each other, by index.
    """
    flat = columns.reshape(-1, columns.shape[-1]) / math.sqrt(len(columns))
    size = np.linalg.norm(flat, axis=0)
    told: list[int] = []
    sets: list[tuple[int, ...]] = []
    # In the order of likelihood: a set says which likelier ones another one looks like.
    for column in np.flatnonzero(size >= UNSEEN_M).tolist():
        before = flat[:, told]
        share = np.linalg.lstsq(before, flat[:, column], rcond=None)[0]
        if np.linalg.norm(flat[:, column] - before @ share) >= UNSEEN_M:
            told.append(column)
            continue
        matters = np.abs(share) * size[told] > _SHARE * size[column]
        sets.append((*(i for i, one in zip(told, matters.tolist(), strict=True) if one), column))
    return tuple(np.flatnonzero(size < UNSEEN_M).tolist()), tuple(sorted(_merged(sets)))


def _merged(sets: list[tuple[int, ...]]) -> list[tuple[int, ...]]:
    """Sets of two that share one are one: each of their parameters could be any other."""
    pairs = [set(one) for one in sets if len(one) == 2]
    merged: list[set[int]] = []
    for pair in pairs:
        apart = [one for one in merged if not one & pair]
        merged = [*apart, pair.union(*(one for one in merged if one & pair))]
    return [*(one for one in sets if len(one) != 2), *(tuple(sorted(one)) for one in merged)]


def _tried(geometry: Geometry, points: FloatArray, now: Correction) -> list[Correction]:
    """What one more parameter would make of it, for each promising one, the likeliest first."""
    drops = _drops(now)
    if drops.max(initial=0.0) <= 0:
        return []
    promising = np.flatnonzero(drops >= _PROMISING * drops.max())
    return [solve(geometry, points, (*now.chosen, int(i)), np.append(now.amounts, 0.0)) for i in promising]


def _drops(now: Correction) -> FloatArray:
    """(p,) how much of the squares each further parameter would take away, by the first derivatives."""
    left, columns = now.left.ravel(), now.columns.reshape(now.left.size, -1)
    if now.chosen:
        basis = np.linalg.qr(columns[:, list(now.chosen)])[0]
        columns = columns - basis @ (basis.T @ columns)
    size = np.linalg.norm(columns, axis=0)
    told = size >= UNSEEN_M * math.sqrt(len(now.left))
    drops = (columns.T @ left) ** 2 / np.where(told, size, 1.0) ** 2
    return np.where(told, drops, 0.0)


def _quantile(probability: float, freedom: float) -> float:
    from scipy.special import stdtrit  # slow to import, and only a tool error needs it

    return float(stdtrit(freedom, probability))
