"""``armctl servos`` on the simulated bus: what it lists, names, changes and refuses."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from armctl.boards import setup_of
from armctl.cli.main import DONE, REFUSED, run
from armctl.hardware.boards import board_type
from armctl.hardware.bus import board, setup
from armctl.hardware.bus.simulated import SimulatedBus
from armctl.hardware.simulation import BoardServer
from armctl.protocol import MonotonicClock
from armctl.robot import load_robot

ROBOT = load_robot("so101")


@pytest.fixture
def bus() -> Iterator[BoardServer[SimulatedBus]]:
    """A bus that other programs can get at, too."""
    model = board_type("feetech").simulated(setup_of(ROBOT), {})
    assert isinstance(model, SimulatedBus)
    with BoardServer(model, MonotonicClock().now) as server:
        yield server


@pytest.fixture
def port(bus: BoardServer[SimulatedBus], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "settings"))
    monkeypatch.setattr(board, "_TIMEOUT_S", 0.15)  # a thread of this test serves it: it may be late
    monkeypatch.setattr(setup, "_PING_S", 0.02)
    return bus.port


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


def test_a_register_is_written_and_the_command_that_cures_is_named(
    port: str, capsys: pytest.CaptureFixture[str]
) -> None:
    on_port = ["servos", "--port", port, "--robot", "so101"]
    assert run([*on_port, "write", "5", "highest", "2500"]) == DONE
    assert run(on_port) == REFUSED
    assert "(write 5 highest 3901)" in capsys.readouterr().out
    assert run([*on_port, "write", "5", "highest", "3901"]) == DONE
    assert run([*on_port, "write", "5", "torque", "1"]) == REFUSED
    assert run([*on_port, "id", "6", "9"]) == DONE
    capsys.readouterr()
    assert run([*on_port, "--json"]) == REFUSED
    told = json.loads(capsys.readouterr().out)["differences"]
    assert told[0]["fact"] == "ServoSilent" and told[0]["mend"]["new_id"] == 6


def test_what_another_program_changes_after_a_save_is_named(
    port: str, bus: BoardServer[SimulatedBus], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    on_port = ["servos", "--port", port, "--robot", "so101"]
    assert run([*on_port, "save", str(tmp_path / "so101.json")]) == DONE
    with bus.inspect() as model:
        model.servo(3).put("offset", 40)
    assert run(on_port) == REFUSED
    assert "homing offset is 40, and was 0 when armctl kept it" in capsys.readouterr().out
    assert run([*on_port, "write", "3", "offset", "0"]) == DONE
    assert run(on_port) == DONE


def test_a_board_whose_servos_have_no_settings_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["servos", "--port", "sim", "--robot", "uzuner"]) == REFUSED
    assert "it has no servos that could be set up" in capsys.readouterr().err
