"""The Forward screen as an operator uses it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.browser.ghost_view import wait_for_ghost, wait_for_no_ghost
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import ServedArm, served_arm

from armctl.robot import Robot
from armctl.runtime import State

pytestmark = pytest.mark.browser
HOME = [0.0, 90.0, -80.0, -40.0, 0.0]
_TYPE_AND_CLICK = """(box, button) => {
  const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
  for (const text of ['4', '45']) {
    set.call(box, text);
    box.dispatchEvent(new Event('input', {bubbles: true}));
  }
  button.click();
}"""
REFERENCE, LAST = "Go with respect to reference", "Go with respect to last position"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedArm]:
    with served_arm(tmp_path / "programs") as served:
        yield served


@pytest.fixture
def page(screen: Screen, served: ServedArm) -> Screen:
    screen.open(served.url, until="STOP")
    screen.open_tab("Forward")
    return screen


def stands_at(page: Screen, served: ServedArm, degrees: list[float]) -> None:
    page.wait_until(
        lambda: served.commanded_deg == degrees and served.now.state is State.HOLDING,
        f"the arm stands at {degrees}",
    )


def test_go_with_respect_to_reference(page: Screen, served: ServedArm) -> None:
    page.type_into("Base °", "30")
    page.type_into("Elbow °", "-45.5")
    asked = [30.0, 90.0, -45.5, -40.0, 0.0]
    wait_for_ghost(page, served.robot, np.radians(asked))
    x, _, z = (1000 * served.robot.forward(np.radians(asked))[:3, 3]).tolist()
    page.wait_for_text(f"{x:.1f}")
    page.wait_for_text(f"{z:.1f}")
    assert served.commanded_deg == HOME  # editing moves nothing
    page.screenshot("forward-editing")
    page.click(REFERENCE)
    stands_at(page, served, asked)
    wait_for_no_ghost(page, served.robot)
    assert page.errors == []


def test_go_with_respect_to_last_position(page: Screen, served: ServedArm) -> None:
    for label, value in zip(
        ("Base °", "Shoulder °", "Elbow °", "Wrist pitch °", "Wrist roll °"), (10, -5, 2.5, 0, 1), strict=True
    ):
        page.type_into(label, str(value))
    page.choose("Movement", "Normal movement")
    page.click(LAST)
    stands_at(page, served, [10.0, 85.0, -77.5, -40.0, 1.0])
    page.click(LAST)
    stands_at(page, served, [20.0, 80.0, -75.0, -40.0, 2.0])


def test_a_planned_movement_takes_its_duration(page: Screen, served: ServedArm) -> None:
    page.type_into("Base °", "10")
    page.type_into("Duration s", "0.1")
    page.click(REFERENCE)
    page.wait_for_notification(re.compile(r"shortest possible duration is 0\.4"))
    assert served.commanded_deg == HOME
    page.type_into("Duration s", "2")
    page.click(REFERENCE)
    page.wait_until(lambda: served.now.state is State.MOVING, "the arm moves")
    began = served.now.stamp
    stands_at(page, served, [10.0, *HOME[1:]])
    assert served.now.stamp - began > 1.0


@pytest.mark.parametrize(
    ("typed", "why"),
    [
        ("", "Shoulder ° is empty"),
        ("nan", "Shoulder °: 'nan' is not a number"),
        ("1e999", "Shoulder °: '1e999' is not a number"),
        ("4,5", "with a point"),
        ("-", "Shoulder °: '-' is not a number"),
    ],
)
def test_what_is_no_number_never_moves_the_arm(page: Screen, served: ServedArm, typed: str, why: str) -> None:
    page.type_into("Base °", "20")
    page.entry("Shoulder °").fill(typed)
    page.pause(300)
    page.wait_for_text(re.compile("Nothing can be sent"))
    for button in (REFERENCE, LAST):
        page.click(button)
        page.wait_for_notification(why)
    assert served.commanded_deg == HOME
    assert served.now.state is State.HOLDING


def test_a_limit_is_named_with_its_value(page: Screen, served: ServedArm) -> None:
    page.type_into("Shoulder °", "150")
    page.click(REFERENCE)
    page.wait_for_notification("Shoulder: 150.00° is outside -3.19° … 146.83°")
    assert served.commanded_deg == HOME
    page.screenshot("forward-limit")


def test_a_click_that_overtakes_a_digit_shows_what_the_server_has(page: Screen, served: ServedArm) -> None:
    """Typing 45 and clicking within 50 ms: the page loses the 5, and must not go on showing it."""
    page.pause(300)
    page.entry("Base °").evaluate(_TYPE_AND_CLICK, page.button(REFERENCE).element_handle())
    page.wait_until(lambda: page.value("Base °") == "4", "the field shows what the server has")
    assert served.commanded_deg[0] <= 4.0
    page.pause(300)
    page.wait_until(lambda: served.now.state is State.HOLDING, "the arm stands")
    page.click(REFERENCE)
    stands_at(page, served, [4.0, *HOME[1:]])


def angles(page: Screen, robot: Robot) -> list[float]:
    return [page.number(f"{joint.title} °") for joint in robot.joints]


def wait_for_angles(page: Screen, robot: Robot, q: np.ndarray) -> None:
    """Wait until the angle fields show ``q`` (n,) [rad]."""
    degrees = np.degrees(q)
    page.wait_until(
        lambda: bool(np.abs(np.array(angles(page, robot)) - degrees).max() < 2e-3),
        f"the angle fields show {degrees.round(3).tolist()}",
    )


def test_a_joint_that_is_typed_takes_the_pose_fields_along(page: Screen, served: ServedArm) -> None:
    page.type_into("Base °", "30")
    q = np.radians([30.0, *HOME[1:]])
    x, y, z = (1000 * served.robot.forward(q)[:3, 3]).tolist()
    page.wait_until(lambda: abs(page.number("X mm") - x) < 2e-3, "X follows the joint")
    assert page.number("Y mm") == pytest.approx(y, abs=2e-3)
    assert page.number("Z mm") == pytest.approx(z, abs=2e-3)
    assert page.value("Base °") == "30"  # what is typed is not rewritten
    assert served.commanded_deg == HOME


def test_a_pose_that_is_typed_takes_the_angle_fields_along(page: Screen, served: ServedArm) -> None:
    robot, home = served.robot, served.robot.pose("home")
    pitch, roll = robot.inverse_kinematics.pitch_and_roll(home)
    page.type_into("Y mm", "40.5")
    x, _, z = robot.forward(home)[:3, 3]
    asked = robot.inverse([x, 0.0405, z], pitch, roll).best("least-travel", home)
    wait_for_angles(page, robot, asked)
    wait_for_ghost(page, robot, asked)
    assert page.value("Y mm") == "40.5"
    assert served.commanded_deg == HOME  # nothing moves
    page.screenshot("forward-coupled")
    page.type_into("Pitch °", "-45")
    page.type_into("Roll °", "20")
    asked = robot.inverse([x, 0.0405, z], np.radians(-45), np.radians(20)).best("least-travel", asked)
    wait_for_angles(page, robot, asked)
    page.click(REFERENCE)
    page.wait_until(
        lambda: (
            served.now.state is State.HOLDING and float(np.abs(served.now.q_command - asked).max()) < 1e-9
        ),
        "the arm stands at the pose",
    )
    assert page.errors == []


def test_a_pose_out_of_reach_keeps_the_angles_and_moves_nothing(page: Screen, served: ServedArm) -> None:
    robot = served.robot
    page.type_into("Z mm", "600")  # passes through 6 and 60, which are in reach
    page.wait_for_text(re.compile(r"The joint angles stay as they are: .*nearest reachable point is \("))
    assert angles(page, robot) == HOME
    assert page.value("Z mm") == "600"
    for button in (REFERENCE, LAST):
        page.click(button)
        page.wait_for_notification(re.compile("pose fields and the joint angles are not the same pose"))
    assert served.commanded_deg == HOME
    page.screenshot("forward-unreachable")
    page.click("Take nearest pose")
    page.wait_until(lambda: page.value("Z mm") != "600", "the pose fields hold the nearest pose")
    nearest = np.radians(angles(page, robot))
    np.testing.assert_allclose(
        1000 * robot.forward(nearest)[:3, 3], [page.number(f"{axis} mm") for axis in "XYZ"], atol=0.05
    )
    page.click(REFERENCE)
    page.wait_until(
        lambda: (
            served.now.state is State.HOLDING and float(np.abs(served.now.q_command - nearest).max()) < 1e-4
        ),
        "the arm stands at the nearest pose",
    )


def test_a_joint_angle_mends_a_pose_out_of_reach(page: Screen, served: ServedArm) -> None:
    page.type_into("X mm", "900")
    page.wait_for_text(re.compile("The joint angles stay as they are"))
    page.type_into("Base °", "12")
    page.wait_until(lambda: page.number("X mm") < 400, "the pose fields follow the joint again")
    page.click(REFERENCE)
    stands_at(page, served, [12.0, *HOME[1:]])


@pytest.mark.parametrize("typed", ["", "-", "nan", "1e999", "12,5"])
def test_a_half_typed_pose_never_moves_the_arm(page: Screen, served: ServedArm, typed: str) -> None:
    page.entry("X mm").fill(typed)
    page.wait_for_text(re.compile("The joint angles stay as they are: X mm"))
    page.pause(200)
    page.click(REFERENCE)
    page.wait_for_notification(re.compile("not the same pose: X mm"))
    assert page.value("X mm") == typed
    assert angles(page, served.robot) == HOME and served.commanded_deg == HOME


def test_a_pitch_that_is_not_held_follows(page: Screen, served: ServedArm) -> None:
    before = page.number("Pitch °")
    page.tick("Hold pitch", on=False)
    page.type_into("X mm", "250")
    page.wait_until(lambda: page.number("Pitch °") != before, "the pitch follows")
    robot = served.robot
    q = np.radians(angles(page, robot))
    np.testing.assert_allclose(1000 * robot.forward(q)[0, 3], 250, atol=0.05)
    pitch, _ = robot.inverse_kinematics.pitch_and_roll(q)
    assert pitch is not None and np.degrees(pitch) == pytest.approx(page.number("Pitch °"), abs=0.01)


def test_the_other_arms_are_coupled_too(screen: Screen, tmp_path: Path) -> None:
    """humanoid: Px, Py, Pz fill Q1 … Q5, and Q1 … Q5 the matrix."""
    with served_arm(tmp_path / "programs", "humanoid") as served:
        screen.open(served.url, until="STOP")
        screen.open_tab("Forward")
        robot = served.robot
        for label, value in (("X mm", "150"), ("Y mm", "-100"), ("Z mm", "-590")):
            screen.type_into(label, value)
        screen.wait_until(
            lambda: bool(
                np.abs(
                    1000 * robot.forward(np.radians(angles(screen, robot)))[:3, 3] - [150, -100, -590]
                ).max()
                < 0.05
            ),
            "the angles reach the point",
        )
        for text in ("150.00", "−100.00", "−590.00"):
            screen.wait_for_text(text)
        screen.screenshot("forward-humanoid")
        assert screen.errors == []


def test_velocities_follow_the_fields(page: Screen, served: ServedArm) -> None:
    J = served.robot.jacobian(served.robot.pose("home"))
    page.type_into("vy mm/s", "80")
    page.type_into("vx mm/s", "0")
    page.wait_for_text(re.compile(r"tool point: 80\.0 mm/s of 80\.0 mm/s"))
    page.type_into("vy mm/s", "900")
    page.wait_for_text(re.compile(r"Base is at its limit"))
    for joint in served.robot.joints:
        page.type_into(joint.title, "60" if joint.title == "Base" else "0")
    speed = 1000 * np.linalg.norm(J[:3, 0]) * np.radians(60)
    page.wait_for_text(f"{speed:.1f}")
    page.type_into("Base", "six")
    page.wait_for_text(re.compile("Base: 'six' is not a number"))
    page.screenshot("forward-velocities")
    assert served.commanded_deg == HOME


def test_the_ghost_belongs_to_the_screen_that_showed_it_last(page: Screen, served: ServedArm) -> None:
    robot = served.robot
    page.type_into("Base °", "25")
    asked = np.radians([25.0, *HOME[1:]])
    wait_for_ghost(page, robot, asked)
    page.open_tab("Inverse")
    for label, value in (("X mm", "220"), ("Y mm", "-196"), ("Z mm", "85")):
        page.type_into(label, value)
    page.click("Solve")
    best = robot.inverse([0.22, -0.196, 0.085]).best("least-rotation")
    wait_for_ghost(page, robot, best)
    page.open_tab("Forward")
    page.click("present pose")  # hides the ghost of this screen, not that of the other
    page.pause(300)
    wait_for_ghost(page, robot, best)
    page.type_into("Base °", "30")
    wait_for_ghost(page, robot, np.radians([30.0, *HOME[1:]]))
    page.open_tab("Inverse")
    page.click("Solve")
    wait_for_ghost(page, robot, best)
    page.click("Go by least energy")
    page.wait_until(
        lambda: np.abs(np.array(served.commanded_deg) - np.degrees(best)).max() < 0.01, "the arm is there"
    )
    page.pause(500)  # what the other screen had shown must not come back now
    wait_for_no_ghost(page, robot)


def test_fields_are_filled_and_figures_follow(page: Screen, served: ServedArm) -> None:
    page.click("zero")
    page.wait_until(lambda: page.value("Shoulder °") == "0", "the fields hold the zero pose")
    wait_for_ghost(page, served.robot, np.zeros(5))
    page.wait_for_text("330.00")
    page.wait_for_text(re.compile("Singular: the tool cannot move out or in"))
    page.choose("Show for", "present pose (live)")
    wait_for_no_ghost(page, served.robot)
    page.wait_for_text(re.compile("Well away from singularities"))
    page.screenshot("forward-figures")
    page.click("present pose")
    page.wait_until(lambda: page.value("Shoulder °") == "90", "the fields hold the present pose")


def test_a_watching_page_cannot_move_the_arm(screens: Screens, served: ServedArm) -> None:
    first, second = screens(served.url), screens(served.url)
    second.open_tab("Forward")
    second.type_into("Base °", "15")
    second.click(REFERENCE)
    second.wait_for_notification(re.compile("this page is watching"))
    assert served.commanded_deg == HOME
    assert first.errors == []
