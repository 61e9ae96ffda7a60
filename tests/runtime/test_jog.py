from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle

import msgspec
import numpy as np
import pytest
from tests.runtime.kit import (
    ROBOT,
    TEST,
    TICK,
    Rig,
    assert_accelerations_keep_limits,
    assert_keeps_limits,
    assert_stream_keeps_limits,
    make_rig,
)

from armctl.errors import InputError
from armctl.facts import State
from armctl.motion import Floor
from armctl.protocol import Command, Jog, JogTool, MoveGripper, MoveJoints, Pause, SetSpeed
from armctl.robot import Robot, load_robot

HOME = ROBOT.pose("home")
LOW = np.radians([0, 60, -80, -20, 0])
LONG = bool(os.environ.get("ARMCTL_LONG"))
AXES = {"X": 0, "Y": 1, "Z": 2}


def along(axis: str, speed: float, frame: str = "base") -> JogTool:
    linear = np.zeros(3)
    linear[AXES[axis]] = speed
    return JogTool(linear, frame="tool" if frame == "tool" else "base")


def replace_rest(command: JogTool, rests_s: float) -> JogTool:
    return msgspec.structs.replace(command, rests_s=rests_s)


def hold(rig: Rig, command: Jog | JogTool, seconds: float, ticks: Sequence[float] = (TICK,)) -> None:
    ends = rig.now.stamp + seconds
    for dt in cycle(ticks):
        if rig.now.stamp >= ends - 1e-9:
            return
        rig.clock.advance(dt - 0.001)
        rig.do(command, 0.001).accepted.result(0)


def enabled(robot: Robot = ROBOT, rate_hz: float = 50.0, q: np.ndarray | None = None) -> Rig:
    return make_rig(robot=robot, rate_hz=rate_hz).enable(robot.pose("home") if q is None else q)


@pytest.fixture
def rig() -> Rig:
    return enabled()


def tools(rig: Rig) -> np.ndarray:
    """(k, 4, 4) poses of the tool so far."""
    return rig.robot.forward(np.array([snapshot.q_command for snapshot in rig.history]))


def deviation(points: np.ndarray, start: np.ndarray, direction: np.ndarray) -> float:
    """How far points (k, 3) are from a line, at most [m]."""
    away = points - start
    return float(np.linalg.norm(away - np.outer(away @ direction, direction), axis=1).max())


@pytest.mark.parametrize("frame", ["base", "tool"])
@pytest.mark.parametrize(("axis", "sign"), [("Y", 1.0), ("Y", -1.0)])
@pytest.mark.parametrize(
    ("rate_hz", "ticks"), [(50.0, (0.02,)), (20.0, (0.05,)), (50.0, (0.02, 0.031, 0.02, 0.013, 0.039))]
)
def test_it_goes_straight(frame: str, axis: str, sign: float, rate_hz: float, ticks: Sequence[float]) -> None:
    rig = enabled(rate_hz=rate_hz)
    start = ROBOT.forward(HOME)
    hold(rig, along(axis, sign * 0.05, frame), 2.3, ticks)
    rig.run(0.5)
    direction = sign * (start[:3, AXES[axis]] if frame == "tool" else np.eye(3)[AXES[axis]])
    points = tools(rig)[:, :3, 3]
    assert (points[-1] - start[:3, 3]) @ direction > 0.1
    assert deviation(points, start[:3, 3], direction) < 1e-4
    pitch = [ROBOT.inverse_kinematics.pitch_and_roll(s.q_command)[0] for s in rig.history]
    assert np.degrees(np.ptp(np.array(pitch, dtype=float))) < 0.05
    assert rig.now.state is State.HOLDING
    assert_stream_keeps_limits(rig, 1)


@pytest.mark.parametrize("name", ["mico", "scorbot", "abaas", "humanoid"])
def test_other_arms_go_straight_too(name: str) -> None:
    robot = load_robot(name)
    rig = enabled(robot)
    start = robot.forward(robot.pose("home"))[:3, 3]
    hold(rig, along("Y", 0.05), 1.0)
    rig.run(0.5)
    points = tools(rig)[:, :3, 3]
    assert points[-1, 1] - start[1] > 0.04
    assert deviation(points, start, np.array([0.0, 1.0, 0.0])) < 1e-4
    assert_accelerations_keep_limits(rig)


