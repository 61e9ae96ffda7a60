"""``armctl servos`` on the simulated bus: what it lists, names, changes and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from armctl.cli.main import DONE, REFUSED, run

ON_SIM = ["servos", "--port", "sim", "--robot", "so101"]


def test_a_bus_is_listed_and_nothing_differs(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*ON_SIM, "--json"]) == DONE
    told = json.loads(capsys.readouterr().out)
    assert [one["id"] for one in told["servos"]] == [1, 2, 3, 4, 5, 6]
    assert told["differences"] == []
    assert told["servos"][0]["model"] == "STS3215"


def test_an_id_is_given_and_a_servo_shows_itself(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*ON_SIM, "id", "6", "7"]) == DONE
    assert run([*ON_SIM, "nudge", "3"]) == DONE
    told = capsys.readouterr().out
    assert "servo 6 has the id 7 now" in told and "servo 3 (elbow_flex) moved" in told
    assert run([*ON_SIM, "id", "6", "5"]) == REFUSED
    assert "there is a servo 5 already; nothing was changed" in capsys.readouterr().err


def test_a_calibration_of_lerobot_is_saved_compared_and_restored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "so101.json"
    assert run([*ON_SIM, "save", str(file)]) == DONE
    assert run([*ON_SIM, "restore", str(file)]) == DONE
    assert "nothing differs" in capsys.readouterr().out
    kept = json.loads(file.read_text())
    kept["wrist_roll"]["range_min"] = 300
    file.write_text(json.dumps(kept))
    assert run([*ON_SIM, "restore", str(file)]) == REFUSED
    assert run([*ON_SIM, "restore", str(file), "--write"]) == DONE
    told = capsys.readouterr().out
    assert "servo 5 (wrist_roll): lowest is 0, the file has 300" in told and "1 registers written" in told


@pytest.mark.parametrize(
    ("motor", "key", "value", "words"),
    [
        ("elbow_flex", "id", 2, "two motors have the id 2"),
        ("elbow_flex", "id", 9, "elbow_flex has the id 9, in SO-101 it is 3"),
        ("gripper", "drive_mode", 1, "drive_mode 1"),
        ("gripper", "range_min", -5, "not a calibration"),
        ("gripper", "homing_offset", 3000, "not a calibration"),
    ],
)
def test_a_file_of_another_arm_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], motor: str, key: str, value: int, words: str
) -> None:
    names = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
    kept = {
        name: {"id": i, "drive_mode": 0, "homing_offset": 0, "range_min": 0, "range_max": 4095}
        for i, name in enumerate(names, start=1)
    }
    kept[motor][key] = value
    file = tmp_path / "other.json"
    file.write_text(json.dumps(kept))
    assert run([*ON_SIM, "restore", str(file), "--write"]) == REFUSED
    assert words in capsys.readouterr().err


def test_a_board_whose_servos_have_no_settings_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["servos", "--port", "sim", "--robot", "uzuner"]) == REFUSED
    assert "it has no servos that could be set up" in capsys.readouterr().err
