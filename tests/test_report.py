"""The report: what is in it, what is not, and what `armctl replay` tells of it."""

from __future__ import annotations

import getpass
import io
import json
import socket
import zipfile
from pathlib import Path

import pytest
from tests.runtime.kit import ROBOT, Rig, make_rig

from armctl import log_files
from armctl.calibration import Calibration
from armctl.cli.main import DONE, REFUSED, run
from armctl.errors import BoardError
from armctl.facts import State
from armctl.protocol import MoveJoints, Origin, black_boxes, read_recording, saved_recordings
from armctl.report import report


@pytest.fixture(autouse=True)
def user(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A user whose names would show if they got into a report."""
    monkeypatch.setattr(socket, "gethostname", lambda: "babbage.lan")
    monkeypatch.setattr(getpass, "getuser", lambda: "lovelace")
    monkeypatch.setattr(Path, "home", lambda: tmp_path / "lovelace")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "lovelace" / "state"))
    return tmp_path / "lovelace"


def faulty(user: Path) -> Rig:
    """An arm whose cable came out on the way to home."""
    rig = make_rig(black_boxes=black_boxes()).enable()
    rig.controller.submit(MoveJoints(ROBOT.pose("home")), Origin("lovelace's page /?token=abcdefgh12345678"))
    rig.run(0.5)
    rig.driver.fail["write"] = BoardError(f"{user}/dev/maestro on babbage is gone")
    rig.until(lambda s: s.state is State.FAULT)
    return rig


def contents(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        found = {name: archive.read(name) for name in archive.namelist()}
    for name in [name for name in found if name.endswith(".zip")]:
        found |= {f"{name}/{inner}": one for inner, one in contents(found.pop(name)).items()}
    return found


def test_what_is_in_it_and_that_nobody_is_named(user: Path) -> None:
    with log_files.begin("serve"):
        rig = faulty(user)
        rig.controller.close()
    data = report(
        "uzuner",
        Calibration("uzuner", "sim", "µs", {}, note="lovelace"),
        rig.controller.black_box(),
        ["pick.toml"],
    )
    found = contents(data)
    names = {name.partition("/")[0] for name in found}
    assert names == {
        "README.txt", "versions.json", "robot", "calibration.toml", "programs.txt", "log", "faults",
        "black_box.json", "ticks.npy",
    }  # fmt: skip
    assert found["robot/uzuner.toml"].startswith(b"#") or b"uzuner" in found["robot/uzuner.toml"]
    assert {"armctl", "Python", "numpy", "viser", "system"} <= json.loads(found["versions.json"]).keys()
    for name in found.keys() - {"README.txt"}:
        assert name.partition(".zip")[0] in found["README.txt"].decode()
    everything = b"".join(found.values())
    for secret in (b"lovelace", b"babbage", b"abcdefgh12345678"):
        assert secret not in everything
    assert b"~/dev/maestro on <host> is gone" in everything


def test_what_cannot_be_had_is_said(user: Path) -> None:
    black_boxes().mkdir(parents=True)
    (black_boxes() / "fault-20260101-000000-x-1.zip").write_text("no zip")
    found = contents(report("/nowhere/arm.toml", recording=BoardError("the arm process ended")))
    told = found["not_had.txt"].decode()
    assert "the last minute: the arm process ended" in told
    assert "/nowhere/arm.toml: cannot be read" in told and "is no black box" in told
    assert "ticks.npy" not in found


def test_replay_writes_every_tick_as_a_table(
    user: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = faulty(user)
    rig.controller.close()
    (path,) = saved_recordings()
    assert run(["replay", "--csv", str(tmp_path / "ticks.csv"), str(path)]) == DONE
    head, *lines = (tmp_path / "ticks.csv").read_text().splitlines()
    assert head.startswith("time_s,late_s,took_s,state,speed,gripper,step,setpoint ")
    assert capsys.readouterr().out.strip() == f"{tmp_path / 'ticks.csv'}: {len(lines)} ticks"
    assert run(["replay", "--csv", str(tmp_path / "no" / "ticks.csv"), str(path)]) == REFUSED


def test_replay_tells_the_story(user: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = faulty(user)
    rig.controller.close()
    (path,) = saved_recordings()
    assert run(["replay", "--text", str(path)]) == DONE
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "uzuner on simulated recording board at sim"
    assert lines[1].startswith("fault: ") and "is gone" in lines[1]
    order = [
        next(i for i, line in enumerate(lines) if part in line)
        for part in (
            "token=abcdefgh12345678: MoveJoints q (0°, 90°, -80°, -40°, 0°)",
            "info: holding → moving",
            "error: moving → fault",
            "< MoveJoints: ",
            "the last ticks",
        )
    ]
    assert order == sorted(order)
    assert lines[-2].split()[1] == "moving" and "90.00" not in lines[-2]
    assert lines[-1].split()[1] == "fault" and "–" in lines[-1].split("|")[0]


def test_replay_of_a_report_and_of_what_is_none(
    user: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = faulty(user)
    rig.controller.close()
    assert run(["doctor", "--port", "sim", "--robot", "uzuner", "--report", str(tmp_path / "r.zip")]) == DONE
    recording = read_recording(tmp_path / "r.zip")
    assert recording.why.startswith("fault: ")
    assert b"round trips" in contents((tmp_path / "r.zip").read_bytes())["doctor.txt"]
    capsys.readouterr()
    assert run(["replay", "--text", str(tmp_path / "r.zip")]) == DONE
    assert "the last ticks" in capsys.readouterr().out
    (tmp_path / "note.txt").write_text("a note")
    for name, told in (("note.txt", "is no black box and no report"), ("none.zip", "cannot be read")):
        assert run(["replay", "--text", str(tmp_path / name)]) == REFUSED
        out, err = capsys.readouterr()
        assert out == "" and told in err and err.count("\n") == 1
    missing = str(tmp_path / "no" / "r.zip")
    assert run(["doctor", "--port", "sim", "--report", missing]) == REFUSED
    assert "the report cannot be written: No such file" in capsys.readouterr().err
