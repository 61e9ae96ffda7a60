from __future__ import annotations

import numpy as np
import pytest
from tests.runtime.kit import (
    ROBOT,
    TEST,
    TICK,
    LateExecutor,
    Rig,
    assert_keeps_limits,
    fails,
    make_rig,
)

from armctl.errors import ArmctlError, BoardTimeoutError, StateError
from armctl.runtime import Jog, MoveGripper, MoveJoints, Origin, Pause, Resume, State
from armctl.runtime.mover import PathMover

REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")


def far(rig: Rig) -> np.ndarray:
    goal = HOME.copy()
    goal[0] = np.radians(90)
    return goal


def test_the_arm_comes_to_rest_as_fast_as_its_accelerations_allow(holding: Rig) -> None:
    holding.do(MoveJoints(far(holding), profile="normal"))
    holding.run(1.0)
    assert holding.now.velocity_command[0] == pytest.approx(np.radians(60))
    ticket = holding.controller.stop(TEST)
    stopped_at = holding.now.stamp
    holding.rests(1)
    # 60 °/s at 360 °/s²: 0.167 s, and a tick for each end
    assert 0.16 < holding.now.stamp - stopped_at < 0.167 + 2 * TICK
    ticket.finished.result(0)
    assert holding.now.cause == "stopped by test"
    assert not holding.now.velocity_command.any()
    holding.sends_nothing(2)
    assert_keeps_limits(holding)


def test_the_first_tick_after_a_stop_slows_down_already(holding: Rig) -> None:
    holding.do(MoveJoints(far(holding), profile="normal"))
    holding.run(1.0)
    before = holding.now.velocity_command[0]
    holding.controller.stop(TEST)
    holding.tick(0.001)  # the wake-up, ahead of the next regular tick
    assert holding.now.velocity_command[0] < before


def test_the_motion_ends_in_words_and_cannot_be_resumed(holding: Rig) -> None:
    motion = holding.do(MoveJoints(far(holding)))
    holding.run(0.5)
    holding.controller.stop(TEST)
    holding.rests(1)
    fails(motion.finished, "move was stopped by test")
    holding.refuses(Resume(), "nothing to resume")
    assert any(text == "STOP (test)" for text in holding.texts)


def test_while_it_slows_down_nothing_else_begins(holding: Rig) -> None:
    holding.do(MoveJoints(far(holding)))
    holding.run(0.5)
    holding.controller.stop(TEST)
    holding.tick()
    assert holding.now.state is State.MOVING
    for command in (MoveJoints(REST), Jog(np.ones(5)), Pause(), Resume()):
        with pytest.raises(StateError):
            holding.do(command).accepted.result(0)


def test_what_waits_in_the_queue_is_dropped_and_what_comes_after_is_not(holding: Rig) -> None:
    before = holding.controller.submit(MoveJoints(HOME), TEST)
    holding.controller.stop(TEST)
    after = holding.controller.submit(MoveJoints(far(holding)), TEST)
    holding.tick()
    fails(before.accepted, "stopped by test before it began")
    after.accepted.result(0)
    assert holding.now.state is State.MOVING


def test_a_paused_motion_is_dropped_too(holding: Rig) -> None:
    holding.do(MoveJoints(far(holding)))
    holding.run(0.5)
    holding.do(Pause())
    holding.until(lambda s: s.state is State.PAUSED, seconds=1)
    holding.controller.stop(TEST)
    holding.tick()
    assert holding.now.state is State.HOLDING


def test_the_gripper_stops_where_it_is(holding: Rig) -> None:
    holding.do(MoveGripper(0.0))
    ticket = holding.do(MoveGripper(1.0))
    holding.run(0.1)
    holding.controller.stop(TEST)
    holding.tick()
    opening = holding.now.gripper
    assert opening is not None
    assert 0 < opening < 1
    fails(ticket.finished, "stopped by test")
    holding.run(1)
    assert holding.now.gripper == opening


def test_a_stop_with_nothing_to_stop_is_over_at_once(rig: Rig) -> None:
    ticket = rig.controller.stop(TEST)
    rig.tick()
    ticket.result(0)
    assert rig.now.state is State.DISCONNECTED


