"""A stream of setpoints; motions with a name, which can be cancelled one by one, and how far they are."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from tests.runtime.kit import MIDDLE, TEST, TICK, Rig, assert_keeps_limits, fails, swings

from armctl.errors import BoardError, InputError, MotionRefusedError
from armctl.facts import State
from armctl.program import Program, WaitStep
from armctl.protocol import (
    Cancel,
    Connect,
    Enable,
    FollowTarget,
    Jog,
    MoveGripper,
    MoveJoints,
    Pause,
    RunProgram,
    StreamJoints,
)

LEFT = MIDDLE + np.radians([20, 0, 0, 0, 0])


@pytest.fixture
def middle(holding: Rig) -> Rig:
    holding.finishes(MoveJoints(MIDDLE))
    holding.history.clear()
    holding.driver.writes.clear()
    return holding


def send(rig: Rig, setpoints: Iterable[np.ndarray], motion: str = "one") -> None:
    for q in setpoints:
        rig.do(StreamJoints(q, motion=motion)).result(0)


def sways(seconds: float) -> list[np.ndarray]:
    times = np.arange(0.0, seconds, TICK)
    return [MIDDLE + np.radians([20, 8, 0, 0, 0]) * np.sin(2 * t) for t in times]


def test_the_arm_follows_a_stream_behind_by_its_braking_way(middle: Rig) -> None:
    setpoints = sways(6.0)
    send(middle, setpoints)
    went = np.array([snapshot.q_command for snapshot in middle.history])
    assert np.degrees(np.abs(went - np.array(setpoints)).max()) < 3.0
    assert np.degrees(np.ptp(went[:, 0])) > 39.0
    assert_keeps_limits(middle)


def test_jumps_are_gone_to_inside_the_limits(middle: Rig) -> None:
    rng = np.random.default_rng(5)
    for _ in range(40):
        send(middle, [MIDDLE + rng.uniform(-0.3, 0.3, 5)] * int(rng.integers(1, 6)))
    assert middle.now.state is State.MOVING
    assert_keeps_limits(middle)


def test_a_stream_that_falls_silent_slows_down_and_may_go_on(middle: Rig) -> None:
    send(middle, [LEFT] * 10)
    fast = np.abs(middle.now.velocity_command).max()
    middle.run(0.1)
    assert np.abs(middle.now.velocity_command).max() > 0.9 * fast
    middle.rests(0.6)
    assert np.abs(middle.now.q_command - LEFT).max() > 0.02
    middle.sends_nothing(1.0)
    send(middle, [LEFT] * 150)
    np.testing.assert_array_equal(middle.now.q_command, LEFT)
    assert_keeps_limits(middle)


def test_the_last_setpoint_is_gone_to_however_long_it_takes(middle: Rig) -> None:
    send(middle, [MIDDLE, LEFT])
    ticket = middle.do(StreamJoints(LEFT, last=True, motion="one"))
    middle.rests(5.0)
    ticket.result(0)
    np.testing.assert_array_equal(middle.now.q_command, LEFT)
    assert middle.now.stamp - middle.history[0].stamp > 0.2
    middle.finishes(StreamJoints(LEFT, last=True, motion="two"))  # there already


def test_the_last_setpoint_behind_the_floor_ends_the_stream_and_says_so(middle: Rig) -> None:
    middle.finishes(MoveJoints(np.radians([0, 60, -80, -20, 0])))
    ticket = middle.do(StreamJoints(np.radians([0.0, 8, -80, -20, 0]), last=True, motion="one"))
    middle.rests(5.0)
    fails(ticket.finished, "setpoint stream: the floor is in the way", MotionRefusedError)
    assert middle.robot.forward(middle.now.q_command)[2, 3] > 0.0


def test_what_cannot_be_is_refused_and_moves_nothing(middle: Rig) -> None:
    middle.refuses(StreamJoints(LEFT), "needs a name", InputError)
    middle.refuses(StreamJoints(LEFT[:3], motion="one"), "5 joint angles", InputError)
    middle.refuses(StreamJoints(LEFT * np.nan, motion="one"), "finite", InputError)
    middle.refuses(StreamJoints(LEFT * 9, motion="one"), r"Base: .* is outside", MotionRefusedError)
    middle.refuses(Cancel(""), "which motion", InputError)
    middle.sends_nothing(0.2)
    send(middle, [LEFT])
    middle.refuses(StreamJoints(LEFT, motion="two"), "another setpoint stream runs")
    middle.refuses(Jog(np.ones(5)), "stop first")
    middle.refuses(Pause(), "setpoint stream cannot be paused")


@pytest.mark.parametrize("silent_s", [0.0, 0.1, 2.0])
def test_stop_ends_a_stream_for_good(middle: Rig, silent_s: float) -> None:
    send(middle, [LEFT] * 8)
    middle.run(silent_s)
    middle.controller.stop(TEST)
    middle.rests(1.0)
    for _ in range(30):  # however long it goes on
        middle.refuses(StreamJoints(LEFT, motion="one"), r"the setpoint stream is over .*begin another one")
        middle.run(0.3)
    send(middle, [LEFT], "two")
    assert middle.now.state is State.MOVING
    assert_keeps_limits(middle)


def test_while_the_arm_stops_no_stream_goes_on(middle: Rig) -> None:
    send(middle, [LEFT] * 8)
    middle.do(Cancel("one"))
    assert middle.now.state is State.MOVING
    middle.refuses(StreamJoints(LEFT, motion="one"), "the setpoint stream is over")
    middle.refuses(StreamJoints(LEFT, motion="two"), "another setpoint stream runs")
    middle.rests(1.0)


def test_after_a_fault_a_stream_does_not_go_on(middle: Rig) -> None:
    send(middle, [LEFT] * 8)
    middle.driver.fail["write"] = ValueError("a defect")
    middle.tick()
    assert middle.now.state is State.FAULT
    middle.driver.fail.clear()
    middle.refuses(StreamJoints(LEFT, motion="one"), "the setpoint stream is over")
    middle.do(Connect("sim")).result(0)
    middle.do(Enable(MIDDLE)).result(0)
    middle.refuses(StreamJoints(LEFT, motion="one"), "the setpoint stream is over")


def test_progress_is_the_share_of_the_motion_that_is_over(middle: Rig) -> None:
    assert middle.now.progress is None
    middle.finishes(MoveJoints(LEFT, duration_s=2.0))
    shown = [snapshot.progress for snapshot in middle.history if snapshot.progress is not None]
    assert len(shown) == pytest.approx(100, abs=2)
    assert shown == pytest.approx(np.arange(len(shown)) / 100, abs=0.011)
    assert middle.now.progress is None
    send(middle, [MIDDLE])
    assert middle.now.progress is None
    middle.rests()
    middle.history.clear()
    steps = (*swings(0.0, 0.1, -0.1), WaitStep(seconds=1))
    middle.finishes(RunProgram(Program(robot="uzuner", steps=steps), loops=2))
    shown = [snapshot.progress for snapshot in middle.history if snapshot.progress is not None]
    assert (np.diff(shown) >= 0).all()
    assert {round(6 * share) for share in shown} == set(range(6))
    middle.do(RunProgram(Program(robot="uzuner", steps=steps), loops=None)).accepted.result(0)
    assert middle.now.progress is None


def test_cancel_stops_one_motion_on_its_path(middle: Rig) -> None:
    motion = middle.do(MoveJoints(LEFT, duration_s=2.0, motion="a"))
    middle.run(0.8)
    for other in ("b", "nothing"):
        middle.do(Cancel(other)).result(0)
    assert middle.now.state is State.MOVING
    cancel = middle.do(Cancel("a"))
    assert not cancel.finished.done()
    middle.rests(1.0)
    cancel.result(0)
    fails(motion.finished, "move was stopped by test")
    assert "move cancelled (test)" in middle.texts
    middle.do(Cancel("a")).result(0)  # over already
    assert_keeps_limits(middle)


def test_cancel_of_a_paused_motion(middle: Rig) -> None:
    motion = middle.do(MoveJoints(LEFT, duration_s=2.0, motion="a"))
    middle.run(0.5)
    middle.do(Pause()).result(0)
    middle.until(lambda snapshot: snapshot.state is State.PAUSED)
    middle.do(Cancel("a"))
    middle.rests(0.1)
    fails(motion.finished, "stopped by test")


def test_cancel_of_a_motion_that_is_planned(late: Rig) -> None:
    motion = late.do(MoveJoints(MIDDLE, motion="a"))
    late.do(Cancel("b")).result(0)
    assert not motion.finished.done()
    late.do(Cancel("a")).result(0)
    fails(motion.finished, "cancelled by test")
    late.executor.work()
    late.sends_nothing(0.5)


def test_cancel_of_the_gripper_lets_the_arm_go_on(middle: Rig) -> None:
    middle.do(MoveGripper(0.0))
    middle.run(3.0)
    arm = middle.do(MoveJoints(LEFT, duration_s=1.0, motion="a"))
    gripper = middle.do(MoveGripper(1.0, motion="g"))
    middle.run(0.1)
    middle.do(Cancel("g")).result(0)
    fails(gripper.finished, "cancelled by test")
    opening = middle.now.gripper
    assert 0.0 < opening < 1.0
    middle.rests()
    arm.result(0)
    assert middle.now.gripper == opening


def test_a_motion_without_a_name_is_not_cancelled_by_another(middle: Rig) -> None:
    send(middle, [LEFT] * 3, "one")
    middle.rests(1.0)
    ticket = middle.do(MoveJoints(MIDDLE))
    middle.do(Cancel("one")).result(0)
    middle.rests()
    ticket.result(0)
    assert middle.do(FollowTarget(None)).finished.exception(0) is None


def test_a_cancel_that_meets_a_fault_is_answered(middle: Rig) -> None:
    middle.do(MoveJoints(LEFT, duration_s=2.0, motion="a"))
    middle.driver.fail["write"] = BoardError("the line is silent")
    cancel = middle.do(Cancel("a"))
    middle.tick()
    assert middle.now.state is State.FAULT
    cancel.result(0)
