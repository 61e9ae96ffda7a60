"""Files that other programs accept, and files of other formats."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.robot.plain_arm import plain_arm

from armctl import load_robot
from armctl.cli.main import run
from armctl.errors import RobotFileError

ARM = plain_arm()
HEAD, _, BODY = ARM.partition("\n")


def opened(path: Path, content: bytes) -> int:
    """Joints of the arm in a file with this content."""
    path.write_bytes(content)
    return load_robot(path).n


@pytest.mark.parametrize("seed", range(25))
def test_any_encoding_and_anything_ahead_of_the_declaration_is_read(tmp_path: Path, seed: int) -> None:
    chance = np.random.default_rng(seed)
    words = {
        "gb2312": "机械臂", "gbk": "機械臂", "big5": "機械手臂", "shift_jis": "ロボット", "euc-kr": "로봇",
        "iso-8859-1": "Länge", "windows-1252": "Länge €", "iso-8859-2": "řada", "windows-1251": "рука",
        "koi8-r": "рука", "utf-8": "Länge 机械臂", "utf-16": "Länge 机械臂", "UTF-8": "ø",
    }  # fmt: skip
    declared = list(words)[seed % len(words)]
    ahead = "".join(
        chance.choice(["\n", "  ", "\r\n", "<!-- a -->", "<!--?-->\n"]) for _ in range(chance.integers(4))
    )
    text = f'{ahead}<?xml version="1.0" encoding="{declared}"?>\n<!-- {words[declared]} -->\n{BODY}'
    assert opened(tmp_path / "arm.urdf", text.encode(declared)) == 5
    # undeclared, as Windows writes it
    assert opened(tmp_path / "arm.urdf", f"{ahead}{HEAD}\n<!-- Länge -->\n{BODY}".encode("cp1252")) == 5


def test_names_come_through_an_encoding(tmp_path: Path) -> None:
    text = f'<?xml version="1.0" encoding="gb2312"?>{BODY}'.replace("hand", "手爪")
    opened(tmp_path / "arm.urdf", text.encode("gb2312"))
    assert "手爪" in load_robot(tmp_path / "arm.urdf").source


def test_lines_keep_their_numbers(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(f"\n<!-- a\n -->\n{HEAD}\n<robot>\n<link name='a'>\n</robot>")
    with pytest.raises(RobotFileError, match="line 7"):
        load_robot(tmp_path / "arm.urdf")
    (tmp_path / "arm.urdf").write_bytes(b'<?xml version="1.0" encoding="gb2312"?><robot>\xff\xff\xff</robot>')
    with pytest.raises(RobotFileError, match="save it as UTF-8"):
        load_robot(tmp_path / "arm.urdf")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ('<sdf version="1.6"><model name="a"/></sdf>', "SDF file of Gazebo"),
        ('<mujoco model="a"><worldbody/></mujoco>', "MJCF file of MuJoCo"),
        ('<robot name="a"><group name="arm"><chain base_link="b" tip_link="t"/></group></robot>', "SRDF"),
        ('<robot name="a"><disable_collisions link1="a" link2="b"/></robot>', "SRDF"),
        ("<launch><node/></launch>", "launch file of ROS"),
        ("<!DOCTYPE html>\n<html></html>", "web page"),
        ("<html><body/></html>", "web page"),
    ],
)
@pytest.mark.parametrize("ending", ["urdf", "xml"])
def test_other_formats_are_named(
    tmp_path: Path, content: str, says: str, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / f"arm.{ending}"
    file.write_text(content)
    with pytest.raises(RobotFileError, match=says) as refused:
        load_robot(file)
    assert "URDF" in str(refused.value) or "download" in str(refused.value)
    assert run(["check", str(file)]) == 1
    assert says in capsys.readouterr().err


def test_a_urdf_file_may_be_called_xml(tmp_path: Path) -> None:
    assert opened(tmp_path / "robot.xml", ARM.encode()) == 5
    for name in ("arm.sdf", "arm.srdf", "arm.mjcf"):
        (tmp_path / name).write_text("<sdf/>")
        with pytest.raises(RobotFileError, match="SDF file of Gazebo"):
            load_robot(tmp_path / name)
