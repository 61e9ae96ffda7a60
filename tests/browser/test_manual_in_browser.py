"""The Manual screen as an operator uses it."""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path

import pytest
from playwright.sync_api import Locator, expect
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State
from armctl.program import (
    ArcStep,
    CommentStep,
    EndStep,
    GripperStep,
    LineStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    SpeedStep,
    WaitStep,
    load_program,
    save_program,
)
from armctl.ui.tabs.manual.shared_program import LeftProgram

pytestmark = pytest.mark.browser

TAB = "Manual"
BROKEN = """format = 1
robot = "uzuner"
name = "broken"
[[steps]]
do = "wait"
seconds = 1
[[steps]]
do = "move"
joint_deg = [0, 90, -80, -40, 0]
"""


def put(page: Screen, served: ServedArm, *poses: tuple[float, ...]) -> None:
    """Put a program of poses on the list, and open the tab that shows it."""
    served.put(*poses)
    page.open_tab("Serial motion")
    page.wait_for_text(re.compile(f"test · {len(poses)} step"))


def click_in(page: Screen, row: str, button: str) -> None:
    page.click(button, within=page.row(row))


def rows(page: Screen) -> Locator:
    return page.page.get_by_role("grid", name="Steps of the program").get_by_role("row")


def select(page: Screen, number: int) -> None:
    """Click a row of the list, from 1."""
    row = rows(page).nth(number - 1)
    page.press(row)
    expect(row).to_have_attribute("aria-selected", "true")


def test_sliders_move_the_arm_only_after_go_and_quick_steps_add_up_to_the_limit(
    page: Screen, served: ServedArm
) -> None:
    page.type_into("Base °", "25.5")
    page.wait_for_text("The sliders show the next pose")
    limits = page.row("Elbow °").locator(".mantine-Slider-markLabel")
    expect(limits).to_have_text(["−84.4", "95.1"])
    thumb, limit = page.row("Elbow °").get_by_role("slider").bounding_box(), limits.first.bounding_box()
    assert thumb is not None and limit is not None
    assert thumb["x"] < limit["x"] + limit["width"]  # it stands above the number
    assert thumb["y"] + thumb["height"] <= limit["y"] + 1
    page.screenshot("manual-joints")
    assert served.commanded_deg == HOME
    page.click("Go")
    served.wait_for_deg(page, [25.5, *HOME[1:]])
    page.wait_for_text(re.compile("The sliders show the arm"))
    page.nudge("Elbow °")
    page.wait_for_text("The sliders show the next pose")
    page.click("Sliders to present pose")
    page.wait_until(lambda: page.number("Elbow °") == -80, "the slider is back")
    click_in(page, "Wrist roll", "+")
    served.wait_for_deg(page, [25.5, *HOME[1:4], 1.0])
    page.wait_until(lambda: page.number("Wrist roll °") == 1, "the slider has followed")

    page.choose("Step °", "5")
    for _ in range(4):
        click_in(page, "Base", "+")
    served.wait_for_deg(page, [45.5, *HOME[1:4], 1.0])
    assert page.notifications() == []
    page.choose("Step °", "10")
    click_in(page, "Elbow", "−")
    page.wait_for_notification(
        re.compile(r"Elbow: −10° from −80\.00° leads to −90\.00°, the limit is −84\.36°")
    )
    page.choose("Step °", "0.1")
    click_in(page, "Elbow", "−")
    served.wait_for_deg(page, [45.5, 90.0, -80.1, -40.0, 1.0])
    assert page.errors == []


