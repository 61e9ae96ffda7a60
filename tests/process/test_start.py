"""What an arm process is told when it starts."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import msgspec
import pytest

from armctl.errors import InputError
from armctl.process.start import Start, start_arm
from armctl.robot import load_robot, shipped_robots


@pytest.mark.parametrize("name", shipped_robots())
def test_a_robot_crosses_whole(name: str) -> None:
    robot = load_robot(name).with_body()
    told = msgspec.msgpack.encode(Start.of(robot, board="*", rate_hz=50.0, folder=None, pin="", logs=False))
    assert msgspec.msgpack.decode(told, type=Start).whole_robot() == robot


def test_settings_of_a_board_that_does_not_say_their_type_are_refused() -> None:
    with pytest.raises(InputError, match="settings_type"):
        start_arm(replace(load_robot("uzuner"), board_settings={"baud": 9600}))


def test_a_client_loads_no_runtime() -> None:
    code = "import sys, armctl.arm; sys.exit('armctl.runtime' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
