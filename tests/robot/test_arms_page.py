"""docs/arms.md says of each shipped arm what its file says."""

from __future__ import annotations

from pathlib import Path

import pytest

from armctl import load_robot, shipped_robots
from armctl.hardware.boards import board_type
from armctl.robot import Robot

PAGE = Path(__file__).parents[2] / "docs" / "arms.md"


def row(robot: Robot) -> str:
    """The line of the table."""
    board = "simulated" if robot.output_map is None else board_type(robot.board).title
    family = robot.inverse_kinematics.family
    return f"| `{robot.name}` | {robot.title} | {robot.n} | {family} | {board} | {robot.source} |"


@pytest.mark.parametrize("name", shipped_robots())
def test_the_page_has_the_row_of_each_arm(name: str) -> None:
    assert row(load_robot(name)) in PAGE.read_text()
