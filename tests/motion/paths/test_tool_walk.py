"""Steps along a curve: their derivatives against differences, and where they leave the limits."""

from __future__ import annotations

import math
import os
from dataclasses import replace

import numpy as np
import pytest
from tests.motion.paths.tool_kit import ROBOTS, SCORBOT, UZUNER, random_start

from armctl import load_robot
from armctl.motion.paths.tool_curve import ToolArc, ToolLine
from armctl.motion.paths.tool_orientation import pitch_rows
from armctl.motion.paths.tool_walk import SHORTEST, StepBudget, ToolTask, repulsion, walk
from armctl.robot import Robot

FREE, KEPT, LED = "free", "kept", "interpolated"


def task_of(robot: Robot, q: np.ndarray, mode: str, *, push: float = 0.0) -> ToolTask:
    """A task along an arc from where the tool is; the last joint stands."""
    tool = robot.forward(q)[:3, 3]
    curve = ToolArc(tool, tool + np.array([0.02, 0.01, 0.015]), tool + np.array([0.05, -0.01, 0.01]))
    pitch = None if mode == FREE else pitch_rows(robot, q, curve.length, 0.2 if mode == LED else None)
    moving = np.arange(robot.n - 1)
    return ToolTask(robot.chain, curve, moving, pitch, robot.speed_limits, robot.limits, push)


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
        assert knot.slope[-1] == 0.0 and knot.bend[-1] == 0.0
        tried += 1
    assert tried >= 3 or robot.name == "mico"


def test_a_walk_that_comes_near_no_limit_is_the_same_with_a_push() -> None:
    rng, felt = np.random.default_rng(7), list[bool]()
    low, high = UZUNER.limits.T
    for share in rng.uniform(0.2, 0.8, (12, UZUNER.n)):
        q = low + share * (high - low)
        task = task_of(UZUNER, q, FREE)
        least, pushed = (
            walk(one, q, only_inside=True, effort=StepBudget(20)) for one in (task, replace(task, push=6.0))
        )
        felt.append(task.nears_limits(least.knots))
        same = [knot.q.tolist() for knot in least.knots] == [knot.q.tolist() for knot in pushed.knots]
        assert same or felt[-1]
    assert any(felt) and not all(felt)


@pytest.mark.parametrize("name", ["mearm", "uarm"])
def test_a_parallel_linkage_follows_a_line_in_few_steps(name: str) -> None:
    """Its links follow several joints: with the bend of a plain chain a step would be a millimetre long."""
    robot = load_robot(name)
    q = robot.pose("home")
    tool = robot.forward(q)[:3, 3]
    line = ToolLine(tool, tool + np.array([0.0, 0.05, 0.02]))
    task = ToolTask(robot.chain, line, np.arange(3), None, robot.speed_limits, robot.limits)
    knot, h = task.knot(q, 0.0), 1e-6
    assert knot is not None
    ahead, behind = (task.knot(q + k * h * knot.slope + 0.5 * h * h * knot.bend, k * h) for k in (1.0, -1.0))
    assert ahead is not None and behind is not None
    np.testing.assert_allclose(knot.bend, (ahead.slope - behind.slope) / (2 * h), rtol=1e-5, atol=1e-3)
    way = walk(task, q, only_inside=True)
    assert way.complete and len(way.knots) < 12


@pytest.mark.parametrize("most", [3, 40])
def test_a_walk_that_was_given_up_goes_on_as_if_it_had_not_been(most: int) -> None:
    rng, farther = np.random.default_rng(8), 0
    for q in (random_start(rng, SCORBOT) for _ in range(5)):
        tool = SCORBOT.forward(q)[:3, 3]
        curve = ToolLine(tool, tool + np.array([0.3, 0.2, -0.3]))  # most end at a limit or out of reach
        pitch = pitch_rows(SCORBOT, q, curve.length, None)
        task = ToolTask(SCORBOT.chain, curve, np.arange(4), pitch, SCORBOT.speed_limits, SCORBOT.limits)
        left = StepBudget(most, SHORTEST)
        anew = walk(task, q, only_inside=False, effort=left)
        for steps in (1, 6, 20):
            given_up, going_on = (
                walk(task, q, only_inside=True, effort=StepBudget(steps)),
                StepBudget(most, SHORTEST),
            )
            way = walk(task, q, only_inside=False, effort=going_on, before=given_up)
            assert [knot.s for knot in way.knots] == [knot.s for knot in anew.knots]
            assert (way.complete, way.crossing, going_on.left) == (anew.complete, anew.crossing, left.left)
            farther += len(way.knots) > len(given_up.knots) > 1
    assert farther >= 3 or most == 3


def test_a_free_joint_moves_as_little_as_serves() -> None:
    q = UZUNER.pose("home")
    task = task_of(UZUNER, q, FREE)
    knot = task.knot(q, 0.0)
    assert knot is not None
    free = np.linalg.svd(UZUNER.jacobian(q)[:3, :4])[2][3]  # moves no tool point
    weighted = knot.slope[:4] / UZUNER.speed_limits[:4] ** 2
    assert abs(free @ weighted) < 1e-9 * np.linalg.norm(weighted)


@pytest.mark.parametrize("bent_deg", [0.1, 0.12, 0.15, 0.3, 1.0])
def test_an_elbow_that_is_nearly_straight_bends_further_to_its_own_side(bent_deg: float) -> None:
    rng, followed = np.random.default_rng(3), 0
    pairs = 20 if os.environ.get("ARMCTL_LONG") else 8
    for side in (1.0, -1.0) * pairs:
        q = random_start(rng, SCORBOT)
        q[2] = side * math.radians(bent_deg)  # straight at 0
        tool = SCORBOT.forward(q)[:3, 3]
        curve = ToolLine(tool, rng.uniform(0.6, 0.9) * tool + rng.uniform(-0.03, 0.03, 3))
        pitch = pitch_rows(SCORBOT, q, curve.length, None)
        task = ToolTask(SCORBOT.chain, curve, np.arange(4), pitch, SCORBOT.speed_limits, SCORBOT.limits)
        way = walk(task, q, only_inside=False)
        if way.path is not None:  # else too near to a singular pose to begin
            assert (side * np.array([knot.q[2] for knot in way.knots]) > 0.0).all()
            followed += 1
    assert followed >= 0.4 * pairs, followed


def test_a_push_leads_away_from_both_limits() -> None:
    limits, q = np.array([[-1.0, 1.0]] * 3), np.array([-1.0, 0.0, 0.9])
    push, change = repulsion(q, limits, 2.0)
    # as a gradient: the motion goes against it; it begins 0.35 rad from a limit
    np.testing.assert_allclose(push, [-2.0, 0.0, 2.0 * (0.25 / 0.35) ** 3])
    h = 1e-6
    ends = [repulsion(q + way * h, limits, 2.0)[0] for way in (1.0, -1.0)]
    np.testing.assert_allclose(change, (ends[0] - ends[1]) / (2 * h), atol=1e-4)
