from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from tests.runtime.kit import (
    ROBOT,
    TICK,
    Rig,
    assert_accelerations_keep_limits,
    assert_keeps_limits,
    assert_stream_keeps_limits,
    fails,
)

from armctl.errors import ArmctlError, InputError, MotionRefusedError, StateError, UnreachableError
from armctl.facts import State
from armctl.kinematics import Target
from armctl.motion import JoinedTrajectory, PointToPoint, arc, plan_joints, plan_target
from armctl.protocol import TIMING, Follow, Jog, MoveJoints, MoveTo, Pause, Release, Resume, SetSpeed

REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")


def test_a_move_arrives_exactly_in_the_planned_time(holding: Rig) -> None:
    duration = PointToPoint.plan(ROBOT, REST, HOME).duration
    ticket = holding.do(MoveJoints(HOME))
    assert ticket.accepted.done()
    assert not ticket.finished.done()
    assert holding.now.state is State.MOVING
    assert holding.now.cause == "move (test)"
    began = holding.now.stamp
    holding.rests()
    assert holding.now.stamp - began == pytest.approx(duration, abs=TICK)
    ticket.result(0)
    assert np.array_equal(holding.now.q_command, HOME)
    assert not holding.now.velocity_command.any()
    assert holding.now.cause == "move finished"
    holding.sends_nothing(1)
    assert_stream_keeps_limits(holding, 1)


def test_normal_movement_turns_every_joint_for_itself(holding: Rig) -> None:
    goal = HOME + np.radians([60, 0, 0, 20, 0])
    holding.do(MoveJoints(goal, profile="normal"))
    holding.run(0.6)
    assert holding.now.q_command[3] == pytest.approx(goal[3], abs=1e-12)
    assert holding.now.q_command[0] != goal[0]
    holding.rests()
    assert np.array_equal(holding.now.q_command, goal)
    assert_accelerations_keep_limits(holding)


def test_a_point_is_reached(holding: Rig) -> None:
    point = np.array([0.2, 0.05, 0.1])
    holding.finishes(MoveTo(Target.of(point), choose="least-travel"))
    np.testing.assert_allclose(ROBOT.forward(holding.now.q)[:3, 3], point, atol=1e-9)


@pytest.mark.parametrize(
    ("command", "error", "message"),
    [
        (MoveTo(Target.of([0.9, 0, 0.1])), UnreachableError, "nearest reachable point"),
        (MoveTo(Target.of([0.2, 0, 0.1]), choose="cheapest"), InputError, "criterion 'cheapest'"),
        (MoveJoints(np.radians([0, 90, -91.2, 0, 0])), MotionRefusedError, "Elbow: -91.20°"),
        (MoveJoints(HOME, duration_s=0.01), MotionRefusedError, "shortest possible duration"),
        (MoveJoints(np.radians([0, -3, -60, -20, 0])), MotionRefusedError, "below the floor"),
        (MoveJoints(np.full(5, np.nan)), InputError, "finite"),
        (MoveJoints(np.zeros(2)), InputError, "5 joint angles"),
    ],
)
def test_what_cannot_be_is_refused_before_the_arm_moves(
    holding: Rig, command: MoveTo | MoveJoints, error: type[Exception], message: str
) -> None:
    ticket = holding.do(command)
    fails(ticket.accepted, message, error)
    fails(ticket.finished, message, error)
    holding.run(0.5)
    assert holding.now.state is State.HOLDING
    assert len(holding.driver.writes) == 1
    assert any("refused" in text for text in holding.texts)


def test_a_second_motion_is_refused_and_says_stop_first(holding: Rig) -> None:
    first = holding.do(MoveJoints(HOME))
    holding.refuses(MoveJoints(REST), r"it is moving \(move \(test\)\); stop first")
    holding.rests()
    first.result(0)


def test_planning_takes_its_time_and_the_arm_waits(late: Rig) -> None:
    ticket = late.do(MoveJoints(HOME))
    late.run(0.2)
    assert late.now.state is State.HOLDING
    assert not ticket.accepted.done()
    late.refuses(MoveJoints(REST), "another motion is being planned")
    late.executor.work()
    late.tick()
    assert ticket.accepted.done()
    assert late.now.state is State.MOVING


def moved(rig: Rig) -> None:
    rig.do(Jog(np.array([1.0, 0, 0, 0, 0]))).accepted.result(0)
    rig.run(1)


