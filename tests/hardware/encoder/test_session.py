"""The exact bytes in each direction, and what is made of what comes unasked."""

from __future__ import annotations

import pytest

from armctl.errors import BoardTimeoutError, StateError
from armctl.hardware.encoder.messages import Answer, Realtime, seal
from armctl.hardware.encoder.session import EncoderSession
from armctl.runtime.clock import ManualClock

STATUS = "@ {ms} O 00 00 00 000000000000 {count} 0 0 0 0 0"


class Wire:
    """Knows what must be written next and what comes back; a wait that brings nothing lets time pass."""

    name = "wire"

    def __init__(self, clock: ManualClock) -> None:
        self._clock = clock
        self._script: list[tuple[bytes, bytes]] = []
        self.incoming = b""
        self.closed = 0

    def expect(self, written: bytes, reply: bytes = b"") -> None:
        self._script.append((written, reply))

    def write(self, data: bytes) -> None:
        assert self._script, f"unexpected {data!r}"
        expected, reply = self._script.pop(0)
        assert data == expected
        self.incoming += reply

    def read(self, count: int, timeout_s: float) -> bytes:
        if not self.incoming:
            self._clock.advance(timeout_s)
        taken, self.incoming = self.incoming[:count], self.incoming[count:]
        return taken

    def discard_input(self) -> None:
        raise AssertionError("what the board says unasked must not be lost")

    def close(self) -> None:
        self.closed += 1

    def done(self) -> bool:
        return not self._script


@pytest.fixture
def wire(clock: ManualClock) -> Wire:
    return Wire(clock)


@pytest.fixture
def session(clock: ManualClock, wire: Wire) -> EncoderSession:
    return EncoderSession(wire, clock.now, 0.09)


def test_a_command_and_its_answer(wire: Wire, session: EncoderSession):
    wire.expect(b"1 HELLO*7DF0\n", seal("1 ok hi there"))
    wire.expect(b"2 EN 1*5689\n", seal("2 ok"))
    assert session.command("HELLO") == "hi there"
    assert session.command("EN 1") == ""
    assert wire.done()
    session.close()
    assert wire.closed == 1


def test_the_same_line_again_until_there_is_an_answer(
    wire: Wire, session: EncoderSession, clock: ManualClock
):
    wire.expect(b"1 HELLO*7DF0\n")
    wire.expect(b"1 HELLO*7DF0\n", b"1 ok*0000\n")
    wire.expect(b"1 HELLO*7DF0\n", seal("1 ok"))
    began = clock.now()
    assert session.command("HELLO") == ""
    assert clock.now() - began == pytest.approx(0.06)


def test_a_line_that_the_board_could_not_read_is_sent_again_at_once(
    wire: Wire, session: EncoderSession, clock: ManualClock
):
    wire.expect(b"1 HELLO*7DF0\n", seal("0 err CRC"))
    wire.expect(b"1 HELLO*7DF0\n", seal("1 ok"))
    began = clock.now()
    session.command("HELLO")
    assert clock.now() == began


def test_an_answer_to_another_line_is_none(wire: Wire, session: EncoderSession):
    wire.expect(b"1 HELLO*7DF0\n", seal("2 ok") + seal("65535 ok") + seal("1 ok mine"))
    assert session.command("HELLO") == "mine"


def test_nobody_answers(wire: Wire, session: EncoderSession, clock: ManualClock):
    for _ in range(3):
        wire.expect(b"1 HELLO*7DF0\n")
    began = clock.now()
    with pytest.raises(BoardTimeoutError, match="wire: the board did not answer 'HELLO' within 90 ms"):
        session.command("HELLO")
    assert clock.now() - began == pytest.approx(0.09)
    wire.expect(b"2 EN 1*5689\n", seal("1 ok late") + seal("2 ok right"))
    assert session.command("EN 1") == "right"


def test_status_lines_without_end_do_not_keep_it_waiting_for_an_answer(
    wire: Wire, session: EncoderSession, clock: ManualClock
):
    def chatter(count: int, timeout_s: float) -> bytes:
        clock.advance(0.002)
        return seal(STATUS.format(ms=1, count=1)) if timeout_s else b""

    for _ in range(3):
        wire.expect(b"1 HELLO*7DF0\n")
    wire.read = chatter
    began = clock.now()
    with pytest.raises(BoardTimeoutError):
        session.command("HELLO")
    assert clock.now() - began < 0.2


def test_a_flood_does_not_keep_it_for_ever(wire: Wire, session: EncoderSession):
    wire.read = lambda count, timeout_s: b"x" * count
    session.drain()
    assert session.status is None


def test_refusals(wire: Wire, session: EncoderSession):
    wire.expect(b"1 HELLO*7DF0\n", seal("1 err FAULT latched"))
    with pytest.raises(StateError, match="the board refused 'HELLO': a fault is latched"):
        session.command("HELLO")
    assert session.settle() == (), "told once"


