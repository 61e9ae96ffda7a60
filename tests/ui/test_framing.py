"""The first view: the whole arm and what is straight ahead of it are in the picture, whatever its size."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from armctl.kinematics import Chain
from armctl.robot import Robot, load_robot, shipped_robots
from armctl.ui.scene.stage import floor_size, framed, in_view, reach

FloatArray = NDArray[np.float64]
FOV = math.radians(75)
AWAY = np.array([0.6, 0.7, 0.3])


def scaled(robot: Robot, factor: float) -> Robot:
    """The same arm, so many times as large."""
    rows = tuple(replace(row, a_m=factor * row.a_m, d_m=factor * row.d_m) for row in robot.chain.rows)
    return replace(robot, chain=Chain.from_dh(rows, robot.chain.convention), floor_z=factor * robot.floor_z)


def on_picture(points: FloatArray, position: FloatArray, centre: FloatArray, aspect: float) -> FloatArray:
    """(k, 2) where points are on a picture whose edges are at -1 and 1."""
    back = (position - centre) / np.linalg.norm(position - centre)
    right = np.cross([0, 0, 1], back) / np.linalg.norm(np.cross([0, 0, 1], back))
    axes = np.stack([right, np.cross(back, right), back])
    x, y, z = ((points - position) @ axes.T).T
    assert (z < 0).all()  # in front of the camera
    return np.stack([x / aspect, y], axis=1) / (-z * math.tan(FOV / 2))[:, None]


@pytest.mark.parametrize("aspect", [0.5, 0.73, 1.13, 2.4])
@pytest.mark.parametrize("factor", [0.2, 1.0, 6.0])
@pytest.mark.parametrize("name", shipped_robots())
def test_an_arm_of_any_size_fills_the_picture_and_does_not_leave_it(
    name: str, factor: float, aspect: float
) -> None:
    points = in_view(scaled(load_robot(name), factor))
    at = on_picture(points, *framed(points, AWAY, FOV, aspect, 0.8), aspect)
    assert np.abs(at).max() == pytest.approx(0.8)


def test_a_single_point_is_looked_at_from_where_it_is() -> None:
    position, centre = framed(np.ones((1, 3)), AWAY, FOV, 1.0, 0.8)
    assert centre == pytest.approx(np.ones(3))
    assert position == pytest.approx(centre)


@pytest.mark.parametrize("factor", [0.2, 1.0, 6.0])
@pytest.mark.parametrize("name", shipped_robots())
def test_the_floor_is_under_all_that_the_arm_reaches(name: str, factor: float) -> None:
    robot = scaled(load_robot(name), factor)
    assert 0.5 * floor_size(robot) >= reach(robot)
    assert floor_size(robot) <= 1.6 or 0.5 * floor_size(robot) < reach(robot) + 0.25
