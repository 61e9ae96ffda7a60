"""The driver against the exact bytes, and against the simulated board in memory."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.hardware.lines import LoopTransport, holding_maestro
from tests.hardware.maestro.conftest import ScriptedTransport

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError, InputError
from armctl.hardware import BoardIdentity, ChannelSettings
from armctl.hardware.faults import Fault, FaultyModel
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.codec import MaestroErrors
from armctl.hardware.maestro.driver import UNKNOWN_MODEL_NOTE, WATCHDOG_NOTE, MaestroDriver, MaestroLine
from armctl.hardware.maestro.simulated import (
    ChannelConfig,
    MaestroSettings,
    SimulatedMaestro,
)
from armctl.hardware.transport import Connection
from armctl.protocol import ManualClock

CHANNELS = [ChannelSettings(channel, 1000.0, 2000.0) for channel in range(4)]


def scripted(*exchanges: tuple[str, str], **options) -> tuple[MaestroDriver, ScriptedTransport]:
    transport = ScriptedTransport(*exchanges)
    return MaestroDriver(Connection(lambda: transport, lambda: 0.0), **options), transport


def test_identity_of_a_board_of_unknown_model_and_of_a_known_one():
    driver, _ = scripted(("a1", "00 00"), ("90 00 a1", "00 00 00 00"))
    identity = driver.open()
    assert identity == BoardIdentity(
        "Pololu Maestro, model unknown", "scripted", notes=(WATCHDOG_NOTE, UNKNOWN_MODEL_NOTE)
    )
    assert "not verified" in WATCHDOG_NOTE
    driver, _ = scripted(("a1", "20 00"), ("90 00 a1", "00 00 00 00"), model=MaestroModel.MICRO_6)
    identity = driver.open()
    assert (identity.kind, identity.notes) == ("Pololu Micro Maestro 6-channel", (WATCHDOG_NOTE,))
    assert identity.earlier[0].startswith("before armctl connected, the board had reported: serial timeout")


@pytest.mark.parametrize(
    ("exchanges", "error", "says"),
    [
        # Silence, as in the factory's serial mode.
        ([("a1", ""), ("1b", "")], BoardTimeoutError, r'USB Dual Port.*"UART, detect .*silently ignores'),
        ([("a1", "00")], BoardProtocolError, "Get Errors was answered by 1 bytes"),
        ([("a1", "41 54")], BoardProtocolError, r"scripted: .*no Maestro"),
        ([("a1", "00 00"), ("90 00 a1", "00 00 10 00")], BoardProtocolError, "answers but misunderstands"),
    ],
)
def test_what_is_no_maestro_is_asked_nothing_more_and_left(exchanges, error, says: str):
    driver, transport = scripted(*exchanges)
    with pytest.raises(error, match=says):
        driver.open()
    transport.assert_done()
    assert transport.closed == 1
    for call in (
        driver.read,
        driver.stop,
        driver.release,
        lambda: driver.configure(CHANNELS),
        lambda: driver.write({}),
    ):
        with pytest.raises(BoardError, match="not connected"):
            call()


def test_opening_again_forgets_the_channels(connect):
    driver = connect(SimulatedMaestro())
    with pytest.raises(BoardError, match="need no homing"):
        driver.home()
    driver.open()
    with pytest.raises(BoardError, match="channel 0 is not configured"):
        driver.write({0: 1500.0})


def test_opening_moves_nothing_and_release_switches_off_what_is_configured(clock: ManualClock, connect):
    board = SimulatedMaestro()
    board.advance(clock.now())
    board.feed(bytes.fromhex("84 02 70 2e 84 05 70 2e"))
    driver = connect(board)
    assert driver.read().positions == {0: None, 1: None, 2: 1500.0, 3: None}
    driver.write({0: 1500.0, 3: 1600.0})
    driver.release()
    assert driver.read().positions == dict.fromkeys(range(4))
    assert board.target_us(5) == 1500.0


def test_channel_settings_that_the_board_cannot_have_are_refused_before_anything_is_sent(connect):
    board = SimulatedMaestro()
    driver = connect(board, model=MaestroModel.MICRO_6)
    before = len(board.log)
    with pytest.raises(BoardError, match="channel 6"):
        driver.configure([ChannelSettings(6, 1000, 2000)])
    with pytest.raises(InputError, match="speed limit"):
        driver.configure([ChannelSettings(0, 1000, 2000, speed=math.nan)])
    assert len(board.log) == before


@given(
    st.lists(
        st.dictionaries(
            st.integers(0, 4),
            st.floats(allow_nan=True, allow_infinity=True) | st.floats(900.0, 2100.0),
            max_size=4,
        ),
        max_size=10,
    )
)
def test_a_write_with_a_setpoint_outside_its_limits_sends_nothing(writes):
    clock = ManualClock()
    board = SimulatedMaestro(
        settings=MaestroSettings(channels={c: ChannelConfig(100.0, 4000.0) for c in range(4)})
    )
    driver = MaestroDriver(Connection(lambda: LoopTransport(board, clock.now), lambda: 0.0))
    driver.open()
    driver.configure(CHANNELS)
    for setpoints in writes:
        inside = all(c < 4 and 1000.0 <= pulse <= 2000.0 for c, pulse in setpoints.items())
        before = len(board.log)
        try:
            driver.write(setpoints)
        except BoardError:
            assert not inside
            assert len(board.log) == before
        else:
            assert inside
    for entry in board.log:
        if entry.raw[0] == 0x84:
            assert 4000 <= entry.data[1] + 128 * entry.data[2] <= 8000


def test_a_channel_too_many_on_a_board_of_unknown_model_is_found_out(connect):
    with pytest.raises(BoardProtocolError, match="did not accept the channel settings"):
        connect(SimulatedMaestro(), channels=[ChannelSettings(6, 1000, 2000)])


def test_stop_holds_what_is_on_where_it_is_and_leaves_off_what_is_off(clock: ManualClock, connect):
    board = SimulatedMaestro()
    driver = connect(board, channels=[ChannelSettings(c, 1000.0, 2000.0, speed=1000.0) for c in range(3)])
    driver.write({0: 1000.0, 1: 2000.0})
    driver.write({0: 2000.0, 1: 1000.0})
    clock.advance(0.2)
    driver.stop()
    clock.advance(5.0)
    assert driver.read().positions == {0: 1200.0, 1: 1800.0, 2: None}


def test_stop_holds_a_channel_that_stands_outside_its_range(clock: ManualClock, connect):
    board = SimulatedMaestro(settings=MaestroSettings(channels={0: ChannelConfig(500.0, 2500.0)}))
    board.advance(clock.now())
    board.feed(bytes.fromhex("84 00 60 46"))  # 2264 µs
    driver = connect(board)
    driver.stop()
    assert driver.read().positions[0] == board.target_us(0) == 2264.0
    assert [entry.raw.hex(" ") for entry in board.log].count(
        "84 00 60 46"
    ) == 2  # the test's own, and the stop's


def test_an_error_is_told_by_the_next_read_whatever_saw_it_first(clock: ManualClock, connect):
    board = SimulatedMaestro(settings=MaestroSettings(timeout_units=50))
    driver = connect(board)
    for call in (lambda: None, lambda: driver.configure(CHANNELS), driver.stop):
        clock.advance(1.0)
        call()
        assert driver.read().errors[0].startswith("serial timeout")
        assert driver.read().errors == ()


@pytest.mark.parametrize("crc", [False, True])
def test_whether_the_board_wants_crcs_is_found_out_without_an_error(connect, crc):
    board = holding_maestro(crc=crc)
    driver = connect(board)
    assert driver.read().positions[0] == 1500.0
    driver.write({0: 1600.0})
    assert driver.read().errors == ()
    assert board.target_us(0) == 1600.0
    assert all(len(entry.raw) == len(entry.data) + 1 + crc for entry in board.log)


def test_a_board_without_crc_that_is_late_is_not_taken_for_one_with(clock: ManualClock, connect):
    faults = FaultyModel(SimulatedMaestro())
    faults.advance(clock.now())
    faults.inject(Fault.DELAY_REPLY, delay_s=0.8)
    assert connect(faults).read().errors == ()


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
