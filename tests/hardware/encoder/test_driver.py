"""The driver against the simulated board in memory: what a day with the arm brings."""

from __future__ import annotations

import math

import pytest
from tests.hardware.encoder.kit import AXES, CHANNELS, PLANTS, Bench, encoder_axis

from armctl.errors import BoardError, PortError, StateError
from armctl.hardware import ChannelSettings, Source
from armctl.hardware.encoder.axes import EncoderSettings
from armctl.hardware.encoder.driver import SILENCE_NOTE, EncoderDriver
from armctl.hardware.encoder.messages import Mode, seal, unseal
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard
from armctl.hardware.transport import Connection, PortInfo
from armctl.runtime.clock import ManualClock


def test_identity(clock: ManualClock):
    identity = Bench(clock).driver.open()
    assert identity.kind == "armctl encoder board, firmware 1.1.0"
    assert identity.port == "loop"
    assert identity.simulated is False
    assert identity.notes == (SILENCE_NOTE,)
    assert Bench(clock, simulated=True).driver.open().notes == ()


def test_opening_and_configuring_move_nothing(bench: Bench):
    readback = bench.driver.read()
    assert readback.positions == {0: None, 1: None, 2: None}
    assert readback.source is Source.MEASURED
    assert (readback.errors, readback.faults, readback.powered) == ((), {}, False)
    assert readback.homing.homed == {0: False, 1: False, 2: False}
    assert readback.homing.running is None
    assert not readback.homing.done
    assert [axis.place for axis in bench.board.axes[:3]] == [-200.0, 100.0, 50.0]
    assert bench.executed()[:3] == ["HELLO", "WD 500", "PAIR NONE"]


def test_settings_are_sent_once(bench: Bench):
    told = len(bench.executed())
    bench.driver.configure(CHANNELS)
    assert len(bench.executed()) == told
    bench.driver.configure(CHANNELS[:2])
    assert "CFG 2 hord=0" in bench.executed()[told:]


def test_settings_do_not_change_while_the_motors_are_on(homed: Bench):
    homed.driver.configure(CHANNELS)
    with pytest.raises(StateError, match="the motors are on"):
        homed.driver.configure(CHANNELS[:2])
    assert homed.driver.read().positions.keys() == {0, 1, 2}


def test_a_board_that_another_program_left_on_is_not_configured(homed: Bench):
    homed.driver.open()
    with pytest.raises(StateError, match="release first, or wait half a second"):
        homed.driver.configure(CHANNELS)


def test_homing_goes_axis_by_axis_and_tells_how_far_it_is(bench: Bench):
    bench.driver.home()
    running: list[int | None] = []
    for _ in range(1000):
        bench.clock.advance(0.02)
        readback = bench.driver.read()
        homing = readback.homing
        if homing.running not in running:
            running.append(homing.running)
        for axis, homed in homing.homed.items():
            assert (readback.positions[axis] is not None) is homed
        if homing.done and homing.running is None:
            break
    assert running == [2, 0, 1, None]
    assert bench.wait(0.2).positions == {0: 0.0, 1: 0.0, 2: 0.0}
    assert readback.powered is True
    assert [axis.place for axis in bench.board.axes[:3]] == pytest.approx([0.0, 0.0, 0.0], abs=0.5)


class SlowToSay(SimulatedEncoderBoard):
    """Says for a while that it is homing, when every axis has its zero already."""

    lingers = True

    def advance(self, now: float) -> bytes:
        lines = super().advance(now).splitlines(keepends=True)
        return b"".join(map(self._still_homing, lines))

    def _still_homing(self, line: bytes) -> bytes:
        text = unseal(line.rstrip())
        return seal(text.replace(" N ", " H ", 1)) if self.lingers and text.startswith("@") else line


def test_homing_goes_on_until_the_board_says_that_it_is_done(clock: ManualClock):
    board = SlowToSay(PLANTS)
    bench = Bench(clock, board).connect()
    bench.home()
    readback = bench.wait(0.1)
    assert readback.homing.done
    assert readback.homing.running == 1  # the last one, not yet let go
    with pytest.raises(StateError, match="the board is homing"):
        bench.driver.write({0: 0.0})
    board.lingers = False
    assert bench.wait(0.1).homing.running is None
    bench.driver.write({0: 0.0})


