"""Configurations spread over the joint limits, always the same ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_SEED = 20_240


def joint_samples(limits: FloatArray, count: int, seed: int = _SEED) -> FloatArray:
    """Configurations (count, n) [rad] inside the limits, ends included.

    A Kronecker sequence in the moving joints (steps of powers of the root of ``x^(m+1) = x + 1``): spread
    more evenly than random numbers. Three in four crowd towards the limits, where much of the boundary
    of a workspace comes from, and half of those have a joint on a limit.

    Args:
        limits: (n, 2) [rad]; a joint whose limits are equal is held there.
        count: how many.
        seed: another one gives another set.
    """
    low, high = limits.T
    moving = np.flatnonzero(high > low)
    rng = np.random.default_rng(seed)
    m = len(moving)
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (m + 1))
    steps = root ** -np.arange(1.0, m + 1)
    u = (rng.random(m) + steps * np.arange(1, count + 1)[:, None]) % 1.0
    kind = np.arange(count) % 4
    u = np.where((kind > 0)[:, None], np.sin(0.5 * np.pi * u) ** 2, u)
    if m:
        snapped = np.flatnonzero(kind > 1)
        u[snapped, rng.integers(m, size=len(snapped))] = rng.integers(2, size=len(snapped))
    q = np.tile(low, (count, 1))
    q[:, moving] = np.clip(low[moving] + u * (high - low)[moving], low[moving], high[moving])
    return q
