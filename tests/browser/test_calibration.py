"""The calibration wizard on a simulated arm whose servos are mounted otherwise than its file says."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import ServedArm

from armctl.calibration import TouchFit
from armctl.facts import State
from armctl.protocol import MoveGripper, MoveJoints
from armctl.robot import OutputMap, load_robot
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration

pytestmark = pytest.mark.browser
TRUE_ZERO_US, TRUE_US_PER_DEG = 1512.0, -8.6
"""how the base's servo is really mounted: the other way round, and off"""
NOISE_DEG = (0.2, -0.15, 0.1, -0.2, 0.05)
OFF_DEG = 1.5
"""how far the elbow really is from what the arm believes"""
TOUCHES = (
    (0, 90, -80, -40, 0),
    (40, 70, -60, -30, 0),
    (-40, 100, -40, -60, 0),
    (60, 60, -20, -70, 0),
    (-60, 110, -75, -20, 0),
    (20, 80, -30, -80, 0),
)


@pytest.fixture
def page(served: ServedArm, screens: Screens) -> Screen:
    screen = screens(served.url)
    screen.dismiss_graphics_warning()
    screen.open_tab("Calibration")
    screen.wait_for_text("In force: the robot file")
    return screen


def map_of(served: ServedArm) -> OutputMap:
    assert served.robot.output_map is not None
    return served.robot.output_map


def true_base_deg(served: ServedArm) -> float:
    """What a protractor at the base would show."""
    pulse = map_of(served).outputs(served.now.q_command)[0]
    return (pulse - TRUE_ZERO_US) / TRUE_US_PER_DEG


def step(page: Screen, served: ServedArm, label: str) -> None:
    before = served.commanded_deg[0]
    page.click(label)
    page.wait_until(lambda: abs(served.commanded_deg[0] - before - float(label.replace("−", "-"))) < 0.02,
                    f"the base has turned by {label}")  # fmt: skip
    served.wait_for(page, State.HOLDING)


def add_mark(page: Screen, degrees: float) -> None:
    page.type_into("Angle read °", f"{degrees:.2f}")
    page.click("Add mark")


def test_a_servo_mounted_otherwise_is_measured_saved_tried_and_taken_back(
    page: Screen, served: ServedArm
) -> None:
    rows = {
        page.tab(label).evaluate("tab => tab.offsetTop") for label in ("Main", "Simulation", "Calibration")
    }
    assert len(rows) == 1  # all tabs stand beside each other
    for number, noise in enumerate(NOISE_DEG):
        if number:
            step(page, served, "+10")
        add_mark(page, true_base_deg(served) + noise)
    page.wait_for_text("Base turns the other way than uzuner says.")
    step(page, served, "+10")
    add_mark(page, true_base_deg(served) + 12)
    page.wait_for_text(re.compile(r"Mark 6 does not fit: at .* µs it says"))
    page.screenshot("calibration_wrong_mark")
    page.page.reload()
    page.open_tab("Calibration")
    page.wait_for_text(re.compile("Mark 6 does not fit"))
    page.click("Delete mark")
    page.wait_until(
        lambda: len(served.console.shared(SharedCalibration).work.joint("base").marks) == 5, "it is deleted"
    )

    page.open_tab("Save & test")
    page.type_into("Note", "horn turned")
    page.screenshot("calibration_save")
    page.click("Save calibration")
    page.wait_for_notification(re.compile(r"\.toml\. The arm is opened anew"))
    served.wait_for(page, State.OFF)
    outputs = map_of(served)
    assert math.radians(outputs.per_rad[0]) == pytest.approx(TRUE_US_PER_DEG, abs=0.1)
    assert outputs.zero[0] == pytest.approx(TRUE_ZERO_US, abs=4)
    file_map = load_robot("uzuner").output_map
    assert file_map is not None
    assert outputs.zero[1:].tolist() == file_map.zero[1:].tolist()

    assert page.tab("Calibration").get_attribute("aria-selected") == "true"  # nobody is led away
    page.open_tab("Main")
    page.click("Enable")
    served.wait_for(page, State.HOLDING)
    page.open_tab("Calibration")
    page.wait_for_text(re.compile("In force: calibration of .* “horn turned”"))
    page.open_tab("Save & test")
    page.wait_for_text("Everything is saved: nothing differs from the calibration in force.")
    near = (0, 90, -5, -5, 0)  # the way to the test pose is slow
    served.order(MoveJoints(np.radians(near))).result(20)
    page.click("Go to test pose")
    page.wait_until(lambda: served.commanded_deg == [0, 90, 0, 0, 0], "it is in the test pose")
    assert true_base_deg(served) == pytest.approx(0, abs=0.5)
    served.wait_for(page, State.HOLDING)
    page.screenshot("calibration_in_force")

    page.click("Revert")
    served.wait_for(page, State.OFF)
    assert map_of(served).per_rad.tolist() == file_map.per_rad.tolist()
    page.wait_for_text("In force: the robot file")
    assert page.errors == []