def test_homing_again_forgets_the_zeros_first(homed: Bench):
    homed.driver.home()
    assert homed.driver.read().positions == {0: None, 1: None, 2: None}
    with pytest.raises(StateError, match="homing"):
        homed.driver.home()
    with pytest.raises(StateError, match="the board is homing"):
        homed.driver.write({0: 0.0})


def test_positions_are_measured_and_follow_the_setpoints(homed: Bench):
    for step in range(51):
        homed.driver.write({0: 10.0 * step, 1: -10.0 * step})
        homed.clock.advance(0.02)
        readback = homed.driver.read()
        # 500 counts/s behind by 30 ms of interpolation, 15 ms of the motor and 20 ms of the status line
        assert abs(readback.positions[0] - 10.0 * step) <= 40.0
    assert homed.wait(0.2).positions == {0: 500.0, 1: -500.0, 2: 0.0}
    assert homed.board.log[-1] in ("PING", "P 500 -500 - - - - 30")


def test_setpoints_before_homing_are_refused_here(bench: Bench):
    told = len(bench.executed())
    with pytest.raises(StateError, match=r"axis 0, 2: not homed.*home first"):
        bench.driver.write({2: 0.0, 0: 0.0})
    assert len(bench.executed()) == told
    assert bench.board.mode is Mode.OFF


@pytest.mark.parametrize("bad", [1001.0, -1001.0, math.nan, math.inf])
def test_setpoints_outside_their_limits_are_refused_here(homed: Bench, bad):
    told = len(homed.executed())
    with pytest.raises(BoardError, match=r"axis 0: .* nothing was sent"):
        homed.driver.write({1: 0.0, 0: bad})
    with pytest.raises(BoardError, match="axis 4 is not configured"):
        homed.driver.write({4: 0.0})
    assert len(homed.executed()) == told


def test_writing_nothing_sends_nothing(homed: Bench):
    homed.driver.release()
    homed.driver.write({})
    assert homed.board.mode is Mode.OFF


def test_release_and_the_first_setpoint_after_it(homed: Bench):
    homed.stream({0: 300.0}, 1.0)
    homed.driver.release()
    readback = homed.wait(0.2)
    assert homed.board.mode is Mode.OFF
    assert (readback.powered, readback.errors) == (False, ())
    assert readback.positions[0] == 300.0, "encoders count with the motors off too"
    homed.driver.write({0: readback.positions[0]})
    assert homed.driver.read().powered is True
    assert "EN 1" in homed.executed()[-2:]


def test_stop_holds_until_the_next_setpoint(homed: Bench):
    homed.driver.write({0: 0.0})
    homed.clock.advance(0.02)
    homed.driver.read()
    for step in range(1, 20):
        homed.driver.write({0: 20.0 * step})
        homed.clock.advance(0.02)
        homed.driver.read()
    homed.driver.stop()
    stood = homed.wait(0.5).positions[0]
    assert homed.board.mode is Mode.HELD
    assert 300.0 < stood < 420.0
    assert homed.wait(0.5).positions[0] == stood
    assert homed.driver.read().powered is True
    readback = homed.stream({0: stood - 10.0}, 0.5)
    assert homed.board.mode is Mode.ON
    assert readback.positions[0] == stood - 10.0
    assert readback.errors == ()


def test_stop_ends_homing_and_homing_begins_again(bench: Bench):
    bench.driver.home()
    bench.wait(0.2)
    bench.driver.stop()
    readback = bench.wait(0.1)
    assert bench.board.mode is Mode.HELD
    assert readback.homing.running is None
    assert not readback.homing.done
    bench.home()


def test_release_ends_homing(bench: Bench):
    bench.driver.home()
    bench.wait(0.2)
    bench.driver.release()
    assert bench.wait(0.2).homing.running is None
    assert bench.board.mode is Mode.OFF


def test_stop_of_motors_that_are_off(bench: Bench):
    bench.driver.stop()
    assert bench.board.mode is Mode.OFF
    bench.home()


def test_reading_alone_keeps_the_board_awake(homed: Bench):
    assert homed.wait(3.0).powered is True
    assert homed.executed().count("PING") >= 10


def test_silence_is_told_and_nothing_goes_on_by_itself(homed: Bench):
    homed.clock.advance(0.6)
    readback = homed.driver.read()
    assert readback.powered is False
    assert len(readback.errors) == 1 and readback.errors[0].startswith("watchdog: ")
    assert readback.positions[0] == 0.0
    told = homed.executed().count("EN 1")
    for _ in range(5):
        with pytest.raises(StateError, match="switched its motors off by itself"):
            homed.driver.write({0: 0.0})
        homed.clock.advance(0.02)
        assert homed.driver.read().errors == readback.errors
        homed.driver.configure(CHANNELS)
    assert homed.executed().count("EN 1") == told
    homed.driver.release()
    assert homed.driver.read().errors == ()
    assert homed.stream({0: 50.0}, 0.5).positions[0] == 50.0


