"""After half a second without a tick nothing goes on by itself: the arm holds, the board is read first."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from tests.runtime.kit import ROBOT, TEST, LateExecutor, Rig, fails, make_rig
from tests.runtime.test_homing import make_homing_rig

from armctl.errors import BoardError
from armctl.facts import State
from armctl.kinematics import Target
from armctl.program import Program, WaitStep
from armctl.protocol import (
    Command,
    Connect,
    Disconnect,
    Enable,
    FollowTarget,
    HomeAxes,
    Jog,
    MonotonicClock,
    MoveGripper,
    MoveJoints,
    Pause,
    RunProgram,
)

HOME = ROBOT.pose("home")
GAP_S = 10.0
WORDS = r"nothing ran for 10\.0 s \(computer suspended, program frozen or too busy, or the board kept it .*\)"
JOG = Jog(np.array([0.3, 0, 0, 0, 0]))
NEAR = FollowTarget(Target.of((0.15, 0.1, 0.2)))
MOVING: list[Command] = [
    MoveJoints(HOME),
    RunProgram(Program(robot="uzuner", steps=(WaitStep(seconds=30),)), None),
    JOG,
    NEAR,
    MoveGripper(0.0),
]


@pytest.mark.parametrize("command", MOVING, ids=lambda command: type(command).__name__)
@pytest.mark.parametrize("paused", [False, True])
def test_what_moved_before_a_gap_ends_with_the_reason(holding: Rig, command: Command, paused: bool) -> None:
    ticket = holding.do(command)
    holding.run(0.08)
    if paused:
        holding.do(Pause())
    held = isinstance(command, Jog | FollowTarget)
    writes, reads = len(holding.driver.writes), holding.driver.calls.count("read")
    holding.tick(GAP_S)
    assert len(holding.driver.writes) == writes
    assert holding.driver.calls.count("read") == reads + 1  # looked at before anything is sent
    assert holding.now.state is State.HOLDING
    assert not holding.now.velocity_command.any()
    if not held:
        fails(ticket.finished, rf"stopped by armctl: {WORDS}; it does not go on by itself, ask for it again")
    assert sum("nothing ran for 10.0 s" in text for text in holding.texts if "STOP" in text) == 1
    holding.sends_nothing(2.0)
    holding.finishes(MoveJoints(HOME))


@pytest.mark.parametrize(("gap_s", "goes_on"), [(0.5, True), (0.501, False)])
def test_up_to_half_a_second_it_goes_on_from_rest(holding: Rig, gap_s: float, goes_on: bool) -> None:
    motion = holding.do(MoveJoints(HOME))
    holding.run(0.3)
    holding.tick(gap_s)
    holding.rests()
    assert (motion.finished.exception(0) is None) == goes_on
    assert np.array_equal(holding.now.q_command, HOME) == goes_on


@pytest.mark.parametrize("command", [JOG, NEAR])
@pytest.mark.parametrize("held_before", [False, True])
def test_what_is_held_must_be_let_go_of_after_a_gap(
    holding: Rig, command: Command, held_before: bool
) -> None:
    if held_before:
        for _ in range(5):
            holding.do(command)
    holding.tick(GAP_S)
    for _ in range(20):  # the page goes on asking
        holding.refuses(command, "let go|switch the live target on again")
    assert holding.now.state is State.HOLDING
    holding.run(0.3)
    holding.do(command).accepted.result(0)
    holding.run(0.1)
    assert holding.now.state is State.MOVING


@pytest.mark.parametrize("command", [MoveJoints(HOME), JOG, MoveGripper(0.0)])
def test_what_was_asked_for_before_a_gap_does_not_begin_after_it(holding: Rig, command: Command) -> None:
    early = holding.controller.submit(command, TEST)
    holding.clock.advance(GAP_S)
    late = holding.controller.submit(MoveJoints(HOME), TEST)
    holding.tick(0.0)
    words = r"nothing ran for 10\.0 s before it could begin; ask for it again"
    fails(early.finished, "let go" if command is JOG else words)
    fails(late.finished, words)  # a socket may have kept it until now
    holding.run(0.2)
    holding.refuses(MoveJoints(HOME), words)
    holding.run(0.1)
    holding.finishes(MoveJoints(HOME))


def test_a_motion_that_is_being_planned_does_not_begin_after_a_gap(late: Rig) -> None:
    motion = late.do(MoveJoints(HOME))
    late.tick(GAP_S)
    fails(motion.finished, WORDS)
    late.executor.work()
    late.sends_nothing(1.0)


def test_a_gap_while_holding_is_told_and_the_board_is_looked_at(holding: Rig) -> None:
    reads = holding.driver.calls.count("read")
    holding.tick(GAP_S)
    assert holding.driver.calls.count("read") == reads + 1
    assert holding.now.state is State.HOLDING
    assert "nothing ran for 10.0 s" in holding.texts[-1] and "the arm stood still" in holding.texts[-1]
    assert holding.now.events[-1].level == "warning"
    holding.run(0.3)
    holding.finishes(MoveJoints(HOME))


@pytest.mark.parametrize("command", [None, MoveJoints(HOME)])
def test_a_board_that_let_go_in_the_gap_is_a_fault(holding: Rig, command: Command | None) -> None:
    if command is not None:
        holding.do(command)
        holding.run(0.2)
    writes = len(holding.driver.writes)
    holding.driver.positions.clear()
    holding.tick(GAP_S)
    holding.run(0.2)
    assert holding.now.state is State.FAULT
    assert "switched the pulses off by itself" in holding.now.cause
    assert len(holding.driver.writes) == writes


def test_homing_does_not_go_on_after_a_gap() -> None:
    rig = make_homing_rig()
    homing = rig.do(HomeAxes())
    rig.run(0.2)
    rig.tick(GAP_S)
    assert rig.driver.calls.count("stop") == 1
    rig.until(lambda s: s.state is State.OFF, seconds=2)
    fails(homing.finished, rf"homing was stopped by armctl: {WORDS}")


def test_enabling_does_not_go_on_after_a_gap(rig: Rig) -> None:
    rig.driver.simulated = False
    rig.do(Connect("sim"))
    enabling = rig.do(Enable(HOME))
    rig.run(0.4)
    on = len(rig.driver.positions)
    rig.tick(GAP_S)
    fails(enabling.finished, rf"enabling was stopped by armctl: {WORDS}")
    rig.sends_nothing(5.0)
    assert (rig.now.state, len(rig.driver.positions)) == (State.OFF, on)


def test_the_clock_goes_on_while_the_computer_is_suspended() -> None:
    clock = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)  # macOS has no other one, and needs none
    before = time.clock_gettime(clock)
    now = MonotonicClock().now()
    assert before <= now <= time.clock_gettime(clock)


def test_connecting_holds_nothing_up() -> None:
    """A Mega takes seconds to start; the arm is shown meanwhile, and answers."""
    rig = make_rig(LateExecutor())
    connecting = rig.do(Connect("sim"))
    rig.run(5.0)
    assert (rig.now.state, rig.now.cause) == (State.DISCONNECTED, "opening sim (test)")
    rig.refuses(Enable(), "it is disconnected")
    rig.refuses(Connect("sim"), "sim is being opened already")
    rig.controller.stop(TEST)
    rig.executor.work()
    rig.tick()
    connecting.finished.result(0)
    rig.do(Enable()).accepted.result(0)


@pytest.mark.parametrize("leave", [lambda rig: rig.do(Disconnect()), lambda rig: rig.controller.close()])
def test_a_line_that_nobody_waits_for_any_more_is_closed(leave: Callable[[Rig], object]) -> None:
    rig = make_rig(LateExecutor())
    connecting = rig.do(Connect("sim"))
    waiting = rig.executor.waiting  # it is being opened: too late to be cancelled
    leave(rig)
    fails(connecting.finished, "disconnected while sim was being opened")
    rig.executor.waiting = waiting
    rig.executor.work()
    assert rig.driver.calls[-1] == "close"
    assert rig.now.state is State.DISCONNECTED


def test_a_line_that_cannot_be_opened_is_told_when_that_is_known() -> None:
    rig = make_rig(LateExecutor())
    rig.driver.fail["open"] = BoardError("nobody answers")
    connecting = rig.do(Connect("sim"))
    rig.run(2.0)
    rig.executor.work()
    rig.tick()
    fails(connecting.finished, "nobody answers", BoardError)
    assert (rig.now.state, rig.now.cause) == (State.DISCONNECTED, "nobody answers")
    rig.driver.fail.clear()
    rig.enable()


def test_what_was_asked_for_in_a_gap_does_not_switch_the_servos_on(rig: Rig) -> None:
    rig.do(Connect("sim"))
    rig.controller.submit(Enable(), TEST)
    rig.tick(GAP_S)
    rig.refuses(Enable(), "nothing ran for 10.0 s before it could begin")
    rig.run(0.3)
    rig.finishes(Enable())
