"""The exact bytes in each direction, what is made of what comes unasked, and who is at the other end."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from tests.hardware.encoder.kit import Bench
from tests.hardware.lines import LoopTransport

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError, StateError
from armctl.hardware import ByteModel
from armctl.hardware.encoder.messages import Banner, LineReply, Realtime, seal
from armctl.hardware.encoder.session import EncoderSession
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard
from armctl.protocol import ManualClock

HELLO, EN_1 = b"1 HELLO*7DF0\n", b"2 EN 1*5689\n"
BANNER = Banner("armctl-encoder", "1.3.0", 4, 6, "power")


def status(ms: int, count: int = 0) -> bytes:
    return seal(f"@ {ms} O 00 00 00 000000000000 000000 00000000 {count} 0 0 0 0 0")


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

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def wire(clock: ManualClock) -> Wire:
    return Wire(clock)


@pytest.fixture
def session(clock: ManualClock, wire: Wire) -> EncoderSession:
    return EncoderSession(wire, clock.now, 0.09)


def test_commands_and_their_answers(wire: Wire, session: EncoderSession):
    wire.expect(HELLO, seal("2 ok") + seal("65535 ok") + seal("1 ok hi there"))  # the first two are of others
    wire.expect(EN_1, seal("2 ok"))
    assert session.command("HELLO") == "hi there"
    assert session.command("EN 1") == ""
    wire.expect(seal("3 PING"), seal("3 err FAULT latched"))
    with pytest.raises(StateError, match="the board refused 'PING': a fault is latched"):
        session.command("PING")
    assert session.settle() == (), "reported once"
    session.close()
    assert wire.closed == 1


def test_the_same_line_again_until_there_is_an_answer(
    wire: Wire, session: EncoderSession, clock: ManualClock
):
    began = clock.now()
    wire.expect(HELLO, seal("0 err CRC"))  # which is repeated at once
    wire.expect(HELLO, b"1 ok*0000\n")
    wire.expect(HELLO, seal("1 ok"))
    assert session.command("HELLO") == ""
    assert clock.now() - began == pytest.approx(0.03)


def test_no_answer(wire: Wire, session: EncoderSession, clock: ManualClock):
    for _ in range(3):
        wire.expect(HELLO)
    began = clock.now()
    with pytest.raises(BoardTimeoutError, match="wire: the board did not answer 'HELLO' within 90 ms"):
        session.command("HELLO")
    assert clock.now() - began == pytest.approx(0.09)
    wire.expect(EN_1, seal("1 ok late") + seal("2 ok right"))
    assert session.command("EN 1") == "right"


def test_bytes_without_end_do_not_keep_it_for_ever(wire: Wire, session: EncoderSession, clock: ManualClock):
    def chatter(count: int, timeout_s: float) -> bytes:
        clock.advance(0.002)
        return status(1) if timeout_s else b""

    for _ in range(3):
        wire.expect(HELLO)
    wire.read = chatter
    began = clock.now()
    with pytest.raises(BoardTimeoutError):
        session.command("HELLO")
    assert clock.now() - began < 0.2
    wire.read = lambda count, timeout_s: b"x" * count
    session.drain()


def test_a_posted_line_is_not_waited_for(wire: Wire, session: EncoderSession, clock: ManualClock):
    began = clock.now()
    wire.expect(HELLO)
    session.post("HELLO")
    wire.expect(EN_1)
    session.post("EN 1")
    wire.incoming = seal("1 err OFF first") + seal("2 err HOLD second") + seal("7 err FAULT of another")
    assert session.settle() == (LineReply(1, "first", "OFF"), LineReply(2, "second", "HOLD"))
    assert session.settle() == ()
    assert clock.now() == began


def test_a_posted_line_is_sent_again_when_it_is_due(wire: Wire, session: EncoderSession, clock: ManualClock):
    wire.expect(HELLO)
    session.post("HELLO")
    clock.advance(0.02)
    session.settle()
    wire.expect(HELLO, seal("0 err CRC"))
    clock.advance(0.02)
    session.settle()
    wire.expect(HELLO)
    session.settle()
    clock.advance(0.06)
    with pytest.raises(BoardTimeoutError, match="'HELLO' within 90 ms"):
        session.settle()
    assert session.settle() == ()


@pytest.mark.parametrize("late", [True, False])
def test_lines_that_follow_each_other_do_not_hide_that_nothing_answers(
    wire: Wire, session: EncoderSession, clock: ManualClock, late
):
    began, error = clock.now(), None
    for sequence in range(1, 10):
        wire.expect(seal(f"{sequence} PING"), seal(f"{sequence - 1} ok") if late and sequence > 1 else b"")
        session.post("PING")
        clock.advance(0.02)
        try:
            session.settle()
        except BoardTimeoutError as silence:
            error = silence
            break
    assert (error is None) is late
    assert clock.now() - began == pytest.approx(0.18 if late else 0.1)


def test_a_command_does_not_wait_for_what_was_posted_before(wire: Wire, session: EncoderSession):
    wire.expect(HELLO)
    session.post("HELLO")
    wire.expect(EN_1, seal("1 err OFF") + seal("2 ok"))
    assert session.command("EN 1") == ""
    session.acknowledge()
    assert session.settle() == ()


def test_sequence_numbers_wrap(wire: Wire, session: EncoderSession):
    session._sequence = 65534
    for sequence in (65535, 1):
        wire.expect(seal(f"{sequence} PING"), seal(f"{sequence} ok"))
        session.command("PING")


def test_the_newest_status_counts_and_an_old_one_is_asked_for_anew(
    wire: Wire, session: EncoderSession, clock: ManualClock
):
    wire.incoming = b"".join(status(20 * n, n) for n in range(500))
    assert session.fresh_status().counts[0] == 499
    clock.advance(0.04)
    assert session.fresh_status().counts[0] == 499
    wire.expect(bytes((Realtime.STATUS,)), status(20000, 7))
    clock.advance(0.1)
    assert session.fresh_status().counts[0] == 7
    wire.expect(HELLO, status(20020) + seal("1 ok"))
    session.command("HELLO")
    assert session.status is None, "the next one shows what has come of the command"
    wire.expect(b"?")
    clock.advance(0.1)
    with pytest.raises(BoardTimeoutError, match="the board has sent no status for 90 ms"):
        session.fresh_status()


def test_why_homing_failed_is_kept_until_the_user_has_taken_note(wire: Wire, session: EncoderSession):
    wire.incoming = b"".join(map(seal, ("! homed 2", "! home failed 3 notfound", "! home failed x")))
    session.drain()
    assert session.homing_failures == {3: "the switch was not found, on either side"}
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
    wire.incoming = status(before_ms) + status(after_ms)
    session.drain()
    assert (session.restarted, session.restarts) == (("unknown", 1) if restarted else (None, 0))


def test_a_banner_is_one_restart(wire: Wire, session: EncoderSession):
    wire.incoming = status(5000) + seal("# armctl-encoder 1.3.0 proto=4 axes=6 reset=brownout")
    wire.incoming += status(20) + status(40)
    session.drain()
    assert (session.restarted, session.restarts) == ("brownout", 1)
    session.acknowledge()
    assert (session.restarted, session.restarts) == (None, 1)


# Who is at the other end of a line that was just opened.


class Other:
    """Says ``at_start`` once, and to every burst what ``answer`` makes of it."""

    def __init__(self, at_start: bytes = b"", answer: Callable[[bytes], bytes] = lambda data: b"") -> None:
        self._unsaid = at_start
        self.feed = answer

    def advance(self, now: float) -> bytes:
        said, self._unsaid = self._unsaid, b""
        return said

    def reset(self) -> None:
        raise AssertionError("no test resets it")


class Watched(SimulatedEncoderBoard):
    """Keeps when it was first spoken to."""

    first: float | None = None

    def feed(self, data: bytes) -> bytes:
        self.first = self._now if self.first is None else self.first
        return super().feed(data)


class Deaf(SimulatedEncoderBoard):
    def feed(self, data: bytes) -> bytes:
        return b""


def greeted(clock: ManualClock, board: ByteModel, *, resets: bool = False) -> Banner:
    transport = LoopTransport(board, clock.now, clock.advance)
    return EncoderSession(transport, clock.now, 0.1).greet(resets=resets)


def hello_answered_by(text: str) -> Other:
    return Other(answer=lambda data: seal(f"{data.split(b' ')[0].decode()} ok {text}"))


@pytest.mark.parametrize("resets", [False, True])
@pytest.mark.parametrize("boot_s", [0.0, 1.7, 4.5])
def test_a_board_that_answers(clock: ManualClock, boot_s, resets):
    board, began = Watched(boot_s=boot_s), clock.now()
    board.advance(began)
    SimulatedEncoderBoard.feed(board, b"77 EN ")  # half a line of an earlier program
    assert greeted(clock, board, resets=resets) == BANNER
    assert clock.now() - began < boot_s + 0.6
    if resets and boot_s < 2.0:
        assert board.first is not None and board.first - began >= boot_s, "not spoken to before it speaks"


FIRMATA_QUERY, FIRMATA_REPORT = bytes.fromhex("f0 79 f7"), bytes.fromhex("f0 79 02 03 53 00 f7")
GRBL = b"\r\nGrbl 1.1h ['$' for help]\r\n"
OTHERS = {
    r"loop: no answer\. Is this the port of the Arduino Mega": Other,
    "loop: StandardFirmata is on this board.*flash": lambda: Other(b"\xf9\x02\x03" + FIRMATA_REPORT),
    "StandardFirmata is on this": lambda: Other(answer=lambda data: FIRMATA_REPORT * (data == FIRMATA_QUERY)),
    r"something else answers there .*Grbl 1\.1h": lambda: Other(GRBL, lambda data: b"ok\r\n"),
    "sends, but does not answer": Deaf,
    "x answers, not armctl-encoder": lambda: hello_answered_by("x 1.0.0 proto=1 axes=1 reset=power"),
    "not how an armctl encoder board introduces": lambda: hello_answered_by("hello yourself"),
}


@pytest.mark.parametrize("resets", [False, True])
@pytest.mark.parametrize("words", OTHERS)
def test_another_board(clock: ManualClock, words, resets):
    began = clock.now()
    silent = "no answer" in words or "does not answer" in words
    with pytest.raises(BoardTimeoutError if silent else BoardProtocolError, match=words):
        greeted(clock, OTHERS[words](), resets=resets)
    assert clock.now() - began <= 7.0


@pytest.mark.parametrize(
    ("protocol", "words"),
    [
        (3, r"speaks protocol 3, this armctl needs protocol 4; flash the board again.*under Flashing"),
        (5, "speaks protocol 5, this armctl needs protocol 4; this armctl is older .*update"),
    ],
)
def test_a_board_of_another_protocol_is_refused_and_its_line_closed(clock: ManualClock, protocol, words):
    board = SimulatedEncoderBoard(protocol=protocol)
    bench = Bench(clock, board)
    with pytest.raises(BoardProtocolError, match=rf"loop: the board's firmware 1\.3\.0 {words}"):
        bench.driver.open()
    assert set(board.log) == {"HELLO"}
    with pytest.raises(BoardError, match="not connected"):
        bench.driver.read()
