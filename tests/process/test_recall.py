"""The last minute, asked for by clients of the arm process."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.process.kit import ROBOT, SECRET, served

from armctl.errors import BoardError, InputError
from armctl.process.lines import LocalLine
from armctl.process.link import Link
from armctl.protocol import Connect, Enable


def test_a_client_gets_the_last_minute_and_a_closed_one_an_error(tmp_path: Path) -> None:
    with served(tmp_path) as address:
        link = Link(LocalLine(address, SECRET), "notebook", ROBOT)
        for command in (Connect("sim"), Enable(ROBOT.pose("rest"))):
            link.submit(command).result(20)
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