@pytest.mark.parametrize(
    ("meanwhile", "words", "error"),
    [
        (lambda rig: rig.do(Release()), "released", StateError),
        (moved, "no longer stands where the motion was planned from", StateError),
        (lambda rig: rig.executor.waiting[0][0].cancel(), "planning was dropped", StateError),
        (
            lambda rig: rig.executor.waiting[0][0].set_exception(ZeroDivisionError("oops")),
            "planning failed: ZeroDivisionError: oops",
            ArmctlError,
        ),
    ],
)
@pytest.mark.logs_a_defect
def test_a_plan_that_cannot_be_taken_is_refused_and_harms_nothing(
    late: Rig, meanwhile: Callable[[Rig], object], words: str, error: type[Exception]
) -> None:
    ticket = late.do(MoveJoints(HOME))
    meanwhile(late)
    late.executor.waiting = [(future, plan) for future, plan in late.executor.waiting if not future.done()]
    late.executor.work()
    late.tick()
    fails(ticket.accepted, words, error)
    assert late.now.state in (State.HOLDING, State.OFF)


def test_following_a_trajectory_of_ones_own(holding: Rig) -> None:
    first = plan_target(ROBOT, REST, Target.of(arc()[20]))
    second = plan_target(ROBOT, first.end, Target.of(arc()[21]))
    holding.finishes(Follow(JoinedTrajectory([first, second])))
    assert np.array_equal(holding.now.q_command, second.end)
    assert_accelerations_keep_limits(holding)


def test_pause_and_resume_on_the_same_path(holding: Rig) -> None:
    trajectory = plan_joints(ROBOT, REST, HOME)
    ticket = holding.do(MoveJoints(HOME))
    holding.run(0.3)
    holding.do(Pause()).result(0)
    holding.until(lambda s: s.state is State.PAUSED, seconds=0.5)
    paused_at = holding.now.q_command
    holding.sends_nothing(1)
    holding.do(Pause()).result(0)
    holding.do(Resume()).result(0)
    assert holding.now.state is State.MOVING
    holding.rests()
    ticket.result(0)
    assert not np.array_equal(paused_at, HOME)
    dense = trajectory.sample(np.linspace(0, trajectory.duration, 20_001)).q
    for snapshot in holding.history:
        assert np.abs(dense - snapshot.q_command).max(axis=1).min() < 1e-4
    assert_accelerations_keep_limits(holding)


def test_a_pause_may_be_taken_back_while_it_slows_down(holding: Rig) -> None:
    holding.do(MoveJoints(HOME))
    holding.run(0.3)
    holding.do(Pause())
    holding.finishes(Resume())
    assert all(s.state is not State.PAUSED for s in holding.history)


def test_the_speed_may_change_on_the_way(holding: Rig) -> None:
    holding.do(MoveJoints(HOME, duration_s=3))
    holding.run(1)
    holding.do(SetSpeed(0.05))
    holding.run(1)
    slow = np.abs(holding.now.velocity_command).max()
    holding.do(SetSpeed(1.0))
    holding.run(0.5)
    assert np.abs(holding.now.velocity_command).max() > 10 * slow
    holding.rests()
    assert_keeps_limits(holding)


def test_a_late_tick_does_not_jump_and_is_told(holding: Rig) -> None:
    holding.do(MoveJoints(HOME))
    holding.run(0.3)
    before = holding.now.q_command
    holding.tick(0.5)
    assert (np.abs(holding.now.q_command - before) <= ROBOT.speed_limits * 2 * TICK + 1e-12).all()
    assert any("480 ms late" in text for text in holding.now.warnings)
    holding.rests()
    holding.run(6)
    assert holding.now.warnings == ()


def test_late_ticks_in_a_row_are_one_notice_and_two_lines_of_the_log(holding: Rig) -> None:
    holding.do(MoveJoints(HOME))
    for late in (0.1, 0.3, 0.2):
        holding.run(0.2)
        holding.tick(TICK + late)
        assert sum(" late" in text for text in holding.now.warnings) == 1
    (told,) = holding.now.warnings
    assert told.startswith("the controller was late 3 times, by up to 300 ms; each time the motion halted")
    holding.rests()
    holding.run(6)
    assert holding.now.warnings == ()
    lines = [event.text for event in holding.now.events if event.about == TIMING]
    assert lines == [text for text in holding.texts if " late" in text]
    assert lines == ["the controller was 100 ms late; the motion halted and goes on from rest", told]
    holding.do(MoveJoints(REST))
    holding.run(0.2)
    holding.tick(0.5)  # after some time in time it is news again
    assert [text for text in holding.texts if " late" in text][2:] == [holding.now.warnings[0]]
    assert "480 ms late" in holding.now.warnings[0]


def test_going_nowhere_is_over_at_once(holding: Rig) -> None:
    holding.do(MoveJoints(REST)).result(0)
    assert holding.now.state is State.HOLDING
    assert len(holding.driver.writes) == 1
