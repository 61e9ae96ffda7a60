"""The Forward screen as an operator uses it."""

from __future__ import annotations

import os
import re

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.ghost_view import ghost_tip_mm, wait_for_ghost, wait_for_no_ghost
from tests.browser.kit import Screen
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State
from armctl.protocol import MoveJoints
from armctl.robot import Robot

pytestmark = pytest.mark.browser
TAB = "Forward"
_TYPE_AND_CLICK = """(box, button) => {
  const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
  for (const text of ['4', '45']) {
    set.call(box, text);
    box.dispatchEvent(new Event('input', {bubbles: true}));
  }
  button.click();
}"""
SEQUENCES = 100 if os.environ.get("ARMCTL_LONG") else 1
REFERENCE, LAST = "Go with respect to reference", "Go with respect to last position"


def angles(page: Screen, robot: Robot) -> list[float]:
    return [page.number(f"{joint.title} °") for joint in robot.joints]


def wait_for_angles(page: Screen, robot: Robot, q: np.ndarray) -> None:
    """Wait until the angle fields show ``q`` (n,) [rad]."""
    degrees = np.degrees(q)
    page.wait_until(
        lambda: bool(np.abs(np.array(angles(page, robot)) - degrees).max() < 2e-3),
        f"the angle fields show {degrees.round(3).tolist()}",
    )


def begin_anew(page: Screen, served: ServedArm) -> None:
    """The arm is at home again, and the fields follow it, whatever was typed into them."""
    served.go_deg(page, HOME)
    page.click("present pose")
    page.wait_for_text("The fields follow the arm until you edit them.")
    wait_for_angles(page, served.robot, np.radians(HOME))


def test_both_buttons_send_the_arm_where_the_fields_say_in_the_time_that_is_asked_for(
    page: Screen, served: ServedArm
) -> None:
    for label in (REFERENCE, LAST):
        expect(page.button(label)).to_be_in_viewport(ratio=1)  # on a laptop, without scrolling
    page.type_into("Base °", "30")
    page.type_into("Elbow °", "-45.5", by_key=True)
    asked = [30.0, 90.0, -45.5, -40.0, 0.0]
    wait_for_ghost(page, served.robot, np.radians(asked))
    x, y, z = (1000 * served.robot.forward(np.radians(asked))[:3, 3]).tolist()
    page.wait_for_text(f"{x:.1f}")
    page.wait_until(lambda: abs(page.number("X mm") - x) < 2e-3, "X follows the joints")
    assert (page.number("Y mm"), page.number("Z mm")) == pytest.approx((y, z), abs=2e-3)
    assert page.value("Base °") == "30"  # what is typed is not rewritten
    assert served.commanded_deg == HOME  # editing moves nothing
    page.screenshot("forward-editing")
    page.click(REFERENCE)
    served.wait_for_deg(page, asked)
    wait_for_no_ghost(page)

    page.type_into("Base °", "20")
    page.type_into("Duration s", "0.1")
    page.click(REFERENCE)
    page.wait_for_notification(re.compile(r"shortest possible duration is 0\.4"))
    assert served.commanded_deg == asked
    page.type_into("Duration s", "2")
    page.click(REFERENCE)
    served.wait_for(page, State.MOVING)
    began = served.now.stamp
    served.wait_for_deg(page, [20.0, *asked[1:]])
    assert served.now.stamp - began > 1.0

    for joint, value in zip(served.robot.joints, (10, -5, 2.5, 0, 1), strict=True):
        page.type_into(f"{joint.title} °", str(value))
    page.choose("Movement", "Normal movement")
    for asked in ([30.0, 85.0, -43.0, -40.0, 1.0], [40.0, 80.0, -40.5, -40.0, 2.0]):
        page.click(LAST)
        served.wait_for_deg(page, asked)
    assert page.errors == []


