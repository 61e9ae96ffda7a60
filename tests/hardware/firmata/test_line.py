"""Finding out who is at the other end, and what a broken line may still be sent."""

from __future__ import annotations

import pytest
from tests.hardware.lines import LoopTransport

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.hardware.firmata.codec import PinState, VersionReport
from armctl.hardware.firmata.line import FirmataLine
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.protocol import ManualClock

from .conftest import RecordingTransport


class Babbler:
    """Says the same every 10 ms, whatever it is asked."""

    def __init__(self, says: bytes) -> None:
        self._says = says
        self.heard = b""
        self._said_at = 0.0

    def feed(self, data: bytes) -> bytes:
        self.heard += data
        return b""

    def advance(self, now: float) -> bytes:
        if now - self._said_at < 0.01:
            return b""
        self._said_at = now
        return self._says

    def reset(self) -> None:
        self.heard = b""


class SlowLine:
    """A simulated board whose bytes arrive one by one, at 57600 baud."""

    def __init__(self, board: SimulatedFirmata) -> None:
        self._board = board
        self._waiting: list[tuple[float, bytes]] = []
        self._now = 0.0

    def _queue(self, data: bytes) -> None:
        start = max([self._now, *(at for at, _ in self._waiting[-1:])])
        self._waiting += [(start + (i + 1) * 10 / 57600, bytes((byte,))) for i, byte in enumerate(data)]

    def feed(self, data: bytes) -> bytes:
        self._queue(self._board.feed(data))
        return b""

    def advance(self, now: float) -> bytes:
        self._now = now
        self._queue(self._board.advance(now))
        due = b"".join(byte for at, byte in self._waiting if at <= now)
        self._waiting = [(at, byte) for at, byte in self._waiting if at > now]
        return due

    def reset(self) -> None:
        self._board.reset()


def line_to(board, clock: ManualClock) -> tuple[FirmataLine, RecordingTransport]:
    transport = RecordingTransport(board, clock)
    return FirmataLine(transport, clock.now), transport


def test_a_board_that_restarts_on_opening_is_not_disturbed(clock: ManualClock):
    line, transport = line_to(SimulatedFirmata(boot_s=1.7), clock)
    board = line.identify(ask_after_s=2.5)
    firmware = board.firmware
    assert (firmware.major, firmware.minor, firmware.name) == (2, 3, "StandardFirmata.ino")
    assert board.capabilities.pins_with(4) == tuple(range(2, 50))
    assert transport.bursts == ["f0 79 f7", "f0 6b f7"]
    assert transport.written[0][0] >= 101.7


def test_a_board_that_runs_already_is_asked_with_a_byte_that_ends_no_sysex(clock: ManualClock):
    board = SimulatedFirmata()
    board.advance(clock.now())
    line, transport = line_to(board, clock)
    line.identify(ask_after_s=0.5)
    assert transport.bursts == ["f9", "f0 79 f7", "f0 6b f7"]
    assert 0.5 <= round(transport.written[0][0] - 100.0, 6) < 0.6


def test_the_capabilities_of_a_mega_come_whole_over_a_slow_line(clock: ManualClock):
    line, _ = line_to(SlowLine(SimulatedFirmata(boot_s=1.0)), clock)
    board = line.identify(ask_after_s=2.5)
    assert len(board.capabilities.pins) == 70


def test_boot_reports_that_come_late_are_not_a_restart(clock: ManualClock):
    line, _ = line_to(SlowLine(SimulatedFirmata(boot_s=3.0)), clock)
    line.identify(ask_after_s=0.2)  # asked three times before it could hear
    clock.advance(1.0)
    assert line.receive() == []


def test_an_unfinished_sysex_from_before_is_not_finished(clock: ManualClock):
    board = SimulatedFirmata()
    board.advance(clock.now())
    board.feed(bytes.fromhex("f0 70 09 20 04 60 12 f7 f0 6f 09 5c 0b f7"))
    board.feed(bytes.fromhex("f0 6f 09 5c"))  # the client that wrote this is gone
    line, transport = line_to(board, clock)
    with pytest.raises(BoardTimeoutError, match="press its reset button and connect again"):
        line.identify(ask_after_s=0.2)
    assert set(transport.bursts) == {"f9"}
    clock.advance(1.0)
    board.advance(clock.now())
    assert {pulse.width_us for pulse in board.pulses(9)} == {1500}


