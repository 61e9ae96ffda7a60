"""Arms from URDF files: kept exactly, and whatever is wrong with a file is named."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from tests.robot.urdf_kit import Step, product, turn
from tests.robot.urdf_kit import written as kit_written
from tests.sticks import bars

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.kinematics import Chain, rotation_from_rpy
from armctl.kinematics.energy import STANDARD_GRAVITY

ARM = """<?xml version="1.0"?>
<robot name="My Arm">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="base_link"><inertial><mass value="3"/></inertial></link>
  <link name="upper"><inertial><origin xyz="0 0 0.2"/><mass value="1.5"/></inertial></link>
  <link name="fore"><visual><geometry><box size="1 1 1"/></geometry></visual></link>
  <link name="hand"><inertial><origin xyz="0.05 0 0"/><mass value="0.25"/></inertial></link>
  <link name="tool0"/>
  <joint name="shoulder_pan_joint" type="continuous">
    <parent link="base_link"/><child link="upper"/>
    <origin xyz="0 0 0.1" rpy="0 0 0.3"/><axis xyz="0 0 2"/>
    <limit effort="12" velocity="2"/>
  </joint>
  <joint name="Elbow-1" type="revolute">
    <parent link="upper"/><child link="fore"/>
    <origin xyz="0.1 0.02 0.4" rpy="0.2 -0.5 1.5708"/><axis xyz="0 1 0"/>
    <limit lower="0.25" upper="2" effort="8" velocity="0"/>
  </joint>
  <joint name="wrist" type="revolute">
    <parent link="fore"/><child link="hand"/>
    <origin xyz="0.3 0 0"/>
    <limit lower="-1" upper="1" effort="3" velocity="1.5"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="hand"/><child link="tool0"/><origin xyz="0.1 0 0.05" rpy="0 1.5707963267948966 0"/>
  </joint>
</robot>
"""


def written(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def changed(old: str, new: str) -> str:
    assert old in ARM
    return ARM.replace(old, new, 1)


def pose(xyz: list[float], rpy: list[float]) -> FloatArray:
    T = np.eye(4)
    T[:3, :3] = rotation_from_rpy(*rpy)
    T[:3, 3] = xyz
    return T


def arm_forward(q: FloatArray) -> FloatArray:
    """The product that the text of ``ARM`` says; 1.5708 is a quarter turn."""
    T = pose([0, 0, 0.1], [0, 0, 0.3]) @ turn([0, 0, 1], q[0])
    T = T @ pose([0.1, 0.02, 0.4], [0.2, -0.5, math.pi / 2]) @ turn([0, 1, 0], q[1])
    T = T @ pose([0.3, 0, 0], [0, 0, 0]) @ turn([1, 0, 0], q[2])
    return T @ pose([0.1, 0, 0.05], [0, math.pi / 2, 0])


def test_a_small_arm(tmp_path: Path) -> None:
    robot = load_robot(written(tmp_path, ARM))
    assert (robot.name, robot.title) == ("my_arm", "My Arm")
    assert robot.joint_names == ("shoulder_pan_joint", "elbow_1", "wrist")
    assert [joint.title for joint in robot.joints] == ["Shoulder pan", "Elbow 1", "Wrist"]
    assert robot.limits == pytest.approx(np.array([[-math.pi, math.pi], [0.25, 2], [-1, 1]]))
    assert robot.speed_limits == pytest.approx([2, math.radians(60), 1.5])
    assert [joint.stall_torque for joint in robot.joints] == [12, 8, 3]
    assert robot.pose("home") == pytest.approx([0, 0.25, 0])
    assert robot.output_map is None
    assert robot.gripper is None
    assumed = "; ".join(robot.assumed)
    assert "limits of ±180° of the continuous joints: shoulder_pan_joint" in assumed
    assert "a speed of 60°/s of joints without one, or with one beyond 3600°/s: elbow_1;" in assumed
    assert "arm.urdf, from base_link to tool0" in robot.source
    for q in np.random.default_rng(0).uniform(-3, 3, (20, 3)):
        assert robot.forward(q) == pytest.approx(arm_forward(q), abs=1e-14)


def test_what_the_masses_weigh(tmp_path: Path) -> None:
    """Torque is the gradient of the potential energy of the links, by finite differences."""
    robot = load_robot(written(tmp_path, ARM))
    assert [(body.joint, body.mass_kg) for body in robot.gravity.bodies] == [(0, 1.5), (2, 0.25)]

    def energy(q: FloatArray) -> float:
        upper = pose([0, 0, 0.1], [0, 0, 0.3]) @ turn([0, 0, 1], q[0])
        hand = arm_forward(q) @ np.linalg.inv(pose([0.1, 0, 0.05], [0, math.pi / 2, 0]))
        heights = (upper @ [0, 0, 0.2, 1])[2] * 1.5 + (hand @ [0.05, 0, 0, 1])[2] * 0.25
        return float(STANDARD_GRAVITY * heights)

    for q in np.random.default_rng(1).uniform(-2, 2, (10, 3)):
        slope = [(energy(q + h) - energy(q - h)) / 2e-6 for h in 1e-6 * np.eye(3)]
        assert robot.gravity.torque(q) == pytest.approx(slope, abs=1e-7)


def random_step(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """An origin and an axis: askew, along the frame, nearly along it, or on the last one's line."""
    T = np.eye(4)
    kind = rng.integers(5)
    if kind < 2:
        T[:3, :3] = rotation_from_rpy(*rng.uniform(-math.pi, math.pi, 3))
    elif kind == 2:
        T[:3, :3] = rotation_from_rpy(*(rng.integers(-2, 3, 3) * math.pi / 2))
    elif kind == 3:
        T[:3, :3] = rotation_from_rpy(*rng.choice([0.0, 1.5708, -3.14159, 1e-7], 3))
    T[:3, 3] = rng.integers(0, 2, 3) * rng.uniform(-0.5, 0.5, 3)
    axis = rng.normal(size=3) if rng.random() < 0.4 else np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
    axis = np.array([1e-8, 0, -1]) if rng.random() < 0.1 else axis
    return T, axis / np.linalg.norm(axis)