def test_what_is_half_typed_no_number_or_past_a_limit_never_moves_the_arm(
    page: Screen, served: ServedArm
) -> None:
    page.type_into("Base °", "20")
    for typed, why in (
        ("", "Shoulder ° is empty"),
        ("nan", "Shoulder °: 'nan' is not a number"),
        ("1e999", "Shoulder °: '1e999' is not a number"),
        ("4,5", "with a point"),
        ("-", "Shoulder °: '-' is not a number"),
        ("150", "Shoulder: 150.00° is outside −3.19° … 146.83°"),
    ):
        page.entry("Shoulder °").fill(typed)
        page.pause(300)
        if typed != "150":
            page.wait_for_text(re.compile("Nothing can be sent"))
        if typed == "150":
            page.wait_for_text(f"{why}.")
            page.wait_until(lambda: not page.is_enabled(REFERENCE) and not page.is_enabled(LAST), "off")
            continue
        for button in (REFERENCE, LAST):
            page.click(button)
            page.wait_for_notification(why)
    page.screenshot("forward-limit")
    assert served.commanded_deg == HOME
    assert served.now.state is State.HOLDING

    begin_anew(page, served)
    for typed in ("", "-", "nan", "1e999", "12,5"):
        page.entry("X mm").fill(typed)
        page.wait_for_text(re.compile("The joint angles stay as they are: X mm"))
        page.pause(200)
        page.click(REFERENCE)
        page.wait_for_notification(re.compile("not the same pose: X mm"))
        assert page.value("X mm") == typed
        assert angles(page, served.robot) == HOME and served.commanded_deg == HOME

    # typing 45 and clicking within 50 ms: the page loses the 5, and must not go on showing it
    begin_anew(page, served)
    page.pause(300)
    page.entry("Base °").evaluate(_TYPE_AND_CLICK, page.button(REFERENCE).element_handle())
    page.wait_until(lambda: page.value("Base °") == "4", "the field shows what the server has")
    assert served.commanded_deg[0] <= 4.0
    page.pause(300)
    served.wait_for(page, State.HOLDING)
    page.click(REFERENCE)
    served.wait_for_deg(page, [4.0, *HOME[1:]])


def test_a_pose_that_is_typed_takes_the_angle_fields_along_as_far_as_the_arm_reaches(
    page: Screen, served: ServedArm
) -> None:
    robot, home = served.robot, served.robot.pose("home")
    pitch, roll = robot.inverse_kinematics.pitch_and_roll(home)
    page.type_into("Y mm", "40.5", by_key=True)
    x, _, z = robot.forward(home)[:3, 3]
    asked = robot.inverse([x, 0.0405, z], pitch, roll).best("least-travel", home)
    wait_for_angles(page, robot, asked)
    wait_for_ghost(page, robot, asked)
    assert page.value("Y mm") == "40.5"
    assert served.commanded_deg == HOME  # nothing moves
    page.screenshot("forward-coupled")
    page.type_into("Pitch °", "-45", by_key=True)
    page.type_into("Roll °", "20")
    asked = robot.inverse([x, 0.0405, z], np.radians(-45), np.radians(20)).best("least-travel", asked)
    wait_for_angles(page, robot, asked)
    page.click(REFERENCE)
    served.wait_for_deg(page, np.degrees(asked).tolist(), within=1e-7)

    begin_anew(page, served)
    out_of_reach_the_angles_stay_and_nothing_moves(page, served)
    begin_anew(page, served)
    page.type_into("X mm", "900")
    page.wait_for_text(re.compile("The joint angles stay as they are"))
    page.type_into("Base °", "12")
    page.wait_until(lambda: page.number("X mm") < 400, "the pose fields follow the joint again")
    page.click(REFERENCE)
    served.wait_for_deg(page, [12.0, *HOME[1:]])

    begin_anew(page, served)
    before = page.number("Pitch °")
    page.tick("Hold pitch", on=False)
    page.type_into("X mm", "250")
    page.wait_until(lambda: page.number("Pitch °") != before, "the pitch follows")
    q = np.radians(angles(page, robot))
    np.testing.assert_allclose(1000 * robot.forward(q)[0, 3], 250, atol=0.05)
    pitch, _ = robot.inverse_kinematics.pitch_and_roll(q)
    assert pitch is not None and np.degrees(pitch) == pytest.approx(page.number("Pitch °"), abs=0.01)
    assert page.errors == []


def out_of_reach_the_angles_stay_and_nothing_moves(page: Screen, served: ServedArm) -> None:
    """Until the nearest pose is taken."""
    robot = served.robot
    page.type_into("Z mm", "600", by_key=True)  # passes through 6 and 60, which are in reach
    page.wait_for_text(
        re.compile(r"The joint angles stay as they are: .*nearest reachable point (with that pitch )?is \(")
    )
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
    served.wait_for_deg(page, np.degrees(nearest).tolist())


