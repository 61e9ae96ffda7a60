"""The log on disk: what a line says, one file a process, bounded, and a disk that does not take it."""

from __future__ import annotations

import errno
import logging
import os
import re
import threading
from datetime import datetime, timedelta
from logging.handlers import RotatingFileHandler
from pathlib import Path

import pytest
from tests.runtime.kit import make_rig

from armctl import log_files

LOG = logging.getLogger("armctl.test")


def test_every_line_of_the_controllers_log_with_time_and_offset(tmp_path: Path) -> None:
    with log_files.begin("serve", tmp_path / "state" / "log") as path:
        assert path is not None
        rig = make_rig().enable()
    lines = path.read_text().splitlines()
    told = [re.fullmatch(r"(\S+) (INFO|WARNING|ERROR) armctl\.runtime: (.*)", line) for line in lines]
    assert [line and line[3] for line in told] == rig.texts
    assert told[0] is not None
    at = datetime.fromisoformat(told[0][1])
    assert at.utcoffset() == datetime.now().astimezone().utcoffset()
    assert abs(datetime.now().astimezone() - at) < timedelta(minutes=5)
    assert path.stat().st_mode & 0o777 == 0o600 and path.parent.stat().st_mode & 0o777 == 0o700


@pytest.mark.logs_a_defect
def test_no_name_can_forge_a_line_and_a_traceback_is_set_in(tmp_path: Path) -> None:
    with log_files.begin("serve", tmp_path) as path:
        LOG.warning("STOP (%s)", "page\n2026-01-01T00:00:00.000+00:00 ERROR armctl.runtime: forged")
        try:
            raise ValueError("a defect")
        except ValueError:
            LOG.exception("it broke")
    assert path is not None
    lines = path.read_text().splitlines()
    assert [line.startswith("    ") for line in lines] == [False, True, False, *[True] * (len(lines) - 3)]
    assert lines[-1] == "    ValueError: a defect"


def test_two_at_once_have_a_file_each(tmp_path: Path) -> None:
    with log_files.begin("serve", tmp_path) as one, log_files.begin("arm", tmp_path) as other:
        LOG.info("both")
    assert one != other
    for path in (one, other):
        assert path is not None and path.read_text().endswith("INFO armctl.test: both\n")
        assert re.fullmatch(rf"\d{{8}}-\d{{6}}-(serve|arm)-{os.getpid()}\.log", path.name)
    assert {type(one) for one in logging.getLogger("armctl").handlers} == {logging.NullHandler}


def test_a_file_is_rotated_and_old_ones_go(tmp_path: Path) -> None:
    for number in range(30):
        for end in ("", ".1"):
            (tmp_path / f"20200101-0000{number:02d}-run-1.log{end}").touch()
    (tmp_path / "notes.txt").touch()
    with log_files.begin("run", tmp_path) as path:
        for number in range(300):
            LOG.info("%d %s", number, "x" * 10_000)
    assert path is not None
    kept = {one.name for one in tmp_path.iterdir()}
    assert len([name for name in kept if name.endswith(".log")]) == 20
    assert "notes.txt" in kept
    assert {path.name, f"{path.name}.1"} <= kept
    assert sum(one.stat().st_size for one in tmp_path.glob(f"{path.name}*")) < 2.1 * 2**20
    tails = log_files.tails(tmp_path, processes=2, most_bytes=25_000)
    assert next(iter(tails)) == path.name and len(tails) == 2
    assert [line.split()[3] for line in tails[path.name].splitlines()] == ["298", "299"]
    assert log_files.tails(tmp_path / "none") == {}


def test_a_deleted_file_is_begun_anew(tmp_path: Path) -> None:
    with log_files.begin("run", tmp_path) as path:
        assert path is not None
        path.unlink()
        LOG.info("after")
    assert path.read_text().endswith("after\n")


def test_a_folder_that_cannot_be_written_is_said_once_and_nothing_stops(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "log").write_text("a file where the folder should be")
    with log_files.begin("run", tmp_path / "log") as path:
        assert path is None
        LOG.info("nowhere")
    (record,) = [one for one in caplog.records if one.levelname == "WARNING"]
    assert "there is no log file" in record.getMessage() and "File exists" in record.getMessage()


def test_a_full_disk_is_said_once_and_nothing_stops(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with log_files.begin("run", tmp_path) as path:
        monkeypatch.setattr(RotatingFileHandler, "flush", full)
        rig = make_rig().enable()
        for number in range(100):
            LOG.info("%d", number)
    monkeypatch.undo()
    told = [one.getMessage() for one in caplog.records if "cannot be written" in one.getMessage()]
    assert told == [f"the log cannot be written: {path}: No space left on device; everything else works"]
    assert rig.now.powered


def test_a_disk_that_hangs_holds_nobody_up(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    goes_on = threading.Event()
    monkeypatch.setattr(log_files, "_MOST_WAITING", 10)
    monkeypatch.setattr(RotatingFileHandler, "flush", lambda _: goes_on.wait())
    with log_files.begin("run", tmp_path):
        for number in range(30):
            LOG.info("%d", number)
        assert any("the disk is too slow" in one.getMessage() for one in caplog.records)
        goes_on.set()


def test_the_terminal_learns_of_it_where_nobody_shows_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    (tmp_path / "log").touch()
    with log_files.begin("run", tmp_path / "log"):
        LOG.warning("not for the terminal")
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1) and err.startswith("armctl: there is no log file: ")
