"""The driver against the simulated board in memory: what a day with the arm, and with its cable, brings."""

from __future__ import annotations

import pytest
from tests.hardware.encoder.kit import AXES, CHANNELS, PLANTS, Bench, encoder_axis

from armctl.errors import BoardError, BoardTimeoutError, StateError
from armctl.hardware import ChannelSettings, Source
from armctl.hardware.driver import HomingState
from armctl.hardware.encoder.driver import SILENCE_NOTE
from armctl.hardware.encoder.messages import BoardFlag, FaultKind, Mode, seal
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard
from armctl.hardware.faults import Fault
from armctl.protocol import ManualClock


def test_identity(clock: ManualClock):
    identity = Bench(clock).driver.open()
    assert identity.kind == "armctl encoder board, firmware 1.3.0"
    assert (identity.port, identity.simulated, identity.notes) == ("loop", False, (SILENCE_NOTE,))
    assert Bench(clock, simulated=True).driver.open().notes == ()


def test_opening_and_configuring_move_nothing(bench: Bench):
    assert bench.executed()[:3] == ["HELLO", "WD 500", "PAIR NONE"]
    readback = bench.driver.read()
    assert (readback.errors, readback.faults, readback.powered) == ((), {}, False)
    assert (readback.positions, readback.source) == ({0: None, 1: None, 2: None}, Source.MEASURED)
    assert readback.homing == HomingState({0: False, 1: False, 2: False})
    assert [axis.place for axis in bench.board.axes[:3]] == [-200.0, 100.0, 50.0]


def test_settings_are_sent_once(bench: Bench):
    sent = len(bench.executed())
    bench.driver.configure(CHANNELS)
    assert len(bench.executed()) == sent
    bench.driver.configure(CHANNELS[:2])
    assert "CFG 2 hord=0" in bench.executed()[sent:]


def test_settings_of_which_half_were_sent_are_sent_again(bench: Bench):
    bench.board.lost = b"CFG 1"
    with pytest.raises(BoardTimeoutError, match="did not answer"):
        bench.driver.configure(CHANNELS[:1])
    bench.board.lost = None
    sent = len(bench.executed())
    bench.driver.configure(CHANNELS)
    assert bench.executed()[sent : sent + 2] == ["WD 500", "PAIR NONE"]


def test_settings_do_not_change_while_the_motors_are_on(homed: Bench):
    homed.driver.configure(CHANNELS)
    with pytest.raises(StateError, match="the motors are on"):
        homed.driver.configure(CHANNELS[:2])
    assert homed.driver.read().positions.keys() == {0, 1, 2}
    homed.driver.open()  # as another program finds it
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
    bench.driver.home()
    assert bench.driver.read().positions == {0: None, 1: None, 2: None}, (
        "homing again forgets the zeros first"
    )
    with pytest.raises(StateError, match="homing"):
        bench.driver.home()


class SlowToSay(SimulatedEncoderBoard):
    """Says for a while that it is homing, when every axis has its zero already."""

    lingers = True

    def _say(self, text: str) -> None:
        super()._say(text.replace(" N ", " H ", 1) if self.lingers else text)


def test_homing_goes_on_until_the_board_says_that_it_is_done(clock: ManualClock):
    bench = Bench(clock, SlowToSay(PLANTS)).connect()
    bench.home()
    readback = bench.wait(0.1)
    assert readback.homing.done
    assert readback.homing.running == 1  # the last one, not yet let go
    with pytest.raises(StateError, match="the board is homing"):
        bench.driver.write({0: 0.0})
    bench.board.lingers = False
    assert bench.wait(0.1).homing.running is None
    bench.driver.write({0: 0.0})


@pytest.mark.parametrize(("call", "mode"), [("stop", Mode.HELD), ("release", Mode.OFF)])
def test_homing_that_is_ended_can_begin_again(bench: Bench, call, mode):
    getattr(bench.driver, call)()
    assert bench.board.mode is Mode.OFF
    bench.driver.home()
    bench.wait(0.2)
    getattr(bench.driver, call)()
    readback = bench.wait(0.1)
    assert bench.board.mode is mode
    assert (readback.homing.running, readback.homing.done) == (None, False)
    bench.home()


@pytest.mark.parametrize(("closed", "detail"), [(False, "not found"), (True, "stays closed")])
def test_homing_that_fails(bench: Bench, closed, detail):
    bench.board.axes[2].switch_stuck = closed
    bench.driver.home()
    readback = bench.wait(10.0)
    assert readback.faults.keys() == {2}
    assert readback.faults[2].startswith("homing failed")
    assert readback.powered is False
    assert detail in readback.faults[2]
    assert detail in bench.wait(0.1).faults[2]
    bench.board.axes[2].switch_stuck = None
    bench.home()


