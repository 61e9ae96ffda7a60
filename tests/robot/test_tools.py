"""Several tools of one arm: where their tips are, what they weigh, and what of them is in the way."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples
from tests.robot.plain_arm import plain_arm
from tests.runtime.signal_kit import SIGNALS

from armctl.arrays import FloatArray
from armctl.calibration import Calibration, JointDeflection, calibrated
from armctl.errors import InputError, RobotFileError
from armctl.kinematics import rotation_from_rpy
from armctl.kinematics.energy import STANDARD_GRAVITY
from armctl.kinematics.samples import joint_samples
from armctl.motion import preflight
from armctl.motion.profiles import PointToPoint
from armctl.robot import Robot, load_robot, robots_folder
from armctl.robot.record import robot_of, robot_record
from armctl.robot.tools import Tool, ToolPiece
from armctl.robot.urdf.side_file import changed_side_file

TOOLS = """
[[tools]]
name = "jaws"
gripper = true

[[tools]]
name = "pen"
title = "Felt pen"
offset_mm = [0, 0, 110]
mass_kg = 0.04
com_mm = [0, 0, 50]
pieces = [{ from_mm = [0, 0, 0], to_mm = [0, 0, 110], radius_mm = 5, color = "blue" }]

[[tools]]
name = "cup"
offset_mm = [12, -5, 60]
turn_deg = [0, 20, 90]
output = "pump"
part_input = "door"
"""


def arm_with_tools(folder: Path, tools: str = TOOLS, more: str = SIGNALS, name: str = "uzuner") -> Robot:
    """A shipped arm with tools in its file."""
    text = (robots_folder() / f"{name}.toml").read_text(encoding="utf-8")
    path = folder / f"{name}.toml"
    path.write_text(f"{text}\n{more}\n{tools}", encoding="utf-8")
    return load_robot(path)


def placed(x_mm: float, y_mm: float, z_mm: float, rx: float, ry: float, rz: float) -> FloatArray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation_from_rpy(*np.radians([rx, ry, rz])), np.array([x_mm, y_mm, z_mm]) / 1000
    return T


def with_one(name: str, tool: Tool) -> Robot:
    return replace(load_robot(name), tools=(tool,)).with_tool(tool.name)


def test_the_first_tool_is_on_until_another_is_chosen(tmp_path: Path) -> None:
    robot = arm_with_tools(tmp_path)
    plain = load_robot("uzuner")
    assert [tool.name for tool in robot.tools] == ["jaws", "pen", "cup"]
    assert robot.tool == "jaws" and robot.gripper == plain.gripper and robot.chain == plain.chain
    pen, cup = robot.with_tool("pen"), robot.with_tool("cup")
    assert pen.gripper is None and pen.with_tool("jaws") == robot and pen.with_tool("cup") is cup
    assert cup.gripper is not None and (cup.gripper.output, cup.gripper.part_input) == ("pump", "door")
    assert cup.tools[1].title == "Felt pen" and cup.tools[2].title == "Cup"
    with pytest.raises(InputError, match="the arm has no tool 'saw'; it has 'jaws', 'pen', 'cup'"):
        robot.with_tool("saw")
    with pytest.raises(InputError, match="it has none in its file"):
        plain.with_tool("pen")


@settings(max_examples=examples(40), deadline=None)
@given(
    st.sampled_from(["uzuner", "ur5", "eezybotarm_mk2"]),  # modified rows, standard rows, a linkage
    st.tuples(*[st.floats(-300, 300)] * 3),
    st.tuples(*[st.floats(-180, 180)] * 3)
    | st.sampled_from([(0, 0, 0), (90, 0, 0), (180, 0, 0), (0, 0, 90)]),
)
def test_the_tip_is_where_the_file_puts_it(
    name: str, offset_mm: tuple[float, float, float], turn_deg: tuple[float, float, float]
) -> None:
    T = placed(*offset_mm, *turn_deg)
    robot = with_one(name, Tool("tip", "Tip", T))
    assert robot.flange is not None
    q = joint_samples(robot.limits, 3)
    assert robot.forward(q) == pytest.approx(robot.flange.forward(q) @ T, abs=1e-12)
    # what is in between is on the line from the flange to the tip: nothing of it comes near to a floor alone
    between = robot.frames(q)[:, len(robot.flange.chain.places) :, :3, 3]
    flange, tip = robot.flange.forward(q)[:, None, :3, 3], robot.forward(q)[:, None, :3, 3]
    away = np.linalg.norm(between - flange, axis=-1)
    assert (away <= np.linalg.norm(tip - flange, axis=-1) + 1e-9).all()


AHEAD, ASIDE, TURNED = placed(0, 0, 80, 0, 0, 0), placed(15, 10, 60, 0, 0, 0), placed(0, 0, 60, 0, 30, 0)


@pytest.mark.parametrize(
    ("name", "tips"),
    [
        *[(name, (AHEAD, ASIDE, TURNED)) for name in ("uzuner", "so101", "mico", "ur5", "ar4", "mearm")],
        *[
            (name, (AHEAD, TURNED)) for name in ("uarm", "humanoid")
        ],  # aside their files are refused, see below
    ],
)
def test_every_family_finds_the_pose_again_with_a_tool(name: str, tips: tuple[FloatArray, ...]) -> None:
    for T in tips:
        _finds_again(with_one(name, Tool("tip", "Tip", T)))


def _finds_again(robot: Robot) -> None:
    assert robot.inverse_kinematics.complete
    q = robot.limits[:, 0] + 0.4 * (robot.limits[:, 1] - robot.limits[:, 0])
    pose = robot.forward(q)
    found = robot.inverse(pose[:3, 3], rotation=pose[:3, :3], start=q)
    poses = robot.forward(found.q)
    assert poses[:, :3, 3] == pytest.approx(np.tile(pose[:3, 3], (len(found.q), 1)), abs=1e-7)
    assert np.abs(poses[:, :3, :3] - pose[:3, :3]).max(axis=(1, 2)).min() < 1e-6


def test_a_tool_weighs_on_the_joints(tmp_path: Path) -> None:
    robot = arm_with_tools(tmp_path).with_tool("pen")
    flange = robot.flange
    assert flange is not None
    tool, step = robot.tools[1], 1e-6

    def energy(q: FloatArray) -> float:
        T = flange.forward(q)
        com = T[:3, :3] @ tool.com_m + T[:3, 3]
        payload = flange.gravity.payload_kg * (robot.forward(q) - T)[2, 3]  # it has moved to the tip
        return STANDARD_GRAVITY * (tool.mass_kg * float(com[2]) + float(payload))

    for q in joint_samples(robot.limits, 4):
        steps = step * np.eye(robot.n)
        more = [(energy(q + one) - energy(q - one)) / (2 * step) for one in steps]
        assert robot.gravity.torque(q) - flange.gravity.torque(q) == pytest.approx(np.array(more), abs=1e-7)


def test_a_soft_arm_sags_by_its_tool_too(tmp_path: Path) -> None:
    robot = arm_with_tools(tmp_path)
    soft = Calibration(
        "uzuner", "7", "µs", {}, deflection={"shoulder": JointDeflection(compliance=math.radians(1.0))}
    )
    arm = calibrated(robot.with_tool("pen"), soft)
    light, heavy = arm.with_tool("jaws").outputs, arm.outputs
    assert arm.tool == "pen" and light.deflection is not None and heavy.deflection is not None
    q = arm.pose("home")
    more = heavy.deflection.gravity.torque(q) - light.deflection.gravity.torque(q)
    ahead = heavy.deflection.setpoint(q) - light.deflection.setpoint(q)
    assert more[1] > 0.05 and ahead[1] == pytest.approx(math.radians(1.0) * more[1]) and ahead[2] == 0.0


def test_a_tool_is_drawn_and_kept_off_the_floor(tmp_path: Path) -> None:
    robot = arm_with_tools(tmp_path)
    pen = robot.with_tool("pen")
    piece = pen.pieces[-1]
    assert piece.part == "the felt pen" and len(pen.pieces) == len(robot.pieces) + 1
    start = robot.pose("home")
    q = robot.inverse([0.22, 0.0, robot.floor_z + 0.07], pitch=-math.pi / 2, start=start).best(
        "least-travel", start
    )
    way = PointToPoint.plan(robot, start, q)
    assert not [one for one in preflight(robot, way) if one.severity == "error"]
    found = [one for one in preflight(pen, way) if one.severity == "error"]
    assert found and found[0].kind == "floor"


def test_a_file_with_capsules_has_the_tool_among_them() -> None:
    bar = ToolPiece(np.zeros(3), np.array([0, 0, 0.05]), 0.004)
    own = load_robot("uzuner")
    robot = replace(own, capsules=own.body.capsules, tools=(Tool("bar", "Bar", np.eye(4), pieces=(bar,)),))
    with_bar = robot.with_tool("bar")
    assert with_bar.capsules is not None and robot.capsules is not None
    assert with_bar.capsules[:-1] == robot.capsules and with_bar.capsules[-1].part == "the bar"


JAW = 'hinge_mm = [26, 9, 0], mirror = "y"'
"""of the jaws' row in its look"""


