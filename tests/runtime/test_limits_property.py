"""Whatever is asked for and however late the ticks come: nothing that leaves the driver breaks a limit."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
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

from armctl.kinematics import Target
from armctl.motion import Floor
from armctl.program import GripperStep, MoveStep, PointStep, Program, WaitStep
from armctl.runtime import (
    FollowTarget,
    Jog,
    JogTool,
    MoveGripper,
    MoveJoints,
    Pause,
    Resume,
    RunProgram,
    SetSpeed,
    State,
)

Script = list[tuple[tuple[Any, ...], list[float]]]
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
ASKED = st.one_of(
    st.tuples(st.just("move"), SHARES, st.sampled_from(["cubic", "normal"])),
    st.tuples(st.just("home"), NEAR_HOME, st.sampled_from(["cubic", "normal"])),
    st.tuples(st.just("program"), PROGRAMS),
    st.tuples(st.just("jog"), RATES),
    st.tuples(st.just("jog"), RATES),
    st.tuples(st.just("speed"), st.floats(0.05, 1.0)),
    st.tuples(st.just("pause")),
    st.tuples(st.just("resume")),
    st.tuples(st.just("stop")),
    st.tuples(st.just("gripper"), st.floats(0, 1)),
)
SPEEDS = st.lists(st.sampled_from([-0.25, -0.05, 0.0, 0.0, 0.02, 0.25]), min_size=3, max_size=3)
TURNS = st.sampled_from([-1.0, 0.0, 0.0, 0.0, 0.5])
FRAMES = st.sampled_from(["base", "tool"])
POINTS = st.tuples(st.floats(-0.3, 0.4), st.floats(-0.4, 0.4), st.floats(-0.1, 0.5))
NEAR = st.tuples(st.floats(0.1, 0.25), st.floats(-0.15, 0.15), st.floats(0.1, 0.3))
PITCHES = st.one_of(st.none(), st.none(), st.floats(-1.5, 1.5))
LED = st.one_of(
    st.tuples(st.just("jog"), RATES),
    st.tuples(st.just("tool"), SPEEDS, TURNS, TURNS, FRAMES),
    st.tuples(st.just("tool"), SPEEDS, st.just(0.0), st.just(0.0), FRAMES),
    st.tuples(st.just("follow"), st.one_of(POINTS, NEAR), PITCHES),
    st.tuples(st.just("follow"), NEAR, st.none()),
    st.tuples(st.just("leave")),
    st.tuples(st.just("speed"), st.floats(0.05, 1.0)),
    st.tuples(st.just("stop")),
    st.tuples(st.just("nothing")),
)
HELD = ("jog", "tool", "follow")
EVEN = st.integers(1, 40).map(lambda k: [TICK] * k)
UNEVEN = st.lists(
    st.sampled_from([0.0, 0.001, 0.006, 0.013, 0.02, 0.021, 0.035, 0.06, 0.5]), min_size=1, max_size=30
)


def scripts(ticks: st.SearchStrategy[list[float]], most: int = 10) -> st.SearchStrategy[Script]:
    asked, led = (st.lists(st.tuples(acts, ticks), min_size=1, max_size=most) for acts in (ASKED, LED))
    return st.one_of(asked, led)


def ask(rig: Rig, action: tuple[Any, ...]) -> None:
    submit = rig.controller.submit
    match action:
        case ("move", shares, profile):
            submit(MoveJoints(LOW + np.array(shares) * (HIGH - LOW), profile=profile), TEST)
        case ("home", offset, profile):
            submit(MoveJoints(np.clip(HOME + np.radians(offset), LOW, HIGH), profile=profile), TEST)
        case ("program", program):
            submit(RunProgram(program, loops=None), TEST)
        case ("jog", rates):
            submit(Jog(np.array(rates)), TEST)
        case ("tool", linear, pitch_rate, roll_rate, frame):
            submit(JogTool(np.array(linear), pitch_rate, roll_rate, frame), TEST)
        case ("follow", point, pitch):
            submit(FollowTarget(Target.of(point, pitch)), TEST)
        case ("leave",):
            submit(FollowTarget(None), TEST)
        case ("speed", fraction):
            submit(SetSpeed(fraction), TEST)
        case ("pause",):
            submit(Pause(), TEST)
        case ("resume",):
            submit(Resume(), TEST)
        case ("gripper", opening):
            submit(MoveGripper(opening), TEST)
        case ("stop",):
            rig.controller.stop(TEST)
        case _:
            pass


def play(script: Script) -> Rig:
    """What all of it must keep to, whatever the ticks: speeds, accelerations, the floor."""
    rig = make_rig().enable(HOME)
    rig.history.clear()  # the jump of enabling
    for action, elapsed in script:
        for k, step in enumerate(elapsed):
            if k == 0 or action[0] in HELD:
                ask(rig, action)
            rig.tick(step)
            assert rig.now.state is not State.FAULT, rig.now.cause
    assert_stream_keeps_limits(rig)
    assert FLOOR.clearance(np.array([s.q_command for s in rig.history])).min() >= -1e-3
    return rig


@given(scripts(UNEVEN))
@settings(max_examples=220, suppress_health_check=list(HealthCheck))
def test_late_and_early_ticks_never_break_a_limit(script: Script) -> None:
    for snapshot in play(script).history:
        assert (np.abs(snapshot.acceleration_command) <= ROBOT.acceleration_limits * (1 + 1e-6) + 1e-9).all()
        assert (np.abs(snapshot.velocity_command) <= ROBOT.speed_limits * (1 + 1e-9)).all()


@given(scripts(EVEN))
@settings(max_examples=220, suppress_health_check=list(HealthCheck))
def test_accelerations_stay_inside_their_limits_whatever_is_asked(script: Script) -> None:
    assert_accelerations_keep_limits(play(script))


@given(st.lists(st.tuples(LED, EVEN), min_size=1, max_size=6))
@settings(max_examples=60, suppress_health_check=list(HealthCheck))
def test_silence_brings_an_arm_that_is_led_to_rest(script: Script) -> None:
    rig = play(script)
    rig.rests(1.5)  # the longest expiry, and braking
    rig.sends_nothing(1.0)
    assert not rig.now.velocity_command.any()


@given(scripts(EVEN, most=6))
@settings(max_examples=80, suppress_health_check=list(HealthCheck))
def test_a_stop_brings_everything_to_rest_and_ends_the_stream(script: Script) -> None:
    rig = play(script)
    ticket = rig.controller.stop(TEST)
    rig.rests(1.0)
    assert ticket.result(0) is None
    assert not rig.now.velocity_command.any()
    rig.sends_nothing(2.0)
    assert rig.now.state is State.HOLDING
