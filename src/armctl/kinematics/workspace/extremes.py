"""The greatest value that a smooth function of the joint angles takes inside the limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.workspace.joint_samples import joint_samples

FloatArray = NDArray[np.float64]
_SAMPLES = 2048
_STARTS = 12
_FINEST = 1e-8
"""[rad] a step by which nothing is gained any more"""
_WORTH = 1e-13
"""the least gain that counts, as a share of the value: along a ridge of many joints less would never end"""
_MOST_ROUNDS = 400


def greatest(value: Callable[[FloatArray], FloatArray], limits: FloatArray) -> tuple[float, FloatArray]:
    """The greatest value found, and a configuration (n,) [rad] that has it.

    The best of evenly spread samples climb, each joint a step up or down, with steps that are halved when
    none of them helps. At a maximum the error is of second order in the finest step; where a long ridge
    leads up to it, the search ends with ``_MOST_ROUNDS`` a little below.

    Args:
        value: of configurations (k, n) [rad] -> (k,).
        limits: (n, 2) joint limits [rad].
    """
    low, high = limits.T
    n = len(limits)
    samples = np.concatenate([joint_samples(limits, _SAMPLES), 0.5 * (low + high)[None]])
    at = samples[np.argsort(value(samples))[-_STARTS:]]
    best = value(at)
    sizes = 0.25 * np.ones(len(at))
    moves = np.concatenate([np.eye(n), -np.eye(n)])
    for _ in range(_MOST_ROUNDS):
        if sizes.max() <= _FINEST:
            break
        tried = np.clip(at[:, None] + sizes[:, None, None] * moves, low, high)
        values = value(tried.reshape(-1, n)).reshape(len(at), -1)
        chosen = values.argmax(axis=1)
        gained = values.max(axis=1) > best + _WORTH * np.abs(best)
        rows = np.flatnonzero(gained)
        at[rows], best[rows] = tried[rows, chosen[rows]], values[rows, chosen[rows]]
        sizes = np.where(gained, sizes, 0.5 * sizes)
    top = int(best.argmax())
    return float(best[top]), at[top].copy()