def without_jaws(folder: Path, names: str = '["jaws"]') -> Path:
    """The file of an arm whose jaws are taken off for other tools than these."""
    text = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")
    assert JAW in text
    path = folder / "uzuner.toml"
    path.write_text(f"{text.replace(JAW, f'{JAW}, tools = {names}')}\n{SIGNALS}\n{TOOLS}", encoding="utf-8")
    return path


def test_jaws_that_are_taken_off_are_neither_drawn_nor_in_the_way(tmp_path: Path) -> None:
    robot = load_robot(without_jaws(tmp_path))
    pen, cup = robot.with_tool("pen"), robot.with_tool("cup")
    assert any(piece.jaw is not None for piece in robot.pieces) and robot.bodies.opens
    for arm in (pen, cup):
        assert not any(piece.jaw is not None for piece in arm.pieces) and not arm.bodies.opens
        assert not any("jaw" in one.part for one in arm.collision.capsules)
    assert any("jaw" in one.part for one in robot.collision.capsules)
    again = robot_of(msgspec.msgpack.decode(msgspec.msgpack.encode(robot_record(pen))))
    assert again == pen and again.with_tool("jaws") == robot
    with pytest.raises(RobotFileError, match="tools: must be one of 'jaws', 'pen', 'cup', not 'saw'"):
        load_robot(without_jaws(tmp_path, '["saw"]'))


