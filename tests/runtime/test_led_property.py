"""However the arm is led, and however late the ticks come: nothing that leaves the driver breaks a limit."""

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
from armctl.runtime import FollowTarget, Jog, JogTool, SetSpeed, State

HOME = ROBOT.pose("home")
FLOOR = Floor(ROBOT)
RATES = st.lists(st.sampled_from([-1.0, -0.5, 0.0, 0.0, 0.3, 1.0]), min_size=5, max_size=5)
SPEEDS = st.lists(st.sampled_from([-0.25, -0.05, 0.0, 0.0, 0.02, 0.25]), min_size=3, max_size=3)
TURNS = st.sampled_from([-1.0, 0.0, 0.0, 0.0, 0.5])
POINTS = st.tuples(st.floats(-0.3, 0.4), st.floats(-0.4, 0.4), st.floats(-0.1, 0.5))
NEAR = st.tuples(st.floats(0.1, 0.25), st.floats(-0.15, 0.15), st.floats(0.1, 0.3))
PITCHES = st.one_of(st.none(), st.none(), st.floats(-1.5, 1.5))
ACTIONS = st.one_of(
    st.tuples(st.just("jog"), RATES),
    st.tuples(st.just("tool"), SPEEDS, TURNS, TURNS, st.sampled_from(["base", "tool"])),
    st.tuples(st.just("tool"), SPEEDS, st.just(0.0), st.just(0.0), st.sampled_from(["base", "tool"])),
    st.tuples(st.just("follow"), st.one_of(POINTS, NEAR), PITCHES),
    st.tuples(st.just("follow"), NEAR, st.none()),
    st.tuples(st.just("leave")),
    st.tuples(st.just("speed"), st.floats(0.05, 1.0)),
    st.tuples(st.just("stop")),
    st.tuples(st.just("nothing")),
)
EVEN = st.integers(1, 40).map(lambda k: [TICK] * k)
UNEVEN = st.lists(
    st.sampled_from([0.0, 0.001, 0.006, 0.013, 0.02, 0.021, 0.035, 0.06, 0.5]), min_size=1, max_size=30
)


def ask(rig: Rig, action: tuple[Any, ...]) -> None:
    submit = rig.controller.submit
    match action:
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
        case ("stop",):
            rig.controller.stop(TEST)
        case _:
            pass


def play(script: list[tuple[tuple[Any, ...], list[float]]]) -> Rig:
    rig = make_rig().enable(HOME)
    rig.history.clear()  # the jump of enabling
    for action, elapsed in script:
        for k, step in enumerate(elapsed):
            if k == 0 or action[0] in ("jog", "tool", "follow"):  # held
                ask(rig, action)
            rig.tick(step)
            assert rig.now.state is not State.FAULT, rig.now.cause
    return rig


def assert_above_the_floor(rig: Rig) -> None:
    q = np.array([snapshot.q_command for snapshot in rig.history])
    assert FLOOR.clearance(q).min() >= -1e-3


@given(st.lists(st.tuples(ACTIONS, UNEVEN), min_size=1, max_size=10))
@settings(max_examples=100, suppress_health_check=list(HealthCheck))
def test_late_and_early_ticks_never_break_a_limit(script: list[tuple[tuple[Any, ...], list[float]]]) -> None:
    rig = play(script)
    assert_stream_keeps_limits(rig)
    assert_above_the_floor(rig)
    for snapshot in rig.history:
        assert (np.abs(snapshot.acceleration_command) <= ROBOT.acceleration_limits * (1 + 1e-6) + 1e-9).all()
        assert (np.abs(snapshot.velocity_command) <= ROBOT.speed_limits * (1 + 1e-9)).all()


@given(st.lists(st.tuples(ACTIONS, EVEN), min_size=1, max_size=10))
@settings(max_examples=100, suppress_health_check=list(HealthCheck))
def test_accelerations_stay_inside_their_limits(script: list[tuple[tuple[Any, ...], list[float]]]) -> None:
    rig = play(script)
    assert_stream_keeps_limits(rig)
    assert_accelerations_keep_limits(rig)
    assert_above_the_floor(rig)


@given(st.lists(st.tuples(ACTIONS, EVEN), min_size=1, max_size=6))
@settings(max_examples=60, suppress_health_check=list(HealthCheck))
def test_silence_brings_everything_to_rest(script: list[tuple[tuple[Any, ...], list[float]]]) -> None:
    rig = play(script)
    rig.until(lambda s: s.state is State.HOLDING, seconds=1.5)  # the longest expiry, and braking
    count = len(rig.driver.writes)
    rig.run(1.0)
    assert len(rig.driver.writes) == count
    assert not rig.now.velocity_command.any()