def test_the_override_slows_joints_and_tool_down(rig: Rig) -> None:
    rig.do(SetSpeed(0.25))
    hold(rig, turn(3), 0.5)
    assert rig.now.velocity_command[3] == pytest.approx(np.radians(120 * 0.25))
    rig.run(0.5)
    hold(rig, along("Y", 0.08), 0.6)
    J = ROBOT.jacobian(rig.now.q_command)
    assert float(np.linalg.norm(J[:3] @ rig.now.velocity_command)) == pytest.approx(0.02, rel=0.02)


def test_where_a_joint_is_too_slow_all_are_scaled_so_that_the_direction_stays(rig: Rig) -> None:
    start = ROBOT.forward(HOME)[:3, 3]
    hold(rig, along("Y", 0.5), 0.5)
    assert np.abs(rig.now.velocity_command / ROBOT.speed_limits).max() == pytest.approx(1.0, abs=0.1)
    assert deviation(tools(rig)[:, :3, 3], start, np.array([0.0, 1.0, 0.0])) < 1e-3
    assert_accelerations_keep_limits(rig)


@pytest.mark.parametrize("rests_s", [0.03, 0.06, 0.12])
def test_no_joint_is_jogged_faster_than_it_brakes_from_in_the_time_that_is_asked_for(
    rig: Rig, rests_s: float
) -> None:
    command = replace_rest(along("Y", 0.5), rests_s)
    start = ROBOT.forward(HOME)[:3, 3]
    hold(rig, command, 0.6)
    most = np.minimum(ROBOT.speed_limits, rests_s * ROBOT.acceleration_limits)
    speeds = np.array([snapshot.velocity_command for snapshot in rig.history])
    assert (np.abs(speeds) / most).max() == pytest.approx(1.0, abs=0.02)
    assert deviation(tools(rig)[:, :3, 3], start, np.array([0.0, 1.0, 0.0])) < 1e-3
    rig.do(Jog(np.zeros(5)))
    rig.run((np.ceil(rests_s / TICK) + 1) * TICK)  # one more, as the line bends the joints' way
    assert not rig.now.velocity_command.any()


def test_at_a_joint_limit_it_stops_and_names_the_joint(rig: Rig) -> None:
    start = ROBOT.forward(HOME)[:3, 3]
    hold(rig, along("X", -0.05), 2.0)
    assert rig.now.warnings == ("jog: Elbow at the limit",)
    assert np.abs(rig.now.velocity_command).max() < np.radians(0.1)
    assert deviation(tools(rig)[:, :3, 3], start, np.array([1.0, 0.0, 0.0])) < 3e-4
    before = ROBOT.forward(rig.now.q_command)[0, 3]
    rig.run(0.5)
    hold(rig, along("X", 0.05), 0.5)
    assert ROBOT.forward(rig.now.q_command)[0, 3] > before + 0.015
    assert_accelerations_keep_limits(rig)


def test_the_stretched_arm_stops_and_comes_back(rig: Rig) -> None:
    hold(rig, along("X", 0.1), 4.0)
    assert np.abs(rig.now.velocity_command).max() < np.radians(5)
    reached = ROBOT.forward(rig.now.q_command)[:3, 3]
    rig.run(0.5)
    hold(rig, along("X", -0.05), 1.0)
    assert ROBOT.forward(rig.now.q_command)[0, 3] < reached[0] - 0.02
    assert_keeps_limits(rig)


def test_it_turns_in_its_place(rig: Rig) -> None:
    start = ROBOT.forward(HOME)[:3, 3]
    hold(rig, JogTool(np.zeros(3), pitch_rate=-0.3), 0.8)
    rig.run(0.3)
    pitch, _ = ROBOT.inverse_kinematics.pitch_and_roll(rig.now.q_command)
    assert pitch is not None
    assert np.degrees(pitch) == pytest.approx(-30 - np.degrees(0.3 * 0.9), abs=1.5)
    assert np.linalg.norm(tools(rig)[:, :3, 3] - start, axis=1).max() < 1e-4
    hold(rig, JogTool(np.zeros(3), roll_rate=0.5), 1.0)
    assert rig.now.q_command[4] == pytest.approx(0.5, abs=0.05)