def test_any_origins_and_axes_are_a_chain() -> None:
    """Base, zeros and tool frame kept: the same pose as the plain product, to 1e-12 m."""
    rng = np.random.default_rng(2)
    for _ in range(400):
        n = int(rng.integers(1, 8))
        steps = [random_step(rng) for _ in range(n)]
        tool = random_step(rng)[0]
        chain = Chain.from_joints([T for T, _ in steps], [axis for _, axis in steps], tool)
        assert (chain.n, chain.rows) == (n, ())
        for q in (np.zeros(n), rng.uniform(-4, 4, n)):
            T = np.eye(4)
            origins = [T]
            for (origin, axis), angle in zip(steps, q, strict=True):
                T = T @ origin @ turn(axis, float(angle))
                origins.append(T)
            frames = chain.frames(q)
            assert np.abs(frames[:-1, :3, 3] - np.array(origins)[:, :3, 3]).max() < 1e-12
            assert np.abs(frames[-1] - T @ tool).max() < 1e-12
            assert np.abs(chain.forward(q) - T @ tool).max() < 1e-12


def test_the_body_goes_from_joint_to_joint(tmp_path: Path) -> None:
    robot = load_robot(written(tmp_path, ARM))
    drawn = [(bar.link, bar.frame, bar.length) for bar in bars(robot.chain, 0.0)]
    lengths = [math.hypot(*offset) for offset in ((0.1,), (0.1, 0.02, 0.4), (0.3,), (0.1, 0.05))]
    assert [drawn[k][:2] for k in range(4)] == [(-1, 0), (0, 1), (1, 2), (2, 3)]
    assert [length for *_, length in drawn] == pytest.approx(lengths, abs=1e-12)
    *_, last = bars(robot.chain, 0.02)
    assert last.length == pytest.approx(math.hypot(0.08, 0.05), abs=1e-12)  # the tool's z lies along x
    assert [one.part for one in robot.undersides][-1] == "the tool"


def part(parent: str, child: str, kind: str = "revolute", mimics: str = "") -> Step:
    return Step(f"j_{child}", kind, parent, child, "0.1 0 0", limits=(-1, 1), mimics=mimics)


