"""Which joints of a URDF file are the arm: rods, jaws, fingers, wheels, covers and cameras are not."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tests.robot.random_arms import random_arm
from tests.robot.urdf_kit import Step, product, written

from armctl import Robot, load_robot
from armctl.errors import RobotFileError, UnclearArmError

ARM = (
    Step("pan", "revolute", "base", "l1", "0 0 0.05"),
    Step("lift", "revolute", "l1", "l2", "0 0 0.06", axis="0 1 0"),
    Step("elbow", "revolute", "l2", "l3", "0 0 0.12", axis="0 1 0"),
    Step("wrist", "revolute", "l3", "l4", "0 0 0.12", axis="0 1 0"),
    Step("roll", "revolute", "l4", "hand", "0 0 0.06"),
)
NAMES = ("pan", "lift", "elbow", "wrist", "roll")


def arm_of(tmp_path: Path, *steps: Step, behind: str = "") -> Robot:
    return load_robot(f"{written(tmp_path / 'arm.urdf', steps)}{behind}")


def asked_of(tmp_path: Path, *steps: Step) -> list[str]:
    with pytest.raises(UnclearArmError) as unclear:
        arm_of(tmp_path, *steps)
    assert str(unclear.value).endswith(f": arm.urdf#{unclear.value.links[0]}")
    return list(unclear.value.links)


@pytest.mark.parametrize("seed", range(300 if os.environ.get("ARMCTL_LONG") else 40))
def test_a_random_arm_has_its_joints_and_its_tool_or_is_asked_for(tmp_path: Path, seed: int) -> None:
    arm = random_arm(seed)
    path, tool = tmp_path / "arm.urdf", arm.links[-1]
    path.write_text(arm.xml)
    try:
        robot = load_robot(path)
    except UnclearArmError as unclear:
        assert unclear.links[0] == tool and not arm.clear, arm.parts
        robot = load_robot(f"{path}#{tool}")
    titles = [joint.title for joint in robot.joints]
    if f"(arm.urdf#{tool} ends the arm ahead of it)" in " ".join(robot.assumed):
        assert not arm.clear, arm.parts
        titles.pop()
    else:
        assert robot.source.endswith(f"to {tool}"), arm.parts
    assert titles == [title_of(name) for name in arm.joints], arm.parts


def title_of(name: str) -> str:
    return re.sub("_", " ", name).capitalize() if name[0].islower() else name


@pytest.mark.parametrize("place", ["base", "l1", "l2", "l3", "l4", "hand"])
@pytest.mark.parametrize("leader", ["lift", "roll"])
def test_a_rod_that_follows_is_no_joint_of_the_arm_wherever_it_hangs(
    tmp_path: Path, place: str, leader: str
) -> None:
    rod = Step("bar", "revolute", place, "b", "-0.03 0 0.06", axis="0 1 0", mimics=leader)
    robot = arm_of(tmp_path, *ARM, rod, Step("end", "revolute", "b", "e", mimics=leader))
    assert robot.joint_names == NAMES and robot.source.endswith("to hand")
    told = " ".join(robot.assumed)
    assert place == "hand" or f"left out: bar (follows {leader}), end (follows {leader})" in told
    assert robot.left_out == ()  # nothing that moves of its own


def test_wheels_at_the_base_are_left_out_and_told(tmp_path: Path) -> None:
    wheels = [Step(f"d{k}", "continuous", "base", f"w{k}", f"{k} 0 0", axis="0 1 0") for k in range(3)]
    robot = arm_of(tmp_path, *wheels, *ARM, Step("c", "fixed", "hand", "cam", "0 0 0.1"))
    assert robot.joint_names == NAMES and robot.source.endswith("to hand")
    assert robot.left_out == ("d0", "d1", "d2")
    assert any(text.startswith("beside the arm and left out: d0, d1, d2") for text in robot.assumed)


@pytest.mark.parametrize("limits", [(0, 1.2), (-1.6, 0.1), (-0.2, 1.7)])
def test_a_last_joint_that_may_be_a_jaw_is_asked_for(tmp_path: Path, limits: tuple[float, float]) -> None:
    jaw = Step("Revolute 7", "revolute", "hand", "part_v2_1", "0 0.02 0.03", axis="1 0 0", limits=limits)
    plain = [Step(f"Revolute {k}", *step_of(step)) for k, step in enumerate(ARM)]
    assert asked_of(tmp_path, *plain, jaw) == ["hand", "part_v2_1"]
    assert arm_of(tmp_path, *plain, jaw, behind="#hand").n == 5
    assert arm_of(tmp_path, *plain, jaw, behind="#part_v2_1").n == 6


def step_of(step: Step) -> tuple[str, str, str, str, str, str]:
    return step.kind, step.parent, step.child, step.xyz, step.rpy, step.axis


def test_a_last_joint_that_hardly_is_a_jaw_is_doubted_in_words(tmp_path: Path) -> None:
    steps = (*ARM[:4], Step("roll", "revolute", "l4", "l5", "0 0 0.06"))
    last = Step("joint_6", "revolute", "l5", "part", "0 0 0.03", limits=(0, 1.2))
    robot = arm_of(tmp_path, *steps, last)
    assert robot.n == 6
    assert (
        "joint_6 is the last of the arm's 6 joints; it may be a jaw as well "
        "(arm.urdf#l5 ends the arm ahead of it)"
    ) in robot.assumed
    tool = Step("end", "fixed", "part", "my_tcp_frame")  # no jaw carries one
    assert not any("jaw" in text for text in arm_of(tmp_path, *steps, last, tool).assumed)


def test_branches_of_the_same_length_are_asked_for(tmp_path: Path) -> None:
    def arm(side: str) -> list[Step]:
        parts = ["torso", *(f"{side}{k}" for k in range(5))]
        return [
            Step(f"j_{child}", "revolute", parent, child, "0.1 0 0", axis="0 1 0")
            for parent, child in pairwise(parts)
        ]

    head = [Step("neck", "revolute", "torso", "h1"), Step("nod", "revolute", "h1", "h2", axis="0 1 0")]
    assert asked_of(tmp_path, *arm("left"), *head, *arm("right")) == ["left4", "right4"]
    longer = Step("j_more", "revolute", "left4", "left5", "0.1 0 0", axis="1 0 0", limits=(-3, 3))
    assert asked_of(tmp_path, *arm("left"), longer, *arm("right"))[0] == "left5"


def test_fingers_of_several_joints_are_no_arms(tmp_path: Path) -> None:
    fingers = [
        Step(f"f{k}{n}", "revolute", f"p{k}{n - 1}" if n else "hand", f"p{k}{n}", "0 0 0.03", axis="0 1 0")
        for k in range(3)
        for n in range(2)
    ]
    assert asked_of(tmp_path, *ARM, *fingers)[0] == "hand"


def test_a_hand_whose_thumb_has_most_joints_is_no_longer_arm(tmp_path: Path) -> None:
    fingers = [
        Step(f"f{k}{n}", "revolute", f"p{k}{n - 1}" if n else "hand", f"p{k}{n}", "0 0 0.03", axis="0 1 0")
        for k in range(4)
        for n in range(2 + 3 * (k == 0))
    ]
    assert asked_of(tmp_path, *ARM, *fingers)[0] == "hand"


def test_a_torso_that_is_called_an_end_effector_is_no_arm(tmp_path: Path) -> None:
    arms = [
        Step(f"{side}{n}", "revolute", f"{side}_{n}" if n else "hand", f"{side}_{n + 1}", axis=f"0 {n % 2} 1")
        for side in ("left", "right")
        for n in range(6)
    ]
    named = Step("t", "fixed", "hand", "torso_end_effector")
    asked = asked_of(tmp_path, *ARM, *arms, named)
    assert asked[0].startswith("left") and asked[-1] == "torso_end_effector"


def test_a_jaw_opens_behind_a_prefix_that_all_joints_have(tmp_path: Path) -> None:
    jaw = Step("arm_gripper", "revolute", "hand", "arm_Moving_Jaw", "0 0.02 0.03", axis="1 0 0")
    tips = [
        Step("a", "fixed", "hand", "Fixed_Jaw_tip"),
        Step("b", "fixed", "arm_Moving_Jaw", "Moving_Jaw_tip"),
    ]
    assert arm_of(tmp_path, *ARM, jaw, *tips).joint_names == NAMES


def test_without_a_joint_that_turns_no_end_is_asked_for(tmp_path: Path) -> None:
    slide = Step("slide", "prismatic", "base", "cart")
    with pytest.raises(RobotFileError, match="no joint turns"):
        arm_of(
            tmp_path, slide, Step("f", "fixed", "base", "left_tcp"), Step("g", "fixed", "base", "right_tcp")
        )


def test_one_slider_at_the_end_is_asked_for(tmp_path: Path) -> None:
    slide = Step("Slider 8", "prismatic", "hand", "part", axis="0 1 0", limits=(0, 0.03))
    assert asked_of(tmp_path, *ARM, slide) == ["hand"]
    assert arm_of(tmp_path, *ARM, slide, behind="#hand").joint_names == NAMES


SCARA = (
    Step("j1", "revolute", "base", "a", "0 0 0.2"),
    Step("j2", "revolute", "a", "b", "0.2 0 0"),
    Step("j4", "revolute", "b", "hand", "0.15 0 -0.05"),
)


@pytest.mark.parametrize("place", range(4))
def test_a_scara_is_refused_for_its_slide_wherever_that_is(tmp_path: Path, place: int) -> None:
    links = ["base", "a", "b", "hand"]
    steps = [step if links.index(step.parent) != place else moved(step) for step in SCARA]
    slide = Step("z", "prismatic", links[place], "q", axis="0 0 -1", limits=(0, 0.1))
    with pytest.raises(RobotFileError, match='<joint name="z">: type="prismatic"'):
        arm_of(tmp_path, *steps, slide)


def moved(step: Step) -> Step:
    return Step(step.joint, step.kind, "q", step.child, step.xyz)


# Rods that keep the hand level: joints that follow others.

PALLETISER = (
    Step("yaw", "revolute", "base", "l1", "0 0 0.1"),
    Step("lift", "revolute", "l1", "l2", "0.02 0 0.04", axis="0 1 0", limits=(-0.1, 1.5)),
    Step("elbow", "revolute", "l2", "l3", "0 0 0.135", axis="0 1 0", limits=(-0.3, 1.2)),
    Step("level_1", "revolute", "l3", "bare", "0.147 0 0", axis="0 1 0", mimics="lift"),
    Step("level_2", "revolute", "bare", "plate", axis="0 -1 0", mimics="elbow"),
    Step("turn", "revolute", "plate", "grip", "0.06 0 -0.05"),
)


def palletiser(tmp_path: Path, steps: Sequence[Step], behind: str = "") -> Robot:
    """Loaded from a file in which ``level_1`` turns against its leader."""
    path = written(tmp_path / "arm.urdf", steps)
    path.write_text(
        path.read_text().replace('<mimic joint="lift"/>', '<mimic joint="lift" multiplier="-1"/>')
    )
    return load_robot(f"{path}{behind}")


@pytest.mark.parametrize("count", [5, 6])
def test_joints_that_follow_make_a_palletiser(tmp_path: Path, count: int) -> None:
    robot = palletiser(tmp_path, PALLETISER[:count])
    assert robot.joint_names == ("yaw", "lift", "elbow", "turn")[: count - 2]
    low, high = robot.limits.T
    for q in np.random.default_rng(1).uniform(low, high, (20, robot.n)):
        each = [*q[:3], -q[1], q[2], *q[3:]]  # of every joint of the file
        pose = product(PALLETISER[:count], "grip" if count == 6 else "plate", each, {})
        assert np.abs(robot.forward(q) - pose).max() < 1e-12
        found = robot.inverse(pose[:3, 3], rotation=pose[:3, :3])
        assert found.complete and min(np.abs(found.q - q).max(axis=1)) < 1e-9


def test_an_offset_of_a_joint_that_follows_counts(tmp_path: Path) -> None:
    path = written(tmp_path / "arm.urdf", PALLETISER[:5])
    text = path.read_text().replace('<mimic joint="elbow"/>', '<mimic joint="elbow" offset="0.25"/>')
    path.write_text(text.replace('<mimic joint="lift"/>', '<mimic joint="lift" multiplier="-1"/>'))
    pose = load_robot(path).forward([0.3, 0.2, 0.1])
    assert np.abs(pose - product(PALLETISER, "plate", [0.3, 0.2, 0.1, -0.2, 0.35], {})).max() < 1e-12


def test_shapes_and_masses_move_with_the_links_of_a_palletiser(tmp_path: Path) -> None:
    path = written(tmp_path / "arm.urdf", PALLETISER)
    solid = (
        '<inertial><mass value="2"/></inertial><visual><geometry><sphere radius="0.01"/></geometry></visual>'
    )
    text = path.read_text().replace('<link name="plate"/>', f'<link name="plate">{solid}</link>')
    path.write_text(text.replace('<mimic joint="lift"/>', '<mimic joint="lift" multiplier="-1"/>'))
    robot = load_robot(path)
    (shape,) = robot.shapes
    assert robot.link_titles[shape.link] == "Level 2"
    torque = robot.gravity.torque(np.array([0.0, 0.5, 0.3, 0.0]))
    reach = [0.135 * math.sin(0.5) + 0.147 * math.cos(0.8), 0.147 * math.cos(0.8)]
    assert np.abs(torque[1:3]) == pytest.approx([2 * 9.80665 * length for length in reach], rel=1e-6)


def test_rods_that_no_solver_takes_are_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match='<joint name="wrist">: follows the joint "lift": no solver'):
        arm_of(tmp_path, *ARM[:3], Step("wrist", "revolute", "l3", "l4", axis="0 1 0", mimics="lift"), ARM[4])


def test_a_leader_off_the_way_is_refused_by_name(tmp_path: Path) -> None:
    rod = Step("rod", "revolute", "base", "r")
    wrist = Step("wrist", "revolute", "l3", "l4", axis="0 1 0", mimics="rod")
    with pytest.raises(
        RobotFileError, match='name="wrist">: follows the joint "rod", which does not turn on'
    ):
        arm_of(tmp_path, rod, *ARM[:3], wrist, ARM[4])


def test_a_lift_below_an_arm_is_held_and_counts_as_left_out(tmp_path: Path) -> None:
    robot = arm_of(tmp_path, Step("lift_z", "prismatic", "floor", "base", limits=(0, 1)), *ARM)
    assert robot.joint_names == NAMES and robot.left_out == ("lift_z",)


def test_a_second_servo_on_one_axis_is_told(tmp_path: Path) -> None:
    second = Step("lift_2", "revolute", "l1", "s", "0 0.04 0.06", axis="0 -1 0", mimics="lift")
    robot = arm_of(tmp_path, *ARM, second)
    assert any("lift_2 turns about the axis of lift" in text for text in robot.assumed)


def test_rods_that_turn_by_themselves_raise_a_doubt(tmp_path: Path) -> None:
    rod = Step("Revolute 9", "revolute", "l1", "part_9", "-0.03 0 0.06", axis="0 1 0")
    other = Step("Revolute 3", "revolute", "l2", "part_3", axis="0 -1 0")
    robot = arm_of(tmp_path, *ARM, rod, other, behind="#hand")
    assert robot.joint_names == NAMES
    assert any(text.startswith("Revolute 9, Revolute 3: parallel to joints") for text in robot.assumed)


def test_rods_that_may_keep_a_hand_level_are_asked_for(tmp_path: Path) -> None:
    rods = [
        Step("Joint5", "revolute", "l1", "part5", "-0.02 0 0.05", axis="0 1 0"),
        Step("Joint6", "revolute", "l2", "part6", "0 0 0.12", axis="0 1 0"),
    ]
    with pytest.raises(UnclearArmError, match=r"Joint5, Joint6 may be rods .*; wrist follows lift and elbow"):
        arm_of(tmp_path, *ARM, *rods)
    assert arm_of(tmp_path, *ARM, *rods, behind="#hand").joint_names == NAMES
    assert arm_of(tmp_path, *ARM, rods[0]).joint_names == NAMES


def test_links_of_collision_shapes_only_are_no_tools(tmp_path: Path) -> None:
    path = written(
        tmp_path / "arm.urdf", (*ARM, Step("f", "fixed", "hand", "flange"), Step("s", "fixed", "hand", "sc"))
    )
    shape = '<geometry><sphere radius="0.05"/></geometry>'
    text = path.read_text().replace(
        '<link name="sc"/>', f'<link name="sc"><collision>{shape}</collision></link>'
    )
    path.write_text(text.replace('<link name="hand"/>', f'<link name="hand"><visual>{shape}</visual></link>'))
    assert load_robot(path).source.endswith("to flange")


def test_a_cover_on_the_last_link_is_not_the_tool(tmp_path: Path) -> None:
    path = written(tmp_path / "arm.urdf", (*ARM, Step("f", "fixed", "hand", "part_v3")))
    shape = '<visual><geometry><sphere radius="0.05"/></geometry></visual>'
    path.write_text(
        path.read_text().replace('<link name="part_v3"/>', f'<link name="part_v3">{shape}</link>')
    )
    assert load_robot(path).source.endswith("to hand")


def test_a_customary_name_in_the_middle_of_an_arm_is_asked_for(tmp_path: Path) -> None:
    assert asked_of(tmp_path, *ARM, Step("t", "fixed", "l2", "tool0")) == ["hand", "tool0"]


@pytest.mark.parametrize("kind", ["revolute", "fixed"])
def test_a_very_deep_file_is_an_answer_too(tmp_path: Path, kind: str) -> None:
    deep = [Step(f"d{k}", kind, f"p{k}", f"p{k + 1}", "0 0 0.01") for k in range(3000)]
    arm = [Step("turn", "revolute", "base", "p0"), *deep]
    if kind == "fixed":
        assert arm_of(tmp_path, *arm).n == 1
    else:
        with pytest.raises(RobotFileError, match="an arm has 64 at most"):
            arm_of(tmp_path, *arm)


def test_a_file_of_a_gripper_is_no_arm(tmp_path: Path) -> None:
    knuckle = Step("finger_joint", "revolute", "base", "left_knuckle")
    with pytest.raises(RobotFileError, match="no joint turns between base and base; finger_joint"):
        arm_of(tmp_path, knuckle)
    assert arm_of(tmp_path, knuckle, behind="#left_knuckle").n == 1