def test_a_posted_line_is_not_waited_for(wire: Wire, session: EncoderSession, clock: ManualClock):
    began = clock.now()
    wire.expect(b"1 HELLO*7DF0\n")
    session.post("HELLO")
    wire.expect(b"2 EN 1*5689\n")
    session.post("EN 1")
    wire.incoming = seal("1 err OFF first") + seal("2 err HOLD second") + seal("7 err FAULT of somebody else")
    assert session.settle() == (Answer(1, "first", "OFF"), Answer(2, "second", "HOLD"))
    assert session.settle() == ()
    assert clock.now() == began


def test_a_posted_line_is_sent_again_when_it_is_due(wire: Wire, session: EncoderSession, clock: ManualClock):
    wire.expect(b"1 HELLO*7DF0\n")
    session.post("HELLO")
    clock.advance(0.02)
    session.settle()
    wire.expect(b"1 HELLO*7DF0\n", seal("0 err CRC"))
    clock.advance(0.02)
    session.settle()
    wire.expect(b"1 HELLO*7DF0\n")
    session.settle()
    clock.advance(0.06)
    with pytest.raises(BoardTimeoutError, match="'HELLO' within 90 ms"):
        session.settle()
    assert session.settle() == ()


def test_lines_that_follow_each_other_do_not_hide_that_nobody_answers(
    wire: Wire, session: EncoderSession, clock: ManualClock
):
    with pytest.raises(BoardTimeoutError):
        for sequence in range(1, 10):
            wire.expect(seal(f"{sequence} PING"))
            session.post("PING")
            clock.advance(0.02)
            session.settle()
    assert clock.now() == pytest.approx(100.1)


def test_late_answers_are_answers(wire: Wire, session: EncoderSession, clock: ManualClock):
    for sequence in range(1, 50):
        wire.expect(seal(f"{sequence} PING"), seal(f"{sequence - 1} ok") if sequence > 1 else b"")
        session.post("PING")
        clock.advance(0.02)
        session.settle()


def test_a_command_does_not_wait_for_what_was_posted_before(wire: Wire, session: EncoderSession):
    wire.expect(b"1 HELLO*7DF0\n")
    session.post("HELLO")
    wire.expect(b"2 EN 1*5689\n", seal("1 err OFF") + seal("2 ok"))
    assert session.command("EN 1") == ""
    session.acknowledge()
    assert session.settle() == ()


def test_sequence_numbers_go_round(wire: Wire, session: EncoderSession):
    session._sequence = 65534
    wire.expect(seal("65535 PING"), seal("65535 ok"))
    wire.expect(seal("1 PING"), seal("1 ok"))
    session.command("PING")
    session.command("PING")


def test_the_newest_status_counts_and_an_old_one_is_asked_for_anew(
    wire: Wire, session: EncoderSession, clock: ManualClock
):
    wire.incoming = b"".join(seal(STATUS.format(ms=20 * n, count=n)) for n in range(500))
    assert session.fresh_status(0.05).counts[0] == 499
    clock.advance(0.04)
    assert session.fresh_status(10.0).counts[0] == 499
    wire.expect(bytes((Realtime.STATUS,)), seal(STATUS.format(ms=20000, count=7)))
    clock.advance(0.1)
    assert session.fresh_status(0.05).counts[0] == 7
    wire.expect(b"?")
    clock.advance(0.1)
    with pytest.raises(BoardTimeoutError, match="the board has sent no status for 90 ms"):
        session.fresh_status(0.05)


def test_a_status_from_before_a_command_counts_no_more(wire: Wire, session: EncoderSession):
    wire.incoming = seal(STATUS.format(ms=20, count=1))
    session.drain()
    assert session.status is not None
    wire.expect(b"1 HELLO*7DF0\n", seal(STATUS.format(ms=40, count=2)) + seal("1 ok"))
    session.command("HELLO")
    assert session.status is None


def test_why_homing_failed_is_kept_until_the_user_has_taken_note(wire: Wire, session: EncoderSession):
    wire.incoming = seal("! homed 2") + seal("! home failed 3 notfound") + seal("! home failed x")
    session.drain()
    assert "not found" in session.homing_failures.pop(3)
    session.acknowledge()
    assert session.homing_failures == {}


@pytest.mark.parametrize(
    ("before_ms", "after_ms", "restarted"),
    [
        (5000, 5020, False),
        (5000, 5000, False),
        (5000, 20, True),
        (2**32 - 10, 10, False),
        (2**32 - 10, 10**6, True),
    ],
)
def test_a_clock_that_goes_back_is_a_restart(
    wire: Wire, session: EncoderSession, before_ms, after_ms, restarted
):
    for ms in (before_ms, after_ms):
        wire.incoming = seal(STATUS.format(ms=ms, count=0))
        session.drain()
    assert (session.restarted, session.restarts) == (("unknown", 1) if restarted else (None, 0))


def test_a_banner_is_one_restart(wire: Wire, session: EncoderSession):
    wire.incoming = seal(STATUS.format(ms=5000, count=0))
    wire.incoming += seal("# armctl-encoder 1.1.0 proto=2 axes=6 reset=brownout")
    wire.incoming += seal(STATUS.format(ms=20, count=0)) + seal(STATUS.format(ms=40, count=0))
    session.drain()
    assert (session.restarted, session.restarts) == ("brownout", 1)
    session.acknowledge()
    assert (session.restarted, session.restarts) == (None, 1)
