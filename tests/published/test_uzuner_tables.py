"""The printed tables of the Uzuner arm, row by row."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from armctl import load_robot

PRINTED = [
    (10.46, -199.73, (-88.039, 43.57, -84.341, -31.568)),
    (21.08, -198.89, (-84.987, 43.57, -84.341, -31.568)),
    (31.63, -197.48, (-81.937, 43.57, -84.339, -31.576)),
    (220.0, -196.0, (-42.402, 14.4, -45.909, -1.305)),
    (220.0, -182.0, (-40.326, 18.92, -53.929, -0.64)),
    (220.0, -168.0, (-38.116, 22.72, -60.482, -0.533)),
]
PEN_PLANE_MM = 85.0


@pytest.mark.parametrize(("x", "y", "angles"), PRINTED)
def test_every_printed_digit(x: float, y: float, angles: tuple[float, ...]) -> None:
    robot = load_robot("uzuner")
    best = np.degrees(robot.inverse([x / 1000, y / 1000, PEN_PLANE_MM / 1000]).best("published"))
    assert np.abs(best[:4] - angles).max() <= 0.0005
    tip = 1000 * robot.forward(np.radians([*angles, 0.0]))[:3, 3]
    assert np.abs(tip - [x, y, PEN_PLANE_MM]).max() <= 0.005


def arc() -> list[list[float]]:
    """58 points on a radius of 200 mm from -87° to 87° [m]."""
    return [
        [0.2 * math.cos(a), 0.2 * math.sin(a), PEN_PLANE_MM / 1000]
        for a in np.radians(np.linspace(-87, 87, 58))
    ]


def line() -> list[list[float]]:
    """29 points at x = 220 mm, y from -196 to 196 mm [m]."""
    return [[0.22, y / 1000, PEN_PLANE_MM / 1000] for y in range(-196, 197, 14)]


@pytest.mark.parametrize(("points", "count"), [(arc, 58), (line, 29)])
@pytest.mark.parametrize("criterion", ["published", "least-rotation", "least-torque"])
def test_both_trajectories_solve_completely(
    points: Callable[[], list[list[float]]], count: int, criterion: str
) -> None:
    robot = load_robot("uzuner")
    path = points()
    assert len(path) == count
    for point in path:
        q = robot.check_limits(robot.inverse(point).best(criterion))
        assert np.abs(robot.forward(q)[:3, 3] - point).max() < 1e-9


def test_the_first_printed_arc_points_are_points_of_the_arc() -> None:
    """10.46 = 200 cos(87°): the arc is about the base axis, its step 174°/57."""
    printed = [[x, y] for x, y, _ in PRINTED[:3]]
    assert np.abs(1000 * np.array(arc())[:3, :2] - printed).max() < 0.02
