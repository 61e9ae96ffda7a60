"""``armctl new``, as one types it."""

from __future__ import annotations

import sys
from pathlib import Path

import click
import numpy as np
import pytest

from armctl import load_robot
from armctl.cli.main import run


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    return tmp_path / "armctl" / "robots"


def test_a_palletiser_from_its_lengths(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = "new crane --title Crane --build palletiser --length upper=80 --length fore=80 --floor -10"
    servos = " --servo base=0 --servo shoulder=1,2250,-10 --servo elbow=2 --limit base=-60,60"
    assert run((line + servos + " --pose rest=0,90,-20").split()) == 0
    out = capsys.readouterr().out
    assert "Crane: 3 joints; yaw, two pitch joints, level hand: every solution in closed form" in out
    assert str(folder / "crane.toml") in out and "armctl serve --robot crane" in out
    robot = load_robot("crane")
    assert robot.floor_z == pytest.approx(-0.01)
    assert robot.output_map is not None and robot.output_map.zero.tolist() == [1500, 2250, 1750]
    assert run(["robots"]) == 0
    assert "Crane: 3 joints" in capsys.readouterr().out
    assert run(["ik", "crane", "200", "0", "80"]) == 0


def test_an_arm_with_servos_and_a_gripper(folder: Path) -> None:
    servos = [
        word for k, joint in enumerate(("base", "shoulder", "elbow")) for word in ("--servo", f"{joint}={k}")
    ]
    assert run(["new", "grabs", "--build", "pitch2", *servos, "--gripper", "4,900,1800"]) == 0
    robot = load_robot("grabs")
    assert robot.gripper is not None and robot.output_map is not None
    assert robot.output_map.gripper_channel == 4
    assert np.degrees(robot.limits[2]).tolist() == pytest.approx([-120, 120])
    assert np.radians(robot.output_map.per_rad[2]) == pytest.approx(8.3)  # 10 µs a degree would not reach


def test_a_copy_is_printed_and_not_saved(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["new", "mine", "--from", "uzuner", "--print"]) == 0
    path = folder.parent.parent / "copy.toml"
    path.write_text(capsys.readouterr().out)
    assert load_robot(path).limits == pytest.approx(load_robot("uzuner").limits)
    assert not folder.exists()


def test_in_a_terminal_it_asks(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    answers = iter([3, 60.0, 0.0, 100.0])
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    monkeypatch.setattr(click, "prompt", lambda *_, **__: next(answers))
    assert run(["new", "small", "--length", "fore=90"]) == 0
    assert "no servos yet" in capsys.readouterr().out
    assert 1000 * load_robot("small").forward([0, 0, 0])[:3, 3] == pytest.approx([190, 0, 60])


@pytest.mark.parametrize(
    ("more", "status", "said"),
    [
        ("", 2, "give --build or --from"),
        ("--from uzuner --build pitch2", 2, "not both"),
        ("--build pitch2 --length upper", 2, "write NAME=VALUE"),
        ("--build pitch2 --length upper=long", 1, "a number is needed"),
        ("--build pitch2 --length upper=-120", 1, "Upper arm: -120 mm is too short; 1 mm or more is allowed"),
        ("--build pitch2 --servo shoulder=1.9", 1, "1.9 is no whole number"),
        ("--build pitch2 --length upper=nan", 1, "one finite number is needed"),
        ("--build pitch2 --limit elbow=1", 1, "2 finite numbers"),
        ("--build pitch2 --limit knee=1,2", 1, "no joint 'knee'"),
        ("--build pitch2 --servo base=1,2,3,4", 1, "1 to 3 finite numbers"),
        ("--from nowhere.toml", 1, "nowhere.toml"),
        ("--build pitch2 --floor nan", 2, "not a finite number"),
    ],
)
def test_what_is_wrong_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], more: str, status: int, said: str
) -> None:
    assert run(["new", "mine", *more.split()]) == status
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1
    assert not folder.exists()


def test_a_broken_file_of_ones_own_does_not_take_the_listing_down(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.mkdir(parents=True)
    (folder / "broken.toml").write_text("no")
    for more in ([], ["--json"]):
        assert run(["robots", *more]) == 0
        out, err = capsys.readouterr()
        assert "uzuner" in out and "broken" not in out
        assert err.startswith("armctl: broken cannot be opened: ") and err.count("\n") == 1
