"""A URDF arm brought in through the page, and the side file that the page writes."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tests.robot.urdf_kit import Step, written

from armctl import load_robot
from armctl.errors import InputError, RobotFileError, StateError
from armctl.motion.clearance import clear_pose
from armctl.robot.urdf import install_package
from armctl.ui.tabs.main import urdf_arm
from armctl.ui.tabs.main.urdf_arm import UrdfArm, _installed, _Present, _saved

LYING = (
    Step("pan", "revolute", "base", "body", "0 0 0.1"),
    Step("lift", "revolute", "body", "upper", "0 0 0.05", axis="0 1 0"),
    Step("elbow", "revolute", "upper", "lower", "0.3 0 0", axis="0 1 0"),
    Step("end", "fixed", "lower", "tool0", "0.1 0 -0.4"),
)
"""at zero its tool is below the floor"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    return written(tmp_path / "arm.urdf", LYING)


def test_tool_rest_pose_and_floor_are_kept_beside_the_file(arm: Path, tmp_path: Path) -> None:
    present = _Present.of(f"{arm}#tool0")
    assert (present.name, present.links) == (str(arm), ("base", "body", "upper", "lower", "tool0"))
    assert present.source.side_path is None
    q = clear_pose(load_robot(arm))
    assert q is not None and np.abs(q).sum() > 0
    rest = np.degrees(q).round(4).tolist()
    changes = {"tool": {"link": "lower", "approach": "x"}, "poses": {"rest": rest}, "floor": {"z_mm": -5.0}}
    side = _saved(present, changes, tmp_path / "robots")
    assert side == tmp_path / "arm.armctl.toml"
    robot = load_robot(arm)
    assert robot.pose("rest") == pytest.approx(q, abs=1e-6) and robot.floor_z == -0.005
    assert robot.source.endswith("to lower, whose x axis is taken for the tool's z")
    assert _Present.of(str(arm)).side.tool.link == "lower"
    # what cannot be opened is not kept
    before = side.read_bytes()
    with pytest.raises(RobotFileError, match="no link 'none'"):
        _saved(_Present.of(str(arm)), {"tool": {"link": "none"}}, tmp_path / "robots")
    assert side.read_bytes() == before
    side.unlink()
    with pytest.raises(RobotFileError, match="3 angles are needed"):
        _saved(present, {"poses": {"rest": [1]}}, tmp_path / "robots")
    assert not side.exists()


def test_beside_a_file_in_a_folder_of_somebody_else_it_goes_into_the_users_folder(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(urdf_arm.os, "access", lambda folder, mode: os.path.basename(folder) == "robots")
    side = _saved(_Present.of(str(arm)), {"floor": {"z_mm": -600}}, tmp_path / "robots")
    assert side == tmp_path / "robots/arm.armctl.toml"
    assert load_robot(side).floor_z == -0.6 and load_robot(arm).floor_z == 0
    again = _Present.of(str(side))
    assert again.source.side_path == side
    assert _saved(again, {"floor": {"z_mm": -700}}, tmp_path / "robots") == side


def test_another_arms_side_file_of_the_same_name_is_left_alone(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(urdf_arm.os, "access", lambda folder, mode: os.path.basename(folder) == "robots")
    (tmp_path / "other").mkdir()
    other = written(tmp_path / "other/arm.urdf", LYING)
    robots = tmp_path / "robots"
    sides = [_saved(_Present.of(str(one)), {"floor": {"z_mm": -600}}, robots) for one in (arm, other, other)]
    assert [side.name for side in sides] == ["arm.armctl.toml", "arm_2.armctl.toml", "arm_2.armctl.toml"]
    assert [_Present.of(str(side)).source.file for side in sides[:2]] == [arm, other]


def test_nothing_is_written_while_the_arm_cannot_be_opened_anew(arm: Path, tmp_path: Path) -> None:
    def refuse() -> None:
        raise StateError("it stands")

    robots = SimpleNamespace(
        require_reopenable=refuse, present=SimpleNamespace(name=str(tmp_path / "robots/a"))
    )
    session = SimpleNamespace(
        require_operator=lambda: None, robots=robots, console=SimpleNamespace(files=tmp_path)
    )
    place = install_package("a.urdf", arm.read_bytes(), tmp_path / "robots")
    before = sorted(tmp_path.rglob("*"))
    page = SimpleNamespace(
        _session=session,
        _present=_Present.of(str(place)),
        _upload=SimpleNamespace(value=SimpleNamespace(name="a.stl", content=b"x")),
    )
    for click in (UrdfArm._on_save, UrdfArm._on_upload):
        with pytest.raises(StateError, match="it stands"):
            asyncio.run(click(page))  # type: ignore[arg-type]
    assert sorted(tmp_path.rglob("*")) == before


def test_an_arm_that_cannot_be_opened_is_not_kept(arm: Path, tmp_path: Path) -> None:
    robots = tmp_path / "robots"
    choice = _installed("my arm.urdf", arm.read_bytes(), robots)
    assert (choice.name, choice.title) == (str(robots / "my_arm"), "arm")
    assert load_robot(choice.name).n == 3
    with pytest.raises(RobotFileError, match=r"is not XML") as refused:
        _installed("other.urdf", b"no", robots)
    assert str(tmp_path) not in str(refused.value)
    assert [one.name for one in robots.iterdir()] == ["my_arm"]
    with pytest.raises(InputError, match="is no URDF arm"):
        _Present.of("uzuner")
