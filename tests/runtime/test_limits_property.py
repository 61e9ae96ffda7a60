"""Whatever is asked for and however late the ticks come: nothing that leaves the driver breaks a limit."""

from __future__ import annotations

import os
from functools import partial

import numpy as np
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from tests.runtime.kit import (
    ROBOT,
    TEST,
    TICK,
    Rig,
    assert_accelerations_keep_limits,
    assert_stream_keeps_limits,
    make_rig,
)

from armctl.facts import State
from armctl.kinematics import Target
from armctl.motion import Floor
from armctl.program import GripperStep, MoveStep, PointStep, Program, WaitStep
from armctl.protocol import (
    Command,
    FollowTarget,
    HeldCommand,
    Jog,
    JogTool,
    MoveGripper,
    MoveJoints,
    Pause,
    Resume,
    RunProgram,
    SetSpeed,
)

SHARE = 1.0 if os.environ.get("ARMCTL_LONG") else 0.25
"""of the scripts"""
Script = list[tuple[Command | str | None, list[float]]]
LOW, HIGH = ROBOT.limits[:, 0], ROBOT.limits[:, 1]
HOME = ROBOT.pose("home")
FLOOR = Floor(ROBOT)
SHARES = st.lists(st.floats(0, 1), min_size=5, max_size=5)
# Around home: most of these motions pass the floor check.
NEAR_HOME = st.lists(st.floats(-20, 20), min_size=5, max_size=5)
RATES = st.lists(st.sampled_from([-1.0, -0.5, 0.0, 0.0, 0.3, 1.0]), min_size=5, max_size=5)
STEPS = st.one_of(
    st.builds(MoveStep, joints_deg=NEAR_HOME.map(lambda d: tuple((np.degrees(HOME) + d).tolist()))),
    st.builds(PointStep, x_mm=st.floats(150, 260), y_mm=st.floats(-150, 150), z_mm=st.floats(60, 250)),
    st.builds(WaitStep, seconds=st.floats(0, 0.2)),
    st.builds(GripperStep, open_percent=st.floats(0, 100)),
)
PROGRAMS = st.lists(STEPS, min_size=1, max_size=4).map(lambda s: Program(robot="uzuner", steps=tuple(s)))
SPEEDS = st.lists(st.sampled_from([-0.25, -0.05, 0.0, 0.0, 0.02, 0.25]), min_size=3, max_size=3)
TURNS = st.sampled_from([-1.0, 0.0, 0.0, 0.0, 0.5])
POINTS = st.tuples(st.floats(-0.3, 0.4), st.floats(-0.4, 0.4), st.floats(-0.1, 0.5))
NEAR = st.tuples(st.floats(0.1, 0.25), st.floats(-0.15, 0.15), st.floats(0.1, 0.3))
PITCHES = st.one_of(st.none(), st.none(), st.floats(-1.5, 1.5))
MOVE = partial(st.builds, MoveJoints, profile=st.sampled_from(["cubic", "normal"]))
JOG = st.builds(Jog, RATES.map(np.array))
TOOL = partial(st.builds, JogTool, SPEEDS.map(np.array), frame=st.sampled_from(["base", "tool"]))
SPEED = st.builds(SetSpeed, st.floats(0.05, 1.0))
STOP = st.just("stop")
ASKED = st.one_of(
    MOVE(SHARES.map(lambda shares: LOW + np.array(shares) * (HIGH - LOW))),
    MOVE(NEAR_HOME.map(lambda offset: np.clip(HOME + np.radians(offset), LOW, HIGH))),
    st.builds(RunProgram, PROGRAMS, loops=st.none()),
    JOG,
    JOG,
    SPEED,
    st.sampled_from([Pause(), Resume()]),
    STOP,
    st.builds(MoveGripper, st.floats(0, 1)),
)
LED = st.one_of(
    JOG,
    TOOL(pitch_rate=TURNS, roll_rate=TURNS),
    TOOL(),
    st.builds(FollowTarget, st.builds(Target.of, st.one_of(POINTS, NEAR), PITCHES)),
    st.builds(FollowTarget, st.builds(Target.of, NEAR)),
    st.just(FollowTarget(None)),
    SPEED,
    STOP,
    st.none(),
)
EVEN = st.integers(1, 40).map(lambda k: [TICK] * k)
UNEVEN = st.lists(
    st.sampled_from([0.0, 0.001, 0.006, 0.013, 0.02, 0.021, 0.035, 0.06, 0.5]), min_size=1, max_size=30
)


