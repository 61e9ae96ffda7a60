"""armctl calibrate: fit, joint, show, list, revert, forget, points, export, import."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path

import numpy as np
import pytest

from armctl.arm import Arm
from armctl.calibration import Calibration, CalibrationStore, JointCalibration, own_calibration
from armctl.cli.main import DONE, REFUSED, WRONG_USAGE, run
from armctl.robot import load_robot

MARKS = "output,angle_deg\n" + "".join(f"{1520 - 9.5 * angle},{angle}\n" for angle in (-60, -30, 0, 30, 60))


@pytest.fixture(autouse=True)
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CalibrationStore:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "settings"))
    return CalibrationStore()


def call(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    status = run(["calibrate", *words])
    out, err = capsys.readouterr()
    return status, out, err


def elbow(zero: float, board: str = "77", note: str = "") -> Calibration:
    joints = {"elbow": JointCalibration(zero, math.degrees(10.0), 700.0, 2300.0)}
    return Calibration("uzuner", board, "µs", joints, (1100.0, 1900.0), "2025-03-01T12:00:00+01:00", note)


def test_fit_gives_the_line_and_saves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], store: CalibrationStore
) -> None:
    (tmp_path / "marks.csv").write_text(MARKS)
    status, out, err = call(capsys, "fit", "uzuner", "elbow", str(tmp_path / "marks.csv"), "--json")
    record = json.loads(out)
    assert (status, err) == (DONE, "")
    assert record["zero"] == pytest.approx(1520) and record["per_deg"] == pytest.approx(-9.5)
    assert record["wrong_marks"] == [] and record["advice"] is None
    assert record["rms_deg"] == pytest.approx(0, abs=1e-9) and record["unit"] == "µs"
    assert record["safe_outputs"] == pytest.approx([1520 - 9.5 * 95.07, 1520 + 9.5 * 84.36])
    status, out, _ = call(capsys, "fit", "uzuner", "elbow", str(tmp_path / "marks.csv"))
    assert status == DONE
    for text in ("Elbow: 1520.00 µs at 0°, -9.5000 µs a degree", "turns the other way", "mark 5: +0.00°"):
        assert text in out
    (tmp_path / "marks.csv").write_text(MARKS.replace(",60\n", ",75\n"))
    status, out, err = call(capsys, "fit", "uzuner", "elbow", str(tmp_path / "marks.csv"))
    assert status == DONE and "mark 5: +15.00°   left out" in out
    assert "armctl: warning: mark 5 does not fit" in err
    assert store.boards() == ()


@pytest.mark.parametrize(
    ("words", "status", "says"),
    [
        (("fit", "uzuner", "knee", "marks.csv"), REFUSED, "has no joint 'knee'"),
        (("fit", "uzuner", "elbow", "none.csv"), REFUSED, "none.csv: cannot be read"),
        (("fit", "nobody", "elbow", "marks.csv"), REFUSED, "there is no robot 'nobody'"),
        (("show", "uzuner"), REFUSED, "uzuner was never calibrated on this computer; begin with `armctl cal"),
        (("points", "uzuner", "marks.csv"), REFUSED, "must name the columns base_deg, shoulder_deg"),
        (("import", "marks.csv"), REFUSED, "marks.csv: line 1, column 7: expected '='"),
        (("joint", "uzuner", "elbow"), WRONG_USAGE, "--port"),
        (("joint", "uzuner", "knee", "--port", "sim"), REFUSED, "has no joint 'knee'"),
        (("joint", "uzuner", "elbow", "--port", "sim", "--places", "2"), WRONG_USAGE, "3<=x<=20"),
        (("turn",), WRONG_USAGE, "No such command"),
    ],
)
def test_refusals_are_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    status: int,
    says: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("marks.csv").write_text(MARKS)
    got, out, err = call(capsys, *words)
    assert (got, out) == (status, "")
    assert says in err and err.count("\n") == 1 and "Traceback" not in err


def test_show_list_revert_and_forget(capsys: pytest.CaptureFixture[str], store: CalibrationStore) -> None:
    store.save(elbow(1490.0, note="first"))
    store.save(elbow(1510.0, note="new horn"))
    status, out, _ = call(capsys, "show", "uzuner")
    assert status == DONE
    for text in (
        "on board 77: elbow and the gripper, measured 2025-03-01T12:00:00+01:00",
        "elbow: 1510.00 µs at 0°, +10.0000 a degree, safe 700.0 … 2300.0",
        "gripper: closed at 1100.0, open at 1900.0 µs",
        "base: as in the robot file",
        "Elbow: -81.00° … 79.00° instead of -84.36° … 95.07°",
        "send it to right angles",
        "version 1   2025-03-01T12:00:00+01:00   first",
    ):
        assert text in out
    assert call(capsys, "revert", "uzuner")[1].startswith("uzuner on board 77: version 1 is in force again")
    record = json.loads(call(capsys, "show", "uzuner", "--json")[1])
    assert record["calibration"]["joints"]["elbow"]["zero"] == 1490.0
    assert [one["number"] for one in record["versions"]] == [3, 2, 1] and record["versions"][0]["again"] == 1
    assert call(capsys, "revert", "uzuner", "--to", "9")[0] == REFUSED
    assert call(capsys, "forget", "uzuner")[:2] == (DONE, "uzuner on board 77 goes by its robot file now\n")
    assert "as in the robot file" in call(capsys, "show", "uzuner")[1]
    assert store.load("uzuner", "77") is None
    listed = json.loads(call(capsys, "list", "--json")[1])
    assert [(one["robot"], one["board"], one["calibration"]) for one in listed] == [("uzuner", "77", None)]


def test_with_several_boards_one_must_be_named(
    capsys: pytest.CaptureFixture[str], store: CalibrationStore
) -> None:
    assert "nothing was calibrated" in call(capsys, "list")[1]
    store.save(elbow(1490.0, "a b"))
    store.save(elbow(1510.0, "77"))
    _, _, err = call(capsys, "show", "uzuner")
    assert "calibrated with several boards: 77, a b; name one with --board" in err
    assert "1490.00" in call(capsys, "show", "uzuner", "--board", "a b")[1]
    assert "known are 77, a b" in call(capsys, "forget", "uzuner", "--board", "x")[2]
    broken = store.versions("uzuner", "77")[0].path
    broken.write_text("format = 1\n")
    listed = call(capsys, "list")[1]
    assert listed.count("elbow and the gripper") == 1 and str(broken) in listed


def test_export_and_import_carry_a_calibration_to_another_board(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], store: CalibrationStore
) -> None:
    store.save(elbow(1490.0))
    file = tmp_path / "elbow.toml"
    assert call(capsys, "export", "uzuner", str(file))[0] == DONE
    status, _, err = call(capsys, "export", "uzuner", str(file))
    assert status == REFUSED and "File exists" in err
    status, out, _ = call(capsys, "import", str(file), "--board", "88")
    assert status == DONE and "uzuner on board 88: elbow and the gripper" in out
    there = store.load("uzuner", "88")
    assert there is not None and there.joints == elbow(1490.0).joints
    file.write_text(file.read_text().replace("[joints.elbow]", "[joints.knee]"))
    status, _, err = call(capsys, "import", str(file))
    assert status == REFUSED and "has no joint 'knee'" in err
    assert len(store.versions("uzuner", "77")) == 1


def test_safe_outputs_and_the_gripper_are_set_by_hand(
    capsys: pytest.CaptureFixture[str], store: CalibrationStore
) -> None:
    status, out, _ = call(capsys, "safe", "uzuner", "elbow", "800", "2300", "--port", "sim")
    assert status == DONE and "elbow: safe outputs 800.0 … 2300.0 µs, kept for board simulated" in out
    assert "Elbow: -64.64° … 85.35° instead of" in out
    assert call(capsys, "gripper", "uzuner", "1900", "1100")[0] == DONE  # the only board
    kept = store.load("uzuner", "simulated")
    assert kept is not None and kept.gripper == (1900.0, 1100.0)
    own = own_calibration(load_robot("uzuner"), "elbow")
    assert kept.joints["elbow"].zero == own.zero
    assert (kept.joints["elbow"].low, kept.joints["elbow"].high) == (800.0, 2300.0)
    for words, says in (
        (("safe", "uzuner", "elbow", "2300", "800"), "the smallest safe output comes first"),
        (("safe", "uzuner", "elbow", "2600", "2700"), "nothing is left"),
        (("safe", "uzuner", "elbow", "300", "2300"), "300.0 … 2300.0 µs reach beyond pulse_us"),
        (("gripper", "uzuner", "10", "9000"), "the board takes 64 … 4080 µs"),
        (("gripper", "humanoid", "1000", "2000", "--port", "sim"), "has none"),
        (
            ("gripper", "abaas", "1000", "2000"),
            "abaas was never calibrated on this computer; say for which board: --port, or",
        ),
    ):
        status, _, err = call(capsys, *words)
        assert status == REFUSED and says in err and "forget" not in err
    assert (
        call(capsys, "safe", "uzuner", "elbow", "8", "9", "--port", "sim", "--board", "1")[0] == WRONG_USAGE
    )
    assert store.load("uzuner", "simulated") == kept
    status, _, err = call(capsys, "safe", "scorbot", "waist", "-9000", "12000", "--port", "sim")
    assert (status, err) == (DONE, "")
    kept = store.load("scorbot", "simulated")
    assert kept is not None and (kept.joints["waist"].low, kept.unit) == (-9000.0, "counts")


def test_points_blame_the_parameter_that_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], store: CalibrationStore
) -> None:
    robot, rng = load_robot("uzuner"), np.random.default_rng(4)
    q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (10, robot.n))
    truly = q.copy()
    truly[:, 2] += math.radians(3.0)
    points = 1000 * robot.forward(truly)[:, :3, 3] + rng.normal(0, 0.2, (10, 3))
    lines = [",".join([*(f"{name}_deg" for name in robot.joint_names), "x_mm", "y_mm", "z_mm"])]
    lines += [",".join(map(repr, row)) for row in np.hstack([np.degrees(q), points]).tolist()]
    (tmp_path / "points.csv").write_text("\n".join(lines))
    status, out, _ = call(capsys, "points", "uzuner", str(tmp_path / "points.csv"), "--json")
    record = json.loads(out)
    assert status == DONE
    assert record["better"] and [one["fact"] for one in record["blamed"]] == ["ZeroOff"]
    assert record["blamed"][0]["part"] == "Elbow"
    assert math.degrees(record["blamed"][0]["off"]) == pytest.approx(3.0, abs=0.3)
    assert record["rms_after_mm"] < 0.6 < record["rms_mm"] < record["largest_mm"]
    assert record["changes"][0]["key"] == "zero_us"
    out = call(capsys, "points", "uzuner", str(tmp_path / "points.csv"))[1]
    assert "Elbow: zero off by +" in out and "zero_us = " in out and "# was 1446.45" in out
    asked = ("points", "uzuner", str(tmp_path / "points.csv"), "--board")
    assert call(capsys, *asked, "77")[0] == REFUSED, "a board that nobody knows"
    store.save(elbow(1446.45))
    out = call(capsys, *asked, "77")[1]
    assert "# [calibration: joints.elbow]" in out and "zero = " in out and "zero_us" not in out
    assert call(capsys, *asked, "77", "--save")[0] == DONE
    kept = store.load("uzuner", "77")
    assert kept is not None and kept.joints["elbow"].zero == pytest.approx(1446.45 - 30.0, abs=3.0)
    refused, _, err = call(capsys, *asked, "77", "--save")
    assert refused == DONE or "nothing to correct" in err


def answer(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


WRIST = ("joint", "uzuner", "wrist_roll", "--port", "sim", "--places", "4", "--speed", "100")


def test_a_joint_is_measured_shown_and_saved(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, store: CalibrationStore
) -> None:
    robot = load_robot("uzuner")
    own, (low, high) = own_calibration(robot, "wrist_roll"), np.degrees(robot.limits[4]).tolist()
    places = np.linspace(low + 0.05 * (high - low), high - 0.05 * (high - low), 4)
    reads = [f"{0.9 * place + 4:.6f}" for place in places.tolist()]
    answer(monkeypatch, "y", "none", "999", f"{reads[0]}°", reads[1].replace(".", ","), "", reads[3], "y")
    status, out, err = call(capsys, *WRIST, "--note", "on the bench")
    assert status == DONE
    assert "'none' is not a number" in err and "999° is no angle of a joint" in err
    assert "saved as version 1" in out and "send it to right angles" in out
    kept = store.load("uzuner", "simulated")
    assert kept is not None and kept.note == "on the bench" and list(kept.joints) == ["wrist_roll"]
    joint = kept.joints["wrist_roll"]
    per_deg = math.radians(own.per_rad) / 0.9
    assert math.radians(joint.per_rad) == pytest.approx(per_deg, rel=1e-6)
    assert joint.zero == pytest.approx(own.zero - 4 * per_deg, rel=1e-6)
    assert joint.low >= own.low and joint.high <= own.high
    with Arm.open("uzuner") as arm:
        assert arm.robot.output_map is not None
        assert arm.robot.output_map.zero[4] == pytest.approx(joint.zero)


@pytest.mark.parametrize(
    ("lines", "status", "says"),
    [
        (("n",), REFUSED, "interrupted"),
        (("y", "1", "2"), REFUSED, "interrupted"),  # the terminal is closed
        (("y", "-40", "", "", ""), REFUSED, "1 marks were taken, 3 are needed; nothing is saved"),
        (("y", "-42", "-14", "14", "42", "n"), DONE, ""),
    ],
)
def test_nothing_is_saved_unless_the_user_says_so(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    store: CalibrationStore,
    lines: tuple[str, ...],
    status: int,
    says: str,
) -> None:
    answer(monkeypatch, *lines)
    got, _, err = call(capsys, *WRIST)
    assert got == status and says in err and "Traceback" not in err
    assert store.boards() == ()