def test_another_direction_waits_until_the_arm_stands_on_its_first_line(rig: Rig) -> None:
    start = ROBOT.forward(HOME)[:3, 3]
    hold(rig, along("Y", 0.08), 0.6)
    hold(rig, along("Z", 0.05), 0.6)
    hold(rig, along("X", 0.05), 0.6)
    points = tools(rig)[:, :3, 3] - start
    corner = points[np.argmax(points[:, 1])]
    off_first = np.abs(points[:, [0, 2]]).max(axis=1)
    off_second = np.abs(points - corner)[:, [0, 1]].max(axis=1)
    off_third = np.abs(points - points[-1])[:, [1, 2]].max(axis=1)
    assert np.minimum(np.minimum(off_first, off_second), off_third).max() < 2e-4
    assert_accelerations_keep_limits(rig)


def test_joints_and_tool_may_be_jogged_in_turn(rig: Rig) -> None:
    hold(rig, along("Y", 0.08), 0.5)
    hold(rig, turn(4, 0.5), 0.6)
    assert rig.now.velocity_command[4] == pytest.approx(0.5 * ROBOT.speed_limits[4])
    hold(rig, along("Y", -0.08), 0.5)
    assert ROBOT.jacobian(rig.now.q_command)[1] @ rig.now.velocity_command < -0.05
    assert_accelerations_keep_limits(rig)


@pytest.mark.parametrize(
    ("name", "command", "text"),
    [
        (
            "uzuner",
            JogTool(np.array([0.6, 0, 0])),
            "600 mm/s and 0 °/s is too fast; at most 500 mm/s and 180 °/s",
        ),
        ("uzuner", JogTool(np.zeros(3), roll_rate=4.0), "229 °/s is too fast"),
        ("uzuner", JogTool(np.array([np.nan, 0, 0])), "needs three speeds"),
        ("uzuner", JogTool(np.zeros(3), rests_s=-1.0), "within a time that is more than 0 s, got -1 s"),
        ("uzuner", JogTool(np.zeros(3), rests_s=np.nan), "the time in which a jog rests"),
        ("uzuner", JogTool(np.zeros(2)), "needs three speeds"),
        ("uzuner", JogTool(np.float64(1)), "needs three speeds"),  # type: ignore
        ("uzuner", JogTool(np.zeros(3), np.nan), "the pitch rate must be a finite number"),
        ("uzuner", JogTool(np.zeros(3), frame="world"), "frame must be one of 'base', 'tool', not 'world'"),  # type: ignore
        ("mico", JogTool(np.zeros(3), 0.3), "the tool of mico cannot pitch while its point stays"),
        (
            "humanoid",
            JogTool(np.zeros(3), 0.0, 0.3),
            "the tool of humanoid cannot roll while its point stays",
        ),
        ("uzuner", Jog(np.full(5, 1.1)), "5 rates between -1 and 1"),
        ("uzuner", Jog(np.full(5, np.nan)), "5 rates between -1 and 1"),
        ("uzuner", Jog(np.zeros(3)), "5 rates between -1 and 1"),
        ("uzuner", Jog("abc"), "the rates of a jog must be numbers, got 'abc'"),  # type: ignore
        ("uzuner", MoveGripper("x"), "the opening of Gripper must be numbers"),  # type: ignore
        ("uzuner", SetSpeed("x"), "the speed must be numbers"),  # type: ignore
    ],
)
def test_what_cannot_be_jogged(name: str, command: Command, text: str) -> None:
    enabled(load_robot(name)).refuses(command, text, InputError)


def test_a_direction_that_is_lost_says_so() -> None:
    rig = enabled(q=np.radians([0, 90, 0, 0, 0]))  # stretched straight up
    before = rig.now.q_command
    hold(rig, along("Z", 0.05), 0.3)
    assert len(rig.now.warnings) == 1
    assert rig.now.q_command == pytest.approx(before, abs=np.radians(0.5))


def turn(joint: int, rate: float = 1.0) -> Jog:
    return Jog(rate * np.eye(5)[joint])


