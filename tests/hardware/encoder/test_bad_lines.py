"""Lost, garbled, halved and late bytes, and a cable that is pulled."""

from __future__ import annotations

import pytest
from tests.hardware.encoder.kit import CHANNELS, PLANTS, Bench
from tests.hardware.lines import Fault, FaultyModel

from armctl.errors import BoardError, BoardTimeoutError, StateError
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard
from armctl.runtime.clock import ManualClock

LOSSES = [Fault.DROP_COMMAND, Fault.GARBLE_COMMAND, Fault.DROP_REPLY, Fault.GARBLE_REPLY, Fault.HALF_REPLY]


class FaultyBench(Bench):
    """A bench whose line can be told to fail; the board itself stays in sight."""

    def __init__(self, clock: ManualClock, seed: int = 0, **options) -> None:
        board = SimulatedEncoderBoard(PLANTS)
        self.faults = FaultyModel(board, seed)
        super().__init__(clock, self.faults, **options)
        self.board = board


@pytest.fixture
def faulty(clock: ManualClock) -> FaultyBench:
    bench = FaultyBench(clock)
    bench.connect()
    bench.home()
    return bench


@pytest.mark.parametrize("fault", LOSSES)
def test_a_lost_setpoint_is_sent_again(faulty: FaultyBench, fault):
    faulty.stream({0: 0.0}, 0.1)
    faulty.faults.inject(fault)
    faulty.driver.write({0: 5.0})
    assert faulty.wait(0.06).errors == ()
    assert faulty.faults.pending == 0
    assert faulty.wait(0.5).positions[0] == 5.0
    assert faulty.executed().count("P 5 - - - - - 30") == 1, "executed once"


@pytest.mark.parametrize("fault", LOSSES)
@pytest.mark.parametrize("call", ["home", "release"])
def test_a_lost_command_is_sent_again_and_done_once(faulty: FaultyBench, fault, call):
    faulty.driver.read()
    done = len(faulty.executed())
    faulty.faults.inject(fault)
    getattr(faulty.driver, call)()
    assert faulty.faults.pending == 0
    expected = {"home": "HOME", "release": "EN 0"}[call]
    assert faulty.executed()[done:].count(expected) == 1


@pytest.mark.parametrize("seed", range(20))
def test_a_line_that_garbles_one_thing_in_three(clock: ManualClock, seed):
    bench = FaultyBench(clock, seed)
    bench.connect()
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


def test_a_late_answer_is_not_taken_for_the_next_one(faulty: FaultyBench):
    faulty.faults.inject(Fault.DELAY_REPLY, delay_s=0.03)
    faulty.driver.write({0: 5.0})
    faulty.clock.advance(0.02)
    assert faulty.driver.read().errors == ()
    faulty.driver.write({0: 6.0})
    assert faulty.wait(0.5).positions[0] == 6.0
    assert faulty.driver.read().errors == ()


def test_a_late_refusal_is_still_told(faulty: FaultyBench):
    faulty.stream({0: 0.0}, 0.1)
    faulty.board.axes[0].settings["max"] = 100
    faulty.faults.inject(Fault.DELAY_REPLY, delay_s=0.03)
    faulty.driver.write({0: 200.0})
    assert faulty.driver.read().errors == ()
    faulty.clock.advance(0.02)
    faulty.driver.write({0: 10.0})
    faulty.clock.advance(0.02)
    assert "LIMIT 0 200" in faulty.driver.read().errors[0]
    assert faulty.driver.read().errors == ()


def test_writing_and_reading_wait_for_no_answer(faulty: FaultyBench):
    faulty.stream({0: 0.0}, 0.1)
    faulty.faults.inject(Fault.DROP_COMMAND, count=2)
    began = faulty.clock.now()
    for _ in range(2):
        faulty.driver.write({0: 5.0})
        faulty.driver.read()
    assert faulty.clock.now() == began


def test_no_answer_at_all_is_a_timeout_and_the_next_reading_works(faulty: FaultyBench):
    faulty.stream({0: 0.0}, 0.1)
    faulty.faults.inject(Fault.DROP_COMMAND, count=8)
    began = faulty.clock.now()
    with pytest.raises(BoardTimeoutError, match=r"loop: the board did not answer 'P 7 .*' within 100 ms"):
        faulty.stream({0: 7.0}, 1.0)
    assert faulty.clock.now() - began == pytest.approx(0.12, abs=0.001)
    while faulty.faults.pending:
        faulty.driver.write({0: 8.0})
    faulty.driver.write({0: 8.0})
    readback = faulty.wait(0.5)
    assert (readback.errors, readback.positions[0]) == ((), 8.0)


