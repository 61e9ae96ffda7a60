"""Newton steps: from one start (``newton``), or from many at once (``newton_many``); and rows of a target.

Where there are more or fewer conditions than unknowns a step is that of Gauss and Newton: of those that least
squares allow the shortest one (J. Nocedal and S. J. Wright, "Numerical optimization", 2006, chapter 10).
Paths through complex poses (``general_six.paths``) check the length of each step besides, a search inside
limits (``numeric.descent``) damps it, and two angles (``subproblems``) are worked in plain floats.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import rotation_angle, skew_part
from armctl.kinematics.chain import Chain
from armctl.kinematics.target import Target

Rows = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""what unknowns (..., n) miss (..., m), and its derivatives (..., m, n)"""
_Number = TypeVar("_Number", np.float64, np.complex128)
_SINGULAR = 1e-12
"""directions that the Jacobian of many keeps by less than this share are left alone"""
_LONGEST = 0.3
"""no unknown of many changes by more in a step [rad]"""
_ROUNDING = 2e-14
"""a miss that no step makes smaller"""
_TOWARDS = 1e-6
"""a rotation missed by less has no direction that it is missed in [rad]"""


def newton(
    rows: Rows,
    x: FloatArray,
    steps: int,
    *,
    rank: float,
    gain: float = 1.0,
    still: float = 0.0,
    longest: float = math.inf,
    limits: FloatArray | None = None,
) -> tuple[FloatArray, float]:
    """Of the places that Newton steps lead to from unknowns ``x`` (n,) the best, and the most it misses.

    A step leaves alone the directions that the derivatives keep by less than ``rank`` of the greatest
    singular value; no unknown changes by more than ``longest`` in it, nor leaves ``limits`` (n, 2). The next
    one is made where this one leaves less than ``gain`` of what was missed before, and more than ``still``.
    """
    best, least = x, math.inf
    for left in range(steps, -1, -1):
        off, J = rows(x)
        missed = float(np.abs(off).max())
        goes_on = still < missed < gain * least and left > 0
        if missed < least:
            best, least = x, missed
        if not goes_on:
            break
        step: FloatArray = np.asarray(np.linalg.lstsq(J, off, rcond=rank)[0], dtype=np.float64)
        if longest < math.inf:
            step = step * min(1.0, longest / max(float(np.abs(step).max()), 1e-300))
        x = x - step if limits is None else np.clip(x - step, limits[:, 0], limits[:, 1])
    return best, least


def newton_many(rows: Rows, q: FloatArray, steps: int) -> FloatArray:
    """Of the places that Newton steps lead to from each of ``q`` (k, n) [rad] the best, (k, n).

    As many conditions as unknowns are needed. All go on until none of them comes nearer.
    """
    best, least = q, np.full(len(q), math.inf)
    for _ in range(steps + 1):
        off, J = rows(q)
        missed = np.abs(off).max(axis=1, initial=0.0)
        nearer = missed < least
        best, least = np.where(nearer[:, None], q, best), np.where(nearer, missed, least)
        if not (nearer & (missed > _ROUNDING)).any():
            break
        step = newton_steps(J, off)
        most = np.abs(step).max(axis=1, initial=0.0)
        q = q - step * np.minimum(1.0, _LONGEST / np.maximum(most, 1e-300))[:, None]
    return best


def newton_steps(J: NDArray[_Number], off: NDArray[_Number]) -> NDArray[_Number]:
    """Steps (k, n) that derivatives (k, n, n) turn into (k, n); by least squares where any is singular."""
    try:
        step = np.linalg.solve(J, off[..., None])
    except np.linalg.LinAlgError:
        step = np.linalg.pinv(J, rcond=_SINGULAR) @ off[..., None]
    return step[..., 0].astype(J.dtype, copy=False)


def target_rows(chain: Chain, target: Target, up: FloatArray, missed: FloatArray | None = None) -> Rows:
    """What configurations miss of a target [m], [rad]. A pitch is measured against ``up`` (3,).

    A rotation is met where the skew part of what is left of it is zero; ``missed`` (...) [rad]: where it is
    missed by so much.
    """
    if target.up is not None:
        wish, aim = np.linalg.svd(up[None])[2][1:], 0.0
    else:
        wish, aim = up[None], math.sin(target.pitch or 0.0)

    def rows(q: FloatArray) -> tuple[FloatArray, FloatArray]:
        pose, J = chain.pose_and_jacobian(q)
        off, axes = [pose[..., :3, 3] - target.position], J[..., 3:, :]
        slopes = [J[..., :3, :]]
        if target.rotation is not None:
            turned = pose[..., :3, :3] @ target.rotation.T
            axis = skew_part(turned)
            if missed is None:
                off.append(axis)
                slopes.append(axes)
            else:
                axis = axis / np.maximum(np.linalg.norm(axis, axis=-1), 0.5 * _TOWARDS)[..., None]
                off.append((rotation_angle(turned) - missed)[..., None])
                slopes.append(axis[..., None, :] @ axes)
        elif target.pitch is not None:
            approach = pose[..., :3, 2]
            off.append(approach @ wish.T - aim)
            slopes.append(wish @ np.cross(axes, approach[..., None], axis=-2))
        return np.concatenate(off, axis=-1), np.concatenate(slopes, axis=-2)

    return rows
