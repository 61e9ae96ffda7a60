"""Whether a solution is isolated, or one of a continuum: joints that can move while the target is met.

Where the Jacobian of what is asked for has a null direction, the arm takes a small step along it and comes
back onto the target by Newton steps across it. If it meets the target there, the solution is not isolated;
at a stretched arm, say, it does not.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, rotation_angle
from armctl.kinematics.chain import Chain
from armctl.kinematics.newton import Rows, newton, target_rows
from armctl.kinematics.target import Target

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
