"""The Trajectory screen as an operator uses it."""

from __future__ import annotations

import re

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.ghost_view import LOOKED_AT, wait_for_ghost
from tests.browser.kit import PATIENCE_MS, Screen
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State
from armctl.motion import line, plan_joints, plan_line
from armctl.program import LineStep, MoveStep, Program

pytestmark = pytest.mark.browser
TAB = "Trajectory"
MOTION = "Which motion"
LINE = "Line (29 points)"


def csv_of(page: Screen, button: str) -> list[str]:
    """The lines of the file that a button offers."""
    return page.download(button).read_text().splitlines()


def test_settings_that_were_not_shown_are_not_run_and_a_motion_is_plotted_with_its_peaks_and_run(
    page: Screen, served: ServedArm
) -> None:
    page.wait_for_text("Nothing is shown yet; press Show first.")
    expect(page.button("Run")).to_be_disabled()
    page.choose("To", "zero")
    page.click("Show")
    page.wait_for_text(re.compile(r"at \d+\.\d\d s: tool"))
    page.type_into("Duration s", "9")
    page.wait_for_text("The settings have changed since: press Show.")
    expect(page.button("Run")).to_be_disabled()
    page.type_into("Duration s", "0.2")
    page.click("Show")
    page.wait_for_notification(re.compile("shortest possible duration"))
    page.type_into("Duration s", "x")
    page.click("Show")
    page.wait_for_notification("Duration s: 'x' is not a number")
    page.type_into("Duration s", "0")
    page.choose("To", "X Y Z")
    page.type_into("To X Y Z mm", "900, 0, 100")
    page.click("Show")
    page.wait_for_notification(re.compile("too far by"))
    assert served.commanded_deg == HOME

    page.choose("To", "zero")
    page.click("Show")
    page.wait_for_text(re.compile(r"at \d+\.\d\d s: tool"))
    page.wait_for_text("Tool position (mm)")
    page.screenshot("trajectory-tool")
    page.choose("Graph of", "Joints")
    for quantity, title in (
        ("Velocity", "Joint velocity (°/s)"),
        ("Acceleration", "Joint acceleration (°/s²)"),
        ("Position", "Joint position (°)"),
    ):
        page.choose("Quantity", quantity)
        page.wait_for_text(title)
    joints = [joint.title for joint in served.robot.joints]
    labels = page.page.locator("[name=graph] .legend > span").locator("visible=true")
    with_values = [re.compile(rf"^{joint} −?\d+\.\d$") for joint in joints]
    expect(labels).to_have_text([*with_values, "Shoulder ≥ −3.2", "Elbow ≥ −84.4"])
    page.choose("Limits", "none")
    expect(labels).to_have_text(with_values)
    page.wait_for_text(re.compile("Pre-flight: "))
    page.type_into("Time s", "0.5")
    page.wait_for_text(re.compile(r"at 0\.50 s: tool"))
    path = plan_joints(served.robot, served.robot.pose("home"), np.zeros(5))
    wait_for_ghost(page, served.robot, path.sample(0.5).q, LOOKED_AT)
    plot = page.page.locator("[name=graph] .plot")
    box = plot.bounding_box()
    assert box is not None
    page.page.mouse.click(box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"])
    quarter = 0.25 * path.duration
    page.wait_until(lambda: abs(page.number("Time s") - quarter) < 0.02 * path.duration, "the slider follows")
    wait_for_ghost(page, served.robot, path.sample(page.number("Time s")).q, LOOKED_AT)
    times = page.page.locator("[name=graph] .times")
    all_of_it = times.text_content() or ""
    page.page.mouse.wheel(0, -300)
    expect(times).not_to_have_text(all_of_it)
    page.press(page.page.locator("[name=graph] button", has_text="All"))
    expect(times).to_have_text(all_of_it)
    assert served.commanded_deg == HOME
    page.click("Run")
    served.wait_for_deg(page, [0.0] * 5)
    page.wait_for_text("The arm has moved since: press Show.")
    expect(page.button("Run")).to_be_disabled()
    assert page.errors == []


def test_a_program_and_a_path_are_drawn_run_and_reported_but_not_a_path_that_was_stopped(
    page: Screen, served: ServedArm
) -> None:
    page.choose(MOTION, "Program on the desk")
    page.click("Show")
    page.wait_for_notification(re.compile("has no steps"))
    x, y, z = served.tool_mm.tolist()
    steps = (
        LineStep(x_mm=x, y_mm=y + 50, z_mm=z, blend_mm=10),
        LineStep(x_mm=x, y_mm=y + 50, z_mm=z + 20),
        MoveStep(joints_deg=(10, 80, -80, -40, 0)),
    )
    served.edited.edit(Program(robot="uzuner", name="lines", steps=steps))
    page.click("Show")
    page.wait_for_text(re.compile("program lines: "))
    page.wait_for_text(re.compile(r"at [1-9]\d*\.\d\d s: .*step 3"))  # cursor and ghost stand at its end
    page.type_into("Time s", "0")
    page.wait_for_text(re.compile("at 0.00 s: .*step 1"))
    page.click("Run")
    served.wait_for_deg(page, [10.0, 80.0, -80.0, -40.0, 0.0])

    page.choose(MOTION, LINE)
    page.type_into("Duration s", "60")
    page.click("Show")
    page.wait_for_text(re.compile(r"at \d+\.\d\d s: tool"))
    page.open_tab("Error report")
    page.click("Run")
    page.wait_for_text(re.compile("Applied: recording"))
    page.click("STOP")
    page.wait_for_text(re.compile("did not come to its end"))
    assert served.now.state is State.HOLDING

    page.type_into("Duration s", "0")
    page.click("Show")
    page.wait_for_text(re.compile("Applied: not run yet"))
    page.wait_for_text("Theoretical: 29 points")
    assert page.value("Choose by") == "published"
    page.click("Run")
    page.wait_for_text(re.compile("Applied: recording"))
    page.page.get_by_text("Applied: 29 points").wait_for(timeout=3 * PATIENCE_MS)
    page.wait_for_text(re.compile("transmitted by the board, not measured"))
    page.page.get_by_text("Applied: 29 points").scroll_into_view_if_needed()
    page.screenshot("trajectory-report")
    served.wait_for(page, State.HOLDING)
    assert served.tool_mm == pytest.approx(1000 * line()[-1], abs=0.01)
    head, *rows = csv_of(page, "Export error report (CSV)")
    assert head.split(",")[:4] == ["point", "desired_x_mm", "desired_y_mm", "desired_z_mm"]
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    assert table.shape == (29, 10)
    assert np.abs(table[:, 1:4] - table[:, 4:7]).max() < 1e-5  # theoretical
    strays, line_m = table[:, 7:10] - table[:, 1:4], line()[-1] - line()[0]
    along = np.outer(strays @ line_m, line_m) / (line_m @ line_m)
    assert np.abs(along).max() < 10  # mm; on a busy machine the arm comes late, on the same way
    assert np.abs(strays - along).max() < 0.5  # a quarter microsecond is 0.1 mm here
    page.click("Next")
    page.wait_for_text(re.compile("page 2 of 2"))
    page.type_into("Row", "7")
    wait_for_ghost(page, served.robot, served.robot.inverse(line()[6]).best("published"), LOOKED_AT)


def test_a_study_is_exported_but_not_run_and_two_motions_are_compared_played_exported_and_run(
    page: Screen, served: ServedArm
) -> None:
    page.choose(MOTION, "Joint by joint (study)")
    page.wait_for_text(re.compile("A study: nothing moves"))
    page.click("Show")
    page.wait_for_text(re.compile(r"Shoulder moves the tip fastest: 73\.7 mm/s"))
    page.wait_for_text("Tip speed by joint (mm/s)")
    expect(page.page.locator("[name=study] .legend > span").locator("visible=true")).to_have_text(
        [re.compile(rf"^{joint.title} [\d.–]+$") for joint in served.robot.joints]
    )
    expect(page.page.get_by_role("button", name="Run", exact=True).locator("visible=true")).to_have_count(0)
    page.screenshot("trajectory-study")
    head, *rows = csv_of(page, "Export study (CSV)")
    assert head.startswith("time_s,base_deg") and head.endswith("tip_by_wrist_roll_mm_s")
    assert len(rows) == 601
    page.choose("Turn", "all joints at once")
    page.wait_for_text("The settings have changed since: press Show.")
    page.click("Show")
    page.wait_for_text(re.compile(r"All joints together: at most 136\.2 mm/s"))
    page.type_into("Joint speed °/s", "0")
    page.click("Show")
    page.wait_for_notification(re.compile("0 °/s is outside 1 … 360 °/s"))
    page.choose(MOTION, "Joint motion")
    page.button("Run").wait_for()
    assert served.commanded_deg == HOME

    page.choose("To", "zero")
    page.click("Show")
    page.wait_for_text(re.compile("present pose to zero, cubic: "))
    page.click("Keep as A")
    page.wait_for_text(re.compile("A is present pose to zero, cubic"))
    page.choose("Profile", "s-curve")
    page.click("Show")
    page.wait_for_text("B: present pose to zero, s-curve")
    page.wait_for_text("% of limit")
    page.choose("Graph of", "Joints")
    page.choose("Quantity", "Velocity")
    page.wait_for_text("Joint velocity (°/s)")
    labels = page.page.locator("[name=graph] .legend > span").locator("visible=true")
    expect(labels.nth(0)).to_have_text(re.compile("^B Base "))
    expect(labels.nth(5)).to_have_text(re.compile("^A Base "))
    page.screenshot("trajectory-compared")
    page.click("Play")
    page.wait_for_text(re.compile(r"at 1\.\d\d s: tool"))
    wait_for_ghost(page, served.robot, np.zeros(5), LOOKED_AT)
    assert served.commanded_deg == HOME
    head, *rows = csv_of(page, "Motion (CSV)")
    assert head.startswith("time_s,base_deg,shoulder_deg") and head.endswith(",tool_pitch_deg")
    assert (float(rows[0].split(",")[2]), float(rows[-1].split(",")[2])) == (90, 0)
    svg = "\n".join(csv_of(page, "Figure (SVG)"))
    assert "present pose to zero, s-curve" in svg and "joint velocity (°/s)" in svg
    assert page.download("Figure (PNG)").read_bytes().startswith(b"\x89PNG")
    page.click("Drop A")
    expect(labels.nth(0)).to_have_text(re.compile("^Base "))
    page.click("Run")
    served.wait_for_deg(page, [0.0] * 5)
    assert page.errors == []


def test_the_tool_is_led_along_a_line_freer_if_need_be_and_what_the_pre_flight_refuses_is_not_run(
    page: Screen, served: ServedArm
) -> None:
    page.page.set_viewport_size({"width": 1280, "height": 800})
    page.choose(MOTION, "Tool line")
    page.type_into("End X Y Z mm", "220, -60, 100")
    page.entry("End X Y Z mm").press("Enter")
    page.wait_for_text(re.compile("The tool pitch cannot be kept: the arm would get 5 % of the way"))
    expect(page.button("Run")).to_be_enabled()
    box = page.page.locator("[name=graph] .plot").locator("visible=true").first.bounding_box()
    assert box is not None and box["y"] + box["height"] <= 800
    page.choose("Tool pitch", "kept")
    page.click("Show")
    page.wait_for_text(re.compile("Pre-flight: refused"))
    page.click("Plan it with the tool pitch free")
    page.wait_for_text(re.compile("Pre-flight: clear"))
    page.click("Run")
    page.wait_until(lambda: bool(np.abs(served.tool_mm - [220, -60, 100]).max() < 0.05), "the tool is there")
    served.go_deg(page, HOME)

    robot = served.robot
    tip = 1000 * robot.forward(robot.pose("home"))[:3, 3]
    page.choose("Tool pitch", "kept if possible")
    end = tip.round(1) + np.array([0.0, 60.0, 0.0])
    page.type_into("End X Y Z mm", ", ".join(f"{value:.1f}" for value in end.tolist()))
    page.type_into("Tool speed mm/s", "80")
    page.click("Show")
    page.press(page.page.get_by_text("Numbers and play speed", exact=True))
    page.wait_for_text("Peaks against the limits")
    page.wait_for_text(re.compile(r"asked for: 80 mm/s"))
    page.wait_for_text(re.compile("Pre-flight: clear"))
    wait_for_ghost(page, robot, plan_line(robot, robot.pose("home"), end / 1000).end, LOOKED_AT)
    page.open_tab("Error report")
    page.wait_for_text("Off the ideal line or arc")
    page.click("Run")
    page.page.get_by_text("Applied: 25 points").wait_for(timeout=3 * PATIENCE_MS)
    assert served.tool_mm == pytest.approx(end, abs=0.05)

    before = served.commanded_deg
    page.type_into("End X Y Z mm", "500 0 300")
    page.click("Show")
    page.wait_for_text(re.compile("Pre-flight: refused"))
    page.wait_for_text(re.compile("Drawn as far as the arm can follow"))
    page.screenshot("trajectory-refused")
    page.wait_for_text("The pre-flight refuses it; see why below.")
    expect(page.button("Run")).to_be_disabled()
    page.type_into("End X Y Z mm", "500 0")
    page.click("Show")
    page.wait_for_notification(re.compile("3 numbers are needed"))
    page.choose(MOTION, "Joint motion")
    page.choose("To", "angles")
    page.type_into("To θ °", "200, 90, -80, -40, 0")
    page.click("Show")
    page.wait_for_text(re.compile("Not drawn: Base: 200.00° is outside"))
    assert served.commanded_deg == before
    assert page.errors == []