def scripts(ticks: st.SearchStrategy[list[float]], most: int = 10) -> st.SearchStrategy[Script]:
    asked, led = (st.lists(st.tuples(acts, ticks), min_size=1, max_size=most) for acts in (ASKED, LED))
    return st.one_of(asked, led)


def play(script: Script) -> Rig:
    """What all of it must keep to, whatever the ticks: speeds, accelerations, the floor."""
    rig = make_rig().enable(HOME)
    for action, elapsed in script:
        for k, step in enumerate(elapsed):
            if action == "stop" and k == 0:
                rig.controller.stop(TEST)
            elif isinstance(action, Command) and (k == 0 or isinstance(action, HeldCommand)):
                rig.controller.submit(action, TEST)
            rig.tick(step)
            assert rig.now.state is not State.FAULT, rig.now.cause
    assert_stream_keeps_limits(rig)
    assert FLOOR.clearance(np.array([s.q_command for s in rig.history])).min() >= -1e-3
    return rig


@given(scripts(UNEVEN))
@settings(max_examples=round(70 * SHARE), suppress_health_check=list(HealthCheck))
def test_late_and_early_ticks_never_break_a_limit(script: Script) -> None:
    for snapshot in play(script).history:
        assert (np.abs(snapshot.acceleration_command) <= ROBOT.acceleration_limits * (1 + 1e-6) + 1e-9).all()
        assert (np.abs(snapshot.velocity_command) <= ROBOT.speed_limits * (1 + 1e-9)).all()


@given(scripts(EVEN))
@settings(max_examples=round(70 * SHARE), suppress_health_check=list(HealthCheck))
def test_accelerations_stay_inside_their_limits_whatever_is_asked(script: Script) -> None:
    assert_accelerations_keep_limits(play(script))


FOLDED = Jog(np.array([-0.5, 1.0, 1.0, 0.3, -0.5]))
"""leads the elbow to its limit; from there the shoulder must race for the tool to go on its line"""
RACING = [(FOLDED, [TICK] * 33), *((JogTool(np.array(way)), [TICK] * 36) for way in
                                   ([-0.25, -0.25, -0.25], [0.25, -0.05, 0.25]))]  # fmt: skip


@given(st.lists(st.tuples(LED, EVEN), min_size=1, max_size=6))
@example(RACING)
@example([RACING[0], (RACING[1][0], [TICK]), RACING[2]])
@settings(max_examples=round(40 * SHARE), suppress_health_check=list(HealthCheck))
def test_silence_brings_an_arm_that_is_led_to_rest(script: Script) -> None:
    rig = play(script)
    rig.rests(1.5)  # the longest expiry, and braking
    rig.sends_nothing(1.0)
    assert not rig.now.velocity_command.any()


@given(scripts(EVEN, most=6))
@settings(max_examples=round(50 * SHARE), suppress_health_check=list(HealthCheck))
def test_a_stop_brings_everything_to_rest_and_ends_the_stream(script: Script) -> None:
    rig = play(script)
    ticket = rig.controller.stop(TEST)
    rig.rests(1.0)
    assert ticket.result(0) is None
    assert not rig.now.velocity_command.any()
    rig.sends_nothing(2.0)
    assert rig.now.state is State.HOLDING