PEN = {
    "name": "pen", "offset_mm": [0, 0, 120], "mass_kg": 0.05,
    "pieces": [{"from_mm": [0, 0, 80], "to_mm": [0, 0, 120], "radius_mm": 4, "color": "blue"}],
}  # fmt: skip


def urdf_with_tools(folder: Path) -> Path:
    """An arm with shapes; its side file has a tool that is nothing, and a pen."""
    path = folder / "arm.urdf"
    path.write_text(plain_arm(), encoding="utf-8")
    changed_side_file(folder / "arm.armctl.toml", {"tools": [{"name": "bare"}, PEN]})
    return path


def test_an_arm_from_a_urdf_file_has_tools_in_its_side_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    loaded = load_robot(urdf_with_tools(tmp_path))
    robot = loaded.with_body()
    pen = robot.with_tool("pen")
    assert robot.tool == "bare" and robot.capsules is not None and pen.capsules is not None
    assert pen.capsules[:-1] == robot.capsules and pen.capsules[-1].part == "the pen"
    q = robot.limits @ [0.4, 0.6]
    assert pen.forward(q) == pytest.approx(robot.forward(q) @ placed(0, 0, 120, 0, 0, 0), abs=1e-12)
    assert np.abs(pen.gravity.torque(q)).sum() > np.abs(robot.gravity.torque(q)).sum()
    late = loaded.with_tool("pen")  # its body is worked out with the tool on
    assert late.capsules is None and late.with_body() == pen == late.with_known_body()
    assert late.collision.capsules == pen.collision.capsules
    assert robot_of(msgspec.msgpack.decode(msgspec.msgpack.encode(robot_record(pen)))) == pen
    with pytest.raises(RobotFileError, match=r"tools\.pen\.gripper: the arm has no"):
        changed_side_file(tmp_path / "arm.armctl.toml", {"tools": [{**PEN, "gripper": True}]})
        load_robot(tmp_path / "arm.urdf")


def test_tools_cross_to_the_arm_process(tmp_path: Path) -> None:
    robot = arm_with_tools(tmp_path).with_tool("cup").gripping(0.5)
    again = robot_of(msgspec.msgpack.decode(msgspec.msgpack.encode(robot_record(robot))))
    assert again.tool == "cup" and again.tools == robot.tools
    assert again.with_tool("pen") == robot.with_tool("pen")
    assert robot_of(robot_record(again)) == again


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('name = "pen"', 'name = "jaws"', "tools.jaws.name: two tools have it"),
        ('title = "Felt pen"', 'title = "Jaws"', "tools.pen.title: two tools are shown by it"),
        ("offset_mm = [0, 0, 110]", "offset_mm = [0, 0, 2001]", "must be -2000 … 2000, not 2001"),
        (
            "to_mm = [0, 0, 110]",
            "to_mm = [0, 0, 0]",
            "tools.pen.pieces: from_mm and to_mm of one are the same",
        ),
        ('output = "pump"', 'output = "siren"', "tools.cup.output: must be one of 'lamp', 'pump', 'bell'"),
        ('part_input = "door"', 'part_input = "x"', "tools.cup.part_input: must be one of 'button'"),
        ('output = "pump"\n', "", "tools.cup.part_input: only a tool with an output has it"),
        ('output = "pump"', 'output = "pump"\ngripper = true', "tools.cup.output: the arm's gripper works"),
        ("mass_kg = 0.04", "mass_g = 40", "unknown key 'mass_g'"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in TOOLS
    with pytest.raises(RobotFileError, match=said):
        arm_with_tools(tmp_path, TOOLS.replace(old, new))


@pytest.mark.parametrize(
    ("name", "tool", "said"),
    [
        ("ur5", "gripper = true", r"tools.tip.gripper: the arm has no \[gripper\]"),
        ("humanoid", "offset_mm = [20, 0, 80]", "tools.tip.offset_mm: the arm is solved in closed form as"),
        ("uarm", "offset_mm = [20, 0, 0]", "put the tip on the axis of the last joint"),
    ],
)
def test_a_tool_that_does_not_suit_the_arm_is_refused(
    tmp_path: Path, name: str, tool: str, said: str
) -> None:
    with pytest.raises(RobotFileError, match=said):
        arm_with_tools(tmp_path, f'[[tools]]\nname = "tip"\n{tool}\n', "", name)
