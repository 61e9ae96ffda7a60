"""``armctl simulate encoder``, for a client that knows only bytes and for the driver."""

from __future__ import annotations

from pathlib import Path

import pytest
import serial
from tests.cli.simulating import simulated

from armctl.cli.main import REFUSED, run
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.transport import Connection
from armctl.robot import load_robot
from armctl.runtime import MonotonicClock, channel_settings


def test_any_client_can_talk_to_it(tmp_path: Path) -> None:
    link = tmp_path / "encoder"
    with simulated("encoder", "--link", str(link)) as said:
        assert str(link) in said
        with serial.Serial(str(link), timeout=10) as port:
            port.write(b"2 EN 1*5689\n")
            while not (line := port.readline()).startswith(b"2 "):
                assert line, "nothing came within ten seconds"
            assert line == b"2 ok*055E\n"
    assert not link.is_symlink()


def test_the_driver_opens_it_like_a_board(tmp_path: Path) -> None:
    link = tmp_path / "encoder"
    robot = load_robot("scorbot")
    with simulated("encoder", "--link", str(link)):
        driver = EncoderDriver(
            Connection(str(link), MonotonicClock().now, ports=list), robot.board_settings, timeout_s=10.0
        )
        assert driver.open().kind == "armctl encoder board, firmware 1.1.0"
        driver.configure(channel_settings(robot))
        driver.home()
        readback = driver.read()
        assert readback.homing is not None and readback.homing.running == 5, "the gripper is the first"
        driver.release()
        driver.close()


def test_a_robot_with_servos_has_no_such_board(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate", "encoder", "--robot", "uzuner"]) == REFUSED
    assert "uzuner is set up for Pololu Maestro, whose outputs are in µs" in capsys.readouterr().err


def test_an_encoder_arm_has_no_simulated_maestro(capsys: pytest.CaptureFixture[str]) -> None:
    """Its counts are no pulse widths."""
    assert run(["simulate", "maestro", "--robot", "scorbot"]) == REFUSED
    assert "outputs are in counts; use `armctl simulate encoder`" in capsys.readouterr().err
