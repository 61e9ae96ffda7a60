"""The way round the joint limits of an arm whose pitch is free."""

from __future__ import annotations

import numpy as np
import pytest
from tests.motion.paths.tool_kit import ABAAS, SCORBOT, UZUNER, random_start, strays

from armctl.motion.error_report import line
from armctl.motion.paths.tool_curve import ToolLine
from armctl.motion.paths.tool_path import tool_line
from armctl.motion.paths.tool_pitch import PitchGrid, led_pitch, motion_weights, plane_senses
from armctl.robot import Robot


@pytest.mark.parametrize("robot", [UZUNER, ABAAS, SCORBOT], ids=lambda robot: robot.name)
def test_the_grid_stands_on_the_branch_of_the_arm(robot: Robot) -> None:
    plane = robot.inverse_kinematics.plane
    assert plane is not None
    rng, free = np.random.default_rng(2), 0
    for q in (random_start(rng, robot) for _ in range(8)):
        tool = robot.forward(q)[:3, 3]
        grid = PitchGrid.of(plane, robot.limits, q, ToolLine(tool, tool + np.array([0.01, 0.02, -0.01])))
        np.testing.assert_allclose(grid.q[0, :, 0], q[1:4], atol=1e-6)
        senses = plane_senses(plane, robot.n)[1:4]
        for i, a in zip(rng.integers(49, size=40), rng.integers(360, size=40), strict=True):
            if not np.isfinite(grid.toll[i, a]):
                continue
            pitch_joints = grid.q[i, :, a]
            assert (pitch_joints >= robot.limits[1:4, 0] - 1e-9).all()
            assert (pitch_joints <= robot.limits[1:4, 1] + 1e-9).all()
            turned = senses @ (pitch_joints - q[1:4]) - grid.turns[a]
            assert abs(np.angle(np.exp(1j * turned))) < 1e-9
            tip = robot.forward(np.array([q[0], *pitch_joints, *q[4:]]))[:3, 3]
            wanted = tool + grid.places[i] / grid.places[-1] * np.array([0.01, 0.02, -0.01])
            assert tip[2] == pytest.approx(wanted[2], abs=1e-9)
            assert np.hypot(*tip[:2]) == pytest.approx(np.hypot(*wanted[:2]), abs=1e-9)
            free += 1
    assert free > 10


def test_the_way_keeps_inside_and_the_led_pitch_keeps_near_it() -> None:
    q = UZUNER.inverse(line()[0]).best("least-rotation")
    plane = UZUNER.inverse_kinematics.plane
    assert plane is not None
    grid = PitchGrid.of(plane, UZUNER.limits, q, ToolLine(line()[0], line()[-1]))
    way = grid.way(motion_weights(UZUNER.speed_limits))
    index = np.rint(way / grid.turns[1]).astype(int) % len(grid.turns)
    assert way[0] == 0.0 and np.isfinite(grid.toll[np.arange(1, 49), index[1:]]).all()
    curve = led_pitch(grid, way, 0.7, 3.0)
    values = curve(grid.places)[:, 0]
    assert values[0] == pytest.approx(0.7, abs=1e-12)
    assert np.abs(values - 0.7 - way).max() < np.radians(5.0)


def test_a_line_goes_round_a_limit_that_the_least_motion_runs_into() -> None:
    q = UZUNER.inverse(line()[0]).best("least-rotation")
    path = tool_line(UZUNER, q, line()[-1], "free")
    away, pitch = strays(UZUNER, path)
    low, high = path.polynomial.extremes()
    assert away < 0.011e-3
    assert (low >= UZUNER.limits[:, 0] - 1e-8).all() and (high <= UZUNER.limits[:, 1] + 1e-8).all()
    assert np.degrees(np.ptp(pitch)) > 20.0  # as no kept pitch could
