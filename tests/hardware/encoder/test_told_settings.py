"""What a board has been told is sent once, and again where that is not certain."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from armctl.errors import BoardError
from armctl.hardware.encoder.driver import ToldSettings


class Line:
    """A session that records commands; the line goes at one of them."""

    name = "loop"

    def __init__(self) -> None:
        self.sent: list[str] = []
        self.lost_at: str | None = None
        self.heard = SimpleNamespace(restarts=0)

    def drain(self) -> None:
        pass

    def fresh_status(self, _oldest_s: float) -> Any:
        return SimpleNamespace(mode=SimpleNamespace(powered=False), latched=True)

    def command(self, line: str) -> None:
        if line == self.lost_at:
            raise BoardError("the line is gone")
        self.sent.append(line)


def table(*lines: str) -> Any:
    return SimpleNamespace(configuration=lambda: lines)


def test_settings_that_were_told_by_half_are_told_again():
    line, told = Line(), ToldSettings()
    one, other = table("CFG 0 vmax=1", "CFG 1 vmax=1"), table("CFG 0 vmax=2", "CFG 1 vmax=2")
    told.tell(line, one)  # type: ignore[arg-type]
    assert line.sent == ["CLR", "WD 500", "CFG 0 vmax=1", "CFG 1 vmax=1"]
    line.sent.clear()
    told.tell(line, one)  # type: ignore[arg-type]
    assert line.sent == []
    line.lost_at = "CFG 1 vmax=2"
    with pytest.raises(BoardError):
        told.tell(line, other)  # type: ignore[arg-type]
    line.lost_at = None
    line.sent.clear()
    told.tell(line, one)  # type: ignore[arg-type]
    assert line.sent == ["WD 500", "CFG 0 vmax=1", "CFG 1 vmax=1"]