def test_a_list_is_recorded_reordered_undone_run_paged_and_inserted_into(
    page: Screen, served: ServedArm
) -> None:
    page.open_tab("Serial motion")
    page.click("Record pose")
    page.wait_until(lambda: len(served.steps) == 1, "a pose is recorded")
    served.go_deg(page, [20, 90, -80, -40, 0])
    page.click("Record pose")
    page.add_step("Wait and tell", "Wait")
    page.wait_until(lambda: len(served.steps) == 3, "three steps are recorded")
    first, second = MoveStep(joints_deg=tuple(HOME)), MoveStep(joints_deg=(20.0, *HOME[1:]))
    assert served.steps == (first, second, WaitStep(seconds=1.0))

    page.unfold("More", "Delete")
    page.click("Delete")
    page.wait_until(lambda: len(served.steps) == 2, "the wait is deleted")
    page.click("Up")
    page.wait_until(lambda: served.steps == (second, first), "the second pose comes first")
    page.click("Undo")
    page.wait_until(lambda: served.steps == (first, second), "the order is as before")
    page.screenshot("manual-serial")

    served.go_deg(page, HOME)
    page.click("Run once")
    served.wait_for_deg(page, [20.0, *HOME[1:]])
    assert any("program 'untitled' finished" in event.text for event in served.now.events)

    put(page, served, *((0.1 * k, *HOME[1:]) for k in range(40)))
    page.wait_until(lambda: rows(page).count() == 40, "all rows are there")
    select(page, 1)
    page.page.keyboard.press("End")
    expect(rows(page).nth(39)).to_have_attribute("aria-selected", "true")
    expect(rows(page).nth(39)).to_be_in_viewport()
    expect(rows(page).nth(0)).not_to_be_in_viewport()
    page.screenshot("manual-long")

    put(page, served, tuple(HOME), (10.0, *HOME[1:]))
    select(page, 2)
    page.choose("New steps go", "before the selected row")
    page.add_step("Wait and tell", "Wait")
    expect(page.entry("Wait time s")).to_be_focused()
    page.page.keyboard.insert_text("2.5")
    page.page.keyboard.press("Enter")
    page.wait_until(lambda: len(served.steps) == 3, "the wait is inserted")
    page.wait_until(lambda: served.steps[1] == WaitStep(seconds=2.5), "as long as was typed")
    select(page, 3)
    page.choose("New steps go", "in place of the selected row")
    served.arm.gripper(40)
    page.click("Record gripper")
    page.wait_until(lambda: served.steps[2] == GripperStep(open_percent=40), "the last step is replaced")


def test_a_program_is_checked_and_runs_from_a_row_step_by_step_or_until_stop(
    page: Screen, served: ServedArm
) -> None:
    put(page, served, tuple(HOME), (0.0, 90.0, -95.0, -40.0, 0.0))
    page.click("Check")
    page.wait_for_text(re.compile("Pre-flight: refused"))
    page.wait_for_text("Step 2 cannot run: its row says why.")
    expect(page.button("Run once")).to_be_disabled()
    page.screenshot("manual-verdict")
    assert served.now.program is None and page.notifications() == []
    expect(rows(page).nth(1)).to_contain_text("-95.00°".replace("-", "−"))
    expect(rows(page).nth(0)).not_to_contain_text("✕")
    select(page, 2)
    page.unfold("More", "Delete")
    page.click("Delete")
    page.wait_until(lambda: len(served.steps) == 1, "the step is deleted")
    page.click("Check")
    page.wait_for_text(re.compile("Pre-flight: (clear|may be run)"))

    put(page, served, (15.0, *HOME[1:]), (5.0, *HOME[1:]), (8.0, *HOME[1:]))
    select(page, 3)
    page.type_into("Times N", "2")
    page.tick("From selected step")
    served.steps_run.clear()
    page.click("Run N times")
    page.wait_until(
        lambda: any("program 'test' finished" in event.text for event in served.now.events), "two passes"
    )
    served.wait_for(page, State.HOLDING)
    assert served.steps_run == [(0, 2), (1, 0), (1, 1), (1, 2)]
    assert served.commanded_deg == [8.0, *HOME[1:]]

    put(page, served, (5.0, *HOME[1:]), (10.0, *HOME[1:]), (15.0, *HOME[1:]))
    page.tick("From selected step", on=False)
    select(page, 1)
    page.type_into("Wrap rows", "1-2")
    page.add_step("Decide and repeat", "Repeat")
    page.wait_until(lambda: len(served.steps) == 5, "the block is there")
    page.click("Done")
    for base in (5.0, 10.0, 5.0, 10.0, 15.0):
        page.click("Step")
        served.wait_for_deg(page, [base, *HOME[1:]])
    page.wait_for_notification("The program is over after this step")

    put(page, served, tuple(HOME), (5.0, *HOME[1:]))
    page.click("Loop")
    page.wait_for_text(re.compile(r"runs step \d of 2, pass [2-9] of ∞"))
    rows(page).and_(page.page.locator("[aria-current=step]")).wait_for()
    page.click("Pause")
    served.wait_for(page, State.PAUSED)
    page.pause(800)  # else it is the second half of a double click
    page.click("Resume")
    served.wait_for(page, State.MOVING)
    page.click("STOP")
    served.wait_for(page, State.HOLDING)
    page.wait_for_text("test · 2 steps")
    assert served.now.program is None


