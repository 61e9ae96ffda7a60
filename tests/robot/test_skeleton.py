"""How long an arm is, whatever stands between its base and its first joint, or behind its last one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.robot.test_urdf_tool import JAW, PROP
from tests.robot.urdf_kit import Step, written

from armctl.robot import Robot, load_robot, shipped_robots
from armctl.robot.shape import reach


def farthest(robot: Robot) -> float:
    """Of the tool from the base, over many configurations, limits left aside [m]."""
    q = np.random.default_rng(7).uniform(-np.pi, np.pi, (20_000, robot.n))
    return float(np.linalg.norm(robot.forward(q)[:, :3, 3], axis=1).max())


@pytest.mark.parametrize("name", shipped_robots())
def test_no_tool_point_of_a_shipped_arm_is_farther_away(name: str) -> None:
    robot = load_robot(name)
    assert farthest(robot) <= reach(robot.chain) <= 1.35 * farthest(robot)


RAISED = (Step("mount", "fixed", "world", "w/base", "0.3 0 0.8", "0.2 0.1 0"), *PROP)


@pytest.mark.parametrize("steps", [JAW, PROP, RAISED])
def test_no_tool_point_of_a_urdf_arm_is_farther_away(tmp_path: Path, steps: tuple[Step, ...]) -> None:
    robot = load_robot(written(tmp_path / "arm.urdf", steps))
    assert farthest(robot) <= reach(robot.chain) <= 1.35 * farthest(robot)


def test_a_straight_arm_is_as_long_as_its_links(tmp_path: Path) -> None:
    steps = (
        Step("a", "revolute", "base", "one", "0 0 0.1", axis="0 1 0"),
        Step("b", "revolute", "one", "two", "0 0 0.2", axis="0 1 0"),
        Step("end", "fixed", "two", "tool0", "0 0 0.3"),
    )
    assert reach(load_robot(written(tmp_path / "arm.urdf", steps)).chain) == pytest.approx(0.6, abs=1e-12)