def test_a_garbled_timeout_says_so(faulty: FaultyBench):
    faulty.faults.inject(Fault.GARBLE_REPLY, count=10)
    with pytest.raises(BoardTimeoutError, match="lines from it were garbled"):
        faulty.stream({0: 5.0}, 1.0)


def test_waiting_for_an_answer_takes_no_longer_than_allowed(faulty: FaultyBench):
    faulty.faults.inject(Fault.DROP_COMMAND, count=4)
    began = faulty.clock.now()
    with pytest.raises(BoardTimeoutError):
        faulty.driver.release()
    assert faulty.clock.now() - began == pytest.approx(0.1, abs=0.01)


def test_homing_after_a_stop_gets_through_a_bad_line(faulty: FaultyBench):
    faulty.driver.stop()
    faulty.faults.inject(Fault.DROP_COMMAND)  # the byte that ends the hold
    faulty.driver.home()
    assert faulty.driver.read().homing.running is not None


def test_release_of_a_board_that_does_not_answer_sends_the_emergency_byte(faulty: FaultyBench):
    faulty.driver.read()
    faulty.faults.inject(Fault.DROP_COMMAND, count=3)
    with pytest.raises(BoardTimeoutError, match=r"motors are off; .* after 500 ms\. Cut their supply"):
        faulty.driver.release()
    assert not faulty.board.mode.powered


def test_stop_that_is_not_confirmed(faulty: FaultyBench):
    faulty.stream({0: 0.0}, 0.1)
    faulty.faults.inject(Fault.DROP_COMMAND, count=1)
    faulty.driver.stop()
    assert faulty.board.mode.value == "B"
    faulty.stream({0: 0.0}, 0.1)
    faulty.faults.inject(Fault.DROP_COMMAND, count=6)
    with pytest.raises(BoardTimeoutError, match="does not confirm that it holds"):
        faulty.driver.stop()


def test_a_lost_release_of_the_hold_is_told_and_made_up_for(faulty: FaultyBench):
    faulty.stream({0: 0.0}, 0.1)
    faulty.driver.stop()
    faulty.driver.read()
    faulty.faults.inject(Fault.DROP_COMMAND, count=1)
    faulty.driver.write({0: 5.0})
    faulty.clock.advance(0.02)
    (refused,) = faulty.driver.read().errors
    assert refused.startswith("a setpoint was refused: the board holds")
    assert faulty.stream({0: 5.0}, 0.5).positions[0] == 5.0


def test_a_setpoint_that_only_the_board_refuses_is_told_by_the_next_reading(faulty: FaultyBench):
    faulty.stream({0: 0.0}, 0.1)
    faulty.board.axes[0].settings["max"] = 100  # narrower than it was told
    faulty.driver.write({0: 200.0})
    (refused,) = faulty.driver.read().errors
    assert "a setpoint was refused: outside the soft limits" in refused
    assert "LIMIT 0 200 -1000 100" in refused
    assert faulty.driver.read().errors == ()


@pytest.mark.parametrize("call", ["read", "write", "stop", "release", "home"])
def test_a_pulled_plug_is_a_board_error(faulty: FaultyBench, call):
    faulty.stream({0: 0.0}, 0.1)
    faulty.faults.unplug()
    with pytest.raises(BoardError, match="unplugged"):
        getattr(faulty.driver, call)(*([{0: 0.0}] if call == "write" else []))
    faulty.driver.close()
    faulty.driver.close()


def test_after_the_plug_is_back_the_arm_must_be_homed(faulty: FaultyBench):
    faulty.faults.unplug()
    with pytest.raises(BoardError):
        faulty.driver.read()
    faulty.faults.plug_in()
    faulty.connect()
    readback = faulty.driver.read()
    assert readback.powered is False
    assert not any(readback.homing.homed.values())
    with pytest.raises(StateError, match="not homed"):
        faulty.driver.write({0: 0.0})
    faulty.home()


def test_a_brown_out_whose_banner_is_lost_is_noticed(faulty: FaultyBench):
    faulty.wait(0.2)
    faulty.faults.brown_out(0.4)
    faulty.clock.advance(0.1)
    with pytest.raises(BoardTimeoutError):
        faulty.driver.read()
    faulty.clock.advance(0.5)
    readback = faulty.driver.read()
    assert "the board has started anew" in readback.errors[0]
    assert readback.powered is False
    with pytest.raises(StateError):
        faulty.driver.write({0: 0.0})
    told = len(faulty.executed())
    faulty.driver.configure(CHANNELS)  # as the runtime does after a silence
    assert "WD 500" in faulty.executed()[told:]
    assert "the board has started anew" in faulty.driver.read().errors[0], "until somebody takes note"
