from __future__ import annotations

import re

import numpy as np
import pytest
from tests.runtime.kit import ROBOT, TICK, Rig, fails

from armctl.errors import (
    ArmctlError,
    BoardError,
    BoardProtocolError,
    BoardTimeoutError,
    MotionRefusedError,
)
from armctl.facts import State, Unanswered
from armctl.program import Program, WaitStep
from armctl.protocol import (
    ClearFault,
    Connect,
    Enable,
    MoveGripper,
    MoveJoints,
    Release,
    RunProgram,
    SetSpeed,
    Snapshot,
)
from armctl.runtime import Controller
from armctl.runtime.activity import Setpoint
from armctl.runtime.mover import PathMover
from armctl.runtime.notices import EventLog

REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")
SILENT = BoardTimeoutError(Unanswered("no answer", "the cable and the power supply"))


@pytest.fixture
def moving(holding: Rig) -> Rig:
    """On its way to home for 0.2 s."""
    holding.do(MoveJoints(HOME))
    holding.run(9 * TICK)
    return holding


def broken(rig: Rig, error: BaseException) -> None:
    """One tick with a defect in the mover."""

    def breaks(_self: PathMover, _now: float, _dt: float) -> Setpoint:
        raise error

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PathMover, "advance", breaks)
        rig.tick()
    assert rig.now.state is State.FAULT


def test_a_write_that_fails_is_a_fault_with_the_line_closed(holding: Rig) -> None:
    motion = holding.do(MoveJoints(HOME))
    holding.run(0.3)
    holding.driver.fail["write"] = BoardError("/dev/ttyACM0: the line is gone (unplugged?)")
    holding.tick()
    assert holding.now.state is State.FAULT
    assert holding.now.cause == "/dev/ttyACM0: the line is gone (unplugged?)"
    assert holding.driver.calls[-1] == "close"
    assert holding.now.board is None
    assert not holding.now.powered
    fails(motion.finished, "unplugged", BoardError)


def test_after_an_unplug_nothing_goes_on_by_itself(holding: Rig) -> None:
    holding.do(RunProgram(Program(robot="uzuner", steps=(WaitStep(seconds=1),)), loops=None))
    holding.driver.fail = {"read": BoardError("unplugged"), "close": OSError("gone")}
    holding.tick()
    assert (holding.now.state, holding.now.cause) == (State.FAULT, "unplugged")
    assert holding.now.events[-1].level == "error"
    changes = [text for text in holding.texts if " → " in text]
    assert [text.split(":")[0] for text in changes] == [
        "disconnected → off",
        "off → moving",
        "moving → holding",
        "holding → moving",
        "moving → fault",
    ]
    holding.driver.fail.clear()
    count = len(holding.driver.calls)
    holding.run(5)
    assert len(holding.driver.calls) == count
    holding.refuses(ClearFault(), r"the board is gone \(unplugged\); connect again")
    for command in (MoveJoints(HOME), Enable(), MoveGripper(0.5)):
        holding.refuses(command, "fault|not connected")
    holding.do(Connect("sim")).result(0)
    assert holding.now.state is State.OFF
    assert holding.now.program is None


@pytest.mark.parametrize("error", [SILENT, BoardProtocolError("garbled")])
def test_a_few_readings_may_fail_and_one_is_not_shown(holding: Rig, error: BoardError) -> None:
    motion = holding.do(MoveJoints(HOME))
    holding.driver.fail["read"] = error
    holding.tick()
    assert holding.now.warnings == ()
    holding.run(3 * TICK)
    assert holding.now.state is State.MOVING
    assert holding.now.warnings == (f"the board does not answer properly: {error}",)
    holding.driver.fail.clear()
    holding.tick()
    assert holding.now.warnings == ()
    holding.rests()
    motion.result(0)


