"""Whatever is asked for and however late the ticks come: nothing that leaves the driver breaks a limit."""

from __future__ import annotations

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

from armctl.program import GripperStep, MoveStep, PointStep, Program, WaitStep
from armctl.runtime import Jog, MoveGripper, MoveJoints, Pause, Resume, RunProgram, SetSpeed, State

LOW, HIGH = ROBOT.limits[:, 0], ROBOT.limits[:, 1]
SHARES = st.lists(st.floats(0, 1), min_size=ROBOT.n, max_size=ROBOT.n)
# Around home: most of these motions pass the floor check.
NEAR_HOME = st.lists(st.floats(-20, 20), min_size=ROBOT.n, max_size=ROBOT.n)
RATES = st.lists(st.sampled_from([-1.0, -0.5, 0.0, 0.0, 0.3, 1.0]), min_size=ROBOT.n, max_size=ROBOT.n)
HOME = ROBOT.pose("home")

STEPS = st.one_of(
    st.builds(MoveStep, joints_deg=NEAR_HOME.map(lambda d: tuple((np.degrees(HOME) + d).tolist()))),
    st.builds(PointStep, x_mm=st.floats(150, 260), y_mm=st.floats(-150, 150), z_mm=st.floats(60, 250)),
    st.builds(WaitStep, seconds=st.floats(0, 0.2)),
    st.builds(GripperStep, open_percent=st.floats(0, 100)),
)
PROGRAMS = st.lists(STEPS, min_size=1, max_size=4).map(lambda s: Program(robot="uzuner", steps=tuple(s)))
ACTIONS = st.one_of(
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
EVEN = st.integers(1, 40).map(lambda k: [TICK] * k)
UNEVEN = st.lists(
    st.sampled_from([0.0, 0.001, 0.006, 0.013, 0.02, 0.021, 0.035, 0.06, 0.5]), min_size=1, max_size=30
)


def ask(rig: Rig, action: tuple) -> None:  # pyright: ignore[reportMissingTypeArgument, reportUnknownParameterType]
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
        case ("speed", fraction):
            submit(SetSpeed(fraction), TEST)
        case ("pause",):
            submit(Pause(), TEST)
        case ("resume",):
            submit(Resume(), TEST)
        case ("gripper", opening):
            submit(MoveGripper(opening), TEST)
        case _:
            rig.controller.stop(TEST)


def play(script: list[tuple[tuple, list[float]]]) -> Rig:  # pyright: ignore[reportMissingTypeArgument]
    rig = make_rig().enable(HOME)
    rig.history.clear()  # the jump of enabling
    for action, elapsed in script:
        for k, step in enumerate(elapsed):
            if k == 0 or action[0] == "jog":  # a jog is held
                ask(rig, action)
            rig.tick(step)
            assert rig.now.state is not State.FAULT, rig.now.cause
    return rig


@given(st.lists(st.tuples(ACTIONS, UNEVEN), min_size=1, max_size=10))
@settings(max_examples=120, suppress_health_check=list(HealthCheck))
def test_late_and_early_ticks_never_break_a_limit(script: list[tuple[tuple, list[float]]]) -> None:  # pyright: ignore[reportMissingTypeArgument]
    rig = play(script)
    assert_stream_keeps_limits(rig)
    for snapshot in rig.history:
        assert (np.abs(snapshot.acceleration_command) <= ROBOT.acceleration_limits * (1 + 1e-6) + 1e-9).all()
        assert (np.abs(snapshot.velocity_command) <= ROBOT.speed_limits * (1 + 1e-9)).all()


@given(st.lists(st.tuples(ACTIONS, EVEN), min_size=1, max_size=10))
@settings(max_examples=120, suppress_health_check=list(HealthCheck))
def test_accelerations_stay_inside_their_limits_whatever_is_asked(
    script: list[tuple[tuple, list[float]]],
) -> None:  # pyright: ignore[reportMissingTypeArgument]
    rig = play(script)
    assert_stream_keeps_limits(rig)
    assert_accelerations_keep_limits(rig)


@given(st.lists(st.tuples(ACTIONS, EVEN), min_size=1, max_size=6))
@settings(max_examples=60, suppress_health_check=list(HealthCheck))
def test_a_stop_brings_everything_to_rest_and_ends_the_stream(
    script: list[tuple[tuple, list[float]]],
) -> None:  # pyright: ignore[reportMissingTypeArgument]
    rig = play(script)
    ticket = rig.controller.stop(TEST)
    rig.until(lambda s: s.state in (State.HOLDING, State.OFF), seconds=1.0)
    assert ticket.finished.result(0) is None
    assert not rig.now.velocity_command.any()
    count = len(rig.driver.writes)
    rig.run(2.0)
    assert len(rig.driver.writes) == count
    assert rig.now.state is State.HOLDING
