from __future__ import annotations

import numpy as np
import pytest
from tests.program.kit import program
from tests.runtime.kit import (
    ROBOT,
    TEST,
    TICK,
    Rig,
    assert_accelerations_keep_limits,
    assert_keeps_limits,
    fails,
    steps_seen,
)

from armctl.errors import InputError, ProgramError
from armctl.facts import State
from armctl.motion import PointToPoint
from armctl.program import GripperStep, MoveStep, PointStep, Program, Step, WaitStep
from armctl.protocol import MoveGripper, MoveJoints, Pause, Resume, RunProgram, SetSpeed

REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")
TO_HOME = MoveStep(joints_deg=tuple(np.degrees(HOME).tolist()))
TO_REST = MoveStep(joints_deg=tuple(np.degrees(REST).tolist()))
POINT = PointStep(x_mm=200, y_mm=50, z_mm=100)
WAIT = WaitStep(seconds=0.5)
FAR_AWAY = PointStep(x_mm=900, y_mm=0, z_mm=0)


def test_every_step_in_order(holding: Rig) -> None:
    ticket = holding.do(RunProgram(program(TO_HOME, GripperStep(open_percent=100), WAIT, POINT, TO_REST)))
    assert holding.now.state is State.MOVING
    assert holding.now.cause == "program 'pick' (test)"
    holding.rests()
    ticket.result(0)
    assert steps_seen(holding) == [(0, 0), (0, 1), (0, 2), (0, 3), (0, 4)]
    np.testing.assert_allclose(holding.now.q_command, REST, atol=1e-12)
    assert holding.now.gripper == 1.0
    assert holding.now.program is None
    assert holding.now.cause == "program 'pick' finished"
    tips = ROBOT.forward(np.array([s.q_command for s in holding.history]))[:, :3, 3]
    assert np.linalg.norm(tips - [0.2, 0.05, 0.1], axis=1).min() < 1e-9
    assert_keeps_limits(holding)


def test_it_does_not_pause_to_think(holding: Rig) -> None:
    one = PointToPoint.plan(ROBOT, REST, HOME).duration
    holding.do(RunProgram(program(TO_HOME, TO_REST), loops=3))
    began = holding.now.stamp
    holding.rests()
    # a tick at the most at each of the six meetings
    assert holding.now.stamp - began <= 6 * (one + TICK) + 2 * TICK
    assert steps_seen(holding) == [(k, step) for k in range(3) for step in range(2)]


def test_for_ever_until_stopped(holding: Rig) -> None:
    ticket = holding.do(RunProgram(program(TO_HOME, WaitStep(seconds=0.1), TO_REST), loops=None))
    holding.run(30)
    assert holding.now.state is State.MOVING
    assert holding.now.program.loops is None
    assert holding.now.program.loop > 5
    holding.stops()
    fails(ticket.finished, "program 'pick' was stopped by test")
    holding.sends_nothing(5)


def test_a_stop_during_a_wait_or_the_gripper_ends_it(holding: Rig) -> None:
    for step in (WaitStep(seconds=60), GripperStep(open_percent=100)):
        holding.do(MoveGripper(0.0))
        holding.run(1)
        ticket = holding.do(RunProgram(program(step, TO_HOME)))
        holding.run(0.2)
        holding.controller.stop(TEST)
        assert holding.tick().state is State.HOLDING
        fails(ticket.finished, "was stopped")
        holding.sends_nothing(2)


def test_it_begins_where_it_is_told_in_the_first_pass_only(holding: Rig) -> None:
    holding.finishes(RunProgram(program(TO_HOME, TO_REST, POINT), loops=2, first=2))
    assert steps_seen(holding) == [(0, 2), (1, 0), (1, 1), (1, 2)]


@pytest.mark.parametrize("step", [TO_HOME, WAIT, GripperStep(open_percent=100)])
def test_pause_and_resume_in_every_kind_of_step(holding: Rig, step: Step) -> None:
    holding.do(MoveGripper(0.0))
    holding.run(0.5)
    ticket = holding.do(RunProgram(program(step, TO_REST)))
    holding.run(0.1)
    holding.do(Pause()).result(0)
    holding.until(lambda s: s.state is State.PAUSED, seconds=0.5)
    assert holding.now.cause == "program 'pick' paused"
    holding.sends_nothing(5)
    assert holding.now.state is State.PAUSED
    assert holding.now.program.step == 0
    holding.finishes(Resume())
    ticket.result(0)
    assert_accelerations_keep_limits(holding)


def test_a_step_that_ends_while_it_is_being_paused_waits_before_the_next(holding: Rig) -> None:
    holding.do(RunProgram(program(TO_HOME, TO_REST)))
    holding.until(lambda s: np.abs(s.q_command - HOME).max() < np.radians(1))
    holding.do(Pause())
    holding.until(lambda s: s.state is State.PAUSED, seconds=1)
    holding.run(1)
    assert holding.now.state is State.PAUSED
    holding.finishes(Resume())
    np.testing.assert_allclose(holding.now.q_command, REST, atol=1e-12)