def test_programs_are_restored_saved_loaded_downloaded_and_uploaded_or_it_is_said_why_not(
    page: Screen, served: ServedArm, tmp_path: Path
) -> None:
    left = LeftProgram(tmp_path / "left.toml", datetime(2026, 3, 4, 14, 3))
    save_program(Program(robot="uzuner", name="stacking", steps=(WaitStep(seconds=1),) * 3), left.path)
    assert served.edited.kept is not None
    served.edited.kept.left.append(left)
    page.open_tab("Serial motion")
    page.wait_for_text("Restore the unsaved program from 2026-03-04, 14:03?")
    page.screenshot("manual-restore")
    page.click("Yes, restore it")
    page.wait_for_text(re.compile("stacking · 3 steps"))
    page.wait_until(lambda: "Restore the unsaved" not in page.text(), "it is not offered any more")
    assert not left.path.exists()

    put(page, served, tuple(HOME))
    page.unfold("Files", "Upload")
    page.type_into("Name", "pick one")
    page.click("Save")
    page.wait_until(lambda: served.edited.saved() == ["pick one"], "the file is there")
    assert load_program(served.edited.folder / "pick one.toml").steps == served.steps
    page.unfold("More", "Delete")
    page.click("Delete")
    page.wait_until(lambda: served.steps == (), "the list is empty")
    assert page.value("Saved programs") == "pick one"
    page.click("Load")
    page.wait_until(lambda: len(served.steps) == 1, "the program is loaded")
    page.type_into("Name", "../elsewhere")
    page.click("Save")
    page.wait_for_notification("is no program name")
    page.screenshot("manual-files")
    assert page.download("CSV").read_text().startswith("step,do,base_deg,")

    put(page, served, tuple(HOME))
    before = served.steps
    file = tmp_path / "broken.toml"
    file.write_text(BROKEN)
    page.upload("Upload", file)
    page.wait_for_notification(re.compile(r"broken\.toml: line 9, step 2: unknown key 'joint_deg'"))
    assert served.steps == before
    file.write_text(BROKEN.replace("joint_deg", "joints_deg"))
    page.upload("Upload", file)
    page.wait_until(lambda: len(served.steps) == 2, "the mended file is on the list")
    page.wait_until(lambda: page.value("Name") == "broken", "its name is shown")
    file = tmp_path / "far.csv"
    file.write_text("x_mm,y_mm,z_mm\n220,0,100\n999,0,100\n")
    page.upload("Upload", file)
    page.wait_for_notification(re.compile(r"far\.csv: step 2: too far by 671\.0 mm"))
    page.wait_for_text("Pre-flight: refused, 1 error")
    film = tmp_path / "film.toml"
    with film.open("wb") as large:
        large.truncate(30 << 20)
    page.upload("Upload", film)
    page.wait_for_notification(
        "film.toml was not taken: it has 30.0 MiB, the largest that is taken has 1 MiB"
    )
    page.wait_until(lambda: page.is_enabled("Upload"), "another file can be sent")
    wait = tmp_path / "wait.toml"
    save_program(Program(robot="uzuner", steps=(WaitStep(seconds=1),)), wait)
    page.upload("Upload", wait)
    page.wait_until(lambda: served.steps == (WaitStep(seconds=1),), "its steps are on the list")


