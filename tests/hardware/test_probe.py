"""Who answers on a port, asked of every board, with a look at what the questions did to it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from tests.hardware.lines import LoopTransport, holding_maestro

from armctl.errors import BoardError
from armctl.hardware import ByteModel
from armctl.hardware.board_type import ARDUINO_MEGA, USB_SERIAL
from armctl.hardware.encoder.messages import seal
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard
from armctl.hardware.faults import FaultyModel
from armctl.hardware.firmata.codec import servo_config, servo_write
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.simulated import (
    MaestroSettings,
    SimulatedMaestro,
)
from armctl.hardware.ports import Approach, Probed, approach, probe
from armctl.hardware.transport import UNKNOWN
from armctl.protocol import ManualClock

MICRO = MaestroModel.MICRO_6.label
PTY = None
BANNER = seal("# armctl-encoder 1.3.0 proto=4 axes=6 reset=external")
STATUS = seal("@ 20 O 00 00 00 000000000000 000000 00000000 0 0 0 0 0 0")
INTRODUCTION = bytes.fromhex("f9 02 05 f0 79 02 05 53 00 74 00 64 00 2e 00 69 00 6e 00 6f 00 f7")  # "Std.ino"


class Talker:
    """A device that says fixed things some time after it is opened, and keeps what it is told.

    Args:
        baud: its rate; opened at another one, it sends and gets garbage.
        says: what it sends at which time after opening.
        answers: what it replies to exactly these bytes.
    """

    def __init__(
        self, baud: int, says: dict[float, bytes], answers: dict[bytes, bytes] | None = None
    ) -> None:
        self.baud, self.says, self.answers = baud, says, answers or {}
        self.received = b""
        self.opened: list[int] = []
        self._opened_at = 0.0
        self._said: set[float] = set()

    def open(self, baud: int, now: float) -> None:
        self.opened.append(baud)
        self._opened_at = now
        self._said.clear()

    def advance(self, now: float) -> bytes:
        due = [at for at in self.says if at <= now - self._opened_at and at not in self._said]
        self._said.update(due)
        said = b"".join(self.says[at] for at in sorted(due))
        return said if self.opened[-1] == self.baud else bytes(byte ^ 0x93 for byte in said)

    def feed(self, data: bytes) -> bytes:
        self.received += data
        return self.answers.get(data, b"") if self.opened[-1] == self.baud else b""

    def reset(self) -> None:
        raise AssertionError("nobody cuts its power here")


def opener(model: ByteModel, clock: ManualClock) -> Callable[[int], LoopTransport]:
    def open_line(baud: int) -> LoopTransport:
        if isinstance(model, Talker):
            model.open(baud, clock.now())
        return LoopTransport(model, clock.now, clock.advance, name="port")

    return open_line


def asked(model: ByteModel, clock: ManualClock, how: Approach) -> Probed:
    return probe(opener(model, clock), how, clock.now)


@pytest.mark.parametrize("label", [MICRO, PTY])
@pytest.mark.parametrize("crc", [False, True])
def test_a_maestro_is_found_and_not_moved(clock: ManualClock, label, crc):
    board = holding_maestro(crc=crc)
    found = asked(board, clock, approach(label))
    assert (found.board, found.name, found.heard) == ("maestro", "Pololu Maestro", b"")
    assert found.details == (("commands carry a CRC",) if crc else ())
    assert board.target_us(0) == 1500.0
    assert board.errors == 0


@pytest.mark.parametrize("label", [MICRO, PTY])
def test_a_maestro_in_a_uart_mode_is_neither_found_nor_moved(clock: ManualClock, label):
    board = holding_maestro(takes_usb=False)
    found = asked(board, clock, approach(label))
    assert found == Probed("port")
    assert board.target_us(0) == 1200.0
    assert board.errors == 0


def test_what_a_maestro_had_reported_is_told(clock: ManualClock):
    board = SimulatedMaestro(settings=MaestroSettings(timeout_units=10))
    board.advance(clock.now() - 5.0)
    found = asked(board, clock, approach(MICRO))
    assert found.reported == ("serial timeout: the board heard nothing for too long and went to its home",)
    assert str(found).startswith("Pololu Maestro; it had reported: serial timeout")


@pytest.mark.parametrize("label", [ARDUINO_MEGA, USB_SERIAL])
def test_an_arduino_introduces_itself_after_the_reset_and_is_sent_nothing(clock: ManualClock, label):
    firmata = Talker(57_600, {1.7: INTRODUCTION[:9], 1.75: INTRODUCTION[9:]})
    found = asked(firmata, clock, approach(label))
    assert found == Probed("port", "firmata", "Std", "2.5", ("Firmata protocol 2.5",))
    assert str(found) == "Std 2.5; Firmata protocol 2.5"
    encoder = Talker(115_200, {1.0: BANNER, 1.02: STATUS})
    details = ("6 axes", "last started by: external")
    found = asked(encoder, clock, approach(label))
    assert found == Probed("port", "encoder", "armctl-encoder", "1.3.0", details)
    assert (firmata.opened, encoder.opened) == ([57_600], [57_600, 115_200])
    assert firmata.received == encoder.received == b""
    encoder.opened.clear()  # opened, and reset, once where it is expected
    assert asked(encoder, clock, approach(label, "encoder")).board == "encoder"
    assert encoder.opened == [115_200]


def test_an_encoder_board_that_has_been_running_is_known_by_its_status(clock: ManualClock):
    board = Talker(115_200, {0.0: STATUS[7:], 0.02: STATUS})
    found = asked(board, clock, approach(PTY))
    assert found == Probed("port", "encoder", "armctl-encoder", None, ("6 axes",))
    assert board.received == b""
    older = seal("@ 20 O 00 00 00 000000000000 0 0 0 0 0 0")  # protocol 2
    found = asked(Talker(115_200, {0.0: older[:-9] + older, 0.02: older}), clock, approach(PTY))
    assert found == Probed("port", "encoder", "armctl-encoder", None)


@pytest.mark.parametrize("label", [ARDUINO_MEGA, PTY])
def test_a_firmata_that_is_not_reset_by_opening_is_asked_last(clock: ManualClock, label):
    baud = 57_600 if label else 115_200
    answers = {b"\xf9": INTRODUCTION[:3], bytes.fromhex("f0 79 f7"): INTRODUCTION[3:]}
    board = Talker(baud, {}, answers)
    found = asked(board, clock, approach(label))
    assert found == Probed("port", "firmata", "Std", "2.5", ("Firmata protocol 2.5",))
    before = bytes.fromhex("a1 1b") if label is PTY else b""
    assert board.received == before + bytes.fromhex("f9 f0 79 f7")
    del answers[bytes.fromhex("f0 79 f7")]
    found = asked(board, clock, approach(label))
    assert found == Probed("port", "firmata", "Firmata", None, ("Firmata protocol 2.5",))


def test_a_mega_with_another_sketch_is_nobody_and_its_words_are_told(clock: ManualClock):
    board = Talker(115_200, {1.0: b"Grbl 1.1h ['$' for help]\r\n"})
    found = asked(board, clock, approach(ARDUINO_MEGA))
    assert found.board is None
    assert str(found) == ("nobody that armctl knows answers; it says \"Grbl 1.1h ['$' for help]\\r\\n\"")
    assert board.received == b""


@pytest.mark.parametrize("label", [USB_SERIAL, UNKNOWN])
def test_nothing_is_sent_to_a_device_that_may_be_anything(clock: ManualClock, label):
    board = Talker(9_600, {})
    start = clock.now()
    assert asked(board, clock, approach(label)) == Probed("port")
    assert board.received == b""
    assert clock.now() - start == pytest.approx(5.0)
    assert str(Probed("port")) == "nobody that armctl knows answers"


@pytest.mark.parametrize("label", [USB_SERIAL, UNKNOWN])
def test_where_the_user_says_what_to_expect_that_is_asked(clock: ManualClock, label):
    board = holding_maestro()
    assert asked(board, clock, approach(label, "maestro")).board == "maestro"
    assert board.target_us(0) == 1500.0
    firmata = Talker(57_600, {})
    assert asked(firmata, clock, approach(label, "firmata")).board is None
    assert firmata.received == b"\xf9"


def test_something_that_answers_the_maestros_question_in_its_own_way(clock: ManualClock):
    board = Talker(115_200, {}, {b"\xa1": b"OK"})
    found = asked(board, clock, approach(PTY))
    assert found.board is None
    assert "no Maestro" in found.details[0]
    assert board.received == b"\xa1"


def test_noise_is_no_board(clock: ManualClock):
    noise = {0.02 * step: bytes((step * 37 + k * 91) & 0xFF for k in range(20)) for step in range(100)}
    board = Talker(115_200, noise)
    start = clock.now()
    found = asked(board, clock, approach(ARDUINO_MEGA))
    assert found.board is None
    assert len(found.heard) == 64
    assert clock.now() - start < 4.0  # a second at each rate is enough to be understood


def test_a_line_that_breaks_is_an_error_and_is_closed(clock: ManualClock):
    model = FaultyModel(SimulatedMaestro())
    model.unplug()
    line = LoopTransport(model, clock.now, clock.advance)
    with pytest.raises(BoardError, match="unplugged"):
        probe(lambda _baud: line, approach(MICRO), clock.now)
    with pytest.raises(BoardError, match="the line is closed"):
        line.write(b"")


def test_a_probe_ends_where_the_clock_stands_still(clock: ManualClock):
    board = Talker(57_600, {})
    board.open(57_600, clock.now())
    line = LoopTransport(board, clock.now)
    assert probe(lambda _baud: line, approach(PTY), clock.now).board is None


@pytest.mark.parametrize("expected", [None, "maestro", "firmata", "encoder"])
def test_the_simulated_boards_are_found_whatever_is_expected_and_nothing_is_done_to_them(
    clock: ManualClock, expected
):
    """The order of the questions is the point: what one board is asked must mean nothing to the others."""
    maestro = holding_maestro()
    assert asked(maestro, clock, approach(PTY, expected)).board == "maestro"
    assert (maestro.target_us(0), maestro.errors) == (1500.0, 0)

    encoder = SimulatedEncoderBoard()
    encoder.advance(clock.now())
    assert asked(encoder, clock, approach(PTY, expected)).board == "encoder"
    assert not encoder.log


@pytest.mark.parametrize("expected", [None, "firmata", "encoder"])
def test_a_firmata_with_its_servos_on_is_found_and_goes_on_sending_the_same_pulses(
    clock: ManualClock, expected
):
    board = SimulatedFirmata()
    board.advance(clock.now())
    board.feed(servo_config(22, 544, 2400) + servo_write(22, 1234))
    clock.advance(1.0)
    found = asked(board, clock, approach(PTY, expected))
    assert (found.board, found.name) == ("firmata", "StandardFirmata")
    assert {pulse.width_us for pulse in board.pulses(22)} == {1234}
    # Nor do the Maestro's questions leave anything behind that the next message would complete.
    board.feed(servo_write(22, 1300))
    clock.advance(0.1)
    board.advance(clock.now())
    assert board.pulses(22)[-1].width_us == 1300
    assert all(board.pulses(pin) == () for pin in range(8))


def test_a_firmata_left_in_the_middle_of_a_message_is_asked_nothing_that_would_finish_it(clock: ManualClock):
    board = SimulatedFirmata()
    board.advance(clock.now())
    board.feed(servo_config(22, 544, 2400) + servo_write(22, 1234))
    clock.advance(1.0)
    board.advance(clock.now())
    board.feed(servo_write(22, 2000)[:3])  # and then the host went away
    asked(board, clock, approach(PTY))
    clock.advance(1.0)
    board.advance(clock.now())
    assert {pulse.width_us for pulse in board.pulses(22)} == {1234}
