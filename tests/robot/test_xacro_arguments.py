"""Arguments of xacro files: on the command line, behind the ``#``, in Python, and in the side file."""

from __future__ import annotations

import random
import string
from pathlib import Path

import numpy as np
import pytest
from tests.robot.urdf_kit import Step
from tests.robot.xacro_kit import write

from armctl import load_robot
from armctl.cli.main import run
from armctl.errors import RobotFileError, UnclearArmError
from armctl.robot import with_argument
from armctl.robot.urdf import changed_side_file
from armctl.ui.tabs.main.urdf_arm import _installed, _Present, _saved

STEPS = (
    Step("pan", "revolute", "base", "body", "0 0 0.05"),
    Step("lift", "revolute", "body", "upper", "0 0 0.06", axis="0 1 0"),
    Step("elbow", "revolute", "upper", "lower", "0 0 $(arg length)", axis="0 1 0"),
    Step("end", "fixed", "lower", "tool0", "0 0 $(arg length)"),
)
BODY = "".join(f'<link name="{one}"/>' for one in ("base", "body", "upper", "lower", "tool0"))
BODY += "".join(step.xml for step in STEPS)


def height(name: str | Path, **arguments: object) -> float:
    """Of the tool at zero [m]."""
    robot = load_robot(name, arguments or None)  # type: ignore[arg-type]
    return round(float(robot.forward(np.zeros(robot.n))[2, 3]), 9)


def test_an_argument_is_given_behind_the_file_in_python_and_in_the_side_file(tmp_path: Path) -> None:
    file = write(tmp_path, {"arm.urdf.xacro": BODY})
    assert height(f"{file}#length:=0.12") == 0.35
    assert height(f"{file}#lower,length:=0.12") == 0.23
    assert height(file, length=0.2) == height(f"{file}#length:=0.1", length="0.2") == 0.51
    changed_side_file(tmp_path / "arm.armctl.toml", {"arguments": {"length": 0.3}})
    assert height(file) == 0.71 and height(f"{file}#length:=0.12") == 0.35


def test_what_is_needed_is_named_with_the_line_to_type(tmp_path: Path) -> None:
    file = write(tmp_path, {"arm.urdf.xacro": f'<xacro:arg name="model"/>{BODY}<link name="$(arg model)"/>'})
    with pytest.raises(UnclearArmError, match="argument 'length' is needed") as refused:
        load_robot(file)
    assert "armctl check arm.urdf.xacro model:=VALUE length:=VALUE" in str(refused.value)
    assert refused.value.arguments == ["model", "length"]
    with pytest.raises(RobotFileError, match="no argument 'lenght'; did you mean 'length'"):
        load_robot(f"{file}#lenght:=0.1,length:=1,model:=x")
    with pytest.raises(
        UnclearArmError, match=r"'length' is needed, .* no default, 'lenght' was given; write"
    ):
        load_robot(f"{file}#lenght:=0.1,model:=x")
    for arguments in ({"length": None}, {"length": [1]}):
        with pytest.raises(RobotFileError, match="must be a text, a number or a bool"):
            load_robot(file, arguments)  # type: ignore[arg-type]
    with pytest.raises(RobotFileError, match="only a xacro file has arguments"):
        load_robot("uzuner", {"length": 1})
    (tmp_path / "plain.urdf").write_text('<robot><link name="a"/></robot>')
    with pytest.raises(RobotFileError, match="no xacro file and has no argument 'length'"):
        load_robot(tmp_path / "plain.urdf", {"length": 1})


def test_defaults_that_stand_are_told(tmp_path: Path) -> None:
    content = f'<xacro:arg name="length" default="0.12"/><xacro:arg name="tall" default="false"/>{BODY}'
    file = write(tmp_path, {"arm.xacro": content})
    told = [text for text in load_robot(file, {"tall": True}).assumed if text.startswith("arguments")]
    assert told == [
        "arguments as the file has them: length:=0.12 (others: armctl check arm.xacro NAME:=VALUE)"
    ]


