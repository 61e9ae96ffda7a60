"""Who is at the other end of a line that was just opened, and how a user is told."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from tests.hardware.encoder.kit import Bench
from tests.hardware.lines import LoopTransport

from armctl.errors import BoardProtocolError, BoardTimeoutError
from armctl.hardware import ByteModel
from armctl.hardware.encoder.messages import Banner, seal
from armctl.hardware.encoder.session import EncoderSession
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard
from armctl.runtime.clock import ManualClock

BANNER = Banner("armctl-encoder", "1.1.0", 2, 6, "power")


class Somebody:
    """Says ``at_start`` once, and to every burst what ``answer`` makes of it."""

    def __init__(self, at_start: bytes = b"", answer: Callable[[bytes], bytes] = lambda heard: b"") -> None:
        self._unsaid = at_start
        self._answer = answer
        self.heard = b""

    def feed(self, data: bytes) -> bytes:
        self.heard += data
        return self._answer(data)

    def advance(self, now: float) -> bytes:
        said, self._unsaid = self._unsaid, b""
        return said

    def reset(self) -> None:
        raise AssertionError("nobody resets it")


def greeted(clock: ManualClock, board: ByteModel, *, resets: bool = False) -> Banner:
    transport = LoopTransport(board, clock.now, clock.advance)
    return EncoderSession(transport, clock.now, 0.1).greet(resets=resets)


def hello_answered_by(text: str) -> Somebody:
    return Somebody(answer=lambda heard: seal(f"{heard.split(b' ')[0].decode()} ok {text}"))


def test_a_board_that_runs_already(clock: ManualClock):
    began = clock.now()
    assert greeted(clock, SimulatedEncoderBoard()) == BANNER
    assert clock.now() - began < 0.1


def test_a_board_that_starts_when_its_port_is_opened_is_not_spoken_to_before_it_speaks(clock: ManualClock):
    class Watched(SimulatedEncoderBoard):
        first: float | None = None

        def feed(self, data: bytes) -> bytes:
            self.first = clock.now() if self.first is None else self.first
            return super().feed(data)

    board = Watched(boot_s=1.7)
    began = clock.now()
    assert greeted(clock, board, resets=True) == BANNER
    assert board.first is not None and board.first - began >= 1.7
    assert clock.now() - began < 2.0


@pytest.mark.parametrize("resets", [False, True])
@pytest.mark.parametrize("boot_s", [0.0, 1.7, 4.5])
def test_slow_starters(clock: ManualClock, boot_s, resets):
    assert greeted(clock, SimulatedEncoderBoard(boot_s=boot_s), resets=resets) == BANNER


def test_half_a_line_of_an_earlier_program_does_no_harm(clock: ManualClock):
    board = SimulatedEncoderBoard()
    board.advance(clock.now())
    board.feed(b"77 EN ")
    assert greeted(clock, board) == BANNER


@pytest.mark.parametrize("resets", [False, True])
def test_nobody(clock: ManualClock, resets):
    began = clock.now()
    with pytest.raises(BoardTimeoutError, match=r"loop: no answer\. Is this the port of the Arduino Mega"):
        greeted(clock, Somebody(), resets=resets)
    assert clock.now() - began <= 7.0


def test_standard_firmata_that_introduces_itself(clock: ManualClock):
    firmata = Somebody(at_start=bytes.fromhex("f9 02 03 f0 79 02 03 53 00 f7"))
    with pytest.raises(BoardProtocolError, match=r"loop: StandardFirmata is on this board.*flash"):
        greeted(clock, firmata, resets=True)


def test_standard_firmata_that_has_to_be_asked(clock: ManualClock):
    query, answer = bytes.fromhex("f0 79 f7"), bytes.fromhex("f0 79 02 03 53 00 f7")
    firmata = Somebody(answer=lambda heard: answer if heard == query else b"")
    with pytest.raises(BoardProtocolError, match="StandardFirmata is on this board"):
        greeted(clock, firmata)


def test_something_else(clock: ManualClock):
    with pytest.raises(BoardProtocolError, match=r"something else answers there .*Grbl 1\.1h"):
        greeted(clock, Somebody(at_start=b"\r\nGrbl 1.1h ['$' for help]\r\n", answer=lambda heard: b"ok\r\n"))


def test_a_board_that_sends_but_does_not_hear(clock: ManualClock):
    class Deaf(SimulatedEncoderBoard):
        def feed(self, data: bytes) -> bytes:
            return b""

    with pytest.raises(BoardTimeoutError, match="sends, but does not answer"):
        greeted(clock, Deaf())


@pytest.mark.parametrize(
    ("says", "words"),
    [
        (
            "armctl-encoder 2.0.0 proto=3 axes=6 reset=power",
            r"2\.0\.0 speaks protocol 3, this armctl needs protocol 2; this armctl is older .*update",
        ),
        ("armctl-gripper 1.0.0 proto=1 axes=1 reset=power", "armctl-gripper answers, not armctl-encoder"),
        ("hello yourself", "not how an armctl encoder board introduces itself"),
    ],
)
def test_another_firmware(clock: ManualClock, says, words):
    with pytest.raises(BoardProtocolError, match=words):
        greeted(clock, hello_answered_by(says))


def test_a_board_that_was_flashed_before_the_protocol_changed(clock: ManualClock):
    board = SimulatedEncoderBoard(protocol=1)
    bench = Bench(clock, board)
    with pytest.raises(BoardProtocolError) as refused:
        bench.driver.open()
    assert str(refused.value) == (
        "loop: the board's firmware 1.1.0 speaks protocol 1, this armctl needs protocol 2; flash the board "
        "again, with the firmware that comes with this armctl (firmware/README.md says how under Flashing)"
    )
    assert set(board.log) == {"HELLO"}


def test_a_refused_greeting_closes_the_line(clock: ManualClock):
    bench = Bench(clock, hello_answered_by("armctl-encoder 2.0.0 proto=3 axes=6 reset=power"))
    with pytest.raises(BoardProtocolError):
        bench.driver.open()
    with pytest.raises(Exception, match="not connected"):
        bench.driver.read()
