"""Values of one joint and configurations of an arm, spread over the joint limits; always the same ones."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.facts.angles import DEGREE, in_degrees
from armctl.kinematics.angles import rest_angle
from armctl.kinematics.target import checked_number

_SEED = 20_240


def joint_samples(limits: FloatArray, count: int, seed: int = _SEED) -> FloatArray:
    """Configurations (count, n) [rad] inside the limits (n, 2), ends included; the same ones for a seed.

    An ``even_spread`` of the moving joints. Three in four crowd towards the limits, where much of the
    boundary of a workspace comes from, and half of those have a joint on a limit.
    """
    low, high = limits.T
    moving = np.flatnonzero(high > low)
    rng = np.random.default_rng(seed)
    m = len(moving)
    u = even_spread(count, rng.random(m))
    kind = np.arange(count) % 4
    u = np.where((kind > 0)[:, None], np.sin(0.5 * np.pi * u) ** 2, u)
    if m:
        snapped = np.flatnonzero(kind > 1)
        u[snapped, rng.integers(m, size=len(snapped))] = rng.integers(2, size=len(snapped))
    q = np.tile(low, (count, 1))
    q[:, moving] = np.clip(low[moving] + u * (high - low)[moving], low[moving], high[moving])
    return q


def even_spread(count: int, start: FloatArray) -> FloatArray:
    """(count, d) points of the unit cube, evenly spread from ``start`` on.

    A Kronecker sequence whose steps are powers of the root of x^(d+1) = x + 1 (M. Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018).
    """
    d = len(start)
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (d + 1))
    steps = root ** -np.arange(1.0, d + 1)
    return (start + steps * np.arange(1, count + 1)[:, None]) % 1.0


# The greatest value that a smooth function of the joint angles takes inside the limits.

_SAMPLES = 2048
_STARTS = 12
_FINEST = 1e-8
"""[rad] a step by which nothing is gained any more"""
_WORTH = 1e-13
"""the least gain that counts, as a share of the value: along a ridge of many joints less would never end"""
_MOST_ROUNDS = 400


def greatest(value: Callable[[FloatArray], FloatArray], limits: FloatArray) -> tuple[float, FloatArray]:
    """The greatest ``value`` found inside limits (n, 2), and a configuration (n,) [rad] that has it.

    The best of evenly spread samples climb, each joint a step up or down, with steps that are halved when
    none of them helps.
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


# The values that a swept joint takes.

DEFAULT_STEP = 0.01 * DEGREE
"""the paper's step of the swept joint [rad]"""
_MOST_VALUES = 2_000_000
_SLACK = 1e-6
"""how far outside a limit a multiple of the step may lie by rounding, in steps"""


def checked_step(step: float) -> float:
    """A sweep's step [rad] as a float. Raises ``InputError`` where it is not a positive finite number."""
    step = checked_number(step, "the step of the swept joint")
    if step <= 0.0:
        raise InputError(f"the step of the swept joint must be a positive angle, got {step!r} rad")
    return step


def grid_values(low: float, high: float, step: float) -> FloatArray:
    """Whole multiples of ``step`` within a joint's limits [rad], rising.

    Limits too narrow for one, such as those of a held joint, have the angle that is nearest to zero.
    Raises ``InputError``: ``step`` is so small that there are too many values.
    """
    if (high - low) / step > _MOST_VALUES:
        least = in_degrees(1.005 * (high - low) / _MOST_VALUES, ".3g")
        raise InputError(
            f"the step of the swept joint must be an angle of at least {least}, got {in_degrees(step, '.6g')}"
        )
    first, last = math.ceil(low / step - _SLACK), math.floor(high / step + _SLACK)
    if first > last:
        return np.array([rest_angle(low, high)])
    return np.clip(step * np.arange(first, last + 1, dtype=np.float64), low, high)
