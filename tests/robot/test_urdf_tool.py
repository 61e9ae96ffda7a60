"""Which link is the tool, which joints are the gripper's, and which axis points ahead."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from tests.robot.urdf_kit import ROUNDED, Step, product, turn, written

from armctl import Robot, load_robot
from armctl.errors import RobotFileError
from armctl.robot import is_urdf
from armctl.robot.urdf.tool import customary_tools, is_tool_frame

JAW = (
    Step("pan", "revolute", "base", "shoulder", "0.02 -0.02 0.095", "-3.1416 0 1.5708"),
    Step("lift", "revolute", "shoulder", "upper", "-0.03 0 -0.05", "-1.5708 -1.5708 0"),
    Step("elbow", "revolute", "upper", "lower", "-0.11 -0.03 0", "0 0 1.5708"),
    Step("flex", "revolute", "lower", "wrist", "-0.13 0.005 0", "0 0 -1.5708"),
    Step("wrist_roll", "revolute", "wrist", "gripper", "0 -0.06 0", "1.5708 0 3.14159"),
    Step("gripper", "revolute", "gripper", "moving_jaw", "0.02 0.02 -0.02", "1.5708 0 0"),
    Step("frame", "fixed", "gripper", "gripper_frame_link", "0 0 -0.098", "1.5708 0 1.5708"),
    Step("eye", "fixed", "gripper", "camera_link", "0.02 0 0"),
    Step("bottom", "fixed", "base", "base_frame", "0.02 0.01 0.03"),
)
"""as desk arms with one moving jaw: the link that the wrist carries is called gripper"""
PROP = (
    Step("waist", "revolute", "w/base", "w/shoulder", "0 0 0.07"),
    Step("shoulder", "revolute", "w/shoulder", "w/upper", "0 0 0.04", axis="0 1 0"),
    Step("elbow", "revolute", "w/upper", "w/fore", "0.05 0 0.25", axis="0 1 0"),
    Step("wrist_angle", "revolute", "w/fore", "w/wrist", "0.25 0 0", axis="0 1 0"),
    Step("wrist_rotate", "revolute", "w/wrist", "w/gripper_link", "0.065 0 0", axis="1 0 0"),
    Step("ee_arm", "fixed", "w/gripper_link", "w/ee_arm_link", "0.043 0 0"),
    Step("gripper", "continuous", "w/ee_arm_link", "w/gripper_prop_link", "0.005 0 0", axis="1 0 0"),
    Step("bar", "fixed", "w/ee_arm_link", "w/bar_link"),
    Step("ee_bar", "fixed", "w/bar_link", "w/fingers_link", "0.023 0 0"),
    Step("left_finger", "prismatic", "w/fingers_link", "w/left", axis="0 1 0"),
    Step("right_finger", "prismatic", "w/fingers_link", "w/right", axis="0 1 0", mimics="left_finger"),
    Step("ee_gripper", "fixed", "w/fingers_link", "w/ee_gripper_link", "0.0275 0 0"),
)
"""a propeller on the gripper's motor and two sliding fingers; every frame has x ahead"""


def arm_of(tmp_path: Path, steps: tuple[Step, ...], behind: str = "") -> Robot:
    return load_robot(f"{written(tmp_path / 'arm.urdf', steps)}{behind}")


def assert_product(robot: Robot, steps: tuple[Step, ...], link: str) -> None:
    for q in np.random.default_rng(3).uniform(-2, 2, (20, robot.n)):
        assert np.abs(robot.forward(q) - product(steps, link, q, ROUNDED)).max() < 1e-14


@pytest.mark.parametrize(
    ("steps", "tool", "joints"),
    [(JAW, "gripper_frame_link", 5), (PROP, "w/ee_gripper_link", 5)],
)
def test_the_joint_of_the_gripper_is_left_out(
    tmp_path: Path, steps: tuple[Step, ...], tool: str, joints: int
) -> None:
    robot = arm_of(tmp_path, steps)
    assert robot.n == joints
    assert robot.source.endswith(f"to {tool}")
    assert robot.assumed[0] == (
        f"the tool is the link {tool}, which has a name as tool frames have; "
        "taken for the gripper's own and left out: gripper (another: arm.urdf#LINK)"
    )
    assert_product(robot, steps, tool)


