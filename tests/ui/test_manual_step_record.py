from __future__ import annotations

import numpy as np
import pytest

from armctl.errors import StateError
from armctl.program import ArcStep, LineStep, PointStep
from armctl.robot import load_robot, shipped_robots
from armctl.ui.tabs.program.record import ARC, LINE, POINT, step_here, tool_point_mm

ROBOT = load_robot("uzuner")
HOME_DEG = (0.0, 90.0, -80.0, -40.0, 0.0)


@pytest.mark.parametrize("name", shipped_robots())
def test_a_recorded_point_leads_back_to_where_the_arm_stood(name: str) -> None:
    robot = load_robot(name)
    q = robot.pose(next(iter(robot.poses)))
    pose_deg = tuple(np.degrees(q).tolist())
    step = step_here(POINT, robot, pose_deg, None)
    assert isinstance(step, PointStep)
    pitch, roll = (None if angle is None else np.radians(angle) for angle in (step.pitch_deg, step.roll_deg))
    point = np.array([step.x_mm, step.y_mm, step.z_mm]) / 1000
    solutions = robot.inverse(point, pitch=pitch, roll=roll)
    assert np.abs(robot.forward(solutions.q)[:, :3, 3] - robot.forward(q)[:3, 3]).max() < 2e-6


def test_line_and_arc_end_where_the_tool_is() -> None:
    x, y, z = tool_point_mm(ROBOT, HOME_DEG)
    assert step_here(LINE, ROBOT, HOME_DEG, None) == LineStep(x_mm=x, y_mm=y, z_mm=z)
    via = (1.0, 2.0, 3.0)
    assert step_here(ARC, ROBOT, HOME_DEG, via) == ArcStep(
        via_x_mm=1, via_y_mm=2, via_z_mm=3, x_mm=x, y_mm=y, z_mm=z
    )


def test_an_arc_needs_a_via_point() -> None:
    with pytest.raises(StateError, match="an arc needs a point on its way: bring the tool there"):
        step_here(ARC, ROBOT, HOME_DEG, None)


def test_an_arm_whose_place_decides_about_its_pitch_lets_it_come_as_it_comes() -> None:
    mico = load_robot("mico")
    pose = tuple(np.degrees(mico.pose("home")).tolist())
    line, point = step_here(LINE, mico, pose, None), step_here(POINT, mico, pose, None)
    assert isinstance(line, LineStep)
    assert isinstance(point, PointStep)
    assert (line.pitch, point.pitch_deg) == ("free", None)
