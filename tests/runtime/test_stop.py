from __future__ import annotations

import numpy as np
import pytest
from tests.runtime.kit import ROBOT, TEST, TICK, Rig, assert_keeps_limits, fails

from armctl.errors import ArmctlError, BoardTimeoutError, StoppedError
from armctl.facts import State
from armctl.facts.commands import Stopped
from armctl.protocol import Jog, MoveGripper, MoveJoints, Origin, Pause, Resume, Ticket
from armctl.runtime.mover import PathMover

REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")
FAR = np.array([np.radians(90), *HOME[1:]])
BASE = Jog(np.array([1.0, 0, 0, 0, 0]))
PAGE_GONE = Origin("page 3", "the operator's page is gone")
WARNING = ("warning", "STOP (page 3: the operator's page is gone)")


def stop(rig: Rig, origin: Origin = TEST) -> Ticket:
    ticket = rig.controller.stop(origin)
    rig.tick()
    return ticket


def logged(rig: Rig) -> list[tuple[str, str]]:
    return [(event.level, event.text) for event in rig.now.events]


def test_the_arm_comes_to_rest_as_fast_as_its_accelerations_allow(holding: Rig) -> None:
    holding.do(MoveJoints(FAR, profile="normal"))
    holding.run(1.0)
    assert holding.now.velocity_command[0] == pytest.approx(np.radians(60))
    ticket = holding.controller.stop(TEST)
    stopped_at = holding.now.stamp
    holding.rests(1)
    # 60 °/s at 360 °/s²: 0.167 s, and a tick for each end
    assert 0.16 < holding.now.stamp - stopped_at < 0.167 + 2 * TICK
    ticket.result(0)
    assert holding.now.cause == "stopped by test"
    assert not holding.now.velocity_command.any()
    holding.sends_nothing(2)
    assert_keeps_limits(holding)


def test_the_first_tick_after_a_stop_slows_down_already(holding: Rig) -> None:
    holding.do(MoveJoints(FAR, profile="normal"))
    holding.run(1.0)
    before = holding.now.velocity_command[0]
    holding.controller.stop(TEST)
    holding.tick(0.001)  # the wake-up, ahead of the next regular tick
    assert holding.now.velocity_command[0] < before


def test_the_motion_ends_in_words_and_nothing_else_begins_before_it_stands(holding: Rig) -> None:
    motion = holding.do(MoveJoints(FAR))
    holding.run(0.5)
    stop(holding)
    assert holding.now.state is State.MOVING
    for command in (MoveJoints(REST), Jog(np.ones(5)), Pause(), Resume()):
        holding.refuses(command, "stop|resume")
    holding.rests(1)
    fails(motion.finished, "move was stopped by test")
    broken = motion.finished.exception()
    assert isinstance(broken, StoppedError) and not broken.help  # what somebody wanted needs no advice
    holding.refuses(Resume(), "nothing to resume")
    assert "STOP (test)" in holding.texts


def test_what_waits_in_the_queue_is_dropped_and_what_comes_after_is_not(holding: Rig) -> None:
    before = holding.controller.submit(MoveJoints(HOME), TEST)
    holding.controller.stop(TEST)
    after = holding.controller.submit(MoveJoints(FAR), TEST)
    holding.tick()
    fails(before.accepted, "stopped by test before it began")
    after.accepted.result(0)
    assert holding.now.state is State.MOVING


def test_a_paused_motion_is_dropped_too(holding: Rig) -> None:
    holding.do(MoveJoints(FAR))
    holding.run(0.5)
    holding.do(Pause())
    holding.until(lambda s: s.state is State.PAUSED, seconds=1)
    stop(holding)
    assert holding.now.state is State.HOLDING


def test_the_gripper_stops_where_it_is(holding: Rig) -> None:
    holding.do(MoveGripper(0.0))
    ticket = holding.do(MoveGripper(1.0))
    holding.run(0.1)
    stop(holding)
    opening = holding.now.gripper
    assert 0 < opening < 1
    fails(ticket.finished, "stopped by test")
    holding.run(1)
    assert holding.now.gripper == opening


def test_a_stop_with_nothing_to_stop_is_over_at_once(rig: Rig) -> None:
    stop(rig).result(0)
    assert rig.now.state is State.DISCONNECTED
    # whoever means to move the arm again sees it
    assert (rig.now.stops, rig.now.last_stop) == (1, Stopped("test"))