def test_a_jog_that_is_still_held_does_not_go_on_after_a_stop(holding: Rig) -> None:
    rates = np.array([1.0, 0, 0, 0, 0])
    for _ in range(20):
        holding.do(Jog(rates))
    holding.controller.stop(TEST)
    for _ in range(60):
        ticket = holding.do(Jog(rates))
    fails(ticket.accepted, "let go first")
    assert holding.now.state is State.HOLDING
    stood = holding.now.q_command
    holding.run(0.3)  # the key is let go
    holding.do(Jog(rates)).accepted.result(0)
    holding.run(0.1)
    assert holding.now.q_command[0] > stood[0]


def test_a_stop_before_the_first_setpoint_moves_nothing(holding: Rig) -> None:
    count = len(holding.driver.writes)
    holding.do(MoveJoints(far(holding)))
    holding.controller.stop(TEST)
    holding.tick()
    assert holding.now.state is State.HOLDING
    assert len(holding.driver.writes) == count


def test_a_jog_that_the_stop_dropped_counts_as_held(holding: Rig) -> None:
    rates = np.array([1.0, 0, 0, 0, 0])
    holding.do(Jog(rates))
    holding.run(0.1)
    dropped = holding.controller.submit(Jog(rates), TEST)
    holding.controller.stop(TEST)
    holding.tick()
    fails(dropped.accepted, "before it began")
    holding.run(0.14)
    holding.refuses(Jog(rates), "let go first")


def test_a_jog_is_over_on_a_board_that_does_not_answer(holding: Rig) -> None:
    holding.do(Jog(np.array([1.0, 0, 0, 0, 0])))
    holding.tick()
    holding.driver.fail["read"] = BoardTimeoutError("no answer")
    holding.run(2 * TICK)
    ticket = holding.controller.stop(TEST)
    holding.tick()
    ticket.finished.result(0)
    assert holding.now.state is State.HOLDING


PAGE_GONE = Origin("page 3", "the operator's page is gone")


def last_event(rig: Rig) -> tuple[str, str]:
    return rig.now.events[-1].level, rig.now.events[-1].text


@pytest.mark.parametrize(
    ("origin", "logged"),
    [
        (PAGE_GONE, ("info", "page 3: the operator's page is gone; nothing moved, holding as before")),
        (TEST, ("warning", "STOP (test)")),
    ],
)
def test_at_rest_a_stop_is_a_warning_and_a_closed_page_is_none(
    holding: Rig, origin: Origin, logged: tuple[str, str]
) -> None:
    ticket = holding.controller.stop(origin)
    holding.tick()
    ticket.result(0)
    assert last_event(holding) == logged


@pytest.mark.parametrize("what", ["motion", "gripper", "jog"])
def test_a_page_that_is_closed_in_a_motion_is_a_warning(holding: Rig, what: str) -> None:
    commands = {"motion": MoveJoints(far(holding)), "gripper": MoveGripper(1.0), "jog": Jog(np.ones(5))}
    holding.do(MoveGripper(0.0))  # in one step: its opening is not known yet
    asked = holding.do(commands[what])
    holding.run(2 * TICK)
    holding.controller.stop(PAGE_GONE)
    holding.rests(1)
    if what != "jog":
        fails(asked.finished, "stopped by page 3: the operator's page is gone")
    assert ("warning", "STOP (page 3: the operator's page is gone)") in [
        (event.level, event.text) for event in holding.now.events
    ]


def test_a_page_that_is_closed_while_its_motion_is_planned_is_a_warning() -> None:
    rig = make_rig(LateExecutor()).enable()
    motion = rig.do(MoveJoints(far(rig)))
    rig.controller.stop(PAGE_GONE)
    rig.tick()
    assert last_event(rig) == ("warning", "STOP (page 3: the operator's page is gone)")
    fails(motion.finished, "stopped by page 3")


def test_a_motion_that_cannot_be_stopped_is_a_fault_and_every_stop_is_answered(
    holding: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A defect: it must neither end the controller's thread nor leave anybody waiting."""

    def broken(_mover: PathMover) -> None:
        raise ZeroDivisionError("by nought")

    motion = holding.do(MoveJoints(far(holding)))
    holding.run(0.5)
    monkeypatch.setattr(PathMover, "stop", broken)
    first, second = holding.controller.stop(TEST), holding.controller.stop(TEST)
    holding.tick()
    for ticket in (first, second):
        ticket.finished.result(0)
    fails(motion.finished, "internal error: ZeroDivisionError: by nought", ArmctlError)
    assert holding.now.state is State.FAULT
    holding.sends_nothing(1.0)