def test_homing_from_beyond_the_switch(bench: Bench):
    bench.board.axes[2].place = 600.0
    bench.home()
    assert bench.board.axes[2].place == pytest.approx(0.0, abs=0.5)


def test_homing_by_stall(clock: ManualClock):
    bench = Bench(clock, axes=(encoder_axis(5, home_toward=-1, home_by="stall"),))
    bench.driver.open()
    bench.driver.configure([ChannelSettings(5, 50.0, 1000.0, 2000.0, 20000.0)])
    bench.driver.home()
    readback = bench.wait(8.0)
    assert readback.positions == {5: 0.0}
    assert readback.homing.done
    assert bench.board.axes[5].place == -1500.0
    assert bench.stream({5: 60.0}, 0.5).positions == {5: 60.0}


def test_positions_are_measured_and_follow_the_setpoints(homed: Bench):
    for step in range(51):
        homed.driver.write({0: 10.0 * step, 1: -10.0 * step})
        homed.clock.advance(0.02)
        readback = homed.driver.read()
        # 500 counts/s behind by 30 ms of interpolation, 15 ms of the motor and 20 ms of the status line
        assert abs(readback.positions[0] - 10.0 * step) <= 40.0
    assert homed.wait(0.2).positions == {0: 500.0, 1: -500.0, 2: 0.0}
    assert homed.board.log[-1] in ("PING", "P 500 -500 - - - - 30")


def test_setpoints_that_are_refused_here(bench: Bench):
    def refused(error, words, setpoints):
        sent = len(bench.executed())
        with pytest.raises(error, match=words):
            bench.driver.write(setpoints)
        assert len(bench.executed()) == sent

    refused(StateError, r"axis 0, 2: not homed.*home first", {2: 0.0, 0: 0.0})
    assert bench.board.mode is Mode.OFF
    bench.home()
    refused(BoardError, r"axis 0: .* nothing was sent", {1: 0.0, 0: 1001.0})
    refused(BoardError, "axis 4 is not configured", {4: 0.0})


def test_release_and_the_first_setpoint_after_it(homed: Bench):
    homed.stream({0: 300.0}, 1.0)
    homed.driver.release()
    homed.driver.write({})
    readback = homed.wait(0.2)
    assert homed.board.mode is Mode.OFF
    assert (readback.powered, readback.errors) == (False, ())
    assert readback.positions[0] == 300.0, "encoders count with the motors off too"
    homed.driver.write({0: readback.positions[0]})
    assert homed.driver.read().powered is True
    assert "EN 1" in homed.executed()[-2:]


def test_stop_holds_until_the_next_setpoint(homed: Bench):
    for step in range(20):
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


def test_reading_alone_keeps_the_board_awake(homed: Bench):
    assert homed.wait(3.0).powered is True
    assert homed.executed().count("PING") >= 10


# What the board does by itself is reported until the user has taken note.


def test_silence_is_reported_and_nothing_goes_on_by_itself(homed: Bench):
    homed.clock.advance(0.6)
    readback = homed.driver.read()
    assert (readback.powered, readback.positions[0]) == (False, 0.0)
    assert len(readback.errors) == 1 and readback.errors[0].startswith("watchdog: ")
    sent = len(homed.executed())
    for _ in range(5):
        with pytest.raises(StateError, match="switched its motors off by itself"):
            homed.driver.write({0: 0.0})
        homed.clock.advance(0.02)
        assert homed.driver.read().errors == readback.errors
        homed.driver.configure(CHANNELS)
    assert "EN 1" not in homed.executed()[sent:]
    homed.driver.release()
    assert homed.driver.read().errors == ()
    assert homed.stream({0: 50.0}, 0.5).positions[0] == 50.0


@pytest.mark.parametrize(
    ("broken", "target", "words", "keeps_zero"),
    [
        ("jammed", 400.0, "stalled: ", True),
        ("jammed", 1000.0, "fell too far behind", True),
        ("torn", 300.0, "its encoder counted nothing", False),
    ],
)
def test_an_axis_that_trips(homed: Bench, broken, target, words, keeps_zero):
    homed.stream({0: 100.0}, 0.5)
    setattr(homed.board.axes[0], broken, True)
    readback = homed.stream({0: target}, 2.0)
    assert readback.faults.keys() == {0}
    assert readback.faults[0].startswith(words)
    assert readback.powered is False
    assert readback.homing.homed[0] is keeps_zero
    with pytest.raises(StateError, match="release"):
        homed.driver.write({0: 100.0})
    setattr(homed.board.axes[0], broken, False)
    homed.driver.release()
    assert homed.driver.read().faults == {}
    if keeps_zero:
        assert homed.stream({0: 150.0}, 0.5).positions[0] == 150.0
    else:
        with pytest.raises(StateError, match="axis 0: not homed"):
            homed.driver.write({0: 0.0})


