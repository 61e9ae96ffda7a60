"""The last minute, and the simulated board, asked for by clients of the arm process."""

from __future__ import annotations

import threading
from contextlib import closing
from pathlib import Path

import pytest
from tests.process.kit import ROBOT, SECRET, served

from armctl.boards import Boards
from armctl.errors import BoardError, InputError
from armctl.process.lines import LocalLine
from armctl.process.link import Link
from armctl.protocol import Connect, Enable, MonotonicClock
from armctl.robot import load_robot


def test_a_client_gets_the_last_minute_and_a_closed_one_an_error(tmp_path: Path) -> None:
    with served(tmp_path) as address:
        link = Link(LocalLine(address, SECRET), "notebook", ROBOT)
        for command in (Connect("sim"), Enable(ROBOT.pose("rest"))):
            link.submit(command).result(20)
        pause, tick = threading.Event(), link.snapshot.tick
        while link.snapshot.tick <= tick:  # that of the answer is kept after it is given
            pause.wait(0.01)
        recording = link.black_box()
        link.close()
        with pytest.raises(BoardError):
            link.black_box()
    assert (recording.robot, recording.why) == ("uzuner", "asked for")
    assert [one.what for one in recording.commands][-2:] == [
        "Connect port 'sim'",
        "Enable q (0°, 110°, -80°, -70°, 0°)",
    ]
    assert recording.states[int(recording.column("state")[-1])] == "holding"


def test_a_minute_that_cannot_be_given_is_said_and_asked_for_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(recording: object) -> bytes:
        raise InputError("no room for it")

    with served(tmp_path) as address:
        link = Link(LocalLine(address, SECRET), "notebook", ROBOT)
        with monkeypatch.context() as patched:
            patched.setattr("armctl.process.server.packed", broken)
            with pytest.raises(BoardError, match="no room for it"):
                link.black_box()
        assert link.black_box().robot == "uzuner"
        link.close()


def test_who_owns_the_arm_sets_servos_up_on_its_simulated_board_and_it_keeps_them(tmp_path: Path) -> None:
    robot = load_robot("so101")
    with served(tmp_path, robot) as address:
        link = Link(LocalLine(address, SECRET), "console", robot)
        port = link.simulated_port()
        assert port == link.simulated_port()
        with (
            closing(Boards(robot, MonotonicClock().now)) as boards,
            closing(boards.servo_setup("sim", served=port)) as setup,
        ):
            setup.change_id(1_000_000, 6, 9)
        link.submit(Connect("sim")).result(20)
        board = link.snapshot.board
        assert board is not None and board.port == port and "servo 6 of 6 did not answer" in board.earlier[0]
        link.close()
        with pytest.raises(BoardError):
            link.simulated_port()