def test_it_speeds_up_to_its_share_of_the_limit_and_expires_100_ms_after_the_last_command(rig: Rig) -> None:
    hold(rig, turn(0, 0.5), 1.0)
    assert rig.now.velocity_command == pytest.approx([np.radians(30), 0, 0, 0, 0])
    assert rig.now.state is State.MOVING
    assert rig.now.cause == "jog (test)"
    last = rig.now.stamp
    rig.until(lambda s: s.velocity_command[0] < np.radians(30) - 1e-9, seconds=1)
    assert rig.now.stamp - last == pytest.approx(0.1, abs=1.01 * TICK)
    rig.rests(1)
    # 30 °/s at 360 °/s²: 83 ms to rest
    assert rig.now.stamp - last < 0.1 + 0.0834 + 3 * TICK
    assert rig.now.cause == "jog finished"
    assert_keeps_limits(rig)


@pytest.mark.parametrize("joint", range(5))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_it_ends_exactly_at_the_joint_limit(joint: int, sign: float) -> None:
    # High up, so that the floor is nowhere near; the straight arm would sweep it with its shoulder.
    rig = enabled(q=np.radians([0, 90, 40, 40, 0] if joint == 1 else [0, 90, 0, 0, 0]))
    hold(rig, turn(joint, sign), 3.5)
    limit = ROBOT.limits[joint, 1 if sign > 0 else 0]
    assert rig.now.q_command[joint] == pytest.approx(limit, abs=1e-9)
    assert not rig.now.velocity_command.any()
    assert rig.now.warnings == (f"jog: {ROBOT.joints[joint].title} at the limit",)
    assert_keeps_limits(rig)
    rig.run(1)
    assert rig.now.warnings == ()
    assert rig.now.state is State.HOLDING


def test_it_brakes_late_but_in_time(rig: Rig) -> None:
    hold(rig, turn(0), 3.0)
    q = np.array([snapshot.q_command[0] for snapshot in rig.history])
    arrived = int(np.argmax(q >= ROBOT.limits[0, 1] - 1e-9))
    # 107.26° at 60 °/s with two ramps of 0.167 s: 1.95 s at the least
    assert arrived * TICK < 1.955 + 5 * TICK


def test_it_stops_above_the_floor_and_comes_up_again() -> None:
    rig = enabled(q=LOW)
    floor = Floor(ROBOT.gripping(rig.now.gripper))
    hold(rig, turn(1, -1.0), 3.0)
    lowest = floor.clearance(rig.now.q_command).min()
    assert 0 <= lowest < 2e-3
    assert rig.now.warnings == ("jog: the floor is in the way",)
    assert all(floor.clearance(s.q_command).min() >= -1e-9 for s in rig.history)
    assert_accelerations_keep_limits(rig)
    hold(rig, turn(1, 1.0), 0.5)
    assert floor.clearance(rig.now.q_command).min() > 0.02


def test_it_stops_where_two_links_would_fold_onto_each_other() -> None:
    rig = enabled(load_robot("mearm"))
    (limit,) = rig.robot.chain.turn_limits
    hold(rig, Jog(np.array([0.0, 0.0, -1.0])), 2.0)
    turns = np.array([s.q_command[2] - s.q_command[1] for s in rig.history])
    assert limit.lower <= turns.min() < limit.lower + np.radians(1)
    assert rig.now.warnings == ("jog: the angle from Shoulder to Elbow is at its limit",)
    assert rig.now.state is not State.FAULT
    hold(rig, Jog(np.array([0.0, 0.0, 1.0])), 0.3)
    assert rig.now.q_command[2] - rig.now.q_command[1] > limit.lower + np.radians(5)


def test_letting_go_near_the_floor_does_not_carry_it_through() -> None:
    floor = Floor(ROBOT.gripping(0.5))  # nobody had seen it: it came on half open
    for ticks in range(20, 75, 3 if LONG else 9):
        rig = enabled(q=LOW)
        hold(rig, Jog(np.array([0.3, -1, 0.2, -1, 0])), ticks * TICK)
        rig.run(0.5)
        assert floor.clearance(np.array([s.q_command for s in rig.history])).min() >= -1e-9