def test_one_next_pose_is_shown_by_all_screens_and_figures_follow_the_fields(
    page: Screen, served: ServedArm
) -> None:
    robot = served.robot
    page.type_into("Base °", "25")
    asked = np.radians([25.0, *HOME[1:]])
    wait_for_ghost(page, robot, asked)
    page.open_tab("Inverse")
    page.type_xyz("220", "-196", "85")
    page.click("Solve")
    best = robot.inverse([0.22, -0.196, 0.085]).best("least-rotation")
    wait_for_ghost(page, robot, best)
    page.open_tab("Forward")
    wait_for_angles(page, robot, best)  # nobody's own any more: they show the next pose
    page.wait_for_text("The fields show the next pose until you edit them.")
    page.click("present pose")
    wait_for_no_ghost(page)
    wait_for_angles(page, robot, robot.pose("home"))
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
    wait_for_no_ghost(page)

    page.open_tab("Forward")
    begin_anew(page, served)
    page.click("zero")
    page.wait_until(lambda: page.value("Shoulder °") == "0", "the fields hold the zero pose")
    wait_for_ghost(page, served.robot, np.zeros(5))
    page.open_tab("Matrix and Jacobian")
    page.wait_for_text("330.00")
    page.wait_for_text(re.compile("Singular: the tool cannot move out or in"))
    page.choose("Show for", "present pose (live)")
    wait_for_no_ghost(page)
    page.wait_for_text(re.compile("Well away from singularities"))
    page.screenshot("forward-figures")
    page.open_tab("Angles and pose")
    page.click("present pose")
    page.wait_until(lambda: page.value("Shoulder °") == "90", "the fields hold the present pose")
    page.open_tab("Velocities")
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


class Sequence:
    """What the operator and others do to one page and one arm, at random."""

    def __init__(self, page: Screen, served: ServedArm, seed: int) -> None:
        self.page, self.served, self.random = page, served, np.random.default_rng(seed)
        self.edited = False

    def another_moves(self, *, wait: bool = True) -> None:
        base, elbow = self.random.uniform((-45, -84), (45, -40))
        pose = [round(float(base), 2), 90.0, round(float(elbow), 2), -40.0, 0.0]
        self.served.order(MoveJoints(np.radians(pose), 2.5, "cubic")).accepted.result(10)
        if wait:
            self.served.wait_for_deg(self.page, pose)

    def edit(self) -> None:
        self.edited = True
        angle = int(self.random.integers(-60, 60))
        angle += str(angle) == self.page.value("Base °")  # what stands there already is no edit
        self.page.type_into("Base °", str(angle), by_key=True)

    def edit_while_it_moves(self) -> None:
        self.another_moves(wait=False)
        self.edit()
        self.served.wait_for(self.page, State.HOLDING)

    def fill_with_the_present_pose(self) -> None:
        self.edited = False
        self.page.click("present pose")

    def reload(self) -> None:
        self.edited = False
        self.page.open(self.served.url, until="Enable")
        self.page.open_tab("Forward")

    def looks_true(self) -> None:
        """What is said of the fields, what they hold and the ghost, once the page has come to rest."""
        page, robot, present = self.page, self.served.robot, self.served.commanded_deg
        page.pause(700)
        said = page.page.get_by_text("The fields follow the arm until you edit them.").locator("visible=true")
        assert (said.count() > 0) is not self.edited
        held = angles(page, robot)
        if not self.edited:
            wait_for_no_ghost(page)
            assert held == pytest.approx(present, abs=0.01)
        elif held == pytest.approx(present, abs=0.01):
            wait_for_no_ghost(page)
        else:
            wait_for_ghost(page, robot, np.radians(held))

    def press(self) -> None:
        page, goal = self.page, angles(self.page, self.served.robot)
        tip = ghost_tip_mm(page)
        page.click(REFERENCE)
        self.served.wait_for_deg(page, goal, within=0.01)
        if tip is not None:
            assert self.served.tool_mm == pytest.approx(tip, abs=0.1)
        self.edited = False  # it is there: the fields follow it again


@pytest.mark.parametrize("seed", range(SEQUENCES))
def test_random_sequences_of_moves_edits_and_reloads(page: Screen, served: ServedArm, seed: int) -> None:
    """What is said and drawn is what the button does."""
    sequence = Sequence(page, served, seed)
    ways = (
        sequence.another_moves, sequence.edit, sequence.edit_while_it_moves,
        sequence.fill_with_the_present_pose, sequence.reload, sequence.press,
    )  # fmt: skip
    for which in sequence.random.permutation(len(ways)):
        ways[which]()
        sequence.looks_true()
    sequence.press()
    assert page.errors == []
