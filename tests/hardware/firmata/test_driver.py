"""The driver against golden bytes, and against the simulated board on a manual clock."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import BoardError, BoardTimeoutError
from armctl.hardware import BoardIdentity, ChannelSettings, Readback, Source
from armctl.hardware.firmata.driver import COMMANDED_NOTE, WATCHDOG_NOTE, FirmataDriver
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.maestro.simulated import SimulatedMaestro
from armctl.hardware.transport import Connection
from armctl.protocol import ManualClock

from .conftest import CHANNELS, FRAME_S, PINS, Session

BYTE_S = 10 / 57600


def test_the_bytes_of_a_whole_session(clock: ManualClock):
    session = Session(SimulatedFirmata(boot_s=1.7), clock, ask_after_s=2.5)
    driver = session.driver
    driver.open()
    driver.configure(CHANNELS)
    session.frame()
    session.frame({22: 2000.0, 9: 1500.0})
    for _ in range(2):
        session.frame({22: 2000.0, 9: 1500.0})
    session.frame({22: 2000.0, 9: 1501.4})
    driver.stop()
    driver.release()
    session.frame()
    clock.advance(FRAME_S)
    driver.write({9: 1000.0, 22: 1000.0})
    driver.close()
    on_9, on_22 = "f0 70 09 68 07 50 0f f7 f0 6f 09", "f0 70 16 68 07 50 0f f7 f0 6f 16"
    off_9, off_22 = "f4 09 01", "f4 16 01"
    held = "f0 79 f7 f0 79 f7 f0 79 f7"
    questions, around = "f0 6d 09 f7 f0 6d 16 f7", "f0 6d 16 f7 f0 6d 09 f7"
    assert session.line.bursts == [
        "f0 79 f7",
        "f0 6b f7",
        f"f0 6d 00 f7 {questions}",  # configure, behind the question that tells earlier answers from its own
        f"f0 6d 01 f7 {questions}",  # and once more: one answer alone may be garbled
        questions,  # the first frame
        f"{held} {on_9} 5c 0b f7 {off_9} {on_22} 50 0f f7 {off_22}",  # behind what keeps the sketch busy
        f"{on_9} 5c 0b f7 {on_22} 50 0f f7",  # with the widths that it keeps by now
        questions,
        around,  # the one that was right last is asked last
        "f0 6f 09 5d 0b f7",  # 1501, and nothing for the pin that stays
        around,
        f"{off_22} f5 16 00 {off_9} f5 09 00",  # and low
        f"f0 6d 32 f7 {questions}",
        f"f0 6d 33 f7 {questions}",
        around,
        f"{held} {on_9} 68 07 f7 {off_9} {on_22} 68 07 f7 {off_22}",
    ]


def test_identity(clock: ManualClock):
    identity = Session(SimulatedFirmata(), clock).driver.open()
    notes = (WATCHDOG_NOTE, COMMANDED_NOTE)
    assert identity == BoardIdentity("Arduino with StandardFirmata 2.3", "loop", notes=notes)
    assert "no watchdog" in WATCHDOG_NOTE
    assert Session(SimulatedFirmata(), clock, simulated=True).driver.open().notes == (COMMANDED_NOTE,)
    with pytest.raises(BoardTimeoutError, match="no answer within 5 s"):
        Session(SimulatedMaestro(), clock).driver.open()


@pytest.mark.parametrize("call", ["read", "stop", "release", "configure", "write"])
def test_nothing_works_before_open(call: str):
    driver = FirmataDriver(Connection("/dev/ttyACM0", lambda: 0.0))
    with pytest.raises(BoardError, match="hobby servos need no homing"):
        driver.home()
    arguments = {"configure": [CHANNELS], "write": [{}]}.get(call, [])
    with pytest.raises(BoardError, match="the Arduino is not connected; connect first"):
        getattr(driver, call)(*arguments)


def test_nothing_is_on_until_it_is_switched_on(clock: ManualClock, connect):
    board = SimulatedFirmata()
    session = connect(board)
    for _ in range(50):
        readback = session.frame()
        assert readback.positions == {9: None, 22: None}
        assert readback.powered is None
    assert all(board.pulses(pin) == () for pin in range(70))
    readback = session.switch_on({9: 1500.0})
    asked, delay_s = readback.asked, readback.delay_s
    assert readback == Readback({9: 1500.0, 22: None}, Source.COMMANDED, asked=asked, delay_s=delay_s)


@pytest.mark.parametrize("pin", [2, 13, 14, 15, 16, 22, 49])
@pytest.mark.parametrize("pulse_us", [544.0, 900.0, 1500.0, 2400.0, 2912.0])
def test_the_first_pulse_is_the_right_one_on_any_pin(clock: ManualClock, connect, pin: int, pulse_us: float):
    board = SimulatedFirmata()
    session = connect(board, channels=[ChannelSettings(pin, 544.0, 2912.0)])
    session.switch_on({pin: pulse_us})
    for _ in range(3):
        session.frame({pin: pulse_us})
    assert {pulse.width_us for pulse in board.pulses(pin)} == {pulse_us}
    assert [number for number in range(70) if board.pulses(number)] == [pin]


def test_a_whole_arm_is_on_after_a_few_frames_and_no_pulse_is_wrong(clock: ManualClock, connect):
    board = SimulatedFirmata()
    pulses = {pin: 1000.0 + 10 * pin for pin in range(2, 18)}
    session = connect(board, channels=[ChannelSettings(pin, 1000, 2000) for pin in pulses])
    started = clock.now()
    session.switch_on(pulses)
    assert clock.now() - started <= 0.5
    session.frame(pulses)
    for pin, pulse_us in pulses.items():
        assert {pulse.width_us for pulse in board.pulses(pin)} == {pulse_us}


@pytest.mark.parametrize("rate_hz", [50, 100, 200])
@pytest.mark.parametrize("pins", [1, 6, 12, 16])
def test_the_line_is_never_given_more_than_it_carries(clock: ManualClock, connect, rate_hz: int, pins: int):
    board = SimulatedFirmata()
    numbers = range(2, 2 + pins)
    session = connect(board, channels=[ChannelSettings(pin, 1000, 2000) for pin in numbers])
    session.switch_on(dict.fromkeys(numbers, 1000.0))
    clock.advance(0.1)
    session.line.written.clear()
    start = clock.now()
    for step in range(2 * rate_hz):
        clock.advance(1 / rate_hz)
        session.driver.write(dict.fromkeys(numbers, 1001.0 + 499.0 * step / rate_hz))
        session.driver.read()
    written = session.line.written
    backlog_s, before = 0.0, start
    for time, data in written:
        backlog_s = max(0.0, backlog_s - (time - before)) + len(data) * BYTE_S
        before = time
        assert backlog_s <= FRAME_S
    setpoints = [time for time, data in written if data[1] == 0x6F]
    assert max(after - before for before, after in pairwise(setpoints)) <= FRAME_S + 1 / rate_hz + 1e-6
    asked = [data.hex() for _, data in written if data[1] == 0x6D]
    assert all(any(f"f06d{pin:02x}f7" in burst for burst in asked) for pin in numbers)
    clock.advance(0.05)
    session.driver.read()
    board.advance(clock.now() + 0.05)
    assert {board.pulses(pin)[-1].width_us for pin in numbers} == {round(1001.0 + 499.0 * (2 - 1 / rate_hz))}


@pytest.mark.parametrize("pins", [1, 6, 12])
def test_whoever_reads_first_loses_no_frame(clock: ManualClock, connect, pins: int):
    numbers = range(2, 2 + pins)
    session = connect(SimulatedFirmata(), channels=[ChannelSettings(pin, 1000, 2000) for pin in numbers])
    session.switch_on(dict.fromkeys(numbers, 1000.0))
    clock.advance(0.1)
    for step in range(100):
        clock.advance(FRAME_S)
        session.driver.read()
        session.line.written.clear()
        session.driver.write(dict.fromkeys(numbers, 1001.0 + step))
        assert [len(data) for _, data in session.line.written] == [6 * pins]


def test_reading_never_waits_and_what_does_not_change_is_not_sent_again(clock: ManualClock, connect):
    session = connect(SimulatedFirmata())
    session.switch_on({9: 1500.0})
    session.frame()
    session.line.written.clear()
    for _ in range(100):
        before = clock.now()
        session.frame({9: 1500.0})
        assert clock.now() - before == pytest.approx(FRAME_S)
    assert all(data[1] == 0x6D for _, data in session.line.written)


def test_settings_and_setpoints_that_the_board_cannot_have_are_refused(connect):
    session = connect(SimulatedFirmata())
    session.switch_on({9: 1500.0})
    session.clock.advance(0.1)
    count = len(session.line.bursts)
    with pytest.raises(BoardError, match=r"pin 22: nan µs is outside 1000 … 2000 µs; nothing was sent"):
        session.driver.write({9: 1600.0, 22: math.nan})
    with pytest.raises(BoardError, match="pin 5 is not configured"):
        session.driver.write({9: 1600.0, 5: 1500.0})
    with pytest.raises(BoardError, match=r"pin 54 cannot drive a servo .* the pins that can: 2 … 49"):
        session.driver.configure([ChannelSettings(54, 1000, 2000)])
    assert len(session.line.bursts) == count
    assert session.frame().positions == {9: 1500.0, 22: None}


@given(
    st.lists(
        st.dictionaries(
            st.sampled_from(PINS),
            st.floats(allow_nan=True, allow_infinity=True) | st.floats(900.0, 2100.0),
            max_size=2,
        ),
        max_size=10,
    )
)
def test_no_pulse_ever_leaves_its_limits(writes):
    clock = ManualClock()
    board = SimulatedFirmata()
    session = Session(board, clock)
    session.driver.open()
    session.driver.configure(CHANNELS)
    for setpoints in writes:
        clock.advance(FRAME_S)
        inside = all(1000.0 <= pulse <= 2000.0 for pulse in setpoints.values())
        try:
            session.driver.write(setpoints)
        except BoardError:
            assert not inside
        else:
            assert inside
        session.driver.read()
    clock.advance(0.1)
    board.advance(clock.now())
    for pin in PINS:
        assert all(1000 <= pulse.width_us <= 2000 for pulse in board.pulses(pin))


def test_stop_sends_nothing_and_drops_what_waits(clock: ManualClock, connect):
    board = SimulatedFirmata()
    session = connect(board)
    session.switch_on({9: 1500.0})
    session.frame({9: 1510.0, 22: 1500.0})  # which holds the sketch until pin 22 is on
    session.driver.write({9: 1600.0})
    count = len(session.line.bursts)
    session.driver.stop()
    assert len(session.line.bursts) == count
    clock.advance(1.0)
    assert session.driver.read().positions[9] < 1600.0
    assert board.pulses(9)[-1].width_us < 1600


def test_release_switches_every_configured_pin_off_and_no_other(clock: ManualClock, connect):
    board = SimulatedFirmata()
    board.advance(clock.now())
    board.feed(bytes.fromhex("f0 70 05 20 04 60 12 f7 f0 6f 05 5c 0b f7"))
    session = connect(board)
    session.switch_on({9: 1500.0, 22: 1600.0})
    session.driver.release()
    readback = session.frame()
    assert readback.positions == {9: None, 22: None}
    assert readback.powered is None
    counts = {pin: len(board.pulses(pin)) for pin in (5, 9, 22)}
    for _ in range(50):
        assert session.frame().errors == ()
    assert [len(board.pulses(pin)) for pin in (9, 22)] == [counts[9], counts[22]]
    assert len(board.pulses(5)) > counts[5]
    assert board.mode(9) == board.mode(22) == 1  # low, not floating


def test_release_with_questions_on_their_way(clock: ManualClock, connect):
    session = connect(SimulatedFirmata())
    for _ in range(5):
        session.switch_on({9: 1500.0, 22: 1600.0})
        session.driver.release()
        for _ in range(30):
            assert session.frame().positions == {9: None, 22: None}


def test_pins_that_are_on_already_are_taken_over_without_a_jolt(clock: ManualClock, connect):
    board = SimulatedFirmata()
    board.advance(clock.now())
    board.feed(bytes.fromhex("f0 70 16 20 04 60 12 f7 f0 6f 16 50 0d f7"))  # 1744 µs
    session = connect(board)
    assert session.driver.read().positions == {9: None, 22: 1744.0}
    session.frame({22: 1745.0})
    session.frame()
    session.frame()
    assert {pulse.width_us for pulse in board.pulses(22)} == {1744, 1745}
    assert not any(b"\xf0\x70" in data for _, data in session.line.written)


def test_a_pin_that_was_left_at_degrees_is_on_at_no_known_width(clock: ManualClock, connect):
    board = SimulatedFirmata()
    board.advance(clock.now())
    board.feed(bytes.fromhex("f4 09 04 e9 5a 00"))  # 90°
    session = connect(board)
    readback = session.driver.read()
    assert readback.positions == {9: None, 22: None}
    assert readback.powered is True


def test_closing_leaves_the_pulses_on_and_opening_again_forgets_the_pins(clock: ManualClock, connect):
    board = SimulatedFirmata()
    session = connect(board)
    session.switch_on({9: 1500.0})
    session.driver.close()
    session.driver.close()
    before = len(board.pulses(9))
    board.advance(clock.now() + 1.0)
    assert len(board.pulses(9)) >= before + 49
    session.driver.open()
    with pytest.raises(BoardError, match="pin 9 is not configured"):
        session.driver.write({9: 1500.0})


def test_what_the_sketch_says_in_words_is_told(clock: ManualClock, connect):
    board = SimulatedFirmata()
    session = connect(board)
    session.line.write(bytes.fromhex("f4 09 33"))
    assert session.frame().errors == ("the sketch says: Unknown pin mode",)
    assert session.frame().errors == ()
