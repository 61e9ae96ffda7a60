"""Which joint moved: for whose arms the section is there."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from armctl.robot import user_robots_folder
from armctl.ui.tabs.main import boards as which_joint


def test_it_is_there_for_robot_files_of_ones_own_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr(which_joint, "WhichJoint", lambda session: "the section")
    (user_robots_folder() / "folder").mkdir(parents=True)
    for name in ("mine.toml", "beside.armctl.toml"):
        (user_robots_folder() / name).touch()

    def shown(name: str) -> object:
        present = SimpleNamespace(present=SimpleNamespace(name=name))
        robot = SimpleNamespace(robot=SimpleNamespace(output_map="some"))
        return which_joint.of_own_arm(SimpleNamespace(robots=present, console=robot))  # type: ignore[arg-type]

    names = ("mine", "beside", "folder", "uzuner")
    assert [shown(name) for name in names] == ["the section", None, None, None]