ARM_PARTS = (part("world", "a"), part("a", "b"), part("b", "c"))


@pytest.mark.parametrize(
    ("parts", "tool"),
    [
        ((), "c"),
        ((part("c", "flange", "fixed"), part("flange", "tip", "fixed")), "tip"),
        ((part("a", "camera", "fixed"), part("c", "tip", "fixed")), "tip"),  # the camera is passed over
        ((part("c", "camera", "fixed"), part("c", "arm_tool0", "fixed")), "arm_tool0"),
        ((part("c", "hand", "fixed"), part("hand", "f1", "prismatic"),
          part("hand", "f2", "prismatic", "j_f1")), "hand"),
        ((part("c", "palm", "fixed"), part("palm", "k1"), part("palm", "k2", "revolute", "j_k1")), "palm"),
        ((part("c", "gripper_base", "fixed"), part("gripper_base", "jaw")), "gripper_base"),
        ((part("c", "tool0", "fixed"), part("c", "finger", "prismatic")), "tool0"),
        ((part("world", "tool0", "fixed"),), "c"),  # a place for tools on the table
    ],
)  # fmt: skip
def test_the_arm_ends_at_the_tool(tmp_path: Path, parts: tuple[Step, ...], tool: str) -> None:
    robot = load_robot(kit_written(tmp_path / "arm.urdf", (*ARM_PARTS, *parts)))
    assert robot.joint_names == ("j_a", "j_b", "j_c")
    assert robot.source.endswith(f"to {tool}")


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        (
            (part("c", "x", "fixed"), part("c", "y", "fixed")),
            "could be the tool: c, x, y; name one: arm.urdf#c",
        ),
        (
            (part("world", "left"), part("left", "hand")),
            "several links could be the tool: hand, c (j_left, j_a ",
        ),
        ((part("c", "l_tcp", "fixed"), part("b", "r_tcp", "fixed")), "could be the tool: l_tcp, r_tcp"),
        ((part("c", "quill", "prismatic"),), 'name="j_quill">: type="prismatic": the chain of an arm holds'),
        ((part("c", "d", "floating"), part("d", "tool0", "fixed")), 'name="j_d">: type="floating"'),
        ((part("c", "d", "planar"), part("d", "tool0", "fixed")), 'name="j_d">: type="planar"'),
        ((part("c", "d", "revolute", "j_b"), part("d", "tool0", "fixed")), 'j_d">: follows the joint "j_b"'),
        (
            (part("world", "rail", "prismatic", "j_b"), part("rail", "tool0")),
            "could be the tool: c, tool0 (tool0",
        ),
    ],
)
def test_where_no_chain_is_clear(tmp_path: Path, parts: tuple[Step, ...], says: str) -> None:
    path = kit_written(tmp_path / "arm.urdf", (*ARM_PARTS, *parts))
    with pytest.raises(RobotFileError, match=re.escape(says)) as refused:
        load_robot(path)
    assert str(path) in str(refused.value)


def test_numbers_that_stand_for_no_limit_are_read_as_none(tmp_path: Path) -> None:
    text = changed('effort="12" velocity="2"', 'effort="1e10" velocity="1e+08" lower="-1e16" upper="1e16"')
    pan = load_robot(written(tmp_path, text)).joints[0]
    assert (pan.speed, pan.stall_torque) == (pytest.approx(math.radians(60)), None)
    assert (pan.lower, pan.upper) == (-math.pi, math.pi)


def test_a_prefix_need_not_be_declared(tmp_path: Path) -> None:
    text = changed("<material", '<gazebo><sensor:camera sensor:kind="x"/></gazebo><material')
    assert load_robot(written(tmp_path, text)).joints == load_robot(written(tmp_path, ARM)).joints