def test_a_jammed_axis_trips_and_says_so(homed: Bench):
    homed.stream({0: 100.0}, 0.5)
    homed.board.axes[0].jammed = True
    readback = homed.driver.read()
    for step in range(60):
        homed.driver.write({0: 100.0 + min(10.0 * step, 300.0)})
        homed.clock.advance(0.02)
        readback = homed.driver.read()
        if readback.faults:
            break
    assert readback.faults.keys() == {0}
    assert readback.faults[0].startswith("stalled: ")
    assert readback.powered is False
    assert readback.homing.homed[0] is True
    with pytest.raises(StateError, match="release"):
        homed.driver.write({0: 100.0})
    homed.board.axes[0].jammed = False
    homed.driver.release()
    assert homed.driver.read().faults == {}
    assert homed.stream({0: 150.0}, 0.5).positions[0] == 150.0


def test_an_overloaded_axis_falls_behind(homed: Bench):
    homed.board.axes[0].jammed = True
    homed.stream({0: 0.0}, 0.04)
    for _ in range(30):
        homed.driver.write({0: 1000.0})
        homed.clock.advance(0.02)
        if homed.driver.read().faults:
            break
    assert homed.driver.read().faults[0].startswith("fell too far behind")


def test_a_torn_encoder_wire_loses_the_zero(homed: Bench):
    homed.board.axes[1].torn = True
    readback = homed.driver.read()
    for _ in range(100):
        homed.driver.write({1: 300.0})
        homed.clock.advance(0.02)
        readback = homed.driver.read()
        if readback.faults:
            break
    assert readback.faults.keys() == {1}
    assert readback.faults[1].startswith("its encoder counted nothing")
    assert readback.positions[1] is None
    homed.driver.release()
    with pytest.raises(StateError, match="axis 1: not homed"):
        homed.driver.write({1: 0.0})


@pytest.mark.parametrize(("closed", "detail"), [(False, "not found"), (True, "stays closed")])
def test_homing_that_fails(bench: Bench, closed, detail):
    bench.board.axes[2].switch_stuck = closed
    bench.driver.home()
    readback = bench.driver.read()
    for _ in range(500):
        bench.clock.advance(0.02)
        readback = bench.driver.read()
        if readback.faults:
            break
    assert readback.faults.keys() == {2}
    assert readback.faults[2].startswith("homing failed")
    assert detail in readback.faults[2]
    assert readback.powered is False
    assert detail in bench.wait(0.1).faults[2]
    bench.board.axes[2].switch_stuck = None
    bench.home()


def test_homing_from_beyond_the_switch(bench: Bench):
    bench.board.axes[2].place = 600.0
    bench.home()
    assert bench.board.axes[2].place == pytest.approx(0.0, abs=0.5)


def test_homing_by_stall(clock: ManualClock):
    bench = Bench(clock)
    axis = encoder_axis(5, home_toward=-1, home_by="stall")
    bench.driver = EncoderDriver(Connection(bench.open_line, clock.now), EncoderSettings((axis,)))
    bench.driver.open()
    bench.driver.configure([ChannelSettings(5, 50.0, 1000.0, 2000.0, 20000.0)])
    bench.driver.home()
    readback = bench.wait(8.0)
    assert readback.positions == {5: 0.0}
    assert readback.homing.done
    assert bench.board.axes[5].place == -1500.0
    assert bench.stream({5: 60.0}, 0.5).positions == {5: 60.0}


def test_a_board_that_has_started_anew_says_so_and_must_be_homed(homed: Bench):
    homed.board.restart("brownout")
    readback = homed.driver.read()
    assert readback.powered is False
    assert readback.positions == {0: None, 1: None, 2: None}
    assert "the board has started anew (its supply voltage sagged)" in readback.errors[0]
    assert "home again" in readback.errors[0]
    assert any(words.startswith("brown-out: ") for words in readback.errors)
    with pytest.raises(StateError, match="by itself"):
        homed.driver.write({0: 0.0})
    assert homed.wait(1.0).errors == readback.errors
    homed.driver.release()
    assert homed.driver.read().errors == ()
    with pytest.raises(StateError, match="not homed"):
        homed.driver.write({0: 0.0})
    told = len(homed.executed())
    homed.home()
    assert "CFG 0 min=-1000 max=1000 vmax=2000 amax=20000" in homed.executed()[told:]
    assert homed.stream({0: 50.0}, 0.5).positions[0] == 50.0


