"""Inputs and outputs in robot files: read strictly, and what they say."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from tests.runtime.signal_kit import SIGNALS, VACUUM, robot_with

from armctl.errors import RobotFileError
from armctl.robot import load_robot, robots_folder
from armctl.robot.record import robot_of, robot_record
from armctl.robot.signals import Input, Output


def test_what_a_file_says(tmp_path: Path) -> None:
    robot = robot_with(tmp_path)
    assert robot.signals.inputs == (
        Input("button", "Button", 6, active_low=True),
        Input("door", "Door", 7, debounce_s=0.04),
        Input("knob", "Knob", 8, "analog"),
    )
    assert robot.signals.outputs[1] == Output("pump", "Vacuum pump", 10, active_low=True, at_fault="off")
    lamp = robot.signals.output("lamp")
    assert lamp is not None
    assert [lamp.goes(moment) for moment in ("stop", "release", "fault", "end")] == [1.0, 0.0, None, 0.0]
    assert robot.signals.input("lamp") is None and not load_robot("uzuner").signals


def test_they_cross_to_the_arm_process(tmp_path: Path) -> None:
    robot = robot_with(tmp_path, gripper=VACUUM)
    again = robot_of(msgspec.json.decode(msgspec.json.encode(robot_record(robot))))
    assert again.signals == robot.signals and again.gripper == robot.gripper
    assert again.gripper is not None and (again.gripper.output, again.gripper.part_input) == ("pump", "door")
    assert again.outputs.gripper_channel is None


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("channel = 6", "channel = 2", r"inputs.button.channel = 2: a joint has it already; choose another"),
        ("channel = 6", "channel = 5", r"inputs.button.channel = 5: the gripper has it already"),
        ("channel = 9", "channel = 6", r"outputs.lamp.channel = 6: inputs.button has it already"),
        ('name = "bell"', 'name = "door"', "outputs.door: two inputs or outputs have this name"),
        ('name = "bell"', 'name = "load"', "outputs.load: programs use the name load for something else"),
        (
            'kind = "analog"',
            'kind = "pull-up"',
            "inputs.knob.kind: on a board of the kind maestro it must be one",
        ),
        (
            'kind = "analog"',
            'kind = "digit"',
            "kind: must be one of 'analog', 'digital', 'pull-up'",
        ),
        ('at_end = "off"', 'at_end = "of"', "at_end: must be one of 'keep', 'off', 'on', not 'of'"),
        ("debounce_ms = 40", "debounce_ms = -1", "debounce_ms: must be 0 … 1000, not -1"),
        ("debounce_ms = 40", "debounce_s = 1", "unknown key 'debounce_s'"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in SIGNALS
    with pytest.raises(RobotFileError, match=said):
        robot_with(tmp_path, SIGNALS.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"pump"', '"siren"', "gripper.output: must be one of 'lamp', 'pump', 'bell', not 'siren'"),
        ('"door"', '"lamp"', "gripper.part_input: must be one of 'button', 'door', 'knob', not 'lamp'"),
        (
            "speed_percent_s = 200",
            "speed_percent_s = 200\nservo = { channel = 5, closed_us = 1000, open_us = 2000 }",
            "gripper: it has an output and a servo; remove one of them",
        ),
    ],
)
def test_a_gripper_that_is_an_output_is_read_strictly(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(RobotFileError, match=said):
        robot_with(tmp_path, gripper=VACUUM.replace(old, new))


@pytest.mark.parametrize(
    ("robot", "said"), [("so101", "kind feetech has no inputs"), ("ur5", "whose joints have")]
)
def test_an_arm_whose_board_has_none_is_refused(tmp_path: Path, robot: str, said: str) -> None:
    text = (robots_folder() / f"{robot}.toml").read_text(encoding="utf-8")
    path = tmp_path / f"{robot}.toml"
    path.write_text(f'{text}\n[[inputs]]\nname = "door"\nchannel = 40\n', encoding="utf-8")
    with pytest.raises(RobotFileError, match=said):
        load_robot(path)