def test_lost_edges_are_told_until_they_are_too_many(homed: Bench):
    homed.stream({0: 100.0}, 0.5)
    homed.board.axes[0].lose_edges(2)
    readback = homed.stream({0: 120.0}, 0.5)
    assert readback.warnings.keys() == {0}
    assert readback.warnings[0].startswith(
        "its encoder has lost 2 edges since homing: it may be off by 4 counts"
    )
    assert (readback.errors, readback.faults, readback.powered) == ((), {}, True)
    homed.board.axes[0].lose_edges(3)
    readback = homed.stream({0: 100.0}, 0.5)
    assert readback.faults.keys() == {0}
    assert readback.faults[0].startswith("its encoder lost more than 4 edges")
    assert (readback.powered, readback.homing.homed[0], readback.warnings) == (False, False, {})
    homed.driver.release()
    with pytest.raises(StateError, match="axis 0: not homed"):
        homed.driver.write({0: 0.0})
    homed.home()
    assert homed.stream({0: 150.0}, 0.5).positions[0] == 150.0


def test_edges_lost_while_the_motors_are_off(homed: Bench):
    homed.driver.release()
    homed.board.axes[1].lose_edges(5)
    readback = homed.wait(0.1)
    assert readback.faults.keys() == {1}
    assert readback.homing.homed == {0: True, 1: False, 2: True}


def test_homing_tells_the_settings_again(homed: Bench):
    """A board whose restart went unseen would home with those of another arm."""
    homed.driver.release()
    sent = len(homed.executed())
    homed.home()
    assert "CFG 0 min=-1000 max=1000 vmax=2000 amax=20000" in homed.executed()[sent:]
    sent = len(homed.executed())
    homed.driver.home()
    assert not any(line.startswith("CFG") for line in homed.executed()[sent:]), "not while the motors are on"


@pytest.mark.parametrize(
    ("cause", "words"),
    [
        ("unexpected", "in the middle of work"),
        ("watchdog", "its program hung"),
        (None, "its reset button was pressed"),
    ],
)
def test_why_it_has_started_anew_is_told_once(homed: Bench, cause, words):
    homed.driver.write({0: 10.0})
    homed.board.reset(cause)
    homed.driver.write({0: 12.0})
    (restart,) = homed.wait(0.1).errors
    assert "the board has started anew" in restart and words in restart


def test_a_board_without_time_for_its_control_says_so(homed: Bench):
    homed.board._flags |= BoardFlag.LATE
    assert "no time to control its motors" in homed.wait(0.1).errors[0]
    homed.driver.release()
    assert homed.driver.read().errors == ()


def test_a_board_that_has_started_anew_says_so_and_must_be_homed(homed: Bench):
    homed.board.reset("brownout")
    readback = homed.driver.read()
    assert readback.powered is False
    assert readback.positions == {0: None, 1: None, 2: None}
    (restart,) = readback.errors
    assert restart.startswith("the board has started anew (its supply voltage sagged)")
    with pytest.raises(StateError, match="by itself"):
        homed.driver.write({0: 0.0})
    assert homed.wait(1.0).errors == readback.errors
    homed.driver.release()
    assert homed.driver.read().errors == ()
    sent = len(homed.executed())
    homed.home()
    assert "CFG 0 min=-1000 max=1000 vmax=2000 amax=20000" in homed.executed()[sent:]


def test_a_board_that_has_started_anew_while_its_motors_were_off(bench: Bench):
    bench.board.reset("external")
    assert "port was opened by another program" in bench.driver.read().errors[0]
    bench.home()
    assert bench.driver.read().errors == ()
    bench.board.reset("watchdog")
    assert "its program hung" in bench.driver.open().earlier[0]
    bench.driver.configure(CHANNELS)
    bench.board.reset("unexpected")
    assert bench.driver.open().earlier == (), "the port was opened soon after another program had spoken"
    bench.board.reset("external")
    (earlier,) = bench.driver.open().earlier
    assert "the board started anew while a program worked with it" in earlier


