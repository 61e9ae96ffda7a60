"""What an arm process is told when it starts."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from fractions import Fraction

import msgspec
import pytest

from armctl.errors import InputError
from armctl.hardware.board_type import SimulatorOption
from armctl.process.start import Start, start_arm
from armctl.robot import load_robot, shipped_robots


@pytest.mark.parametrize("name", shipped_robots())
def test_a_robot_crosses_whole(name: str) -> None:
    robot = load_robot(name).with_body()
    told = msgspec.msgpack.encode(Start.of(robot, board="*", rate_hz=50.0, folder=None, pin="", logs=False))
    assert msgspec.msgpack.decode(told, type=Start).whole_robot() == robot


@pytest.mark.parametrize(
    "settings", [{"baud": 9600}, ["a", "b"], SimulatorOption("load", "what it carries", ("a", "b"))]
)
def test_settings_cross_of_a_board_that_does_not_say_their_type(settings: object) -> None:
    robot = replace(load_robot("uzuner"), board_settings=settings)
    told = msgspec.msgpack.encode(Start.of(robot, board="*", rate_hz=50.0, folder=None, pin="", logs=False))
    assert msgspec.msgpack.decode(told, type=Start).whole_robot().board_settings == settings


@pytest.mark.parametrize("settings", [object(), Fraction(1, 3)])
def test_settings_that_are_no_record_are_refused(settings: object) -> None:
    with pytest.raises(InputError, match="settings_type"):
        start_arm(replace(load_robot("uzuner"), board_settings=settings))


def test_a_client_loads_no_runtime() -> None:
    code = "import sys, armctl.arm; sys.exit('armctl.runtime' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