def test_marks_are_not_changed_by_a_page_that_watches_and_touched_points_name_the_joint_that_is_off(
    page: Screen, served: ServedArm, screens: Screens
) -> None:
    add_mark(page, 0.4)
    watcher = screens(served.url, width=1920, height=1080)
    watcher.open_tab("Calibration")
    watcher.wait_for_text("1480.0")
    watcher.type_into("Angle read °", "7")
    for button in ("Add mark", "Delete mark", "Set upper limit here", "+10"):
        expect(watcher.button(button)).to_be_disabled()
    watcher.wait_for_text("This page is watching")
    watcher.open_tab("Save & test")
    for button in ("Forget what is not saved", "Save calibration"):
        expect(watcher.button(button)).to_be_disabled()
    work = served.console.shared(SharedCalibration).work
    assert [math.degrees(mark.angle) for mark in work.joint("base").marks] == pytest.approx([0.4])
    assert work.joint("base").high is None
    assert served.commanded_deg[0] == 0
    assert served.console.shared(SharedCalibration).versions() == ()
    page.hold("Jog +", 500)
    served.wait_for(page, State.HOLDING)
    assert 0 < served.commanded_deg[0] < 9
    page.type_into("Angle read °", "1,5")
    page.wait_for_text("'1,5' is not a number (write 1.5, with a point)")
    expect(page.button("Add mark")).to_be_disabled()
    page.open_tab("Gripper")
    page.click("Move gripper")
    page.wait_for_text("1500.0 µs")
    served.order(MoveGripper(0.2))  # in Manual, or by a program: pressed again, nothing jumps back
    page.wait_until(lambda: page.number("Gripper %") == 20, "the slider shows where the gripper is")
    page.click("Move gripper")
    page.pause()
    assert served.now.gripper == pytest.approx(0.2)
    served.order(MoveGripper(0.5))
    page.wait_for_text("1500.0 µs")
    page.click("Closed here")
    page.wait_until(lambda: work.jaw("closed") == 1500, "the gripper is closed here")
    watcher.leave_page()

    page.open_tab("Known points")
    for joints in TOUCHES:
        served.go_deg(page, joints)
        really = np.radians(np.add(joints, (0, 0, OFF_DEG, 0, 0)))
        page.type_xyz(*(f"{1000 * value:.2f}" for value in served.robot.forward(really)[:3, 3]))
        page.click("Here")
    page.wait_for_text("Suggested values")
    page.wait_for_text(re.compile(r"Elbow: zero off by .*"))
    page.screenshot("calibration_points")
    told = served.console.shared(SharedCalibration).points.result
    assert isinstance(told, TouchFit)
    assert told.after.rms < 0.0005 < told.before.rms
    assert "joints.elbow.servo" in page.download("Download the suggestion").read_text()
    page.click("Apply the correction")
    page.wait_for_notification(re.compile("Correction applied"))
    served.wait_for(page, State.OFF)
    page.wait_for_text(re.compile(r"Corrected: .* mm before, 0\.\d\d mm after"))
    page.wait_for_text("Touch 3 more points to check it.")


def test_a_sheet_is_downloaded_and_its_crosshairs_are_proposed_and_touched(
    page: Screen, served: ServedArm
) -> None:
    page.open_tab("Known points")
    page.choose("Points", "a printed sheet, A4")
    page.wait_for_text(re.compile(r"Touch crosshair \d+ next"))
    assert page.download("Download the sheet").read_bytes().startswith(b"%PDF")
    shared = served.console.shared(SharedCalibration)
    sheet, first = shared.points.sheet, shared.points.next
    assert sheet is not None and first is not None
    page.wait_for_text("Known points · ")
    page.click("Go")
    above = 1000 * sheet.laid_m[first.number - 1]
    page.wait_until(lambda: bool(np.abs(served.tool_mm - above)[:2].max() < 0.5), "it is above the crosshair")
    assert 29 < served.tool_mm[2] - above[2] < 101

    served.wait_for(page, State.HOLDING)
    there = served.tool_mm
    page.click("−10", within=page.row("Z up mm"))
    page.click("−10", within=page.row("Z up mm"))
    page.wait_until(lambda: abs(served.tool_mm[2] - there[2] + 20) < 0.1, "it is 20 mm lower")
    served.wait_for(page, State.HOLDING)
    page.click("Here")
    page.wait_until(lambda: len(shared.points.touches) == 1, "it is touched")
    assert shared.points.touches[0].number == first.number
    page.wait_until(lambda: shared.points.next is not None, "the next one is proposed")
    page.wait_until(lambda: page.value("Crosshair") != str(first.number), "another one is next")
    page.screenshot("calibration_sheet")
    page.click("Undo the last")
    page.wait_until(lambda: not shared.points.touches, "it is taken back")
    assert page.errors == []