@pytest.mark.parametrize(("roll", "jaw"), [("Wrist_Roll", "Jaw"), ("5", "6"), ("wrist_roll", "gripper")])
def test_a_wrist_that_carries_the_fixed_jaw_stays(tmp_path: Path, roll: str, jaw: str) -> None:
    jaws = (
        Step(roll, "revolute", "wrist", "Fixed_Jaw", "0 -0.06 0", "1.5708 0 3.14159"),
        Step(jaw, "revolute", "Fixed_Jaw", "Moving_Jaw", "0.02 0.02 -0.02", "1.5708 0 0"),
    )
    robot = arm_of(tmp_path, (*JAW[:4], *jaws))
    assert robot.n == 5 and robot.joint_names[3] == "flex" and robot.source.endswith("to Fixed_Jaw")
    assert f"left out: {jaw} " in robot.assumed[0]


def test_without_a_frame_the_arm_ends_at_what_the_wrist_carries(tmp_path: Path) -> None:
    steps = tuple(step for step in JAW if step.joint != "frame")  # the camera is none
    robot = arm_of(tmp_path, steps)
    assert robot.joint_names[-1] == "wrist_roll"
    assert robot.assumed[0].startswith(
        "the tool is the link gripper, which the last joint of the arm moves; "
    )
    assert_product(robot, steps, "gripper")


def finger(joint: str, child: str, parent: str = "gripper", kind: str = "revolute", mimics: str = "") -> Step:
    return Step(joint, kind, parent, child, "0 0.01 -0.02", mimics=mimics)


@pytest.mark.parametrize(
    "fingers",
    [
        (finger("Jaw", "part6"),),
        (finger("6", "leftClaw"),),
        (finger("l_gripper_joint", "part6"),),
        (finger("finger1", "f1"), finger("finger2", "f2")),
        (finger("finger1", "f1"), finger("tip1", "f2", parent="f1", mimics="finger1")),
        (finger("gripper", "g", kind="prismatic"),),
    ],
)
def test_fingers_that_names_tell(tmp_path: Path, fingers: tuple[Step, ...]) -> None:
    robot = arm_of(tmp_path, (*JAW[:5], *fingers))
    assert robot.joint_names[-1] == "wrist_roll"
    assert robot.source.endswith("to gripper")
    assert "wrist_roll" not in robot.assumed[0]


@pytest.mark.parametrize(
    "last",
    [
        finger("gripper_roll", "g"),
        finger("joint6", "gripper_link"),
        finger("tilt", "hand"),
    ],
)
def test_joints_of_the_arm_that_carry_a_gripper(tmp_path: Path, last: Step) -> None:
    steps = (*JAW[:5], last)
    robot = arm_of(tmp_path, steps)
    assert robot.n == 6
    assert robot.assumed[0] == (
        f"the tool is the link {last.child}, which the last joint of the arm moves (another: arm.urdf#LINK)"
    )
    assert_product(robot, steps, last.child)


def test_an_arm_joint_behind_a_gripper_joint_stays(tmp_path: Path) -> None:
    robot = arm_of(tmp_path, (*JAW[:6], Step("swing", "revolute", "moving_jaw", "hand", "0 0 0.1")))
    assert robot.joint_names[-2:] == ("gripper", "swing")


@pytest.mark.parametrize(
    ("steps", "link", "last"),
    [
        (JAW, "moving_jaw", "gripper"),
        (JAW, "gripper", "wrist_roll"),
        (JAW, "lower", "elbow"),
        (PROP, "w/gripper_prop_link", "gripper"),
    ],
)
def test_the_user_names_the_tool(tmp_path: Path, steps: tuple[Step, ...], link: str, last: str) -> None:
    robot = arm_of(tmp_path, steps, f"#{link}")
    assert robot.joint_names[-1] == last
    assert robot.source.endswith(f"to {link}")
    assert not [text for text in robot.assumed if text.startswith("the tool is")]
    assert_product(robot, steps, link)


