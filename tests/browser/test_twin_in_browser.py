"""A page of ``armctl twin``, opened as a file, without armctl and without a network."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.kit import Screen

from armctl.program import MoveStep, Program, check_program
from armctl.robot import load_robot
from armctl.ui.twin_file import planned_for_file, program_file

pytestmark = pytest.mark.browser
ROBOT = load_robot("uzuner")
STEPS = (MoveStep(joints_deg=(60, 60, -40, -40, 0)), MoveStep(joints_deg=(0, 0, 0, 0, 0)))


def test_a_file_plays_and_is_scrubbed_offline(screen: Screen, tmp_path: Path) -> None:
    program = Program(robot="uzuner", name="mine", steps=STEPS)
    plan = planned_for_file(ROBOT, program, ROBOT.first_pose, None)
    findings = check_program(program, ROBOT, start=ROBOT.first_pose)
    file = tmp_path / "mine.html"
    file.write_text(program_file(ROBOT, program, plan, findings), encoding="utf-8")
    page, asked = screen.page, list[str]()
    page.on("request", lambda request: asked.append(request.url))
    page.context.set_offline(True)
    page.goto(file.as_uri())
    page.wait_for_function("window.__viserMutable?.nodeRefFromName['/arm/tool']")
    end = f"{plan.duration:.1f} / {plan.duration:.1f} s"
    page.locator("#twin-speed").select_option("8")
    expect(page.locator("#twin-time")).to_have_text(end)  # played to its end by itself

    def tool_is(time: float) -> bool:
        tool = ROBOT.forward(plan.sample(time).q)[:3, 3]
        seen = screen.node("/arm/tool")
        return seen is not None and float(np.abs(tool - seen).max()) < 1e-3

    screen.wait_until(lambda: tool_is(plan.duration), "the arm is where the plan ends")
    page.locator("#twin-seek").fill("0.5")
    screen.wait_until(lambda: tool_is(0.5), "the arm is where the slider says")
    page.get_by_role("button", name="step 2").click()
    begins = plan.steps[1].begins
    screen.wait_until(lambda: tool_is(begins), "the arm is where the step begins that was found")
    expect(page.locator("#twin-step")).to_contain_text("Step 2 of 2: pose")
    angle = page.locator("#twin-side .values b").first.inner_text()
    assert float(angle.replace("−", "-")) == pytest.approx(np.degrees(plan.sample(begins).q[0]), abs=0.06)
    graph = page.locator("#twin-side svg").first
    box = graph.bounding_box()
    assert box is not None
    left, width = (float(graph.get_attribute(f"data-{name}") or "nan") for name in ("left", "width"))
    graph.click(position={"x": (left + 0.25 * width) * box["width"] / 384, "y": box["height"] / 2})
    at = 0.25 * plan.duration
    screen.wait_until(lambda: abs(float(page.locator("#twin-seek").input_value()) - at) < 0.02, "the graph")
    screen.screenshot("twin-file")
    page.context.set_offline(False)
    assert asked == [file.as_uri()]
    assert screen.errors == []