def test_failures_count_in_a_row_only_and_the_channels_are_set_again(holding: Rig) -> None:
    holding.driver.calls.clear()
    for _ in range(3):
        holding.driver.fail["read"] = SILENT
        holding.run(3 * TICK)
        holding.driver.fail = {"configure": SILENT}  # does not take its limits back: still silent
        holding.tick()
        holding.driver.fail.clear()
        holding.tick()
    assert holding.now.state is State.HOLDING
    assert holding.driver.calls.count("configure") == 6


def test_too_many_lose_the_board(holding: Rig) -> None:
    holding.driver.fail["read"] = SILENT
    holding.run(0.9)
    assert holding.now.state is State.HOLDING  # a busy computer is late, not a board gone
    holding.run(0.2)
    assert holding.now.state is State.FAULT
    lost = r"lost the board: 5\d readings in a row failed in 1\.\d s \(no answer\); check the cable and"
    assert re.match(lost, holding.now.cause)


def test_a_silent_board_gets_no_setpoints_and_the_arm_goes_on_from_rest(moving: Rig) -> None:
    moving.driver.fail["read"] = SILENT
    moving.run(3 * TICK)
    before = len(moving.driver.writes)
    moving.run(20 * TICK)
    assert moving.now.state is State.MOVING
    assert not moving.now.velocity_command.any()
    moving.driver.fail.clear()
    moving.tick()
    assert len(moving.driver.writes) == before  # one good answer is not yet a board to be trusted
    moving.rests()
    assert moving.now.cause == "move finished"
    assert np.array_equal(moving.now.q_command, HOME)


def test_a_motion_is_finished_once_its_last_setpoint_has_gone_out(moving: Rig) -> None:
    moving.driver.sent = False
    moving.until(lambda snapshot: snapshot.progress == 1.0)
    moving.run(0.5)
    assert moving.now.state is State.MOVING
    moving.driver.sent = True
    moving.tick()
    assert (moving.now.state, moving.now.cause) == (State.HOLDING, "move finished")


def test_a_motion_that_was_stopped_while_it_waited_leaves_the_next_its_time(moving: Rig) -> None:
    moving.driver.sent = False
    moving.until(lambda snapshot: snapshot.progress == 1.0)
    moving.run(0.5)
    moving.stops()
    moving.driver.sent = True
    moving.run(2.0)
    moving.do(MoveJoints(REST))
    moving.driver.sent = False
    moving.until(lambda snapshot: snapshot.progress == 1.0)
    moving.run(0.5)
    moving.driver.sent = True
    moving.rests()
    assert moving.now.cause == "move finished"


def test_a_gripper_has_arrived_once_its_last_setpoint_has_gone_out(holding: Rig) -> None:
    holding.driver.sent = False
    gripping = holding.do(MoveGripper(0.6))
    holding.run(0.8)
    assert not gripping.finished.done()
    holding.driver.sent = True
    holding.tick()
    gripping.result(0)
    holding.driver.sent = False
    gripping = holding.do(MoveGripper(0.5))
    holding.until(lambda snapshot: snapshot.state is State.FAULT)
    fails(gripping.finished, "has not taken the last setpoints", BoardError)


def test_a_line_that_takes_no_setpoints_is_a_fault_and_no_finished_motion(moving: Rig) -> None:
    moving.driver.sent = False
    moving.until(lambda snapshot: snapshot.state is State.FAULT)
    assert "has not taken the last setpoints for 1 s" in moving.now.cause


def test_a_setpoint_that_was_dropped_is_told_and_written_again_from_rest(moving: Rig) -> None:
    moving.driver.expired = (0, 1)
    moving.tick()
    assert any("setpoints of Base, Shoulder were dropped" in text for text in moving.now.warnings)
    stands, count = moving.now.q_command, len(moving.driver.writes)
    moving.tick()
    assert not moving.now.velocity_command.any()
    moving.until(lambda _: len(moving.driver.writes) > count)
    outputs = ROBOT.output_map
    assert outputs is not None
    sent = outputs.angles(moving.driver.writes[count][1])
    np.testing.assert_allclose(sent, stands, atol=1e-9)
    moving.rests()
    assert np.array_equal(moving.now.q_command, HOME)


