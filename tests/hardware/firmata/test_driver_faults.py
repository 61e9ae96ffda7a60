"""What the driver does on a bad line, and with a board that starts anew."""

from __future__ import annotations

import math
import re
from itertools import pairwise

import pytest

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.hardware import ChannelSettings
from armctl.hardware.faults import Fault, FaultyModel, trouble
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.protocol import ManualClock

from .conftest import CHANNELS

ON = {9: 1500.0, 22: 1600.0}


@pytest.fixture
def board() -> SimulatedFirmata:
    return SimulatedFirmata()


@pytest.fixture
def seed() -> int:
    return 0


@pytest.fixture
def faults(board: SimulatedFirmata, seed: int) -> FaultyModel:
    return FaultyModel(board, seed)


@pytest.fixture
def session(faults: FaultyModel, connect):
    running = connect(faults)
    running.switch_on(ON)
    for _ in range(3):
        running.frame(ON)
    return running


def test_a_setpoint_that_never_arrived_is_told_and_sent_again(session, board, faults):
    faults.inject(Fault.DROP_COMMAND)
    session.frame({9: 1700.0})
    assert board.pulses(9)[-1].width_us == 1500
    errors = [error for _ in range(4) for error in session.frame().errors]
    assert errors == [
        "pin 9 had 1500 instead of the 1700 µs last sent: bytes were lost or garbled on the line; sent "
        "again. Check the USB cable"
    ]
    session.frame()
    assert board.pulses(9)[-1].width_us == 1700


@pytest.mark.parametrize("seed", range(40))
def test_a_garbled_setpoint_is_put_right_within_a_few_frames(session, board, faults, seed: int):
    faults.inject(Fault.GARBLE_COMMAND)
    outcomes = []
    for _ in range(20):
        try:
            session.frame({9: 1700.0, 22: 1600.0})
        except (BoardTimeoutError, BoardProtocolError) as error:
            outcomes.append(error)
        except BoardError as error:
            # A flipped bit may make a reset, or another mode, out of anything: the pins are off then.
            assert "restarted" in str(error)
            assert board.mode(9) != 4 or board.mode(22) != 4
            return
    session.frame()
    assert (board.pulses(9)[-1].width_us, board.pulses(22)[-1].width_us) == (1700, 1600)


