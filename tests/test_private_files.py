"""What armctl keeps of its user is for this user alone: logs, last poses, black boxes, reports."""

from __future__ import annotations

import logging
import os
import stat
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from armctl import log_files
from armctl.calibration import Calibration, CalibrationStore
from armctl.cli.main import cli
from armctl.documents import write_atomically
from armctl.hardware import BoardIdentity
from armctl.program import Program, save_program
from armctl.protocol import LastPose, black_boxes
from armctl.robot import load_robot
from armctl.runtime import PoseFolder
from armctl.runtime.black_box import BlackBox, save_recording
from armctl.system import open_private, private_folder

ROBOT = load_robot("uzuner")

pytestmark = pytest.mark.skipif(os.name != "posix", reason="Windows has other rights")


@pytest.fixture(autouse=True)
def generous(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A user whose new files are everybody's, and whose state lies in a folder of the test."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(logging.getLogger("armctl"), "propagate", False)  # it is long
    before = os.umask(0)
    yield tmp_path / "state"
    os.umask(before)


def modes(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): f"{stat.S_IMODE(path.stat().st_mode):o}"
        for path in sorted(folder.rglob("*"))
    }


def others_may(folder: Path) -> list[str]:
    """What group or others have any right to."""
    return [name for name, mode in modes(folder).items() if not mode.endswith("00")]


def everything_is_kept() -> None:
    """A log that is rotated, a black box, a last pose."""
    with log_files.begin("test") as path:
        assert path is not None
        for _ in range(12):
            logging.getLogger("armctl.test").warning("x" * 100_000)
    save_recording(BlackBox(ROBOT, 0.02, lambda: 0.0, None).recording("asked for"), black_boxes())
    poses = PoseFolder.of_user(ROBOT)
    poses.save(BoardIdentity("board", "sim"), LastPose(np.zeros(5), None, 1.0, ""))
    poses.close()


def test_what_is_kept_of_a_user_is_for_this_user_alone(generous: Path) -> None:
    everything_is_kept()
    kept = modes(generous)
    assert len([name for name, mode in kept.items() if mode == "600"]) == 4, kept
    assert len([name for name, mode in kept.items() if mode == "700"]) == 4, kept
    assert others_may(generous) == []


def test_what_older_versions_left_open_is_closed(generous: Path) -> None:
    everything_is_kept()
    for path in generous.rglob("*"):
        path.chmod(0o777 if path.is_dir() else 0o666)
    everything_is_kept()
    assert others_may(generous / "armctl") == []


def test_a_report_is_for_its_user_alone_also_in_place_of_an_open_file(tmp_path: Path) -> None:
    report = tmp_path / "report.zip"
    report.write_bytes(b"an old one")
    assert stat.S_IMODE(report.stat().st_mode) == 0o666
    CliRunner().invoke(cli, ["doctor", "--port", "sim", "--robot", "uzuner", "--report", str(report)])
    assert report.read_bytes()[:2] == b"PK" and stat.S_IMODE(report.stat().st_mode) == 0o600


def test_a_file_is_private_from_its_first_moment(tmp_path: Path) -> None:
    descriptor = open_private(str(tmp_path / "new"), os.O_WRONLY | os.O_CREAT)
    assert stat.S_IMODE(os.fstat(descriptor).st_mode) == 0o600
    os.close(descriptor)
    made: list[int] = []
    watched = os.replace
    with pytest.MonkeyPatch.context() as patched:

        def replace(one: Path, other: Path) -> None:
            made.append(stat.S_IMODE(os.stat(one).st_mode))
            watched(one, other)

        patched.setattr(Path, "replace", replace)
        write_atomically(tmp_path / "whole", b"x", private=True)
    assert made == [0o600]


def test_a_link_in_a_private_folder_does_not_close_the_file_that_it_leads_to(tmp_path: Path) -> None:
    shared, folder = tmp_path / "shared", tmp_path / "private"
    shared.write_text("everybody's")
    folder.mkdir()
    (folder / "link").symlink_to(shared)
    private_folder(folder)
    assert stat.S_IMODE(shared.stat().st_mode) == 0o666 and stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_what_people_share_stays_readable(tmp_path: Path) -> None:
    program = tmp_path / "program.toml"
    save_program(Program(robot="uzuner"), program)
    CalibrationStore(tmp_path / "calibrations").save(Calibration("uzuner", "maestro 1", "us", {}))
    files = list(tmp_path.rglob("*.toml"))
    assert len(files) >= 2
    assert {stat.S_IMODE(path.stat().st_mode) for path in files} == {0o644}
