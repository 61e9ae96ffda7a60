"""A tool's whole orientation on the pages: two ways to type it, and no offer where the arm cannot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.robot.panda_kit import panda
from tests.ui.page_kit import FakePage

from armctl.errors import InputError, UnreachableError
from armctl.facts import Several, ToDo, say
from armctl.facts.targets import PoseUnmet
from armctl.kinematics import Target, quaternion_wxyz, roll_pitch_yaw, rotation_from_rpy
from armctl.kinematics.angles import rotation_angle
from armctl.protocol import MoveJoints
from armctl.robot import Robot, load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.forward.figures import REFERENCE
from armctl.ui.tabs.forward.screen import ForwardScreen, coupled_joints
from armctl.ui.tabs.inverse.answer import solve
from armctl.ui.tabs.inverse.answer_html import details_html, notice_html
from armctl.ui.tabs.inverse.branches import branches_html
from armctl.ui.tabs.inverse.screen import InverseScreen
from armctl.ui.tabs.inverse.target_form import ANY, PITCH_AND_ROLL, WHOLE, TargetForm
from armctl.ui.tabs.manual.jog import KEYS, tool_axes, tool_jog
from armctl.ui.widgets.angle_fields import OrientationFields

ARMS = {"six": load_robot("ur5"), "seven": panda()}
R = rotation_from_rpy(0.3, -0.4, 1.2)


@pytest.fixture(params=ARMS)
def robot(request: pytest.FixtureRequest) -> Robot:
    return ARMS[request.param]


@pytest.fixture
def page(server: GuardedServer, robot: Robot) -> FakePage:
    return FakePage(server, robot, robot.pose("home"))


def off(robot: Robot, q: np.ndarray, rotation: np.ndarray) -> float:
    return float(rotation_angle(robot.forward(q)[:3, :3].T @ rotation))


def test_each_follows_the_other_and_what_was_filled_in_is_exact(page: FakePage) -> None:
    edits: list[int] = []
    fields = OrientationFields(page.gui, R)
    fields.attach(page.on, lambda: edits.append(1))
    assert fields.rotation == pytest.approx(R, abs=1e-15)
    page.put("Rz °", "-20")
    expected = rotation_from_rpy(0.3, -0.4, np.radians(-20))
    assert fields.rotation == pytest.approx(expected, abs=1e-12)
    shown = np.array([float(part) for part in fields.fields[3].text.split(",")])
    assert shown == pytest.approx(quaternion_wxyz(expected), abs=1e-6)
    page.put("Quaternion", "0, 2, 0, 0")  # any length: half a turn about x
    assert fields.rotation == pytest.approx(np.diag([1.0, -1.0, -1.0]), abs=1e-12)
    assert float(fields.fields[0].text) == pytest.approx(180)
    for label, wrong in (("Quaternion", "1, 0, 0"), ("Quaternion", "0, 0, 0, 0"), ("Rx °", "east")):
        page.put(label, wrong)
        with pytest.raises(InputError, match=label if wrong != "0, 0, 0, 0" else "length 0"):
            _ = fields.rotation
    assert len(edits) == 5


def test_forward_couples_angles_and_orientation(page: FakePage, robot: Robot) -> None:
    ForwardScreen(page.session)
    home = robot.pose("home")
    rpy = np.degrees(roll_pitch_yaw(robot.forward(home)[:3, :3]))
    page.put("Rz °", f"{rpy[2] + 10:.6f}")
    page.press(REFERENCE)
    command = page.sent[-1]
    assert isinstance(command, MoveJoints)
    wanted = rotation_from_rpy(*np.radians(rpy + np.array([0, 0, 10])))
    assert off(robot, command.q, wanted) < 1e-6
    assert robot.forward(command.q)[:3, 3] == pytest.approx(robot.forward(home)[:3, 3], abs=1e-6)
    assert np.abs(command.q - home).max() < np.radians(60)
    x = 1000 * robot.forward(home)[0, 3]
    page.put("X mm", f"{x - 20:.6f}")  # the orientation is held
    page.press(REFERENCE)
    assert off(robot, page.sent[-1].q, wanted) < 1e-6  # type: ignore[attr-defined]


def test_a_pose_that_cannot_be_had_leaves_the_angles(server: GuardedServer) -> None:
    robot = ARMS["six"]
    page = FakePage(server, robot, robot.pose("home"))
    ForwardScreen(page.session)
    page.put("Z mm", "5000")
    with pytest.raises(UnreachableError, match="not the same pose") as refused:
        page.press(REFERENCE)
    match refused.value.reason:
        case Several((PoseUnmet(reason), ToDo("mend pose"))):
            assert reason is not None and "too far" in say(reason) and say(reason) in str(refused.value)
        case other:
            raise AssertionError(other)
    home = robot.pose("home")
    reach = robot.inverse([9.0, 0.0, 0.3]).nearest_m
    assert reach is not None
    there = Target.of(0.999 * reach, rotation=robot.forward(home)[:3, :3] @ np.diag([-1.0, 1.0, -1.0]))
    edge = solve(robot, there, "least-rotation", home)
    shown = notice_html(robot, edge)
    assert "No solution in that orientation" in shown and "least energy will go to" not in shown
    assert edge.best is not None and edge.why_not and "not in that orientation" in say(edge.why_not)
    found = coupled_joints(robot, there, home)
    assert found.q is None and found.why_not and "not in that orientation" in say(found.why_not)
    assert found.nearest_q is not None


def test_nothing_goes_by_itself_to_another_orientation_than_was_asked_for(server: GuardedServer) -> None:
    robot = ARMS["six"]
    page = FakePage(server, robot, robot.pose("home"))
    InverseScreen(page.session)
    page.put("Orientation", WHOLE)
    for label, value in (("X mm", 50), ("Y mm", 0), ("Z mm", 300), ("Rx °", 180), ("Ry °", 0), ("Rz °", 0)):
        page.put(label, str(value))
    with pytest.raises(UnreachableError, match="but not in that orientation"):
        page.press("Go by least energy")
    assert not page.sent


def test_inverse_asks_for_a_point_pitch_and_roll_or_the_whole(page: FakePage, robot: Robot) -> None:
    form = TargetForm(page.session, lambda: None)
    present = robot.forward(robot.pose("home"))  # it begins with the whole, as the tool is turned now
    assert form.target().rotation == pytest.approx(present[:3, :3], abs=1e-12)  # prefilled
    page.put("Ry °", "12")
    assert roll_pitch_yaw(np.array(form.target().rotation))[1] == pytest.approx(np.radians(12))
    texts = form.texts
    page.put("Orientation", PITCH_AND_ROLL)
    assert "As long as neither is ticked, the point alone counts" in page.shown_html
    page.put("Use pitch", True)
    assert "As long as neither is ticked" not in page.shown_html
    asked = form.target()
    assert asked.rotation is None and asked.pitch is not None and asked.roll is None
    page.put("Orientation", ANY)
    assert form.target().rotation is None
    assert form.target().pitch is None and form.texts != texts
    form.following.resume()
    form.following.follow(robot.pose("rest"))
    page.put("Orientation", WHOLE)
    rest = robot.forward(robot.pose("rest"))[:3, :3]
    assert form.target().rotation == pytest.approx(rest, abs=1e-12)


def test_inverse_goes_where_the_whole_orientation_is_met(page: FakePage, robot: Robot) -> None:
    InverseScreen(page.session)
    point = robot.forward(robot.pose("home"))[:3, 3]
    page.put("Orientation", WHOLE)
    page.put("Least energy is", "least-travel")
    page.press("Solve")
    page.press("Go by least energy")
    command = page.sent[-1]
    assert isinstance(command, MoveJoints)
    assert np.abs(command.q - robot.pose("home")).max() < 1e-6  # it stands there already
    page.put("Z mm", f"{1000 * point[2] - 30:.6f}")
    page.press("Go by least energy")
    command = page.sent[-1]
    assert isinstance(command, MoveJoints)
    assert off(robot, command.q, robot.forward(robot.pose("home"))[:3, :3]) < 1e-6
    assert robot.forward(command.q)[:3, 3] == pytest.approx(point - [0, 0, 0.03], abs=1e-6)


def test_the_answer_says_how_the_tool_is_turned_and_what_is_free() -> None:
    robot, home = ARMS["seven"], ARMS["seven"].pose("home")
    pose = robot.forward(home)
    found = solve(robot, Target.of(pose[:3, 3], rotation=pose[:3, :3]), "least-rotation", home)
    assert "in steps of 0.2° of Joint 7" in details_html(robot, found)
    assert "One joint is free" in branches_html(found) and "pitch" not in branches_html(found)
    assert not isinstance(found.curve, str) and found.curve.unit == "°"


def test_what_an_arm_cannot_do_is_not_offered(server: GuardedServer) -> None:
    uzuner = load_robot("uzuner")
    page = FakePage(server, uzuner, uzuner.pose("home"))
    TargetForm(page.session, lambda: None)
    with pytest.raises(KeyError):
        page.put("Orientation", WHOLE)
    assert [robot.orients_tool for robot in (uzuner, *ARMS.values())] == [False, True, True]
    assert tool_axes(uzuner) == ("X", "Y", "Z", "Pitch", "Roll")
    for robot in ARMS.values():
        assert tool_axes(robot) == ("X", "Y", "Z", "Rx", "Ry", "Rz")
        assert max(robot.n, len(tool_axes(robot))) <= len(KEYS)
    jog = tool_jog("Ry", -1.0, 30, "tool")
    assert jog.angular is not None and np.degrees(jog.angular) == pytest.approx([0, -15, 0])
    assert not jog.linear.any() and jog.frame == "tool"


@pytest.mark.parametrize("wobble", [0.0, 1e-16, -1e-16, 1e-12, -1e-12])
def test_half_a_turn_reads_180_degrees_whatever_rounding_does(wobble: float) -> None:
    for axis in range(3):
        turns = np.zeros(3)
        turns[axis] = math.pi + wobble
        R = rotation_from_rpy(*turns)
        R = np.where(np.abs(R) < 1e-11, np.copysign(np.abs(R), wobble or 1.0), R)
        read = roll_pitch_yaw(R)
        assert np.abs(rotation_from_rpy(*read.tolist()) - R).max() < 1e-11
        assert (np.degrees(read) > -179.999).all()
