"""Lesson 2: many ways to a point. Replace each ``...`` by your answer, then run this file with Python."""

from __future__ import annotations

import numpy as np
from exercises import check, near

import armctl

UZUNER = armctl.load_robot("uzuner")
HIGH_M, POINT_M = [0.060, 0.0, 0.300], [0.220, -0.060, 0.100]

# 1. Robot uzuner, X 60, Y 0, Z 300, nothing else asked for: how many branches have solutions?
#    (Inverse, Solve, Branches)
BRANCHES = ...

# 2. X 220, Y -60, Z 100: what is the least sum of all joint angles, in degrees? (Go by least energy: add
#    them up without their signs)
LEAST_ROTATION_DEG = ...

# 3. Y = 0, Z = 100: how far out can the tool be? The largest X in mm, to 1 mm.
FARTHEST_X_MM = ...

# 4. A point X, Y, Z in mm where the tool can point straight down (pitch -90°).
STRAIGHT_DOWN_MM = ...

# 5. Two links of 146.05 and 187.325 mm lie in a plane; the first joint is at (0, 0). Return both ways to put
#    the end at (x, y), each as (first, second) angle in degrees. The second counts from the first link.
UPPER_MM, FORE_MM = 146.05, 187.325


def two_ways(x_mm: float, y_mm: float) -> list[tuple[float, float]]:
    """Both solutions."""
    raise NotImplementedError("write this function")


# What follows checks your answers.


def farthest(answer: float) -> bool:
    inside, beyond = (UZUNER.inverse([x / 1000, 0.0, 0.100]).success for x in (answer - 1.0, answer + 1.0))
    return inside and not beyond


def down(answer: tuple[float, float, float]) -> bool:
    return UZUNER.inverse(np.array(answer) / 1000, pitch=np.radians(-90)).success


def is_inverse(answer: object) -> bool:
    for turn, bend in np.radians(np.random.default_rng(2).uniform((-180, 5), (180, 175), (100, 2))):
        end = UPPER_MM * np.exp(1j * turn) + FORE_MM * np.exp(1j * (turn + bend))
        ways = np.radians(two_ways(end.real, end.imag))
        ends = UPPER_MM * np.exp(1j * ways[:, 0]) + FORE_MM * np.exp(1j * ways.sum(axis=1))
        apart = abs(np.exp(1j * ways[0, 1]) - np.exp(1j * ways[1, 1]))
        if len(ways) != 2 or not np.allclose(ends, end, atol=1e-6) or apart < 1e-6:
            return False
    return True


if __name__ == "__main__":
    found = UZUNER.inverse(POINT_M)
    least = float(np.degrees(np.abs(found.best("least-rotation")).sum()))
    branches = set(UZUNER.inverse(HIGH_M).branch)
    check(
        (BRANCHES, near(len(branches), 0), "Count the branches that are not refused."),
        (LEAST_ROTATION_DEG, near(least, 0.1), "Add up the angles of the ghost, each without its sign."),
        (FARTHEST_X_MM, farthest, "Type larger X until armctl refuses. It names the nearest point."),
        (STRAIGHT_DOWN_MM, down, "Choose 'tool pitch and roll' in Inverse, type -90, go nearer."),
        (two_ways, is_inverse, "The cosine rule gives the second angle, with both signs; then atan2."),
    )
