"""The rows of a pitch against differences, and the pitch that leads round the joint limits."""

from __future__ import annotations

import numpy as np
import pytest
from tests.motion.paths.tool_kit import ABAAS, ROBOTS, SCORBOT, UZUNER, random_start

from armctl.motion.analysis import line
from armctl.motion.paths.tool_curve import ToolLine
from armctl.motion.paths.tool_orientation import (
    AxisPitch,
    PitchGrid,
    carried,
    elevations,
    led_pitches,
    pitch_rows,
)
from armctl.robot import Robot, load_robot


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_carried_columns_are_second_derivatives(robot: Robot) -> None:
    rng, h = np.random.default_rng(3), 1e-6
    for q in (random_start(rng, robot) for _ in range(10)):
        rates = rng.uniform(-1, 1, robot.n)
        J = robot.jacobian(q)
        ahead, behind = robot.jacobian(q + h * rates), robot.jacobian(q - h * rates)
        np.testing.assert_allclose(carried(J[:3], J[3:], rates), (ahead - behind)[:3] / (2 * h), atol=1e-8)


@pytest.mark.parametrize("parts", [(2,), (0, 1)])
def test_rows_of_the_axis_are_derivatives(parts: tuple[int, ...]) -> None:
    rng, h, rows = np.random.default_rng(4), 1e-6, AxisPitch(parts, 0.3, 0.7)
    for q in (random_start(rng, UZUNER) for _ in range(10)):
        rates = rng.uniform(-1, 1, 5)
        ends = [q + way * h * rates for way in (1.0, -1.0)]
        poses = [UZUNER.forward(end) for end in ends]
        value = (rows.missing(ends[1], poses[1], 0.0) - rows.missing(ends[0], poses[0], 0.0)) / (2 * h)
        pose, J = UZUNER.forward(q), UZUNER.jacobian(q)
        np.testing.assert_allclose(rows.rows(pose, J) @ rates, value, atol=1e-8)
        slopes = [rows.rows(pose, UZUNER.jacobian(end)) for pose, end in zip(poses, ends, strict=True)]
        np.testing.assert_allclose(rows.turned(pose, J, rates), (slopes[0] - slopes[1]) / (2 * h), atol=1e-8)
    q, pose = np.zeros(5), UZUNER.forward(np.zeros(5))
    wanted = [(rows.missing(q, pose, 0.1 + way * h), rows.rates(0.1 + way * h)[0]) for way in (1.0, -1.0)]
    slopes = (np.array(wanted[0]) - np.array(wanted[1])) / (2 * h)
    np.testing.assert_allclose(rows.rates(0.1), slopes, atol=1e-8)


@pytest.mark.parametrize("robot", [*ROBOTS, load_robot("ur5")], ids=lambda robot: robot.name)
@pytest.mark.parametrize("end", [None, 0.3])
def test_the_elevation_asked_for_begins_at_that_of_the_arm_and_goes_to_the_end(
    robot: Robot, end: float | None
) -> None:
    rng = np.random.default_rng(8)
    for q in (random_start(rng, robot) for _ in range(10)):
        rows, now = pitch_rows(robot, q, 0.2, end), robot.forward(q)[None]
        begun = float(elevations(robot, now)[0])
        assert rows.elevation(0.0) == pytest.approx(begun, abs=1e-9)
        assert rows.elevation(0.2) == pytest.approx(begun if end is None else end, abs=1e-9)


@pytest.mark.parametrize("robot", [UZUNER, ABAAS, SCORBOT], ids=lambda robot: robot.name)
def test_the_grid_stands_on_the_branch_of_the_arm(robot: Robot) -> None:
    plane = robot.inverse_kinematics.plane
    assert plane is not None
    rng, free = np.random.default_rng(2), 0
    for q in (random_start(rng, robot) for _ in range(8)):
        tool = robot.forward(q)[:3, 3]
        grid = PitchGrid(plane, robot.limits, q, ToolLine(tool, tool + np.array([0.01, 0.02, -0.01])))
        np.testing.assert_allclose(grid.q[0, :, 0], q[1:4], atol=1e-6)
        senses = np.array(plane.signs)
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


def test_the_way_keeps_inside_and_the_led_pitches_keep_near_it() -> None:
    q = UZUNER.inverse(line()[0]).best("least-rotation")
    plane, curve = UZUNER.inverse_kinematics.plane, ToolLine(line()[0], line()[-1])
    assert plane is not None
    grid = PitchGrid(plane, UZUNER.limits, q, curve)
    way = grid.way(np.ones(3))
    index = np.rint(way / grid.turns[1]).astype(int) % len(grid.turns)
    assert way[0] == 0.0 and np.isfinite(grid.toll[np.arange(1, 49), index[1:]]).all()
    for pitch in led_pitches(UZUNER, plane, q, curve):
        values = pitch.curve(grid.places)[:, 0]
        assert values[0] == pytest.approx(pitch.senses @ q, abs=1e-12)
        assert np.abs(values - values[0] - way).max() < np.radians(8.0)