@pytest.mark.parametrize(
    ("behind", "says"),
    [
        (
            "#tool0",
            "there is no link 'tool0'; it has base, shoulder, upper, lower, wrist, gripper, moving_jaw",
        ),
        ("#base_frame", "no joint turns between base and base_frame"),
        ("#", "behind the # stands the name of the tool link"),
        ("#gripper,", "with commas between; got 'gripper,'"),
        ("#gripper,approach=w", "approach=AXIS (x, y, z, -x, -y, -z)"),
        ("#approach=x,approach=y", "got 'approach=x,approach=y'"),
    ],
)
def test_names_that_say_nothing(tmp_path: Path, behind: str, says: str) -> None:
    with pytest.raises(RobotFileError, match=re.escape(says)):
        arm_of(tmp_path, JAW, behind)


def test_a_sliding_joint_on_the_way_is_named(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match=r'<joint name="left_finger">: type="prismatic"') as refused:
        arm_of(tmp_path, PROP, "#w/left")
    assert "an arm that ends ahead of it is named as arm.urdf#w/fingers_link" in str(refused.value)


@pytest.mark.parametrize(
    ("kind", "limits", "at_mm"),
    [("prismatic", (-0.1, 0.4), 0), ("prismatic", (0.2, 0.4), 200), ("planar", (-1, 1), 0)],
)
def test_what_moves_the_base_stays_where_it_is_and_is_told(
    tmp_path: Path, kind: str, limits: tuple[float, float], at_mm: float
) -> None:
    slide = Step("slide", kind, "rail", "base", xyz="0.1 0 0", axis="0 1 0", limits=limits)
    robot = arm_of(tmp_path, (Step("mount", "fixed", "world", "rail"), slide, *JAW))
    assert f"fixed: slide at {at_mm} mm, which moves the base and is no joint of the arm" in robot.assumed
    tool, alone = robot.forward(np.zeros(5)), arm_of(tmp_path, JAW).forward(np.zeros(5))
    assert tool[:3, 3] - alone[:3, 3] == pytest.approx([0.1, 0.001 * at_mm, 0.0])


@pytest.mark.parametrize(
    ("links", "tools"),
    [
        (("base", "tcp", "ee_link", "tool0"), ["tool0"]),
        (("left_tcp", "right_tcp", "end_effector"), ["left_tcp", "right_tcp"]),
        (("left_tool0", "tool0"), ["tool0"]),
        (("base", "toolbox", "mytcp"), []),
    ],
)
def test_names_that_are_the_tools_by_custom(links: tuple[str, ...], tools: list[str]) -> None:
    assert customary_tools(links) == tools


def test_the_words_of_customary_names_tell_a_tool_frame() -> None:
    assert all(map(is_tool_frame, ("tool0", "my_tcp_frame", "ee_gripper_link", "effector", "gripper_frame")))
    assert not any(map(is_tool_frame, ("base_link", "gripper", "end", "tool_camera", "ee_finger")))


def test_how_files_may_be_named(tmp_path: Path) -> None:
    path = written(tmp_path / "ARM.URDF", PROP)
    assert load_robot(path).n == load_robot(str(path)).n == 5
    named = Path(f"{path}#w/ee_arm_link")
    assert load_robot(named).source.endswith("to w/ee_arm_link")
    assert [
        is_urdf(name) for name in ("a.urdf", Path("a.Urdf"), named, "a.urdf#l", "a.urdf.xacro", "a.zip")
    ] == [True] * 6
    assert [is_urdf(name) for name in ("uzuner", "a.toml", ".urdf", "urdf#l")] == [False] * 4
    with pytest.raises(RobotFileError, match=r"ends in \.toml or \.urdf"):
        load_robot("arm.txt")


@pytest.mark.parametrize(
    ("axis", "about", "angle"),
    [("x", "y", 90), ("-x", "y", -90), ("y", "x", -90), ("-y", "x", 90), ("z", "x", 0), ("-z", "x", 180)],
)
def test_the_approach_axis(tmp_path: Path, axis: str, about: str, angle: float) -> None:
    turned = turn(np.eye(3)["xyz".index(about)], math.radians(angle))
    robot = arm_of(tmp_path, PROP, f"#w/ee_gripper_link,approach={axis}")
    for q in np.random.default_rng(4).uniform(-2, 2, (10, robot.n)):
        expected = product(PROP, "w/ee_gripper_link", q, {}) @ turned
        assert np.abs(robot.forward(q) - expected).max() < 1e-14
    assert robot.source.endswith("" if axis == "z" else f", whose {axis} axis is taken for the tool's z")


