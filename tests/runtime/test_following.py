from __future__ import annotations

import numpy as np
import pytest
from tests.runtime.kit import (
    ROBOT,
    TEST,
    TICK,
    LateExecutor,
    Rig,
    assert_accelerations_keep_limits,
    assert_keeps_limits,
    make_rig,
)

from armctl.errors import StateError
from armctl.facts import State
from armctl.kinematics import Target
from armctl.motion import Floor
from armctl.protocol import FollowTarget, MoveJoints, Pause, SetSpeed
from armctl.robot import load_robot
from armctl.runtime.joint_servo import KeepClear
from armctl.runtime.live_target import live_goal

HOME = ROBOT.pose("home")
TOOL = ROBOT.forward(HOME)[:3, 3]


@pytest.fixture
def rig() -> Rig:
    return make_rig().enable(HOME)


def follow(
    rig: Rig, point: np.ndarray | list[float], seconds: float = TICK, pitch: float | None = None
) -> None:
    for _ in range(round(seconds / TICK)):
        rig.do(FollowTarget(Target.of(point, pitch))).accepted.result(0)


def tool(rig: Rig) -> np.ndarray:
    return rig.robot.forward(rig.now.q_command)[:3, 3]


def test_to_begin_where_the_tool_is_moves_nothing(rig: Rig) -> None:
    follow(rig, TOOL, 1.0)
    assert np.abs(rig.now.q_command - HOME).max() < 1e-9
    assert rig.now.state is State.MOVING
    assert rig.now.cause == "live target (test)"


def test_it_arrives_exactly_keeps_pitch_and_roll_and_stays_until_it_is_left(rig: Rig) -> None:
    goal = TOOL + np.array([0.02, 0.06, -0.03])
    follow(rig, goal, 2.0)
    assert tool(rig) == pytest.approx(goal, abs=1e-9)
    assert ROBOT.inverse_kinematics.pitch_and_roll(rig.now.q_command) == pytest.approx(
        ROBOT.inverse_kinematics.pitch_and_roll(HOME), abs=1e-9
    )
    assert rig.now.warnings == ()
    rig.do(FollowTarget(None))
    rig.tick()
    assert rig.now.state is State.HOLDING
    assert rig.now.cause == "live target finished"
    assert_keeps_limits(rig)


def test_a_circle_is_followed_close_behind_and_without_a_jump(rig: Rig) -> None:
    lag: list[float] = []
    for k in range(300):
        w = 2 * np.pi * k * TICK / 3
        point = TOOL + np.array([0.0, 0.03 * np.sin(w), 0.03 * (1 - np.cos(w))])
        follow(rig, point)
        lag.append(float(np.linalg.norm(tool(rig) - point)))
    assert max(lag) < 0.009  # at 63 mm/s: a seventh of a second
    assert np.mean(lag[50:]) < 0.005
    assert_keeps_limits(rig)


def test_its_target_expires_500_ms_after_the_last_one(rig: Rig) -> None:
    follow(rig, TOOL + np.array([0.0, 0.15, 0.0]), 0.2)
    last = rig.now.stamp
    rig.finishes(SetSpeed(0.1), 2)
    assert 0.5 <= rig.now.stamp - last < 0.65
    assert tool(rig)[1] < TOOL[1] + 0.1
    assert_accelerations_keep_limits(rig)


def test_leaving_it_brakes_at_once(rig: Rig) -> None:
    follow(rig, TOOL + np.array([0.0, 0.15, 0.0]), 0.4)
    rig.do(FollowTarget(None))
    left = rig.now.stamp
    rig.rests(1)
    assert rig.now.stamp - left < 0.25
    assert_accelerations_keep_limits(rig)


def test_stop_ends_it_until_the_page_has_been_silent(rig: Rig) -> None:
    follow(rig, TOOL + np.array([0.0, 0.15, 0.0]), 0.4)
    rig.controller.stop(TEST)
    rig.tick()
    with pytest.raises(StateError, match="the arm was stopped; switch the live target on again"):
        follow(rig, TOOL)
    rig.rests(1)
    assert rig.now.cause == "stopped by test"
    rig.run(0.3)
    follow(rig, TOOL)
    assert rig.now.state is State.MOVING
    assert_accelerations_keep_limits(rig)


def test_the_override_slows_it_down(rig: Rig) -> None:
    rig.do(SetSpeed(0.1))
    follow(rig, TOOL + np.array([0.0, 0.15, 0.0]), 1.0)
    assert np.abs(rig.now.velocity_command / ROBOT.speed_limits).max() <= 0.1 + 1e-9
    assert np.abs(rig.now.velocity_command / ROBOT.speed_limits).max() == pytest.approx(0.1)


def test_out_of_reach_it_goes_to_the_nearest_point_and_says_why(rig: Rig) -> None:
    point = np.array([0.5, 0.0, 0.2])
    follow(rig, point, 4.0)
    nearest = ROBOT.inverse(point).nearest_m
    assert np.linalg.norm(tool(rig) - nearest) < 2e-3
    (notice,) = rig.now.warnings
    assert notice.startswith("live target: too far by 171.3 mm")
    assert notice.endswith("following the nearest point")
    follow(rig, TOOL, 4.0)
    assert tool(rig) == pytest.approx(TOOL, abs=1e-9)
    assert rig.now.warnings == ()
    assert_accelerations_keep_limits(rig)


def test_what_it_does_instead_is_said_in_the_language_of_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LC_ALL", "tr_TR.UTF-8")
    note = live_goal(ROBOT, KeepClear(ROBOT), HOME, Target.of([0.5, 0.0, 0.2]), None, None).note
    assert note is not None and note.startswith("171.3 mm fazla uzak: ")
    assert note.endswith("; en yakın nokta izleniyor")


