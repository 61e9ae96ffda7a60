from __future__ import annotations

import pytest
from tests.hardware.lines import LoopTransport

from armctl.errors import BoardError
from armctl.runtime.clock import ManualClock


class Parrot:
    """Repeats what it hears after a delay."""

    def __init__(self, delay_s: float = 0.0) -> None:
        self._delay_s = delay_s
        self._now = 0.0
        self._waiting: list[tuple[float, bytes]] = []

    def feed(self, data: bytes) -> bytes:
        if self._delay_s == 0.0:
            return data
        self._waiting.append((self._now + self._delay_s, data))
        return b""

    def advance(self, now: float) -> bytes:
        self._now = now
        due = b"".join(data for at, data in self._waiting if at <= now)
        self._waiting = [(at, data) for at, data in self._waiting if at > now]
        return due

    def reset(self) -> None:
        self._waiting.clear()


def test_bytes_go_round(clock: ManualClock):
    line = LoopTransport(Parrot(), clock.now)
    line.write(b"abc")
    assert line.read(2, 1.0) == b"ab"
    assert line.read(2, 1.0) == b"c"
    assert line.name == "loop"


def test_a_read_waits_on_the_injected_clock_until_the_answer_comes(clock: ManualClock):
    line = LoopTransport(Parrot(0.02), clock.now, clock.advance)
    start = clock.now()
    line.write(b"abc")
    assert line.read(3, 0.05) == b"abc"
    assert clock.now() - start == pytest.approx(0.02, abs=0.0011)


def test_a_read_gives_up_at_its_timeout(clock: ManualClock):
    line = LoopTransport(Parrot(1.0), clock.now, clock.advance)
    start = clock.now()
    line.write(b"abc")
    assert line.read(3, 0.05) == b""
    assert clock.now() - start == pytest.approx(0.05)


def test_without_a_wait_the_clock_stands_still(clock: ManualClock):
    line = LoopTransport(Parrot(1.0), clock.now)
    line.write(b"abc")
    assert line.read(3, 5.0) == b""
    assert clock.now() == 100.0
    clock.advance(1.0)
    assert line.read(3, 5.0) == b"abc"


def test_discarded_input_is_gone(clock: ManualClock):
    line = LoopTransport(Parrot(), clock.now)
    line.write(b"abc")
    line.discard_input()
    assert line.read(3, 0.0) == b""


def test_after_closing_nothing_goes_through(clock: ManualClock):
    line = LoopTransport(Parrot(), clock.now, name="twin")
    line.close()
    line.close()
    for call in (lambda: line.write(b"a"), lambda: line.read(1, 0.0), line.discard_input):
        with pytest.raises(BoardError, match="twin: the line is closed"):
            call()