def test_a_board_that_has_started_anew_while_its_motors_were_off(bench: Bench):
    bench.board.restart("external")
    assert "port was opened by another program" in bench.driver.read().errors[0]
    bench.home()
    assert bench.driver.read().errors == ()


def test_the_emergency_byte_of_somebody_else(homed: Bench):
    homed.board.feed(b"\x18")
    homed.clock.advance(0.1)
    readback = homed.driver.read()
    assert readback.powered is False
    assert "emergency byte" in readback.errors[0]


def test_what_was_wrong_before_is_told_once(homed: Bench):
    homed.clock.advance(0.6)
    identity = homed.driver.open()
    assert identity.earlier[0].startswith("before armctl connected, the board had reported: watchdog")
    homed.driver.configure(CHANNELS)
    readback = homed.driver.read()
    assert readback.errors == ()
    assert readback.homing.done, "it still knows its zeros"


def test_notes_on_a_fault_and_on_a_bad_start(clock: ManualClock):
    bench = Bench(clock).connect()
    bench.board.axes[2].switch_stuck = False
    bench.driver.home()
    bench.wait(8.0)
    assert "axis 2: homing failed" in bench.driver.open().earlier[0]
    bench.board.restart("watchdog")
    assert "its last start was after a watchdog reset" in bench.driver.open().earlier[0]


def test_more_axes_than_the_board_has(clock: ManualClock):
    bench = Bench(clock)
    driver = EncoderDriver(
        Connection(bench.open_line, clock.now), EncoderSettings(tuple([*AXES, encoder_axis(6)]))
    )
    with pytest.raises(BoardError, match=r"the board has axes 0 … 5, but the robot file uses axis 6"):
        driver.open()
    with pytest.raises(BoardError, match="not connected"):
        driver.read()


@pytest.mark.parametrize("call", ["read", "stop", "release", "home", "configure", "write"])
def test_nothing_works_before_open(clock: ManualClock, call):
    arguments = {"configure": [CHANNELS], "write": [{0: 1.0}]}.get(call, [])
    with pytest.raises(BoardError, match="not connected"):
        getattr(Bench(clock).driver, call)(*arguments)


def test_nothing_can_be_homed_before_it_is_configured(clock: ManualClock):
    bench = Bench(clock)
    bench.driver.open()
    with pytest.raises(BoardError, match="configure the board first"):
        bench.driver.home()
    with pytest.raises(BoardError, match="axis 0 is not configured"):
        bench.driver.write({0: 0.0})


def test_a_port_that_the_listing_rules_out_is_not_opened():
    port = PortInfo("/dev/ttyACM1", "Arduino Mega", "", "1", False, "no permission")
    driver = EncoderDriver(
        Connection("/dev/ttyACM1", lambda: 0.0, ports=lambda: [port]), EncoderSettings(AXES)
    )
    with pytest.raises(PortError, match="/dev/ttyACM1: no permission"):
        driver.open()


def test_closing_twice_and_opening_again(homed: Bench):
    homed.driver.close()
    homed.driver.close()
    homed.clock.advance(1.0)
    homed.connect()
    readback = homed.driver.read()
    assert readback.homing.done
    assert homed.stream({0: 20.0}, 0.5).positions[0] == 20.0


class DeafTo(SimulatedEncoderBoard):
    """Does not receive the bursts that contain ``lost``."""

    lost: bytes | None = None

    def feed(self, data: bytes) -> bytes:
        return b"" if self.lost is not None and self.lost in data else super().feed(data)


def test_settings_of_which_half_were_sent_are_sent_again(clock: ManualClock):
    board = DeafTo(PLANTS)
    bench = Bench(clock, board).connect()
    told = len(board.log)
    board.lost = b"CFG 1"
    with pytest.raises(BoardError, match="did not answer"):
        bench.driver.configure(CHANNELS[:1])
    board.lost = None
    told = len(board.log)
    bench.driver.configure(CHANNELS)
    assert list(board.log)[told : told + 2] == ["WD 500", "PAIR NONE"]
