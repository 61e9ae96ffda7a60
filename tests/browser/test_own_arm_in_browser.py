"""One's own arm in the page: described, drawn, saved, opened, its channels found, and moved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import ServedArm, served_arm
from tests.robot.urdf_kit import Step, written

from armctl import load_robot
from armctl.facts import State
from armctl.robot import user_robots_folder

pytestmark = pytest.mark.browser


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ServedArm:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    with served_arm(tmp_path) as served:
        yield served


@pytest.fixture
def page(served: ServedArm, screens: Screens) -> Screen:
    screen = screens()
    screen.open(served.url, until="Enable")
    screen.open_tab("Main", "Your own arm")
    screen.click("New arm")
    screen.wait_for_text("every solution in closed form")
    return screen


def opened(page: Screen, served: ServedArm, name: str) -> None:
    page.wait_until(lambda: served.robot.name == name, f"{name} is the present robot")
    page.wait_until(lambda: served.now.state is State.OFF, "it is connected")

    def listed() -> bool:
        """The tab in which it was saved is opened again, once."""
        if page.tab("Arm").get_attribute("aria-selected") != "true":
            page.press(page.tab("Arm"))
            return False
        return page.value("Robot") == served.robot.title

    page.wait_until(listed, "the list shows it")


def test_a_file_with_two_tools_asks_which_one_and_a_palletiser_is_made_from_its_lengths(
    page: Screen, served: ServedArm, tmp_path: Path
) -> None:
    steps = (
        Step("pan", "revolute", "base", "body", "0 0 0.1"),
        Step("lift", "revolute", "body", "upper", "0 0 0.05", axis="0 1 0"),
        Step("elbow", "revolute", "upper", "lower", "0.3 0 0", axis="0 1 0"),
        Step("back", "fixed", "lower", "back_tcp", "0 0 0.1"),
        Step("front", "fixed", "lower", "front_tcp", "0.1 0 0"),
    )
    file = written(tmp_path / "forked.urdf", steps)
    page.click("Discard")
    page.open_tab("Arms from URDF files")
    page.upload("Upload an arm", file)
    page.wait_for_text("Which link is the tool?")
    page.click("Cancel")
    expect(page.page.get_by_text("Which link is the tool?")).to_have_count(0)
    page.upload("Upload an arm", file)
    page.wait_for_text("Which link is the tool?")
    page.click("front_tcp")
    page.wait_until(lambda: served.robot.source.endswith("to front_tcp"), "it is open with that tool")
    page.wait_until(lambda: page.value("Robot") == served.robot.title, "the page is its own")

    page.open_tab("Main", "Your own arm")
    page.click("New arm")
    page.wait_for_text("every solution in closed form")
    page.choose("Begin with", "3 joints, rods keep the hand level (MeArm, EEZYbotARM, uArm)")
    for label, mm in (("Height mm", "60"), ("Upper arm mm", "80"), ("Forearm mm", "80"), ("Hand mm", "68")):
        page.type_into(label, mm)
    page.open_tab("3 Save")
    page.type_into("Title", "Crane 2")
    page.wait_until(lambda: page.value("File name") == "crane_2", "the file is named after the title")
    page.type_into("File name", "crane")
    page.type_into("Title", "Crane")
    page.wait_for_text("3 joints: yaw, two pitch joints, level hand")
    page.click("Save and open")
    opened(page, served, "crane")
    path = user_robots_folder() / "crane.toml"
    assert path.is_file() and load_robot("crane") == served.robot
    assert 1000 * served.robot.forward([0, 0, 0])[:3, 3] == pytest.approx([228, 0, 60])
    page.click("Enable")
    page.wait_for_text("HOLDING")
    page.open_tab("Inverse")
    page.type_xyz("190", "30", "90")
    page.click("Solve")
    page.wait_for_text("solution")
    page.click("Go by least energy")
    target = np.array([0.19, 0.03, 0.09])
    page.wait_until(
        lambda: float(np.abs(served.robot.forward(served.now.q)[:3, 3] - target).max()) < 1e-3, "it is there"
    )


def test_a_copy_keeps_what_is_not_edited_and_wrong_rows_are_not_saved(
    page: Screen, served: ServedArm
) -> None:
    old = served.robot
    page.choose("Begin with", "A copy of the present robot")
    page.open_tab("3 Save")
    page.wait_until(lambda: page.value("Floor mm") == f"{1000 * old.floor_z:g}", "the floor is its own")
    page.wait_until(lambda: page.value("Gripper channel") == "5", "the gripper is its own")
    page.type_into("Title", "Twin")
    page.wait_until(lambda: page.value("File name") == "twin", "the file is named after the title")
    page.open_tab("2 Joints")
    page.type_into("Highest °", "30")
    page.choose("Joint", old.joint_names[1])
    page.type_into("Speed °/s", "20")
    page.open_tab("3 Save")
    page.click("Save and open")
    opened(page, served, "twin")
    new = load_robot("twin")
    assert new.limits[0, 1] == pytest.approx(np.radians(30))
    assert (new.output_map, new.floor_z) == (old.output_map, old.floor_z)
    assert new.joints[0].acceleration == pytest.approx(old.joints[0].acceleration)
    ratio = new.joints[1].acceleration / old.joints[1].acceleration
    assert ratio == pytest.approx(np.radians(20) / old.joints[1].speed)

    page.open_tab("Main", "Your own arm")
    page.click("New arm")
    page.wait_for_text("every solution in closed form")
    page.choose("Begin with", "DH rows")
    rows = page.page.get_by_role("textbox", name="Rows", exact=True).or_(page.entry("Rows")).first
    rows.fill("0 90 80 0 base\n120 0 0 zero shoulder")
    page.wait_for_text("row 2, theta_deg: 'zero' is not a number")
    page.open_tab("3 Save")
    page.wait_until(lambda: not page.is_enabled("Save and open"), "a wrong one is not saved")
    page.open_tab("1 Lengths")
    rows.fill("0 90 80 0 base\n120 0 0 0 shoulder\n100 0 0 0 elbow\n0 90 0 90")
    page.wait_for_text("3 joints: yaw")
    page.open_tab("3 Save")
    page.type_into("File name", "uzuner")
    page.click("Save and open")
    page.wait_for_notification("a robot of armctl; choose another name")
    page.click("Discard")
    assert served.robot.name == "twin"
    assert [file.name for file in user_robots_folder().iterdir()] == ["twin.toml"]


def test_the_tabs_that_are_open_stay_where_an_arm_s_own_copy_is_opened(
    page: Screen, served: ServedArm
) -> None:
    page.open_tab("Manual", "In & out")
    page.click("Add it to the arm")
    page.wait_until(lambda: served.robot.name == "my_uzuner", "the copy is open")
    page.wait_for_text("Button")
    for tab in ("Manual", "In & out"):
        expect(page.tab(tab)).to_have_attribute("aria-selected", "true")


def test_servos_whose_channels_are_found(page: Screen, served: ServedArm) -> None:
    page.choose("Begin with", "3 joints: base, shoulder, elbow")
    page.open_tab("2 Joints")
    for channel, joint in enumerate(("base", "shoulder", "elbow")):
        page.choose("Joint", joint)
        page.type_into("Lowest °", "-")  # half typed: told below, not by a notice
        page.wait_for_text("Lowest °: '-' is not a number")
        expect(page.page.get_by_text("Refused:")).to_have_count(0)
        page.type_into("Lowest °", "-60")
        page.type_into("Highest °", "70")
        page.type_into("Servo channel", str(channel))
    page.open_tab("3 Save")
    page.type_into("Title", "Three")
    page.wait_until(lambda: page.value("File name") == "three", "the file is named after the title")
    page.type_into("Gripper channel", "1")
    page.wait_for_text("two servos are on the same channel")
    page.type_into("Gripper channel", "3")
    page.wait_until(lambda: page.is_enabled("Save and open"), "it can be saved")
    page.click("Save and open")
    opened(page, served, "three")
    assert served.robot.output_map is not None and served.robot.gripper is not None
    assert served.robot.output_map.channels == (0, 1, 2)
    assert served.robot.output_map.gripper_channel == 3
    assert np.degrees(served.robot.limits) == pytest.approx(np.tile([-60, 70], (3, 1)))
    page.click("Enable")
    page.wait_for_text("HOLDING")
    page.open_tab("Your own arm")
    page.unfold("Which joint moved?", "Nudge")
    before = served.now.q_command.copy()
    page.click("Nudge")
    page.wait_until(lambda: abs(served.now.q_command[0] - before[0]) > 0.05, "channel 0 moved")
    page.wait_until(
        lambda: bool(np.allclose(served.now.q_command, before)) and served.now.state is State.HOLDING,
        "it went back",
    )
    # the base's servo is on channel 1, the shoulder's on channel 0
    for joint in ("Shoulder", "Base", "Elbow"):
        page.choose("It moved", joint)
        page.click("This joint moved")
    page.click("Write channels")
    page.wait_until(
        lambda: served.robot.output_map is not None and served.robot.output_map.channels == (1, 0, 2),
        "the arm is opened with its channels",
    )
    assert load_robot("three") == served.robot