def test_a_wait_is_not_stretched_by_the_speed(holding: Rig) -> None:
    holding.do(SetSpeed(0.1))
    holding.do(RunProgram(program(WAIT)))
    began = holding.now.stamp
    holding.rests()
    assert holding.now.stamp - began == pytest.approx(0.5, abs=3 * TICK)


@pytest.mark.parametrize(
    ("wrong", "loops", "first", "error", "message"),
    [
        (program(), 1, 0, ProgramError, "pick: it has no steps"),
        (Program(robot="abaas", steps=(WAIT,)), 1, 0, ProgramError, "it is for the robot 'abaas'"),
        (program(WAIT, MoveStep(joints_deg=(0, 1))), 1, 0, ProgramError, "pick: step 2: 5 joint angles"),
        (program(MoveStep(joints_deg=(0, 90, -91.2, 0, 0))), 1, 0, ProgramError, "step 1: Elbow: -91.20°"),
        (program(WAIT), 0, 0, InputError, "once or more often, not 0 times"),
        (program(WAIT), 1, 1, InputError, "pick has no step 2; it has 1"),
        (program(FAR_AWAY), 1, 0, ProgramError, "pick: step 1: "),
    ],
)
def test_what_cannot_run_is_refused(
    holding: Rig, wrong: Program, loops: int, first: int, error: type[Exception], message: str
) -> None:
    ticket = holding.do(RunProgram(wrong, loops, first))
    holding.run(0.1)
    with pytest.raises(error, match=message):
        ticket.accepted.result(0)
    assert holding.now.state is State.HOLDING
    assert len(holding.driver.writes) == 1


def test_a_step_that_cannot_be_reached_stops_it_holding_and_names_the_step(holding: Rig) -> None:
    ticket = holding.do(RunProgram(program(TO_HOME, WAIT, FAR_AWAY, TO_REST)))
    ticket.accepted.result(0)
    holding.rests()
    with pytest.raises(ProgramError, match="pick: step 3: ") as caught:
        ticket.result(0)
    assert caught.value.__cause__ is not None
    np.testing.assert_allclose(holding.now.q_command, HOME, atol=1e-12)
    assert holding.now.cause.startswith("pick: step 3: ")
    holding.do(MoveJoints(REST)).accepted.result(0)


def test_the_next_step_is_planned_while_the_present_one_runs(late: Rig) -> None:
    ticket = late.do(RunProgram(program(TO_HOME, TO_REST, POINT)))
    assert len(late.executor.waiting) == 1
    late.run(0.1)
    assert not ticket.accepted.done()
    late.executor.work()
    late.run(0.1)
    assert ticket.accepted.done()
    assert len(late.executor.waiting) == 1  # the second one, while the first runs
    late.run(3)  # the planner is late: the arm waits at home
    np.testing.assert_allclose(late.now.q_command, HOME, atol=1e-12)
    assert late.now.state is State.MOVING
    late.executor.work()
    late.run(0.1)
    assert not np.allclose(late.now.q_command, HOME)
    late.executor.work()
    late.rests()
    ticket.result(0)


def test_an_endless_loop_that_goes_nowhere_does_not_hang(holding: Rig) -> None:
    holding.do(RunProgram(program(TO_REST, WaitStep(seconds=0)), loops=None))
    holding.run(2)
    assert holding.now.state is State.MOVING
    holding.controller.stop(TEST)
    assert holding.tick().state is State.HOLDING


def test_the_gripper_belongs_to_the_program(holding: Rig) -> None:
    """What comes next in it is checked with the gripper as its steps leave it."""
    holding.do(MoveGripper(0.0))
    holding.do(RunProgram(program(GripperStep(open_percent=100), WaitStep(seconds=5))))
    holding.tick()
    holding.refuses(MoveGripper(0.2), "the gripper is not free: wait, or stop first")
    holding.run(1)
    holding.refuses(MoveGripper(0.2), "the gripper is not free: wait, or stop first")
    holding.stops()
    holding.do(MoveGripper(0.2)).accepted.result(0)


@pytest.mark.logs_a_defect
def test_a_defect_in_planning_the_next_step_is_logged_once(
    holding: Rig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ValueError("oops")

    monkeypatch.setattr("armctl.program.motion_steps.choose_end", broken)
    ticket = holding.do(RunProgram(program(TO_HOME, POINT, TO_REST)))
    holding.rests()
    fails(ticket.finished, "pick: planning failed: ValueError: oops", ProgramError)
    assert sum(record.message == "planning failed" for record in caplog.records) <= 2