def test_an_outage_that_is_over_stops_no_later_motion(holding: Rig) -> None:
    holding.driver.fail["read"] = SILENT
    holding.run(0.9)
    holding.driver.fail.clear()
    holding.run(0.3)
    motion = holding.do(MoveJoints(HOME))
    holding.run(1.2)
    holding.driver.fail["read"] = SILENT  # one lost answer, long after it
    holding.tick()
    holding.driver.fail.clear()
    holding.rests()
    motion.result(0)
    assert holding.now.cause == "move finished"


def test_what_the_board_reports_stops_the_motion_and_is_shown(holding: Rig) -> None:
    motion = holding.do(MoveJoints(HOME))
    holding.run(0.3)
    holding.driver.errors = ("serial overrun",)
    holding.tick()
    assert "the board reports: serial overrun" in holding.now.warnings
    holding.rests(1)
    fails(motion.finished, "stopped by armctl: the board reports: serial overrun")
    assert holding.now.more_warnings == (), "the cause tells it"
    holding.do(MoveJoints(HOME))
    assert holding.now.more_warnings == holding.now.warnings != ()
    holding.rests(1)
    holding.run(11)
    assert holding.now.warnings == ()


def test_a_setpoint_that_the_gate_refuses_is_a_fault_and_is_not_sent(
    holding: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = holding.do(MoveJoints(HOME))
    holding.run(0.2)
    stood, count = holding.now.q_command, len(holding.driver.writes)

    def jumps(_self: PathMover, _now: float, _dt: float) -> Setpoint:
        return Setpoint(stood + np.radians([10, 0, 0, 0, 0]), np.zeros(5), np.zeros(5))

    with monkeypatch.context() as patch:
        patch.setattr(PathMover, "advance", jumps)
        holding.tick()
    assert holding.now.state is State.FAULT
    assert holding.now.cause.startswith("Base: a step of 10.000° in 20.0 ms, its speed limit allows 1.200°")
    fails(motion.finished, "a step of", MotionRefusedError)
    holding.run(1)
    assert len(holding.driver.writes) == count
    assert holding.now.powered
    holding.do(ClearFault()).result(0)
    assert holding.now.state is State.HOLDING
    assert np.array_equal(holding.now.q_command, stood)
    holding.do(MoveJoints(HOME)).accepted.result(0)


@pytest.mark.parametrize("error", [ZeroDivisionError("oops"), SystemExit("oops")])
@pytest.mark.logs_a_defect
def test_a_defect_in_the_controller_is_a_fault_and_the_ticks_go_on(
    holding: Rig, error: BaseException
) -> None:
    motion = holding.do(MoveJoints(HOME))
    broken(holding, error)
    assert holding.now.cause == f"internal error: {type(error).__name__}: oops"
    fails(motion.finished, "internal error", ArmctlError)
    holding.run(0.2)
    holding.do(ClearFault()).result(0)
    assert holding.now.state is State.HOLDING


@pytest.mark.logs_a_defect
def test_release_works_in_a_fault(moving: Rig) -> None:
    broken(moving, ZeroDivisionError())
    moving.do(Release()).result(0)
    assert moving.now.state is State.OFF
    assert moving.driver.positions == {}


def test_a_release_that_cannot_be_sent_is_a_fault(holding: Rig) -> None:
    holding.driver.fail["release"] = BoardError("unplugged")
    holding.refuses(Release(), "unplugged", BoardError)
    assert holding.now.state is State.FAULT


@pytest.mark.logs_a_defect
def test_pulses_that_go_off_during_another_fault_leave_nothing_to_hold(moving: Rig) -> None:
    broken(moving, ZeroDivisionError())
    moving.driver.positions.clear()
    moving.run(0.1)
    assert "ZeroDivisionError" in moving.now.cause
    moving.do(ClearFault()).result(0)
    assert moving.now.state is State.OFF
    assert not moving.now.powered


def test_a_board_that_sends_something_else_is_told_after_half_a_second(holding: Rig) -> None:
    holding.driver.positions[2] += 30.0
    holding.run(0.4)
    assert holding.now.warnings == ()
    holding.run(0.3)
    (warning,) = holding.now.warnings
    assert "Elbow by 30.0 µs" in warning
    assert holding.now.state is State.HOLDING
    holding.driver.positions[2] -= 29.5
    holding.tick()
    assert holding.now.warnings == ()


def test_a_reading_without_pulses_halts_the_arm_at_once_and_one_is_no_fault(moving: Rig) -> None:
    good = dict(moving.driver.positions)
    del moving.driver.positions[2]
    moving.driver.write = lambda setpoints: moving.driver.writes.append((0.0, dict(setpoints)))  # type: ignore[method-assign]
    moving.tick()
    moving.sends_nothing(TICK)
    moving.driver.positions = good
    del moving.driver.write  # type: ignore[method-assign]
    moving.rests()
    assert moving.now.cause == "move finished"


def test_what_was_off_before_enabling_does_not_count(holding: Rig) -> None:
    holding.driver.positions.clear()
    holding.run(0.1)
    holding.do(ClearFault())
    holding.finishes(Enable())
    pulses = dict(holding.driver.positions)
    holding.driver.positions.clear()
    holding.tick()
    assert holding.now.state is State.HOLDING
    holding.driver.positions = pulses
    holding.run(0.2)
    assert holding.now.state is State.HOLDING


def test_after_a_stall_the_board_is_asked_before_it_is_written_to(moving: Rig) -> None:
    moving.driver.positions.clear()  # the board's own watchdog
    moving.driver.errors = ("serial timeout",)
    count = len(moving.driver.writes)
    moving.tick(0.7)
    moving.run(0.2)
    assert len(moving.driver.writes) == count
    assert moving.now.state is State.FAULT
    assert "switched the pulses off by itself" in moving.now.cause


def test_a_board_that_went_home_by_itself_is_not_written_to(moving: Rig) -> None:
    moving.driver.positions[0] += 90.0  # 10° away
    moving.driver.errors = ("serial timeout",)
    count = len(moving.driver.writes)
    moving.tick(0.7)
    assert moving.now.state is State.HOLDING  # one garbled answer is no proof, and nothing is sent until then
    moving.tick()
    assert moving.now.state is State.FAULT
    assert moving.now.cause.startswith("the board moved the arm by itself (Base; serial timeout); check ")
    moving.do(ClearFault())
    moving.run(0.3)
    assert len(moving.driver.writes) == count
    moving.do(Enable()).result(0)
    assert np.degrees(moving.now.q_command[0] - REST[0]) > 9


def test_the_log_is_bounded_and_a_clock_that_was_set_back_does_not_silence_it(
    holding: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    for k in range(300):
        holding.do(SetSpeed(0.5 + 0.5 * (k % 2)))
    assert len(holding.now.events) == 200
    times = iter([5000.0, 5001.0, 1000.0])
    monkeypatch.setattr("armctl.runtime.notices.wall_time", lambda: next(times))
    log = EventLog()
    for _ in range(3):
        log.warn("STOP (test)")
    assert [event.stamp for event in log.events] == [5000.0, 1000.0]


@pytest.mark.logs_a_defect
def test_a_defect_of_who_is_told_is_a_fault_and_the_controller_goes_on(rig: Rig) -> None:
    told: list[Snapshot] = []

    def tell(snapshot: Snapshot) -> None:
        told.append(snapshot)
        if len(told) == 1:
            raise ValueError("oops")

    controller = Controller(ROBOT, lambda _: rig.driver, rig.clock, published=tell)
    for _ in range(2):
        controller.tick()
    assert told[-1].cause == "internal error: ValueError: oops"
    controller.tick()
    assert told[-1].tick == 3
    controller.close()