@pytest.mark.parametrize("fault", [Fault.DROP_REPLY, Fault.HALF_REPLY, Fault.DROP_COMMAND])
def test_an_answer_that_is_lost_is_counted_and_the_arm_moves_on(session, board, faults, fault: Fault):
    """Safe: a sketch that has started anew ignores setpoints, and one answer in 60 ms has to come."""
    faults.inject(fault)
    lost, malformed = 0, 0
    for step in range(40):
        try:
            readback = session.frame({9: 1500.0 + step // 20, 22: 1600.0})
        except BoardProtocolError:
            malformed += 1
            continue
        assert readback.errors == () or fault is Fault.DROP_COMMAND
        lost += readback.lost
    assert lost == (2 if fault is not Fault.HALF_REPLY else 1)
    assert malformed <= 1
    assert session.frame().positions == {9: 1501.0, 22: 1600.0}


@pytest.mark.parametrize(("delay_s", "silent"), [(0.1, False), (0.2, True), (0.29, True)])
def test_a_late_answer_is_taken_when_it_comes(session, faults, delay_s: float, silent: bool):
    faults.inject(Fault.DELAY_REPLY, delay_s=delay_s)
    told = []
    for pulse_us in range(1500, 1540):
        try:
            assert session.frame({9: float(pulse_us), 22: 1600.0}).errors == ()
        except BoardTimeoutError as error:
            told.append(str(error))
    assert all(re.match(r"loop: no answer for \d{3} ms; check the cable", text) for text in told)
    assert bool(told) is silent


@pytest.mark.parametrize(
    ("lost_s", "step_us", "says"),
    [(0.06, 60, ""), (0.1, 80, "did not get what was sent"), (0.2, 16, "had"), (0.5, 16, "had")],
)
def test_what_is_lost_for_a_while_is_told_and_no_step_of_the_arm(
    connect, board, clock: ManualClock, lost_s: float, step_us: int, says: str
):
    """Setpoints move by 10 µs a frame; the board may be brought back at 750 µs/s, 15 µs a frame."""
    faults = FaultyModel(board, 0, [trouble(f"drop-command@2+{lost_s}")])
    session = connect(faults, channels=[ChannelSettings(9, 1000.0, 2000.0, speed=750.0)])
    session.switch_on({9: 1000.0})
    clock.advance(101.8 - clock.now())
    pulse_us, told = 1000.0, []
    for _ in range(100):
        pulse_us = min(1700.0, pulse_us + 10.0)
        try:
            told += session.frame({9: pulse_us}).errors
        except BoardTimeoutError:
            pulse_us -= 10.0  # whoever drives it halts, and asks until an answer comes
    pulses = [pulse.width_us for pulse in board.pulses(9)]
    assert max(abs(after - before) for before, after in pairwise(pulses)) <= step_us
    assert pulses[-1] == 1700
    assert any(says in words for words in told) or not says


@pytest.mark.parametrize("seed", range(40))
def test_a_garbled_answer_never_moves_anything(session, board, faults, seed: int):
    faults.inject(Fault.GARBLE_REPLY)
    for _ in range(40):
        try:
            session.frame(ON)
        except (BoardTimeoutError, BoardProtocolError):
            continue
    assert {pulse.width_us for pulse in board.pulses(9)} == {1500}
    assert {pulse.width_us for pulse in board.pulses(22)} == {1600}
    assert session.frame(ON).positions == ON


@pytest.mark.parametrize("seed", range(4))
def test_a_minute_of_garbled_answers_gives_nothing_up(connect, seed: int):
    board = SimulatedFirmata()
    session = connect(FaultyModel(board, seed, [trouble("garble-reply:0.05@2")]))
    session.switch_on(ON)
    pulse_us, told = 1500.0, 0
    for frame in range(3000):
        pulse_us = 1600.0 + 100.0 * math.sin(frame / 40)
        try:
            session.frame({9: pulse_us, 22: 1600.0})
        except (BoardTimeoutError, BoardProtocolError):
            told += 1
    steps = [abs(after.width_us - before.width_us) for before, after in pairwise(board.pulses(9))]
    assert max(steps[100:]) <= 6
    assert told


def test_a_broken_message_says_so(session, faults):
    session.line._received += bytes.fromhex("f0 6e 09 f9")
    with pytest.raises(BoardProtocolError, match=r"loop: the board sent f0 6e 09, which is no whole message"):
        session.frame(ON)


def test_a_restart_is_told_and_nothing_is_written_after_it(session, board, clock: ManualClock):
    board.reset()
    count = len(session.line.bursts)
    for call in (
        lambda: session.frame({9: 1800.0}),
        lambda: session.driver.write({9: 1800.0}),
        session.driver.read,
        session.driver.stop,
        session.driver.release,
        lambda: session.driver.configure(CHANNELS),
    ):
        with pytest.raises(
            BoardError,
            match=r"the board has restarted \(reset button, or its supply broke down\): its servos are off "
            r"and the arm may have dropped; check the supply, then connect again",
        ):
            call()
    assert len(session.line.bursts) == count
    before = len(board.pulses(9))
    session.driver.open()
    session.driver.configure(CHANNELS)
    assert session.driver.read().positions == {9: None, 22: None}
    assert len(board.pulses(9)) == before


def test_a_brown_out_whose_report_was_lost_is_found_by_the_pins_modes(session, board, faults, clock):
    pulses = {pin: len(board.pulses(pin)) for pin in ON}
    faults.brown_out(0.1)
    with pytest.raises(BoardError, match=r"no longer drives pins 9, 22, and .* restarted .* connect again"):
        for step in range(50):
            try:
                session.frame({9: 1500.0 + step, 22: 1600.0})
            except (BoardTimeoutError, BoardProtocolError):
                continue
    clock.advance(1.0)
    board.advance(clock.now())
    assert {pin: len(board.pulses(pin)) for pin in ON} == pulses, "a board that has restarted must stay off"
    with pytest.raises(BoardError, match="no longer drives"):
        session.driver.write({9: 1500.0})


def test_configuring_a_running_board_again_disturbs_nothing(session, board, clock):
    session.driver.configure(CHANNELS)
    for _ in range(10):
        assert session.frame(ON).errors == ()
    session.driver.configure([*CHANNELS, ChannelSettings(5, 1000, 2000)])
    assert session.frame(ON).positions == {5: None, **ON}
    assert {pulse.width_us for pulse in board.pulses(9)} == {1500}


def test_configuring_takes_no_answer_to_an_earlier_question_for_its_own(session, faults, clock):
    """Else its own answers, which come later, are taken for those to the next questions."""
    for turn in range(8):
        for delay_s in (0.06, 0.05, 0.06):  # a line that is slow for a while, and keeps the order
            faults.inject(Fault.DELAY_REPLY, delay_s=delay_s)
        assert session.frame({9: 1500.0 + 20 * turn, 22: 1600.0}).errors == ()  # its questions are open
        clock.advance(0.055)
        session.driver.configure(CHANNELS)
        for step in range(6):
            assert session.frame({9: 1501.0 + 20 * turn + step, 22: 1600.0}).errors == ()


def test_a_release_is_not_believed_by_the_answer_to_an_earlier_question(session, board, faults, clock):
    session.driver.release()
    faults.inject(Fault.DELAY_REPLY, count=2, delay_s=0.06)
    session.frame()  # asks, and will hear that the pins are off
    session.driver.write(ON)
    faults.inject(Fault.DROP_COMMAND, count=2)  # the release never arrives
    session.driver.release()
    assert board.mode(9) == board.mode(22) == 1


def test_configuring_finds_out_that_the_pins_are_off_or_the_board_silent(session, board, faults, clock):
    faults.inject(Fault.DROP_REPLY, count=2)
    session.driver.configure(CHANNELS)
    faults.inject(Fault.DROP_REPLY, count=3)
    with pytest.raises(BoardTimeoutError, match="of pins 9, 22 within 250 ms, though asked 3 times"):
        session.driver.configure(CHANNELS)
    faults.brown_out(0.0)
    clock.advance(0.001)
    board.advance(clock.now())  # the report is lost
    with pytest.raises(BoardError, match="no longer drives pins 9, 22"):
        session.driver.configure(CHANNELS)


def test_a_swallowed_release_is_sent_again_and_one_that_is_not_confirmed_warns(session, board, faults):
    session.line.write(bytes.fromhex("f0 6d 09"))  # an unfinished sysex takes the whole command in
    session.driver.release()
    assert board.mode(9) == board.mode(22) == 1
    assert session.frame().positions == {9: None, 22: None}
    faults.inject(Fault.DROP_REPLY, count=50)
    with pytest.raises(
        BoardTimeoutError,
        match=r"confirm the release of pins 9, 22; the arm may still be held\. Cut the servos' supply",
    ):
        session.driver.release()


def test_an_unplugged_board_is_a_board_error_for_every_call(session, faults):
    faults.unplug()
    for call in (session.driver.read, session.driver.stop, session.driver.release, session.frame):
        with pytest.raises(BoardError, match="unplugged"):
            call()
    session.driver.close()
    session.driver.close()