def test_no_motion_begins_while_it_is_held(rig: Rig) -> None:
    hold(rig, turn(0), 0.2)
    rig.refuses(MoveJoints(HOME), "stop first")
    rig.refuses(Pause(), "jog cannot be paused")


@pytest.mark.parametrize("command", [Jog(np.zeros(5)), JogTool(np.zeros(3))])
def test_zero_does_not_begin_a_jog(rig: Rig, command: Jog | JogTool) -> None:
    rig.do(command).result(0)
    assert rig.now.state is State.HOLDING


def test_a_command_that_came_too_late_moves_nothing(rig: Rig) -> None:
    rig.controller.submit(turn(0), TEST)
    rig.tick(0.5)
    rig.run(0.5)
    assert np.array_equal(rig.now.q_command, HOME)
    assert rig.now.state is State.HOLDING


def test_a_held_joint_is_not_jogged() -> None:
    held = replace(ROBOT.joints[4], lower=0.0, upper=0.0)
    rig = make_rig(robot=replace(ROBOT, joints=(*ROBOT.joints[:4], held))).enable(HOME)
    rig.refuses(turn(4), r"Wrist roll is held at 0\.00°: .* cannot be jogged", InputError)
    assert rig.now.state is State.HOLDING
    hold(rig, turn(0), 0.2)
    assert rig.now.q_command[0] > HOME[0]
    assert rig.now.q_command[4] == 0.0
    assert rig.now.warnings == ()


def test_what_its_sender_writes_afterwards_changes_nothing(rig: Rig) -> None:
    wanted = 0.1 * np.eye(5)[0]
    rig.do(Jog(wanted)).accepted.result(0)
    wanted[:] = 1e6
    rig.run(0.08)
    assert np.degrees(rig.now.velocity_command[0]) == pytest.approx(6)
    assert not rig.now.velocity_command[1:].any()


@pytest.mark.parametrize("factor", [6.0, 2.0, 0.4])
def test_joints_that_brake_unequally_keep_the_angle_between_links(factor: float) -> None:
    """The sum of their angles is largest while they brake, not at the end."""
    arm = load_robot("mearm")
    joints = tuple(
        replace(joint, acceleration=joint.acceleration * (factor if k == 2 else 1.0))
        for k, joint in enumerate(arm.joints)
    )
    rig = enabled(replace(arm, joints=joints))
    chance = np.random.default_rng(int(10 * factor))
    at_limit = 0
    for _ in range(25 if LONG else 8):
        rates = np.concatenate([[0.0], chance.choice([-1.0, -0.5, 0.5, 1.0], 2), np.zeros(arm.n - 3)])
        for _ in range(int(chance.integers(5, 40))):
            rig.controller.submit(Jog(rates), TEST)
            rig.tick(0.02)
            assert rig.now.state is not State.FAULT, rig.now.cause
            at_limit += any("is at its limit" in text for text in rig.now.warnings)
    assert at_limit > 0


PAGE_SHARE = 0.25
"""of the joints' speeds: what the page offers at first"""


@pytest.mark.parametrize("share", [PAGE_SHARE, 1.0])
@pytest.mark.parametrize("name", ["uzuner", "so101", "ur5", "ar4"])
def test_once_it_is_let_go_each_joint_brakes_from_the_next_tick_as_hard_as_it_may(
    name: str, share: float
) -> None:
    rig = enabled(load_robot(name))
    hold(rig, Jog(share * np.resize([1.0, -1.0], rig.robot.n)), 0.5)
    before, let_go = np.abs(rig.now.velocity_command), rig.now.stamp
    rig.do(Jog(np.zeros(rig.robot.n)), TICK)
    rig.run(TICK)  # it is taken at one tick, and obeyed at the next
    slower = np.maximum(before - rig.robot.acceleration_limits * TICK, 0.0)
    assert before.any() and (np.abs(rig.now.velocity_command) <= slower + 1e-9).all()
    while rig.now.velocity_command.any():
        rig.run(TICK)
    stands_s = rig.now.stamp - let_go
    assert stands_s <= (before / rig.robot.acceleration_limits).max() + 2 * TICK + 1e-9
    assert share > PAGE_SHARE or stands_s <= 0.1 + 1e-9, stands_s
