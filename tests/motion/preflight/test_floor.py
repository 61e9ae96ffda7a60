from __future__ import annotations

import math

import numpy as np
import pytest

from armctl.motion import Floor
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")


def test_the_turning_column_is_exempt_and_the_tool_is_the_last_part() -> None:
    floor = Floor(ROBOT)
    assert "the base" not in floor.parts
    assert floor.parts[-1] == "the tool"
    assert "the link behind elbow" in floor.parts


def test_heights_are_those_of_the_frames() -> None:
    floor = Floor(ROBOT)
    q = np.radians([20, 40, -30, -60, 10])
    height = 0.163 + 0.125 * math.sin(q[1]) + 0.104 * math.sin(q[1] + q[2]) + 0.101 * math.sin(q[1:4].sum())
    assert floor.clearance(q)[-1] == pytest.approx(height)
    # the lowest corner is never above any point of the straight arm between its joints
    elbow = 0.163 + 0.125 * math.sin(q[1])
    assert np.abs(floor.clearance(q) - elbow).min() < 1e-12


def test_it_takes_many_configurations_at_once() -> None:
    floor = Floor(ROBOT)
    q = np.stack([ROBOT.pose(name) for name in ("home", "rest", "zero")])
    many = floor.clearance(q)
    assert many.shape == (3, len(floor.parts))
    for row, one in zip(many, q, strict=True):
        np.testing.assert_allclose(row, floor.clearance(one), atol=1e-15)
