from __future__ import annotations

import pytest
from tests.hardware.lines import LoopTransport

from armctl.errors import BoardProtocolError
from armctl.hardware.maestro.codec import MaestroErrors
from armctl.hardware.maestro.driver import MaestroLine
from armctl.runtime.clock import ManualClock


class SlowBoard:
    """Answers 20 ms after each request; the first answer has two stray bytes before it."""

    def __init__(self) -> None:
        self._now = 0.0
        self._answers = [[(0.02, "ff ff 70 17"), (0.03, "00 00")], [(0.02, "70 17 00 00")]]
        self._waiting: list[tuple[float, bytes]] = []

    def feed(self, data: bytes) -> bytes:
        assert data.hex(" ") == "90 00 a1"
        self._waiting += [(self._now + delay, bytes.fromhex(text)) for delay, text in self._answers.pop(0)]
        return b""

    def advance(self, now: float) -> bytes:
        self._now = now
        due = b"".join(data for at, data in self._waiting if at <= now)
        self._waiting = [(at, data) for at, data in self._waiting if at > now]
        return due

    def reset(self) -> None:
        self._waiting.clear()


def test_a_shifted_answer_is_refused_and_its_rest_does_not_shift_the_next(clock: ManualClock):
    line = MaestroLine(LoopTransport(SlowBoard(), clock.now, clock.advance), timeout_s=0.05)
    with pytest.raises(BoardProtocolError, match="loop: the board answered error bits 0x1770"):
        line.read([0])
    assert line.read([0]) == ({0: 1500.0}, MaestroErrors(0))