@pytest.mark.parametrize("seed", range(20))
def test_any_value_comes_through_a_name(tmp_path: Path, seed: int) -> None:
    """Signs that mean something in a name are escaped in it."""
    chance = random.Random(seed)
    letters = string.ascii_letters + string.digits + "%,#/\\:=+ .-()é"
    value = "".join(chance.choices(letters, k=12)).strip() or "x"
    content = f'<xacro:arg name="length" default="0.1"/>{BODY}<link name="${{xacro.arg(\'it\')}}"/>'
    joint = '<joint name="j" type="fixed"><parent link="base"/><child link="${xacro.arg(\'it\')}"/></joint>'
    file = write(tmp_path, {"arm.xacro": content + joint})
    name = with_argument(str(file), f"it:={value}")
    assert name is not None
    name = with_argument(name, "length:=0.12")
    assert name is not None and height(name) == 0.35
    assert value in _Present.of(name).links
    assert value in _Present.of(str(Path(name))).links


@pytest.mark.parametrize(
    "line",
    [
        "fk {file} 0 0 0 length:=0.2",
        "fk length:=0.2 {file} 0 0 0",
        "fk --json {file} length:=0.2 -- 0 0 0",
        "ik {file} 0 0 510 length:=0.2",
        "check {file} length:=0.2",
        "doctor --port sim --robot {file} length:=0.2",
        "doctor --port sim --robot={file} length:=0.2",
    ],
)
def test_the_command_line_takes_arguments_as_ros_users_type_them(
    tmp_path: Path, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write(tmp_path, {"arm.xacro": BODY})
    assert run(line.format(file=file).split()) == 0, capsys.readouterr().err
    if line.startswith("fk"):
        assert "510.0" in capsys.readouterr().out
    assert run(line.format(file=file).replace("length:=0.2", "").split()) != 0
    assert "length:=VALUE" in capsys.readouterr().err


def test_an_argument_without_a_xacro_file_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["fk", "uzuner", "0", "0", "0", "0", "0", "length:=0.2"]) == 2
    assert "length:=0.2 is an argument of a xacro file" in capsys.readouterr().err


# Macros only.

MACROS = '<xacro:macro name="my_arm" params="prefix length:=1 *origin">{BODY}</xacro:macro>'


def test_a_file_of_macros_says_which_and_who_calls_them(tmp_path: Path) -> None:
    files = {
        "urdf/macro.xacro": MACROS,
        "urdf/whole.urdf.xacro": '<xacro:include filename="macro.xacro"/><xacro:my_arm prefix="a"/>',
        "urdf/parts.xacro": '<xacro:macro name="inner" params=""><xacro:my_armada/></xacro:macro>',
        "package.xml": "<package><name>my_arm</name></package>",
    }
    file = write(tmp_path, files)
    with pytest.raises(RobotFileError, match=r"only defines the macro my_arm; open .*: whole\.urdf\.xacro$"):
        load_robot(file)
    (tmp_path / "urdf/whole.urdf.xacro").unlink()
    with pytest.raises(RobotFileError, match=r"only defines the macro my_arm; .*or write one") as refused:
        load_robot(file)
    assert '<xacro:my_arm prefix="VALUE"><origin/></xacro:my_arm>' in str(refused.value)


# The page.


def test_the_page_asks_for_what_an_uploaded_file_needs_and_keeps_it(tmp_path: Path) -> None:
    content = f'<xacro:arg name="tall" default="no"/>{BODY}'
    upload = write(tmp_path, {"arm.urdf.xacro": content}).read_bytes()
    robots = tmp_path / "robots"
    with pytest.raises(UnclearArmError) as unclear:
        _installed("arm.urdf.xacro", upload, robots, {})
    assert unclear.value.arguments == ["length"] and list(robots.iterdir()) == []
    choice = _installed("arm.urdf.xacro", upload, robots, {"arguments": {"length": "0.12"}})
    assert height(choice.name) == 0.35
    present = _Present.of(choice.name)
    asked = [(one.name, one.value, one.default) for one in present.arguments]
    assert asked == [("tall", "no", "no"), ("length", "0.12", None)]
    _saved(present, {"arguments": {"length": "0.2", "tall": None}}, robots)
    assert height(choice.name) == 0.51
    with pytest.raises(RobotFileError, match="must be 3 numbers"):
        _saved(present, {"arguments": {"length": "long"}}, robots)
    assert height(choice.name) == 0.51