def test_every_kind_of_step_is_recorded_edited_taken_back_exported_and_read_again(
    page: Screen, served: ServedArm
) -> None:
    page.open_tab("Serial motion")
    page.click("Record pose")
    page.click("Point")
    served.go_deg(page, [10, 90, -80, -40, 0])
    page.click("Line")
    page.click("Arc")
    page.wait_for_notification("an arc needs a point on its way")
    page.click("Set via")
    page.wait_for_text(re.compile(r"Arc via \(.*\) mm"))
    served.go_deg(page, [20, 90, -80, -40, 0])
    page.click("Arc")
    page.wait_until(lambda: len(served.steps) == 4, "pose, point, line and arc are on the list")
    assert [type(step) for step in served.steps] == [MoveStep, PointStep, LineStep, ArcStep]

    page.add_step("Program", "Speed")
    page.add_step("Program", "Comment")
    page.type_into("Note", "=SUM(A1)")
    page.unfold("More", "Delete")
    page.type_into("Wrap rows", "2-3")
    page.add_step("Decide and repeat", "Repeat")
    page.wait_until(lambda: len(served.steps) == 8, "the block is there")
    page.click("Done")
    kinds = [MoveStep, RepeatStep, PointStep, LineStep, EndStep, ArcStep, SpeedStep, CommentStep]
    assert [type(step) for step in served.steps] == kinds
    expect(rows(page)).to_have_count(8)
    page.screenshot("manual-every-kind")

    rows(page).nth(3).dblclick()
    page.type_into("Tool speed mm/s", "25")
    page.click("More fields")
    page.type_into("Blend mm", "-1")
    page.wait_for_text(re.compile("Blend mm: must be 0"))
    page.wait_until(lambda: getattr(served.steps[3], "speed_mm_s", None) == 25, "the speed is saved")
    line = served.steps[3]
    page.screenshot("manual-step-fields")
    page.type_into("Blend mm", "5")
    page.wait_until(lambda: served.steps[3] != line, "the line is edited")
    edited = served.steps
    assert isinstance(edited[3], LineStep)
    assert (edited[3].speed_mm_s, edited[3].blend_mm) == (25, 5)
    page.click("Done")
    expect(page.button("Redo")).to_be_disabled()
    page.click("Undo")
    page.wait_until(lambda: served.steps[3] == line, "the line is as it was")
    page.click("Redo")
    page.wait_until(lambda: served.steps == edited, "the line is edited again")
    expect(page.button("Redo")).to_be_disabled()

    page.unfold("Files", "Upload")
    for button in ("Download", "CSV"):
        file = page.download(button)
        page.click("Delete")
        page.wait_until(lambda: served.steps != edited, "a step is deleted")
        page.upload("Upload", file)
        page.wait_until(lambda: served.steps == edited, f"{file.name} gives the same steps")
    assert "import armctl" in page.download("Python").read_text()
    points = page.download("CSV X-Y-Z")
    assert points.read_text().startswith("step,do,x_mm,y_mm,z_mm,")
    assert "'=SUM(A1)" in points.read_text()
    page.screenshot("manual-files-unfolded")
    assert page.errors == []


def test_a_program_is_edited_while_it_loops_but_not_by_a_page_that_watches(
    page: Screen, screens: Screens, served: ServedArm
) -> None:
    served.put(tuple(HOME))
    watcher = screens(served.url)
    watcher.open_tab("Manual", "Serial motion")
    watcher.unfold("More", "Delete")
    for button in ("Delete", "Run once"):
        expect(watcher.button(button)).to_be_disabled()
    watcher.wait_for_text("This page is watching")
    assert len(served.steps) == 1
    assert served.commanded_deg == HOME
    watcher.leave_page()

    put(page, served, (5.0, *HOME[1:]), (10.0, *HOME[1:]))
    page.click("Loop")
    page.wait_for_text(re.compile(r"runs step \d of 2"))
    rows(page).nth(1).dblclick()
    fields = page.page.get_by_role("group", name="Angles °")
    fields.wait_for()
    page.click("Pause")
    served.wait_for(page, State.PAUSED)
    page.type_into("Base °", "20", within=fields)
    page.wait_for_text("the edit takes effect at the next pass")
    page.screenshot("manual-edit-waits")
    assert served.commanded_deg[0] <= 10
    page.pause(800)  # else it is the second half of a double click
    page.click("Resume")
    page.wait_until(lambda: served.commanded_deg[0] > 15, "the edit has taken effect")
    page.wait_for_text(re.compile(r"runs step \d of 2"))
    rows(page).and_(page.page.locator("[aria-current=step]")).wait_for()
    assert page.notifications() == []
    page.type_into("Shoulder °", "-3", within=fields)
    page.wait_for_notification(re.compile(r"The next pass would stop there.*below the floor", re.DOTALL))