@pytest.mark.parametrize(
    ("sent", "words"), [(b"\x18", "emergency byte"), (seal("7 EN 0"), "switched its motors off by itself")]
)
def test_motors_that_another_program_switches_off(homed: Bench, sent, words):
    homed.board.feed(sent)
    homed.clock.advance(0.1)
    readback = homed.driver.read()
    assert readback.powered is False
    assert words in readback.errors[0]


def test_what_was_wrong_before_is_reported_once(homed: Bench):
    homed.board.axes[1].fault = FaultKind.STALL
    homed.clock.advance(0.6)
    earlier = homed.driver.open().earlier
    assert earlier[0].startswith("before armctl connected, the board had reported: watchdog")
    assert "axis 1: stalled" in earlier[1]
    homed.driver.configure(CHANNELS)
    readback = homed.driver.read()
    assert readback.errors == ()
    assert readback.homing.done, "it still knows its zeros"


def test_more_axes_than_the_board_has(clock: ManualClock):
    driver = Bench(clock, axes=(*AXES, encoder_axis(6))).driver
    with pytest.raises(BoardError, match=r"the board has axes 0 … 5, but the robot file uses axis 6"):
        driver.open()
    with pytest.raises(BoardError, match="not connected"):
        driver.read()


@pytest.mark.parametrize("call", ["read", "stop", "release", "home", "configure", "write"])
def test_nothing_works_before_open(clock: ManualClock, call):
    arguments = {"configure": [CHANNELS], "write": [{0: 1.0}]}.get(call, [])
    driver = Bench(clock).driver
    with pytest.raises(BoardError, match="not connected"):
        getattr(driver, call)(*arguments)
    driver.open()
    with pytest.raises(BoardError, match="configure the board first"):
        driver.home()


# Lost, garbled, halved and late bytes, and a cable that is pulled.

LOSSES = [Fault.DROP_COMMAND, Fault.GARBLE_COMMAND, Fault.DROP_REPLY, Fault.GARBLE_REPLY, Fault.HALF_REPLY]


@pytest.mark.parametrize("fault", LOSSES)
@pytest.mark.parametrize(
    ("call", "line"), [("write", "P 5 - - - - - 30"), ("home", "HOME"), ("release", "EN 0")]
)
def test_a_lost_line_is_sent_again_and_done_once(homed: Bench, fault, call, line):
    homed.stream({0: 0.0}, 0.1)
    done = len(homed.executed())
    homed.faults.inject(fault)
    getattr(homed.driver, call)(*([{0: 5.0}] if call == "write" else []))
    assert homed.wait(0.06).errors == ()
    assert homed.faults.pending == 0
    assert homed.executed()[done:].count(line) == 1
    if call == "write":
        assert homed.wait(0.5).positions[0] == 5.0


def test_lines_that_get_no_answer_are_counted(homed: Bench):
    asked = lost = 0
    for step in range(60):
        if step % 6 == 0:
            homed.faults.inject(Fault.DROP_COMMAND)
        homed.driver.write({0: float(step)})
        homed.clock.advance(0.02)
        readback = homed.driver.read()
        asked, lost = asked + readback.asked, lost + readback.lost
    assert 60 <= asked <= 75
    assert 9 <= lost <= 11
    assert homed.wait(0.5).lost == 0


