"""README and docs/arms.md describe each shipped arm as its file does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from armctl import load_robot, shipped_robots
from armctl.hardware.boards import board_type
from armctl.robot import Robot

ROOT = Path(__file__).parents[2]
PAGE, README = ROOT / "docs" / "arms.md", ROOT / "README.md"


def board(robot: Robot) -> str:
    """What the column *board* says."""
    return "simulated only" if robot.simulated_only is not None else board_type(robot.board).title


def row(robot: Robot) -> str:
    """The line of the table."""
    family = robot.inverse_kinematics.family
    return f"| `{robot.name}` | {robot.title} | {robot.n} | {family} | {board(robot)} | {robot.source} |"


@pytest.mark.parametrize("name", shipped_robots())
def test_the_page_has_the_row_of_each_arm(name: str) -> None:
    assert row(load_robot(name)) in PAGE.read_text()


def test_the_readme_says_of_each_arm_which_board_it_needs() -> None:
    """A row an arm, and none else; arms of one board need the same."""
    text = README.read_text()
    assert f"armctl ships [{len(shipped_robots())} arms]" in text
    table = re.findall(r"^\| `(\w+)` \| (.+?) \| (.+?) \| (.+?) \|$", text, re.MULTILINE)
    assert sorted(name for name, *_ in table) == sorted(shipped_robots())
    needs: dict[str, str] = {}
    for name, title, shown, need in table:
        robot = load_robot(name)
        assert (title, shown) == (robot.title, board(robot))
        if robot.simulated_only is not None:
            assert need == f"nothing: {robot.simulated_only}"
        else:
            assert needs.setdefault(shown, need) == need
