"""Newton steps, from one start or from many at once; rows of a target; and whether a solution is isolated.

Where there are more or fewer conditions than unknowns a step is that of Gauss and Newton: of those that least
squares allow the shortest one (J. Nocedal and S. J. Wright, "Numerical optimization", 2006, chapter 10).
Paths through complex poses (``general_six.pencil``) check the length of each step besides, a search inside
limits (``numeric.descent``) damps it, and two angles (``subproblems``) are worked in plain floats.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, rotation_angle, skew_part
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


# Whether a solution is isolated, or one of a continuum: joints that can move while the target is met.
#
# Where the Jacobian of what is asked for has a null direction, the arm takes a small step along it and comes
# back onto the target by Newton steps across it. If it meets the target there, the solution is not isolated;
# at a stretched arm, say, it does not.

_LOOKED_AT = 256
"""of a long list, so many solutions are looked at, evenly spread"""
_TRIED = 6
"""of those with a null direction so many are tried"""
_NULL = 1e-5
"""the share of the greatest singular value below which a direction changes nothing"""
_STEPS = 1e-3, 3e-5
"""along a null direction [rad], the second where limits leave no more; there what is isolated misses the
target by about the square"""
_ROUNDS, _NEARER = 23, 0.8
"""to come back by, and what is left of the miss by each: with two null directions that do not depend on each
other, a step may only halve how far off the right one the arm is"""
_FAINT = 1e-9
"""the share of the greatest singular value below which no step is taken"""
_MET = 1e-4
"""how near to the target counts as on it: a share of the square of the step, in [m] and [rad]"""
_MISFIT = 4e-9
"""how far an arm may be from what its family takes it for [m], [rad]"""
_MOVES = 0.02
"""the share of the largest movement from which a joint counts as moving"""
_PUSHED = 1e-4
"""the share of the step by which rounding may push a joint over its limit"""
_UNMET = 1e-6
"""a rotation missed by more is one that the arm can only come near to [rad]"""


def moving_joints(
    chain: Chain, limits: FloatArray, target: Target, q: FloatArray, held: Collection[int], up: FloatArray
) -> tuple[int, ...]:
    """Joints that can move together from one of the solutions ``q`` (k, n) [rad]; none: all are isolated.

    Inside limits (n, 2) [rad]; joints that are ``held`` stay. A pitch is measured against ``up`` (3,).
    """
    free = [k for k in np.flatnonzero(limits[:, 0] < limits[:, 1]).tolist() if k not in held]
    q = q[np.unique(np.linspace(0, len(q) - 1, min(_LOOKED_AT, len(q))).astype(np.intp))]
    J = _rows(chain, target, up, q)(q)[1][:, :, free]
    _, sizes, directions = np.linalg.svd(J)
    rank = (sizes > _NULL * np.maximum(sizes[:, :1], _NULL)).sum(axis=1)
    singular = np.flatnonzero(rank < len(free))
    middle, half = limits.mean(axis=1), 0.5 * np.ptp(limits, axis=1)
    for i in singular[:: max(1, len(singular) // _TRIED)].tolist():
        for direction in _combined(directions[i, rank[i] :]):
            for length in _STEPS:
                step = np.zeros(chain.n)
                step[free] = length * direction
                moved = _moved(chain, target, up, q[i], step, free)
                if moved is None:
                    break
                if (np.abs(q[i] + moved - middle) <= half + max(_PUSHED * length, LIMIT_TOLERANCE)).all():
                    size = np.abs(moved)
                    return tuple(np.flatnonzero(size > _MOVES * size.max()).tolist())
    return ()


def uncertainties(
    chain: Chain, limits: FloatArray, target: Target, q: FloatArray, held: Collection[int], up: FloatArray
) -> FloatArray:
    """How far (k,) rounding, and axes that a family takes as parallel, may carry solutions (k, n) [rad]."""
    free = [k for k in np.flatnonzero(limits[:, 0] < limits[:, 1]).tolist() if k not in held]
    if len(q) == 0 or not free:
        return np.zeros(len(q))
    sizes = np.linalg.svd(_rows(chain, target, up, q)(q)[1][:, :, free], compute_uv=False)
    return _MISFIT / np.maximum(sizes[:, -1], math.sqrt(_MISFIT))


def _combined(null: FloatArray) -> Iterator[FloatArray]:
    """Both ways along each of some unit directions (d, m), and between each two of them."""
    between = [a + sign * b for a, b in itertools.combinations(null, 2) for sign in (1.0, -1.0)]
    for direction in (*null, *(one / math.sqrt(2.0) for one in between)):
        yield direction
        yield -direction


def _moved(
    chain: Chain, target: Target, up: FloatArray, q: FloatArray, step: FloatArray, free: list[int]
) -> FloatArray | None:
    """What the joints (n,) move by when the arm steps aside and comes back onto the target, if it can.

    Whatever the limits.
    """
    length = float(np.linalg.norm(step))
    ahead = step / length
    miss = _rows(chain, target, up, q)
    mask = np.isin(np.arange(chain.n), free)

    def rows(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        r, J = miss(x)
        return np.append(r, ahead @ (x - q) - length), np.vstack([J * mask, ahead])

    met = _MET * length**2
    x, missed = newton(rows, q + step, _ROUNDS, rank=_FAINT, gain=_NEARER, still=met)
    aside = float(np.abs(x - q).max())
    return x - q if missed <= met and 0.1 * length < aside < 10.0 * length else None


def _rows(chain: Chain, target: Target, up: FloatArray, solved: FloatArray) -> Rows:
    """As ``target_rows``; a rotation that solutions (..., n) miss is to be missed by as much."""
    if target.rotation is None:
        return target_rows(chain, target, up)
    missed = rotation_angle(chain.forward(solved)[..., :3, :3] @ target.rotation.T)
    return target_rows(chain, target, up, None if missed.max() < _UNMET else missed)
