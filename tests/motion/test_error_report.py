"""Errors of a path: from its line or arc, against a brute-force search, and as the paper prints them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples

from armctl.motion import PointToPoint, arc, line, plan_arc, plan_line, plan_spline
from armctl.motion.analysis import (
    ErrorReport,
    PathError,
    as_printed,
    distances,
    path_error,
)
from armctl.motion.choices import solve_points
from armctl.motion.paths.tool_curve import ToolArc, ToolCurve, ToolLine
from armctl.motion.plan import plan_blended, plan_through
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")
ARC = ToolArc(arc()[0], arc()[29], arc()[-1])
LINE = ToolLine(line()[0], line()[-1])
COORDINATE = st.integers(-400, 400).map(lambda mm: mm / 1000)
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE)


@pytest.mark.parametrize("ideal", [ARC, LINE, ToolArc([0.2, 0, 0.1], [0, 0.2, 0.1], [0, -0.2, 0.1])])
@settings(max_examples=examples(60))
@given(point=POINT)
def test_the_nearest_place_is_the_nearest_of_many(
    ideal: ToolCurve, point: tuple[float, float, float]
) -> None:
    points = np.array([point])
    many = ideal.positions(np.linspace(0.0, ideal.length, 4001))
    brute = float(np.linalg.norm(many - points, axis=1).min())
    found = float(distances(ideal, points)[0])
    assert found <= brute + 1e-12
    assert found >= brute - ideal.length / 4000


def test_the_error_has_its_largest_and_its_time() -> None:
    error = PathError(np.array([0.0, 0.02, 0.04]), np.array([0.0, 0.003, 0.001]))
    assert (error.largest, error.when) == (0.003, 0.02)
    assert error.rms == pytest.approx(math.sqrt(1e-5 / 3))


def test_every_tick_and_the_end_are_looked_at() -> None:
    error = path_error(ROBOT, PointToPoint.lasting(HOME, np.zeros(5), 1.01), LINE)
    assert len(error.time) == 52
    assert error.time[-1] == 1.01 and error.time[1] == pytest.approx(0.02)
    assert len(path_error(ROBOT, PointToPoint.lasting(HOME, HOME, 1e6), LINE).time) == 100_001
    assert len(path_error(ROBOT, PointToPoint.lasting(HOME, HOME, 0.0), LINE).time) == 1


def test_a_tool_line_and_a_tool_arc_keep_to_their_curve() -> None:
    tip = ROBOT.forward(HOME)[:3, 3]
    end, via = tip + np.array([0, 0.08, 0]), tip + np.array([0, 0.04, 0.02])
    straight = path_error(ROBOT, plan_line(ROBOT, HOME, end), ToolLine(tip, end))
    round_ = path_error(ROBOT, plan_arc(ROBOT, HOME, via, end), ToolArc(tip, via, end))
    assert max(straight.largest, round_.largest) < 0.05e-3
    joints = PointToPoint.lasting(HOME, plan_line(ROBOT, HOME, end).end, 2.0)
    assert path_error(ROBOT, joints, ToolLine(tip, end)).largest > 0.05e-3


@pytest.mark.parametrize("choose", ["published", "least-rotation"])
@pytest.mark.parametrize("points", [arc(), line()], ids=["arc", "line"])
def test_the_theoretical_error_is_the_paper_s_when_rounded_as_printed(
    points: np.ndarray, choose: str
) -> None:
    solved = solve_points(ROBOT, points, choose, HOME)
    exact = ErrorReport(points, ROBOT.forward(solved)[:, :3, 3])
    printed = ErrorReport(points, ROBOT.forward(as_printed(solved))[:, :3, 3])
    assert exact.rmse.max() < 5e-12
    assert 0 < printed.rmse.max() <= 0.005e-3
    assert np.degrees(as_printed(solved)) == pytest.approx(np.degrees(solved), abs=0.00051)


def test_a_spline_and_a_blended_motion_pass_the_points_without_a_stop() -> None:
    solved = solve_points(ROBOT, arc(), "least-rotation", HOME)
    stops = plan_through(ROBOT, list(solved))
    smooth = plan_spline(ROBOT, solved, checked=False)
    blended = plan_blended(ROBOT, list(solved), 0.002)
    for motion in (smooth, blended):
        assert motion.start == pytest.approx(solved[0], abs=1e-12)
        assert motion.end == pytest.approx(solved[-1], abs=1e-12)
        inner = np.linspace(0.05, 0.95, 500) * motion.duration
        assert np.abs(motion.sample(inner).velocity).max(axis=1).min() > 0.1
        assert motion.duration < stops.duration / 2
        assert path_error(ROBOT, motion, ARC).largest < 0.05e-3 + 0.004**2 / 8 / 0.2
    slower = plan_blended(ROBOT, list(solved), 0.002, 2 * blended.duration)
    assert slower.duration == pytest.approx(2 * blended.duration)


def test_the_arc_has_58_points_and_begins_as_printed() -> None:
    points = arc()
    assert points.shape == (58, 3)
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 0.2)
    assert (points[:, 2] == 0.085).all()
    printed = [[10.46, -199.73], [21.08, -198.89], [31.63, -197.48]]
    np.testing.assert_allclose(1000 * points[:3, :2], printed, atol=0.03)


def test_the_line_has_29_points_from_minus_196_to_196() -> None:
    points = line()
    assert points.shape == (29, 3)
    np.testing.assert_allclose(1000 * points[:3], [[220, -196, 85], [220, -182, 85], [220, -168, 85]])
    np.testing.assert_allclose(1000 * points[-1], [220, 196, 85])
