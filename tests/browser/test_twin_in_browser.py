"""A page of ``armctl twin``, opened as a file, without armctl and without a network."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.kit import Screen

from armctl.program import GripperStep, MoveStep, Program, Step, check_program
from armctl.program.rehearsal import Rehearsal
from armctl.robot import load_robot
from armctl.ui.twin_file import planned_for_file, program_file

pytestmark = pytest.mark.browser
ROBOT = load_robot("uzuner")
STEPS = (MoveStep(joints_deg=(60, 60, -40, -40, 0)), MoveStep(joints_deg=(0, 0, 0, 0, 0)))
GRIP = GripperStep(open_percent=60, part_x_mm=25, part_y_mm=25, part_z_mm=25)


def opened(screen: Screen, file: Path, *steps: Step) -> Rehearsal:
    """The page of a program, without a network; its plan."""
    program = Program(robot="uzuner", name="mine", steps=steps)
    plan = planned_for_file(ROBOT, program, ROBOT.first_pose, None)
    findings = check_program(program, ROBOT, start=ROBOT.first_pose)
    file.write_text(program_file(ROBOT, program, plan, findings), encoding="utf-8")
    screen.page.context.set_offline(True)
    screen.page.goto(file.as_uri())
    screen.page.wait_for_function("window.__viserMutable?.nodeRefFromName['/arm/tool']")
    return plan


def test_a_file_plays_and_is_scrubbed_offline(screen: Screen, tmp_path: Path) -> None:
    file, page, asked = tmp_path / "mine.html", screen.page, list[str]()
    page.on("request", lambda request: asked.append(request.url))
    plan = opened(screen, file, *STEPS)
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


def test_a_part_is_in_view_while_it_is_carried(screen: Screen, tmp_path: Path) -> None:
    plan = opened(screen, tmp_path / "carried.html", STEPS[0], GRIP, STEPS[1], GripperStep(open_percent=100))
    page, node = screen.page, "window.__viserMutable.nodeRefFromName['/arm/tool/part0']"
    begins = [step.begins for step in plan.steps]
    for k, carried in enumerate((False, True, True, False)):
        page.locator("#twin-seek").fill(str(round(begins[k] + 0.2, 2)))
        page.wait_for_function(f"{node} && {node}.visible === {str(carried).lower()}")
        screen.screenshot(f"twin-file-part-{k}")
    page.context.set_offline(False)
    assert screen.errors == []