def test_nobody_answers(clock: ManualClock):
    line, transport = line_to(Babbler(b""), clock)
    with pytest.raises(BoardTimeoutError, match=r"loop: no answer within 5 s\. .*StandardFirmata, Upload"):
        line.identify(ask_after_s=2.5)
    assert transport.bursts == ["f9"] * 3
    assert clock.now() - 100.0 == pytest.approx(5.0, abs=0.1)
    cannot_wait = FirmataLine(LoopTransport(Babbler(b""), clock.now), clock.now)
    with pytest.raises(BoardTimeoutError, match="no answer"):
        cannot_wait.identify(ask_after_s=2.5)


@pytest.mark.parametrize(
    ("says", "error", "words"),
    [
        (
            b"\x80\x13Marlin",
            BoardProtocolError,
            r"in Firmata at 57600 baud \(first bytes .*4d 61 72.*\); load",
        ),
        (
            b"# armctl-encoder 1.1.0 proto=2 axes=6 reset=power*1A2B\n",
            BoardProtocolError,
            "armctl's own firmware for arms with encoders, not Firmata",
        ),
        (b"\xf9\x02\x05", BoardTimeoutError, "speaks Firmata but did not tell its firmware within 2 s"),
    ],
)
def test_something_that_is_no_standard_firmata(clock: ManualClock, says: bytes, error, words: str):
    line, _ = line_to(Babbler(says), clock)
    with pytest.raises(error, match=words):
        line.identify(ask_after_s=0.2)


def test_after_a_restart_nothing_more_is_sent(clock: ManualClock):
    board = SimulatedFirmata()
    line, transport = line_to(board, clock)
    line.identify(ask_after_s=0.2)
    board.reset()
    clock.advance(0.1)
    count = len(transport.bursts)
    for call in (line.receive, line.receive, lambda: line.send(b"\xf9"), lambda: list(line.listen(0.1))):
        with pytest.raises(BoardError, match=r"the board has restarted .* connect again"):
            call()
    assert len(transport.bursts) == count


def test_another_version_than_before_is_a_garbled_message(clock: ManualClock):
    line, transport = line_to(SimulatedFirmata(), clock)
    line.identify(ask_after_s=0.2)
    transport._received += bytes.fromhex("f9 01 04")
    assert line.receive() == [VersionReport(1, 4)]


class BreakingTransport(LoopTransport):
    """Loses the second half of one write, and raises."""

    breaks = False

    def write(self, data: bytes) -> None:
        if self.breaks:
            super().write(data[: len(data) // 2])
            raise BoardTimeoutError("loop: the board takes no more bytes")
        super().write(data)


def test_after_a_write_that_broke_off_nothing_more_is_sent(clock: ManualClock):
    board = SimulatedFirmata()
    transport = BreakingTransport(board, clock.now, clock.advance)
    line = FirmataLine(transport, clock.now)
    line.identify(ask_after_s=0.2)
    line.send(bytes.fromhex("f0 70 09 20 04 60 12 f7 f0 6f 09 5c 0b f7"))
    transport.breaks = True
    with pytest.raises(BoardTimeoutError, match="takes no more bytes"):
        line.send(bytes.fromhex("f0 6f 09 68 0c f7"))
    transport.breaks = False
    for call in (line.receive, lambda: line.send(bytes.fromhex("f0 6f 09 68 0c f7"))):
        with pytest.raises(BoardError, match=r"an earlier write broke off.*connect again"):
            call()
    clock.advance(1.0)
    board.advance(clock.now())
    assert {pulse.width_us for pulse in board.pulses(9)} == {1500}


def test_what_is_listened_for_comes_in_order(clock: ManualClock):
    line, _ = line_to(SimulatedFirmata(), clock)
    line.identify(ask_after_s=0.2)
    line.send(bytes.fromhex("f0 6d 09 f7 f0 6d 36 f7"))
    assert list(line.listen(0.1)) == [PinState(9, 1, 0), PinState(54, 2, 0)]