@pytest.mark.parametrize("seed", range(20))
def test_a_line_that_garbles_one_thing_in_three(clock: ManualClock, seed):
    bench = Bench(clock, seed=seed).connect()
    bench.home()
    for step in range(100):
        if step % 3 == 0:
            bench.faults.inject(LOSSES[(step // 3 + seed) % len(LOSSES)])
        bench.driver.write({0: 2.0 * step, 1: -2.0 * step})
        bench.clock.advance(0.02)
        # A flipped bit may make a byte of a line one that is obeyed at once: the arm then holds, and says so.
        refused = bench.driver.read().errors
        assert all("refused" in words or "emergency" in words for words in refused), refused
        if refused:
            return
    assert bench.faults.pending <= 2
    assert bench.stream({0: 198.0, 1: -198.0}, 0.5).positions == {0: 198.0, 1: -198.0, 2: 0.0}


@pytest.mark.parametrize(
    ("late", "refused"),
    [
        (5.0, ()),
        (200.0, ("a setpoint was refused: outside the soft limits (the board says: LIMIT 0 200 -1000 100)",)),
    ],
)
def test_a_late_answer_is_not_taken_for_the_next_one(homed: Bench, late, refused):
    homed.stream({0: 0.0}, 0.1)
    homed.board.axes[0].settings["max"] = 100  # less than the driver has sent
    homed.faults.inject(Fault.DELAY_REPLY, delay_s=0.03)
    homed.driver.write({0: late})
    assert homed.driver.read().errors == ()
    homed.clock.advance(0.02)
    homed.driver.write({0: 6.0})
    homed.clock.advance(0.02)
    assert homed.driver.read().errors == refused
    readback = homed.wait(0.5)
    assert (readback.errors, readback.positions[0]) == ((), 6.0)


def test_no_answer_at_all_is_a_timeout_and_the_next_reading_works(homed: Bench):
    homed.stream({0: 0.0}, 0.1)
    homed.faults.inject(Fault.DROP_COMMAND, count=8)
    began = homed.clock.now()
    homed.driver.write({0: 7.0})
    homed.driver.read()
    assert homed.clock.now() == began, "neither waits for an answer"
    with pytest.raises(BoardTimeoutError, match=r"loop: the board did not answer 'P 7 .*' within 100 ms"):
        homed.stream({0: 7.0}, 1.0)
    assert homed.clock.now() - began == pytest.approx(0.12, abs=0.001)
    while homed.faults.pending:
        homed.driver.write({0: 8.0})
    homed.driver.write({0: 8.0})
    readback = homed.wait(0.5)
    assert (readback.errors, readback.positions[0]) == ((), 8.0)


def test_a_garbled_timeout_says_so(homed: Bench):
    homed.faults.inject(Fault.GARBLE_REPLY, count=10)
    with pytest.raises(BoardTimeoutError, match="lines from it were garbled"):
        homed.stream({0: 5.0}, 1.0)


def test_homing_after_a_stop_gets_through_a_bad_line(homed: Bench):
    homed.driver.stop()
    homed.faults.inject(Fault.DROP_COMMAND)  # the byte that ends the hold
    homed.driver.home()
    assert homed.driver.read().homing.running is not None


def test_release_of_a_board_that_does_not_answer_sends_the_emergency_byte(homed: Bench):
    homed.driver.read()
    homed.faults.inject(Fault.DROP_COMMAND, count=3)
    began = homed.clock.now()
    with pytest.raises(BoardTimeoutError, match=r"motors are off; .* after 500 ms\. Cut their supply"):
        homed.driver.release()
    assert homed.clock.now() - began == pytest.approx(0.1, abs=0.01)
    assert not homed.board.mode.powered


def test_stop_that_is_not_confirmed(homed: Bench):
    homed.stream({0: 0.0}, 0.1)
    homed.faults.inject(Fault.DROP_COMMAND, count=1)
    homed.driver.stop()
    assert homed.board.mode is Mode.HELD
    homed.stream({0: 0.0}, 0.1)
    homed.faults.inject(Fault.DROP_COMMAND, count=6)
    with pytest.raises(BoardTimeoutError, match="does not confirm that it holds"):
        homed.driver.stop()


def test_a_lost_release_of_the_hold_is_reported_and_made_up_for(homed: Bench):
    homed.stream({0: 0.0}, 0.1)
    homed.driver.stop()
    homed.driver.read()
    homed.faults.inject(Fault.DROP_COMMAND, count=1)
    homed.driver.write({0: 5.0})
    homed.clock.advance(0.02)
    (refused,) = homed.driver.read().errors
    assert refused.startswith("a setpoint was refused: the board holds")
    assert homed.stream({0: 5.0}, 0.5).positions[0] == 5.0


def test_a_pulled_plug_is_a_board_error_and_then_the_arm_must_be_homed(homed: Bench):
    homed.stream({0: 0.0}, 0.1)
    homed.faults.unplug()
    for call in ("read", "write", "stop", "release", "home"):
        with pytest.raises(BoardError, match="unplugged"):
            getattr(homed.driver, call)(*([{0: 0.0}] if call == "write" else []))
    homed.driver.close()
    homed.driver.close()
    homed.faults.plug_in()
    homed.connect()
    readback = homed.driver.read()
    assert readback.powered is False
    assert not any(readback.homing.homed.values())
    homed.home()


def test_a_brown_out_whose_banner_is_lost_is_noticed(homed: Bench):
    homed.wait(0.2)
    homed.faults.brown_out(0.4)
    homed.clock.advance(0.1)
    with pytest.raises(BoardTimeoutError):
        homed.driver.read()
    homed.clock.advance(0.5)
    readback = homed.driver.read()
    assert "the board has started anew" in readback.errors[0]
    assert readback.powered is False
    with pytest.raises(StateError):
        homed.driver.write({0: 0.0})
    sent = len(homed.executed())
    homed.driver.configure(CHANNELS)  # as the runtime does after a silence
    assert "WD 500" in homed.executed()[sent:]
    assert "the board has started anew" in homed.driver.read().errors[0], "until the user has taken note"