def test_below_the_floor_it_stays_above(rig: Rig) -> None:
    follow(rig, [0.2, 0.0, -0.1], 4.0)
    floor = Floor(ROBOT)
    assert all(floor.clearance(s.q_command).min() >= -1e-9 for s in rig.history)
    assert floor.clearance(rig.now.q_command).min() < 0.02
    assert rig.now.warnings == ("live target: the floor is in the way",)
    assert_accelerations_keep_limits(rig)


def test_another_branch_is_not_taken_silently(rig: Rig) -> None:
    follow(rig, [-0.15, 0.01, 0.2], 1.0)
    assert np.abs(rig.now.q_command - HOME).max() < 1e-9
    assert rig.now.warnings == (
        "live target: it can be reached only with back elbow-up; the arm keeps its posture and waits",
    )


def test_the_tool_is_not_swung_round_the_back() -> None:
    start = HOME + np.radians([100, 0, 0, 0, 0])
    mirrored = HOME + np.radians([-100, 0, 0, 0, 0])
    point = ROBOT.forward(mirrored)[:3, 3]
    found = live_goal(ROBOT, KeepClear(ROBOT), start, Target.of(point), np.radians(-30))
    assert found.q is None
    assert "the tool would swing" in found.note


def test_where_the_pitch_cannot_be_kept_the_point_comes_first_and_the_pitch_comes_back(rig: Rig) -> None:
    follow(rig, [0.15, 0.1, 0.2], 2.0)
    assert tool(rig) == pytest.approx([0.15, 0.1, 0.2], abs=1e-9)
    follow(rig, TOOL, 2.0)
    assert rig.now.q_command == pytest.approx(HOME, abs=1e-9)


def test_a_pitch_that_is_asked_for_is_met(rig: Rig) -> None:
    follow(rig, [0.2, 0.0, 0.2], 2.0, pitch=np.radians(-45))
    pitch, _ = ROBOT.inverse_kinematics.pitch_and_roll(rig.now.q_command)
    assert pitch == pytest.approx(np.radians(-45))


@pytest.mark.parametrize("name", ["mico", "scorbot", "abaas", "humanoid"])
def test_every_arm_follows(name: str) -> None:
    robot = load_robot(name)
    rig = make_rig(robot=robot).enable(robot.pose("home"))
    goal = tool(rig) + np.array([0.0, 0.02, 0.0])
    follow(rig, goal, 2.0)
    assert tool(rig) == pytest.approx(goal, abs=1e-6)
    assert_accelerations_keep_limits(rig)


def test_it_needs_the_arm_holding_and_nothing_else_begins_meanwhile(rig: Rig) -> None:
    follow(rig, TOOL, 0.1)
    rig.refuses(MoveJoints(HOME), "stop first")
    rig.refuses(Pause(), "live target cannot be paused; press STOP")
    rig.do(FollowTarget(None))
    rig.run(0.2)
    rig.do(MoveJoints(ROBOT.pose("rest")))
    with pytest.raises(StateError, match="to follow a target needs the arm holding, it is moving"):
        follow(rig, TOOL)


def test_only_the_newest_target_is_solved_for() -> None:
    rig = make_rig(executor := LateExecutor()).enable(HOME)
    for k in range(20):
        follow(rig, TOOL + np.array([0.0, 0.002 * k, 0.0]))
    assert len(executor.waiting) == 1  # the first; the others wait for nobody
    executor.work()
    rig.tick()
    rig.tick()
    assert len(executor.waiting) == 1
    executor.work()
    last = TOOL + np.array([0.0, 0.038, 0.0])
    follow(rig, last, 1.0)
    assert executor.waiting == []
    assert tool(rig) == pytest.approx(last, abs=1e-9)


def test_what_is_solved_after_it_was_left_moves_nothing() -> None:
    rig = make_rig(executor := LateExecutor()).enable(HOME)
    follow(rig, TOOL + np.array([0.0, 0.05, 0.0]), 0.1)
    rig.do(FollowTarget(None))
    executor.work()
    rig.run(0.5)
    assert np.array_equal(rig.now.q_command, HOME)
    assert rig.now.state is State.HOLDING


def test_what_was_left_is_not_gone_to_when_another_target_is_followed() -> None:
    rig = make_rig(executor := LateExecutor()).enable(HOME)
    first, second, third = (TOOL + np.array([0.0, y, 0.0]) for y in (0.05, -0.08, 0.06))
    follow(rig, first, 2 * TICK)
    executor.work()
    follow(rig, first, 0.1)
    follow(rig, second, 2 * TICK)  # is being solved for
    rig.do(FollowTarget(None))
    assert rig.now.velocity_command.any()  # it still slows down
    follow(rig, third, 2 * TICK)
    executor.work()
    follow(rig, third, 0.5)
    assert tool(rig)[1] > TOOL[1]  # not on its way to the second one, whose answer has come
    executor.work()
    follow(rig, third, 1.0)
    assert tool(rig) == pytest.approx(third, abs=1e-9)


def test_after_a_stop_the_same_target_is_followed_again(rig: Rig) -> None:
    goal = TOOL + np.array([0.02, 0.06, -0.03])
    follow(rig, goal, 0.3)
    rig.do(FollowTarget(None))
    rig.run(1.0)
    assert rig.now.state is State.HOLDING
    assert np.abs(tool(rig) - goal).max() > 1e-3
    follow(rig, goal, 2.0)
    assert tool(rig) == pytest.approx(goal, abs=1e-9)