ELBOW_LIMIT = '<limit lower="0.25" upper="2" effort="8" velocity="0"/>'
ENTITY = '<!DOCTYPE robot [<!ENTITY a "b"><!ENTITY c "&a;&a;">]>'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is not XML: no element found"),
        (b"\xff\xfe\x00<", "is not XML"),
        ('<?xml version="1.0" encoding="nonsense"?><robot>', "is not XML"),
        ("<model/>", "the root element is <model>, a URDF file has <robot>"),
        ("<robot/>", "there is no <link>"),
        ('<robot><link name="a"/></robot>', "no joint turns between a and a"),
        (ARM.replace("<robot", f"{ENTITY}<robot", 1).encode("utf-16"), "holds a document type ('robot')"),
        (
            changed("<material", '<xacro:include xmlns:xacro="http://ros.org/xacro" filename="x"/><material'),
            '<xacro:include filename="x">: cannot be read: No such file',
        ),
        (
            changed("<material", '<x:macro xmlns:x="http://ros.org/xacro" name="m"/><material'),
            'xmlns:x="http://ros.org/xacro": call the prefix of xacro "xacro"',
        ),
        (changed('<parent link="fore"/>', '<parent link="four"/>'), '<parent link="four">: there is no such'),
        (changed('<child link="hand"/>', '<child link="hund"/>'), '<child link="hund">: there is no such'),
        (changed('<child link="hand"/>', '<child link="fore"/>'), 'already hangs on the joint "Elbow-1"'),
        (changed('<parent link="base_link"/>', '<parent link="hand"/>'), "form a loop: "),
        (changed('"tool0"/>', '"tool0"/><link name="lost"/>'), "several root links (base_link, lost)"),
        (changed('"tool0"/>', '"tool0"/><link name="hand"/>'), '<link name="hand">: there are two'),
        (changed('"wrist"', '"Elbow-1"'), '<joint name="Elbow-1">: there are two'),
        (changed('<link name="tool0"/>', "<link/>"), "<link>: the attribute 'name' is missing"),
        (changed('type="continuous"', ""), "the attribute 'type' is missing"),
        (changed('type="continuous"', 'type="hinge"'), 'type="hinge": allowed are revolute, continuous'),
        (changed('<parent link="fore"/>', ""), '<joint name="wrist">: <parent> is missing'),
        (changed('<child link="hand"/>', "<child/>"), "wrist\">: <child>: the attribute 'link' is missing"),
        (changed('xyz="0.3 0 0"', 'xyz="nan 0 0"'), 'wrist">: <origin>: xyz="nan 0 0": must be 3 numbers'),
        (changed('xyz="0.3 0 0"', 'xyz="0.3 0"'), 'xyz="0.3 0": must be 3 numbers within ±1e+06'),
        (changed('xyz="0 0 2"', 'xyz="0 0 0"'), '<axis xyz="0 0 0">: has no direction'),
        (changed('xyz="0 0 2"', 'xyz="0 0 1e400"'), "<axis>: xyz="),
        (changed(ELBOW_LIMIT, ""), '<joint name="Elbow-1">: <limit> is missing; a revolute joint needs'),
        (changed(ELBOW_LIMIT, '<limit effort="1"/>'), "<limit lower=0.0 upper=0.0>: both are 0, which is"),
        (
            changed(ELBOW_LIMIT, '<limit lower="90" upper="90"/>'),
            "both are in radians; these look like deg",
        ),
        (changed('lower="0.25"', 'lower="3"'), "<limit lower=3.0 upper=2.0>: the lower limit comes first"),
        (changed('lower="0.25"', 'lower="-99"'), "both are in radians; these look like deg"),
        (changed('lower="0.25"', 'lower="x"'), '<limit>: lower="x": must be a number'),
        (changed('velocity="2"', 'velocity="2_0"'), '<limit>: velocity="2_0": must be a number'),
        (changed('<mass value="1.5"/>', '<mass value="-1"/>'), "a mass is not negative"),
        (changed('<mass value="1.5"/>', "<mass/>"), "upper\">: <mass>: the attribute 'value' is missing"),
        (changed('<origin xyz="0 0 0.2"/>', '<origin xyz="0 0 nan"/>'), '<inertial>: <origin>: xyz="0 0 nan'),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str | bytes, says: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(RobotFileError, match=re.escape(says)) as refused:
        load_robot(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_loop_without_a_root_and_an_arm_without_a_free_joint(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match="form a loop; a robot has one root link"):
        load_robot(kit_written(tmp_path / "arm.urdf", (part("c", "a"), *ARM_PARTS[1:])))
    steps = tuple(dataclasses.replace(step, limits=(0.2, 0.2)) for step in HELD)
    with pytest.raises(RobotFileError, match="no joint turns between base and tool0"):
        load_robot(kit_written(tmp_path / "arm.urdf", steps))


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match="cannot be read: No such file"):
        load_robot(tmp_path / "none.urdf")


