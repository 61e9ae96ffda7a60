"""A start without a jump: servos come on one after the other, where the arm is said to stand."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples
from tests.runtime.kit import MIDDLE, ROBOT, TEST, TICK, Rig, fails, make_rig

from armctl.errors import BoardError, EnableError, InputError, MotionRefusedError
from armctl.facts import State
from armctl.hardware import Source
from armctl.protocol import Connect, Disconnect, Enable, MoveGripper, MoveJoints, Release
from armctl.robot import load_robot

HOME, REST = ROBOT.pose("home"), ROBOT.pose("rest")
ARMS = [load_robot(name) for name in ("uzuner", "abaas", "mico")]
SOURCES = [Source.COMMANDED, Source.TRANSMITTED]


def real(rig: Rig, positions: dict[int, float] | None = None) -> Rig:
    """Connected to a board that is not simulated and sends these pulses."""
    rig.driver.simulated = False
    rig.driver.positions = dict(positions or {})
    rig.do(Connect("/dev/ttyACM0")).result(0)
    return rig


def first_pulses(rig: Rig) -> list[tuple[float, int]]:
    """When each channel came on, in that order."""
    seen: dict[int, float] = {}
    for at, values in rig.driver.writes:
        assert len(values) == 1 or set(values) <= set(seen), "several servos came on at once"
        for channel in values:
            seen.setdefault(channel, at)
    return [(at, channel) for channel, at in seen.items()]


def test_servos_come_on_from_the_base_outward_the_gripper_last(rig: Rig) -> None:
    enabling = real(rig).do(Enable(HOME, 0.25))
    assert (rig.now.state, rig.now.cause) == (State.MOVING, "enabling (test)")
    enabling.accepted.result(0)
    rig.rests()
    enabling.result(0)
    times, channels = zip(*first_pulses(rig), strict=True)
    assert channels == (0, 1, 2, 3, 4, 5)
    assert np.diff(times) == pytest.approx(0.3, abs=TICK)
    assert rig.driver.positions == pytest.approx({**ROBOT.output_map.outputs(HOME), 5: 1250.0})
    np.testing.assert_array_equal(rig.now.q_command, HOME)
    assert rig.now.gripper == 0.25
    rig.sends_nothing(1.0)


def test_nothing_streams_before_each_has_had_the_time_to_arrive(rig: Rig) -> None:
    real(rig).do(Enable(HOME))
    rig.refuses(MoveJoints(MIDDLE), "it is moving")
    rig.refuses(MoveGripper(0.0), "the gripper needs the arm enabled")
    rig.rests()
    low, high = ROBOT.limits.T
    arrival_s = np.maximum(HOME - low, high - HOME) / ROBOT.speed_limits
    came_on = np.array([at for at, _ in first_pulses(rig)])
    assert rig.now.stamp >= (came_on[:5] + arrival_s).max()
    assert rig.now.stamp - came_on[0] < 5.0


def test_without_a_pose_a_board_that_cannot_tell_is_not_enabled(rig: Rig) -> None:
    pulses = ROBOT.output_map.outputs(HOME)
    for positions in ({}, {0: pulses[0], 1: pulses[1]}):
        real(rig, positions).refuses(
            Enable(), r"nobody knows where the arm is: pulses are off\. .*--pose last"
        )
        assert rig.driver.writes == []
        assert rig.now.state is State.OFF
        rig.do(Disconnect())


def test_a_simulated_board_needs_no_pose_and_is_quick(rig: Rig) -> None:
    rig.do(Connect("sim"))
    began = rig.now.stamp
    rig.finishes(Enable())
    assert rig.now.stamp - began <= 0.5
    assert [channel for _, channel in first_pulses(rig)] == [0, 1, 2, 3, 4, 5]
    np.testing.assert_array_equal(rig.now.q_command, REST)


def test_a_gripper_that_nobody_has_seen_comes_on_half_open_and_then_goes_at_its_speed(rig: Rig) -> None:
    real(rig, ROBOT.output_map.outputs(HOME)).finishes(Enable())
    assert rig.driver.writes[1:] == [(rig.driver.writes[1][0], {5: 1500.0})]
    rig.do(MoveGripper(0.0))
    rig.run(0.5)
    opened = np.array([values[5] for _, values in rig.driver.writes if 5 in values]) / 1000 - 1
    assert np.abs(np.diff(opened)).max() <= 2.0 * TICK + 1e-9
    assert rig.now.gripper == 0.0


@pytest.mark.parametrize(
    ("opening", "words"), [(1.5, r"an opening of 150 % is outside 0 … 100 %"), (np.nan, "finite number")]
)
def test_an_opening_that_is_none_is_refused(rig: Rig, opening: float, words: str) -> None:
    real(rig).refuses(Enable(HOME, opening), words, InputError)
    assert rig.driver.writes == []


@pytest.mark.parametrize("end", ["stop", "release", "disconnect", "close"])
def test_whatever_ends_it_no_more_servos_come_on(rig: Rig, end: str) -> None:
    enabling = real(rig).do(Enable(HOME))
    rig.run(0.4)
    if end == "stop":
        rig.controller.stop(TEST)
    elif end == "close":
        rig.controller.close()
    else:
        rig.controller.submit(Release() if end == "release" else Disconnect(), TEST)
    count = len(rig.driver.writes)
    rig.run(5)
    assert len(rig.driver.writes) == count == 2
    fails(enabling.finished, "stopped by|released|disconnected")
    states = {"stop": State.OFF, "release": State.OFF}
    assert rig.now.state is states.get(end, State.DISCONNECTED)
    assert set(rig.driver.positions) == (set() if end == "release" else {0, 1})


def test_after_a_stop_it_goes_on_with_those_that_are_off(rig: Rig) -> None:
    real(rig).do(Enable(HOME))
    rig.run(0.4)
    rig.controller.stop(TEST)
    rig.run(0.1)
    assert "Base, Shoulder: on and held; the others are off" in "\n".join(rig.texts)
    assert rig.now.powered
    rig.finishes(Enable(HOME))
    assert [channel for _, channel in first_pulses(rig)] == [0, 1, 2, 3, 4, 5]


def test_a_board_that_reports_trouble_meanwhile_gets_no_more(rig: Rig) -> None:
    enabling = real(rig).do(Enable(HOME))
    rig.run(0.4)
    rig.driver.errors = ("serial timeout",)
    count = len(rig.driver.writes)
    rig.run(3)
    assert len(rig.driver.writes) == count
    fails(enabling.finished, "enabling ended, the board reports serial timeout", BoardError)
    assert rig.now.state is State.OFF


def test_servos_that_go_off_meanwhile_are_a_fault_and_no_more_come_on(rig: Rig) -> None:
    enabling = real(rig).do(Enable(HOME))
    rig.run(0.4)
    rig.driver.positions.clear()  # the supply broke down
    count = len(rig.driver.writes)
    rig.run(4)
    assert len(rig.driver.writes) == count
    assert rig.now.state is State.FAULT
    words = r"the board switched the pulses off by itself \(Base, Shoulder\)"
    fails(enabling.finished, words, MotionRefusedError)


def test_one_garbled_reading_does_not_end_it(rig: Rig) -> None:
    enabling = real(rig).do(Enable(HOME))
    rig.run(0.4)
    pulses, rig.driver.positions = rig.driver.positions, {}
    rig.tick()
    rig.driver.positions = pulses
    rig.rests()
    enabling.result(0)


def test_a_servo_that_the_board_does_not_confirm_ends_it(rig: Rig) -> None:
    real(rig)
    rig.driver.dead = {2}
    enabling = rig.do(Enable(HOME))
    rig.run(5.0)
    fails(enabling.finished, r"has not confirmed within 2 s that Elbow came on", EnableError)
    assert (rig.now.state, rig.now.commanded, rig.now.powered) == (State.OFF, False, True)
    assert [channel for _, channel in first_pulses(rig)] == [0, 1, 2]
    assert "Base, Shoulder: on and held; the others are off" in "\n".join(rig.texts)
    rig.sends_nothing(5.0)
    rig.driver.dead = set()
    rig.finishes(Enable(HOME))


def test_a_gripper_that_the_board_does_not_confirm_ends_it(rig: Rig) -> None:
    real(rig)
    rig.driver.dead = {5}
    enabling = rig.do(Enable(HOME))
    rig.run(8.0)
    fails(enabling.finished, r"has not confirmed within 2 s that Gripper came on", EnableError)
    assert rig.now.state is State.OFF


def test_what_could_not_be_sent_in_time_ends_it_and_is_named(rig: Rig) -> None:
    enabling = real(rig).do(Enable(HOME))
    rig.run(0.4)
    rig.driver.expired = (1,)
    rig.run(0.1)
    count = len(rig.driver.writes)
    fails(enabling.finished, r"Shoulder could not be switched on in time, and will not come on", EnableError)
    rig.run(5.0)
    assert (rig.now.state, len(rig.driver.writes)) == (State.OFF, count)


def test_on_a_line_that_is_too_slow_nothing_is_switched_on(rig: Rig) -> None:
    real(rig)
    rig.driver.delay_s = 0.085
    rig.run(0.2)
    rig.refuses(Enable(HOME), r"too slow: the board's answers took up to 85 ms, at most 50 ms", EnableError)
    rig.sends_nothing(2.0)
    rig.driver.delay_s = 0.01
    rig.run(1.5)
    rig.finishes(Enable(HOME))


def test_pulses_that_come_on_by_themselves_are_told(rig: Rig) -> None:
    real(rig)
    rig.run(0.1)
    rig.driver.positions = {2: 1500.0}
    rig.tick()
    assert not any("came on" in text for text in rig.now.warnings)  # one answer alone is no proof
    rig.tick()
    assert any("Elbow came on though nobody asked" in text for text in rig.now.warnings)
    assert (rig.now.state, rig.now.powered) == (State.OFF, True)


def test_enabling_ends_where_every_tick_is_late():
    rig = make_rig(rate_hz=20.0)
    rig.do(Connect("sim"))
    enabling = rig.do(Enable(HOME))
    while not enabling.finished.done() and rig.now.stamp < 30.0:
        rig.tick(0.25)
    with pytest.raises(EnableError, match="for 5 s this computer was too busy to switch a servo on"):
        enabling.finished.result(0)
    assert (rig.now.state, rig.driver.writes) == (State.OFF, [])


@settings(max_examples=examples(25))
@given(
    robot=st.sampled_from(ARMS),
    source=st.sampled_from(SOURCES),
    simulated=st.booleans(),
    rate_hz=st.sampled_from([20.0, 50.0, 200.0]),
    on=st.lists(st.booleans(), min_size=8, max_size=8),
    shares=st.lists(st.floats(0, 1), min_size=8, max_size=8),
    opening=st.none() | st.floats(0, 1),
    late=st.lists(st.sampled_from([1.0, 1.0, 0.3, 2.0, 5.0]), min_size=1, max_size=8),
)
def test_after_enable_no_setpoint_leaves_the_limits_or_is_too_fast(
    robot, source, simulated, rate_hz, on, shares, opening, late
) -> None:
    """Every arm, every servo board, whatever is on already: each channel's pulses, the first one too."""
    n, outputs = robot.n, robot.output_map
    robot = robot if outputs is not None else replace(robot, gripper=None)
    rig = make_rig(robot=robot, rate_hz=rate_hz)
    rig.driver.source, rig.driver.simulated = source, simulated or outputs is None
    low, high = robot.limits.T
    q = low + np.array(shares[:n]) * (high - low)
    if outputs is not None:
        pulses = list(outputs.outputs(q).items())
        rig.driver.positions = {channel: us for k, (channel, us) in enumerate(pulses) if on[k]}
    rig.do(Connect("sim"))
    enabling = rig.do(Enable(q, opening))
    tick = 1 / rate_hz
    ticks = itertools.cycle(late)
    while not enabling.finished.done() and rig.now.stamp < 30.0:  # the clock begins at 10 s
        rig.tick(tick * next(ticks))
    refused = enabling.finished.exception(0)
    if refused is not None:  # below the floor, or every tick was late
        assert not rig.driver.writes or "too busy" in str(refused)
        return
    came_on = dict(rig.driver.positions)
    rig.do(MoveJoints(robot.pose("home")))
    if robot.gripper is not None and rig.now.gripper is not None:
        rig.do(MoveGripper(1.0))
    for _ in range(round(1.5 * rate_hz)):
        rig.tick(tick * next(ticks))
    by_channel = {one.channel: one for one in rig.driver.settings}
    last: dict[int, tuple[float, float]] = {}
    for at, values in rig.driver.writes:
        for channel, us in values.items():
            if channel in last:
                before, then = last[channel]
                speed = by_channel[channel].speed / 1.5  # the board's own limit leaves that margin
                assert abs(us - before) <= speed * (at - then) * (1 + 1e-6) + 0.3  # ranges are rounded inward
            last[channel] = us, at
    assert set(came_on) == set(by_channel)
    assert rig.now.state is not State.FAULT, rig.now.cause