def approach_of(robot: Robot) -> list[str]:
    return [text for text in robot.assumed if text.startswith("pitch is the elevation")]


def test_a_tool_whose_x_points_ahead_is_told(tmp_path: Path) -> None:
    assert approach_of(arm_of(tmp_path, PROP)) == [
        "pitch is the elevation of the tool's z axis; in the link w/ee_gripper_link not z but x points "
        "ahead, along the axis of wrist_rotate, so that no pitch can be asked for "
        "(arm.urdf#w/ee_gripper_link,approach=x takes x for z)"
    ]
    without_roll = (*PROP[:4], Step("end", "fixed", "w/wrist", "w/ee_link", "0.1 0 0"))
    assert approach_of(arm_of(tmp_path, without_roll)) == [
        "pitch is the elevation of the tool's z axis; in the link w/ee_link not z but x points ahead, "
        "along the last link (arm.urdf#w/ee_link,approach=x takes x for z)"
    ]
    assert "not z but -y points ahead" in approach_of(arm_of(tmp_path, JAW, "#gripper_frame_link"))[0]


def test_the_other_approach_axis_makes_pitch_what_the_eye_sees(tmp_path: Path) -> None:
    robot = arm_of(tmp_path, PROP, "#approach=x")
    assert not approach_of(robot)
    q = np.array([0.4, 0.3, 0.6, 0.2, 0.5])
    T = product(PROP, "w/ee_gripper_link", q, {})
    found = robot.inverse(T[:3, 3], pitch=math.asin(T[2, 0]), roll=0.5)
    assert found.success, found.reason
    assert min(np.abs(found.q - q).max(axis=1)) < 1e-9


def test_where_no_pitch_can_be_asked_for_none_is_explained(tmp_path: Path) -> None:
    hand = dataclasses.replace(PROP[-1], xyz="0.0275 0.02 0")
    wall = (Step("mount", "fixed", "world", "w/base", "0 0 1", "1.5708 0 0"), *PROP[:-1], hand)
    told = [text for text in arm_of(tmp_path, wall).assumed if text.startswith("pitch")]
    assert len(told) == 1 and "so that no pitch can be asked for" in told[0]


def test_a_tool_that_points_no_way_at_all_is_not_told(tmp_path: Path) -> None:
    askew = (*PROP[:5], Step("end", "fixed", "w/gripper_link", "w/tool0", "0.1 0 0", "0.5 0.5 0.5"))
    ahead = (*PROP[:5], Step("end", "fixed", "w/gripper_link", "w/tool0", "0.1 0 0", "0 1.5708 0"))
    nowhere = PROP[:4]
    for steps in (askew, ahead, nowhere):
        assert not approach_of(arm_of(tmp_path, steps))


@pytest.mark.parametrize("beside", ["0", "0.02"])
def test_a_base_that_is_not_upright_is_told(tmp_path: Path, beside: str) -> None:
    hand = dataclasses.replace(PROP[-1], xyz=f"0.0275 {beside} 0")
    wall = (Step("mount", "fixed", "world", "w/base", "0 0 1", "1.5708 0 0"), *PROP[:-1], hand)
    robot = arm_of(tmp_path, wall, "#approach=x")
    assert robot.inverse_kinematics.family.endswith("beside the tool") == (beside != "0")
    assert [text for text in robot.assumed if text.startswith("pitch is measured")] == [
        "pitch is measured from the plane that the axis of waist stands on, not from the horizontal: "
        "that axis leans by 90.0° in the root frame"
    ]
    hanging = (Step("mount", "fixed", "world", "w/base", "0 0 1", "3.14159 0 0"), *PROP)
    for upright in (PROP, hanging):
        assert not [text for text in arm_of(tmp_path, upright).assumed if "measured from" in text]