def test_a_stop_before_the_first_setpoint_moves_nothing(holding: Rig) -> None:
    holding.do(MoveJoints(FAR))
    holding.controller.stop(TEST)
    holding.sends_nothing(TICK)
    assert holding.now.state is State.HOLDING


def test_a_jog_that_is_still_held_does_not_go_on_after_a_stop(holding: Rig) -> None:
    for _ in range(20):
        holding.do(BASE)
    holding.controller.stop(TEST)
    for _ in range(60):
        ticket = holding.do(BASE)
    fails(ticket.accepted, "let go first")
    assert holding.now.state is State.HOLDING
    stood = holding.now.q_command
    holding.run(0.3)  # the key is let go
    holding.do(BASE).accepted.result(0)
    holding.run(0.1)
    assert holding.now.q_command[0] > stood[0]


def test_a_jog_that_the_stop_dropped_counts_as_held(holding: Rig) -> None:
    holding.do(BASE)
    holding.run(0.1)
    dropped = holding.controller.submit(BASE, TEST)
    stop(holding)
    fails(dropped.accepted, "before it began")
    holding.run(0.14)
    holding.refuses(BASE, "let go first")


def test_a_jog_is_over_on_a_board_that_does_not_answer(holding: Rig) -> None:
    holding.do(BASE)
    holding.tick()
    holding.driver.fail["read"] = BoardTimeoutError("no answer")
    holding.run(2 * TICK)
    stop(holding).result(0)
    assert holding.now.state is State.HOLDING


@pytest.mark.parametrize(
    ("origin", "line"),
    [
        (PAGE_GONE, ("info", "page 3: the operator's page is gone; nothing moved, holding as before")),
        (TEST, ("warning", "STOP (test)")),
    ],
)
def test_at_rest_a_stop_is_a_warning_and_a_closed_page_is_none(
    holding: Rig, origin: Origin, line: tuple[str, str]
) -> None:
    stop(holding, origin).result(0)
    assert logged(holding)[-1] == line


def test_a_press_that_comes_on_two_ways_is_one_line_and_each_motion_that_it_stops_another(
    holding: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("armctl.runtime.notices.wall_time", lambda: 1000.0)
    for count in (1, 2):
        holding.do(MoveJoints(FAR if count == 1 else HOME))
        holding.run(2 * TICK)
        for _ in range(2):
            holding.controller.stop(TEST)
            holding.tick()
        holding.rests(1)
        stop(holding).result(0)
        assert logged(holding).count(("warning", "STOP (test)")) == count


@pytest.mark.parametrize("command", [MoveJoints(FAR), MoveGripper(1.0), Jog(np.ones(5))])
def test_a_page_that_is_closed_in_a_motion_is_a_warning(
    holding: Rig, command: MoveJoints | MoveGripper | Jog
) -> None:
    holding.do(MoveGripper(0.0))  # in one step: its opening is not known yet
    asked = holding.do(command)
    holding.run(2 * TICK)
    holding.controller.stop(PAGE_GONE)
    holding.rests(1)
    if not isinstance(command, Jog):
        fails(asked.finished, "stopped by page 3: the operator's page is gone")
    assert WARNING in logged(holding)


def test_a_page_that_is_closed_while_its_motion_is_planned_is_a_warning(late: Rig) -> None:
    motion = late.do(MoveJoints(FAR))
    stop(late, PAGE_GONE)
    assert logged(late)[-1] == WARNING
    fails(motion.finished, "stopped by page 3")
    late.executor.work()
    late.sends_nothing(0.2)


@pytest.mark.logs_a_defect
def test_a_motion_that_cannot_be_stopped_is_a_fault_and_every_stop_is_answered(
    holding: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A defect: it must neither end the controller's thread nor leave a caller waiting."""

    def broken(_mover: PathMover) -> None:
        raise ZeroDivisionError("by nought")

    motion = holding.do(MoveJoints(FAR))
    holding.run(0.5)
    monkeypatch.setattr(PathMover, "stop", broken)
    first, second = holding.controller.stop(TEST), holding.controller.stop(TEST)
    holding.tick()
    first.result(0)
    second.result(0)
    fails(motion.finished, "internal error: ZeroDivisionError: by nought", ArmctlError)
    assert holding.now.state is State.FAULT
    holding.sends_nothing(1.0)
