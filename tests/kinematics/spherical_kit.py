"""Arms with a spherical shoulder and an elbow: the humanoid, and random ones."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np
from tests.kinematics.kit import FloatArray, random_q, rows_of, solver_of

from armctl.kinematics import Chain, DHRow, Solutions
from armctl.kinematics.families.spherical_shoulder.solver import SphericalShoulderSolver

QUARTER = math.pi / 2
STEP = math.radians(0.5)
HUMANOID = Chain.from_dh(
    [
        DHRow(0.0, QUARTER, 0.0, QUARTER),
        DHRow(0.0, -QUARTER, 0.0, QUARTER),
        DHRow(-0.35, 0.0, 0.0),
        DHRow(0.0, -QUARTER, 0.0, QUARTER),
        DHRow(0.0, 0.0, 0.29),
    ],
    "standard",
)
"""the humanoid paper's DH table"""
HUMANOID_LIMITS = np.radians([[-90, 90], [-90, 0], [0, 180], [0, 90], [0, 0.0]])
TITLES = ("Shoulder swing", "Shoulder lift", "Shoulder turn", "Elbow", "Wrist roll")


def spherical_solver(
    chain: Chain, limits: FloatArray, titles: tuple[str, ...] = ()
) -> SphericalShoulderSolver:
    ik = solver_of(chain, limits, titles)
    assert isinstance(ik, SphericalShoulderSolver)
    return ik


def random_arm(rng: np.random.Generator) -> tuple[Chain, FloatArray]:
    """Axes at any angle, offsets, tools, both conventions; limits narrow, wide, fixed, over a full turn."""

    def some(low: float, high: float) -> float:
        return float(rng.choice([0.0, rng.uniform(low, high)]))

    def twist() -> float:
        return float(rng.choice([QUARTER, -QUARTER, rng.uniform(0.4, 2.7), -rng.uniform(0.4, 2.7)]))

    steps = [("z", some(-2, 2), rng.uniform(-0.2, 0.2), False), ("x", some(-2, 2), some(-0.1, 0.1), False)]
    steps += [("z", 0.0, some(-0.2, 0.2), True)]
    for _ in range(2):
        steps += [("z", some(-2, 2), 0.0, False), ("x", twist(), 0.0, False), ("z", 0.0, 0.0, True)]
    steps += [("z", some(-2, 2), some(-0.3, 0.3), False)]
    steps += [("x", float(rng.choice([0.0, QUARTER, twist()])), rng.uniform(0.05, 0.3), False)]
    steps += [("z", some(-2, 2), 0.0, True), ("z", some(-2, 2), some(-0.1, 0.1), False)]
    if rng.random() < 0.6:
        steps += [("x", twist(), some(0.05, 0.2), False), ("z", 0.0, rng.uniform(0.05, 0.3), True)]
        if rng.random() < 0.4:
            steps += [("z", some(-2, 2), 0.0, False), ("x", some(-2, 2), 0.0, False)]
    else:
        steps += [("x", some(-2, 2), rng.uniform(0.05, 0.3), False), ("z", 0.0, some(-0.1, 0.1), False)]
    convention: Literal["standard", "modified"] = "standard" if rng.random() < 0.5 else "modified"
    chain = Chain.from_dh(rows_of(steps, convention), convention)
    low, high = -rng.uniform(0.1, 3.3, chain.n), rng.uniform(0.1, 3.3, chain.n)
    k = rng.integers(chain.n)
    kind = rng.random()
    if kind < 0.25:  # a joint that cannot pass zero
        low[k] = rng.uniform(0.1, 1.0)
        high[k] = low[k] + rng.uniform(0.3, 3.5)
    elif kind < 0.35:  # more than a full turn
        low[k], high[k] = -4.0, 7.0
    elif kind < 0.5:  # fixed
        high[k] = low[k]
    return chain, np.stack([low, high], axis=1)


def configurations(limits: FloatArray, rng: np.random.Generator, count: int) -> Iterator[FloatArray]:
    """Random ones, every third with some joints exactly on their limits."""
    for i in range(count):
        q = random_q(rng, limits)
        if i % 3 == 2:
            at = rng.random(len(q)) < 0.6
            q = np.where(at, limits[np.arange(len(q)), rng.integers(2, size=len(q))], q)
        yield q


def singular_configuration(
    ik: SphericalShoulderSolver, limits: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Elbow straight or folded, shoulder axes in one plane, or both; exactly or nearly; some at limits."""
    q = random_q(rng, limits)
    near = rng.choice([0.0, 0.0, 1e-9, 1e-7, 1e-5], 2)
    kind = rng.integers(1, 4)
    if kind & 1:
        q[3] = math.remainder(rng.choice([0.0, math.pi]) - ik.geometry.offset, 2 * math.pi) + near[0]
    if kind & 2:
        q[1] = math.remainder(ik.geometry.singular + rng.choice([0.0, math.pi]), 2 * math.pi) + near[1]
    if rng.random() < 0.4:
        at = rng.random(len(q)) < 0.5
        q = np.where(at, limits[np.arange(len(q)), rng.integers(2, size=len(q))], q)
    return np.clip(q, *limits.T)


def assert_reached(solutions: Solutions, limits: FloatArray) -> None:
    """Every solution inside the limits and on the target."""
    assert solutions.success, solutions.reason
    assert ((solutions.q >= limits[:, 0]) & (solutions.q <= limits[:, 1])).all()
    assert solutions.residual_m.max() < 1e-9


def miss(solutions: Solutions, q: FloatArray) -> float:
    """Largest joint difference of the nearest solution [rad]."""
    return float(np.abs(solutions.q - q).max(axis=1).min())
