"""The controller on a simulated Feetech bus: taking over, sag, joints that a hand leads, and what is told."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from tests.faults.kit import PORT, Bench
from tests.runtime.kit import TEST

from armctl.errors import EnableError, MotionRefusedError, StateError
from armctl.facts import State
from armctl.hardware import Source
from armctl.protocol import ClearFault, Connect, Enable, LimitTorque, MoveJoints, Release


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench("feetech")
    bench.does(Connect(PORT), State.OFF)
    yield bench
    bench.close()


@pytest.fixture
def holding(bench: Bench) -> Bench:
    bench.does(Enable(), State.HOLDING)
    return bench


def refused(bench: Bench, command: object) -> Exception:
    ticket = bench.controller.submit(command, TEST)  # type: ignore[arg-type]
    bench.run(0.2)
    error = ticket.finished.exception(0)
    assert error is not None
    return error


def lead(bench: Bench, joint: int, degrees: float) -> None:
    """A hand turns a joint within half a second, and holds it there."""
    one = bench.board.plant.joints[joint]
    one.hand = np.radians(degrees) / 0.5
    bench.run(0.5)
    one.hand = 0.0
    bench.run(0.1)


def test_the_arm_is_taken_over_where_it_is_measured(bench: Bench):
    before = [one.shaft for one in bench.board.servos]
    bench.does(Enable(), State.HOLDING)
    bench.run(1.0)
    assert [one.shaft for one in bench.board.servos] == pytest.approx(before, abs=3)
    assert bench.now.source is Source.MEASURED
    assert np.abs(bench.now.q - bench.now.q_command).max() < np.radians(0.5)
    assert bench.now.quantities["Elbow flex"].voltage_v == pytest.approx(12.0, abs=0.5)


def test_a_move_ends_where_it_was_sent_but_for_the_sag_which_is_no_fault(holding: Bench):
    goal = holding.robot.pose("home")
    holding.does(MoveJoints(goal), State.HOLDING)
    holding.run(2.0)
    assert np.abs(holding.now.q - goal).max() < np.radians(5.0)
    assert not [one for one in holding.now.warnings if "does not stand" in one]


def test_a_joint_that_torque_would_throw_is_named_and_the_arm_stays_limp():
    bench = Bench("feetech")
    bench.board.servo(2).put("lowest", 1500)
    bench.does(Connect(PORT), State.OFF)
    error = refused(bench, Enable())
    assert isinstance(error, EnableError)
    assert "Shoulder lift: servo 2 stands at" in str(error)
    assert not any(one.driven for one in bench.board.servos)
    assert bench.now.state is State.OFF
    bench.close()


def test_a_servo_that_is_missing_is_named_by_its_joint(bench: Bench):
    bench.board.loose = 4
    bench.run(1.0)
    error = refused(bench, Enable())
    assert "Wrist roll: servo 5 does not answer" in str(error)
    assert not any(one.driven for one in bench.board.servos)


def test_joints_that_a_hand_leads_are_recorded_where_they_stand(holding: Bench):
    holding.does(Release(("wrist_flex",)), State.HOLDING)
    lead(holding, 3, -20.0)
    now = holding.now
    assert now.limp == ("Wrist flex",)
    led = np.degrees(now.q_command[3])
    assert led == pytest.approx(np.degrees(holding.robot.pose("rest")[3]) - 20.0, abs=1.5)
    assert now.q_command[0] == pytest.approx(0.0, abs=np.radians(0.5))
    with pytest.raises(StateError):
        raise refused(holding, MoveJoints(holding.robot.pose("home")))
    holding.board.plant.joints[3].hand = None
    before = holding.board.servo(4).shaft
    holding.does(Enable(), State.HOLDING)
    holding.run(0.5)
    assert holding.now.limp == ()
    assert holding.board.servo(4).shaft == pytest.approx(before, abs=25)  # it sags from the hand


def test_torque_comes_back_only_where_the_led_arm_touches_nothing(
    holding: Bench, monkeypatch: pytest.MonkeyPatch
):
    holding.does(Release(("elbow_flex",)), State.HOLDING)
    lead(holding, 2, -5.0)
    from armctl.facts import Said

    monkeypatch.setattr("armctl.runtime.power.touching", lambda *_: Said("hand touches base"))
    error = refused(holding, Enable())
    assert isinstance(error, MotionRefusedError) and "hand touches base" in str(error)
    assert not holding.board.servo(3).driven


def test_a_supply_that_was_interrupted_leaves_the_arm_limp_until_it_is_enabled(holding: Bench):
    holding.line.reset()
    holding.run(1.0)
    assert holding.now.state is State.FAULT
    assert "their supply was interrupted" in holding.now.cause
    assert not any(one.driven for one in holding.board.servos)
    holding.does(ClearFault(), State.OFF)
    holding.does(Enable(), State.HOLDING)
    assert all(one.driven for one in holding.board.servos)


def test_a_torque_limit_outlives_a_power_cut(holding: Bench):
    holding.does(LimitTorque(0.4, ("wrist_roll",)), State.HOLDING)
    assert holding.board.servo(5).get("torque_limit") == 400
    holding.line.reset()
    holding.run(1.0)
    holding.does(ClearFault(), State.OFF)
    holding.does(Enable(), State.HOLDING)
    assert [holding.board.servo(one).get("torque_limit") for one in (1, 5)] == [1000, 400]


def test_a_killed_host_leaves_the_arm_at_its_last_goal(holding: Bench):
    """No watchdog: the servos go on to the last goal that they were sent, which is a few degrees away."""
    holding.ask(MoveJoints(holding.robot.pose("home")))
    farthest = 0.0
    for _ in range(60):
        holding.tick()
        for one in holding.board.servos:
            ahead = abs(one.get("goal_position") - one.shaft) * 360 / 4096
            farthest = max(farthest, ahead)
    assert farthest < 12.0
    holding.start()  # another process; nobody speaks to the board meanwhile
    holding.clock.advance(1.0)
    holding.board.advance(holding.clock.now())
    goals = [one.get("goal_position") for one in holding.board.servos]
    assert [one.shaft for one in holding.board.servos] == pytest.approx(goals, abs=70)
    assert all(one.driven for one in holding.board.servos)
