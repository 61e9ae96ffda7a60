"""Another tool is put on: said in Main, drawn, counted in what the page shows, and in what a program does."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.browser.kit import Screen
from tests.browser.served_arm import ServedArm, served_arm
from tests.robot.test_tools import TOOLS

from armctl.program import PointStep, ToolStep
from armctl.robot import robots_folder

pytestmark = pytest.mark.browser
TAB = "Main"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedArm]:
    """An arm with several tools, of a board without inputs and outputs."""
    text = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")
    file = tmp_path / "uzuner.toml"
    tools = TOOLS.replace('output = "pump"\npart_input = "door"\n', "")
    file.write_text(f"{text}\n{tools}", encoding="utf-8")
    with served_arm(tmp_path / "files", str(file)) as served:
        yield served


def test_another_tool_is_said_to_be_on_and_the_page_shows_its_tip(page: Screen, served: ServedArm) -> None:
    page.choose("Tool", "Felt pen")
    page.click("This tool is on")
    page.wait_until(lambda: served.now.tool == "pen", "the arm knows of it")
    page.wait_for_notification("Felt pen is on")
    page.wait_until(lambda: served.app.robots.console.robot.tool == "pen", "the page shows it")
    tip = 1000 * served.app.robots.console.robot.forward(served.now.q_command)[:3, 3]
    page.wait_until(
        lambda: re.search(rf"X mm\s+{tip[0]:.1f}\b", page.page.inner_text("[name=where]")) is not None,
        "its tip is told",
    )
    page.add_step("Program", "Tool")
    page.wait_until(lambda: served.steps == (ToolStep(tool="pen"),), "the step is on the list")
    served.put_steps(ToolStep(tool="jaws"), PointStep(x_mm=200, y_mm=0, z_mm=120), ToolStep(tool="pen"))
    page.click("Run once")
    page.wait_until(lambda: served.now.tool == "jaws", "the program has changed it")
    page.wait_until(lambda: served.now.program is None and served.now.tool == "pen", "the program is over")
    flange = served.app.robots.console.robot.with_tool("jaws")
    assert 1000 * flange.forward(served.now.q_command)[:3, 3] == pytest.approx(
        np.array([200, 0, 120]), abs=0.01
    )
    assert page.errors == []
