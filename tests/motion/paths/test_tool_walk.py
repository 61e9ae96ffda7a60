"""The derivatives along a path, against differences."""

from __future__ import annotations

import numpy as np
import pytest
from tests.motion.paths.tool_kit import ROBOTS, UZUNER, random_start

from armctl.motion.paths.tool_curve import ToolArc
from armctl.motion.paths.tool_pitch import AxisPitch, carried, pitch_rows
from armctl.motion.paths.tool_walk import Repulsion, ToolTask
from armctl.robot import Robot

FREE, KEPT, LED = "free", "kept", "interpolated"


def task_of(robot: Robot, q: np.ndarray, mode: str, *, push: float = 0.0) -> ToolTask:
    """A task along an arc from where the tool is, over a roll joint that turns, whatever the limits are."""
    tool = robot.forward(q)[:3, 3]
    curve = ToolArc.through(tool, tool + np.array([0.02, 0.01, 0.015]), tool + np.array([0.05, -0.01, 0.01]))
    moving = np.arange(robot.n - 1)
    rate = np.zeros(robot.n)
    rate[-1] = 1.5
    led = np.zeros(robot.n)
    led[-1] = q[-1]
    pitch = None if mode == FREE else pitch_rows(robot, q, curve.length, 0.2 if mode == LED else None)
    margin = np.full(robot.n, 1.0)
    repulsion = Repulsion(robot.limits, margin, push)
    return ToolTask(robot.chain, curve, moving, led, rate, pitch, robot.speed_limits, repulsion)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
@pytest.mark.parametrize("mode", [FREE, KEPT, LED])
@pytest.mark.parametrize("push", [0.0, 3.0])
def test_the_bend_is_the_derivative_of_the_slope_along_the_path(robot: Robot, mode: str, push: float) -> None:
    rng, tried = np.random.default_rng(5), 0
    for q in (random_start(rng, robot) for _ in range(12)):
        task = task_of(robot, q, mode, push=push)
        if task.rows > len(task.moving):
            assert robot.name == "mico"
            continue
        knot = task.knot(q, 0.0)
        if knot is None or np.abs(knot.slope).max() > 60.0:
            continue
        # along the path's own direction and curvature, of which the slope is a function of place
        h = 1e-6
        sides = [
            task.knot(q + way * h * knot.slope + 0.5 * h * h * knot.bend, way * h) for way in (1.0, -1.0)
        ]
        assert sides[0] is not None and sides[1] is not None
        differences = (sides[0].slope - sides[1].slope) / (2 * h)
        np.testing.assert_allclose(knot.bend, differences, atol=1e-4 * (1 + np.abs(knot.bend).max()))
        np.testing.assert_allclose(
            robot.jacobian(q)[:3] @ knot.slope, task.curve.derivatives(0.0)[1], atol=1e-9
        )
        assert knot.slope[-1] == 1.5 and knot.bend[-1] == 0.0
        tried += 1
    assert tried >= 3 or robot.name == "mico"


def test_a_free_joint_moves_as_little_as_serves() -> None:
    q = UZUNER.pose("home")
    task = task_of(UZUNER, q, FREE)
    knot = task.knot(q, 0.0)
    assert knot is not None
    free = np.linalg.svd(UZUNER.jacobian(q)[:3, :4])[2][3]  # moves no tool point
    weighted = knot.slope[:4] / UZUNER.speed_limits[:4] ** 2
    assert abs(free @ weighted) < 1e-9 * np.linalg.norm(weighted)


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
        value = (rows.value(ends[0], poses[0]) - rows.value(ends[1], poses[1])) / (2 * h)
        pose, J = UZUNER.forward(q), UZUNER.jacobian(q)
        np.testing.assert_allclose(rows.rows(pose, J) @ rates, value, atol=1e-8)
        slopes = [rows.rows(pose, UZUNER.jacobian(end)) for pose, end in zip(poses, ends, strict=True)]
        np.testing.assert_allclose(rows.turned(pose, J, rates), (slopes[0] - slopes[1]) / (2 * h), atol=1e-8)
    wanted = [rows.wanted(0.1 + way * h) for way in (1.0, -1.0)]
    np.testing.assert_allclose(rows.wanted(0.1)[1:], (wanted[0] - wanted[1])[:2] / (2 * h), atol=1e-8)


def test_a_push_leads_away_from_both_limits() -> None:
    repulsion = Repulsion(np.array([[-1.0, 1.0]] * 3), np.full(3, 0.5), 2.0)
    push, change = repulsion.push(np.array([-1.0, 0.0, 0.9]))
    np.testing.assert_allclose(push, [-2.0, 0.0, 2.0 * 0.8**3])  # as a gradient: the motion goes against it
    h = 1e-6
    ends = [repulsion.push(np.array([-1.0, 0.0, 0.9]) + way * h)[0] for way in (1.0, -1.0)]
    np.testing.assert_allclose(change, (ends[0] - ends[1]) / (2 * h), atol=1e-5)