def test_names_that_robots_cannot_have(tmp_path: Path) -> None:
    text = ARM.replace('name="My Arm"', "").replace('"wrist"', '"7"')
    robot = load_robot(written(tmp_path, text.replace('"Elbow-1"', '"Shoulder Pan Joint"')))
    assert robot.name == "arm"
    assert robot.joint_names == ("shoulder_pan_joint", "shoulder_pan_joint_2", "joint_7")


# Joints whose two limits are the same angle: fixed there, which is said.

HELD = (
    Step("waist", "revolute", "base", "body", "0 0 0.1"),
    Step("shoulder", "revolute", "body", "upper", "0.02 0 0.05", axis="0 1 0"),
    Step("twist", "revolute", "upper", "fore", "0 0 0.2", "0.1 0 0.2", axis="0 0 -1"),
    Step("elbow", "revolute", "fore", "lower", "0.01 0 0.05", axis="0 1 0"),
    Step("end", "fixed", "lower", "tool0", "0 0 0.15"),
)


def held(name: str, angle: float) -> tuple[Step, ...]:
    return tuple(
        dataclasses.replace(step, limits=(angle, angle)) if step.joint == name else step for step in HELD
    )


@pytest.mark.parametrize(("name", "angle"), [("waist", 0.7), ("twist", -0.4), ("elbow", 2.1)])
def test_such_a_joint_stands_at_its_angle(tmp_path: Path, name: str, angle: float) -> None:
    robot = load_robot(kit_written(tmp_path / "arm.urdf", held(name, angle)))
    place = [step.joint for step in HELD].index(name)
    assert robot.n == 3
    assert name not in robot.joint_names
    assert f"fixed: {name} at {math.degrees(angle):.1f}°, as both limits are the same" in robot.assumed
    for q in np.random.default_rng(5).uniform(-2, 2, (20, 3)):
        expected = product(HELD, "tool0", np.insert(q, place, angle), {})
        assert np.abs(robot.forward(q) - expected).max() < 1e-14


def test_a_rounded_quarter_turn_is_exact_there_too(tmp_path: Path) -> None:
    robot = load_robot(kit_written(tmp_path / "arm.urdf", held("twist", 1.5708)))
    q = np.array([0.3, -0.5, 0.8])
    assert np.abs(robot.forward(q) - product(HELD, "tool0", np.insert(q, 2, math.pi / 2), {})).max() < 1e-14
    assert any(text.startswith("exact: 1 angle written as rounded quarter turns") for text in robot.assumed)


def test_what_hangs_on_it_weighs_where_it_stands(tmp_path: Path) -> None:
    """The same torque as with limits a hair apart, the joint at their middle."""
    file = kit_written(tmp_path / "arm.urdf", held("twist", -0.4))
    masses = file.read_text()
    for link in ("fore", "lower"):
        inertial = '<inertial><origin xyz="0.03 0.02 0.1"/><mass value="1"/></inertial>'
        masses = masses.replace(f'<link name="{link}"/>', f'<link name="{link}">{inertial}</link>')
    file.write_text(masses)
    free = tmp_path / "free.urdf"
    free.write_text(masses.replace('lower="-0.4" upper="-0.4"', 'lower="-0.5" upper="-0.3"'))
    robot, other = load_robot(file), load_robot(free)
    assert (robot.n, other.n) == (3, 4)
    for q in np.random.default_rng(6).uniform(-2, 2, (10, 3)):
        torque = other.gravity.torque(np.insert(q, 2, -0.4))
        assert robot.gravity.torque(q) == pytest.approx(np.delete(torque, 2), abs=1e-12)
