from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armctl.errors import InputError, MotionRefusedError
from armctl.motion import PROFILES, PointToPoint, ProfileName
from armctl.motion.profiles import shortest_words
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
# now and then a joint does not move, or hardly
TRAVELS = st.lists(
    st.one_of(st.just(0.0), st.floats(-7, 1).map(lambda e: 10.0**e), st.floats(-3, 3), st.just(1e-300)),
    min_size=ROBOT.n,
    max_size=ROBOT.n,
)
KEEPS_JERK = ("quintic", "s-curve")


def only(j: int, travel: np.ndarray) -> np.ndarray:
    return np.where(np.arange(len(travel)) == j, travel, 0.0)


@pytest.mark.parametrize("profile", PROFILES)
@given(start=TRAVELS, end=TRAVELS, slower=st.one_of(st.none(), st.floats(1, 20)))
@settings(max_examples=60)
def test_ends_limits_and_the_integral_of_the_speed(
    profile: ProfileName, start: list[float], end: list[float], slower: float | None
) -> None:
    shortest = PointToPoint.plan(ROBOT, start, end, profile=profile)
    duration = None if slower is None else max(shortest.duration * slower, 1e-3)
    motion = PointToPoint.plan(ROBOT, start, end, duration, profile)
    time = np.linspace(0.0, motion.duration, 701)
    state = motion.sample(time)
    np.testing.assert_array_equal(state.q[0], start if motion.duration > 0 else end)
    np.testing.assert_array_equal(state.q[-1], end)
    peaks = motion.peaks
    for values, most, limit in (
        (state.velocity, peaks.speed, ROBOT.speed_limits),
        (state.acceleration, peaks.acceleration, ROBOT.acceleration_limits),
    ):
        assert (np.abs(values) <= most * (1 + 1e-9) + 1e-15).all()
        assert (most <= limit * (1 + 1e-9)).all()
    assert np.isfinite(state.jerk).all()
    if profile in KEEPS_JERK:
        assert (np.abs(state.jerk) <= ROBOT.jerk_limits * (1 + 1e-9)).all()
    np.testing.assert_array_equal(peaks.low, np.minimum(start, end))
    np.testing.assert_array_equal(peaks.high, np.maximum(start, end))
    if motion.duration > 0:
        middle = motion.sample(0.5 * (time[1:] + time[:-1]))
        way = middle.velocity.sum(axis=0) * motion.duration / 700
        size = 1e-9 + np.abs(np.subtract(end, start))
        np.testing.assert_allclose(way / size, np.subtract(end, start) / size, atol=2e-3)


@pytest.mark.parametrize("profile", PROFILES)
@given(start=TRAVELS, end=TRAVELS)
@settings(max_examples=40)
def test_each_derivative_is_that_of_the_one_before(
    profile: ProfileName, start: list[float], end: list[float]
) -> None:
    motion = PointToPoint.plan(
        ROBOT, start, end, 2.0 + 2 * PointToPoint.plan(ROBOT, start, end, profile=profile).duration, profile
    )
    h = motion.duration * 1e-5
    t = np.linspace(0.0, motion.duration, 97)[1:-1]
    before, here, after = motion.sample(t - h), motion.sample(t), motion.sample(t + h)
    for early, late, slope in (
        (before.q, after.q, here.velocity),
        (before.velocity, after.velocity, here.acceleration),
        (before.acceleration, after.acceleration, here.jerk),
    ):
        off = np.abs((late - early) / (2 * h) - slope) > 1e-3 * (1e-3 + np.abs(slope).max())
        # where a seam of the law lies within h of a sample, there is no slope to be met
        assert off.sum(axis=0).max() <= 3


@pytest.mark.parametrize("profile", PROFILES)
@given(start=TRAVELS, end=TRAVELS)
@settings(max_examples=60)
def test_joints_start_and_arrive_together_as_soon_as_the_slowest_can(
    profile: ProfileName, start: list[float], end: list[float]
) -> None:
    motion = PointToPoint.plan(ROBOT, start, end, profile=profile)
    travel = np.subtract(end, start)
    alone = [PointToPoint.plan(ROBOT, np.zeros(5), only(j, travel), profile=profile) for j in range(5)]
    assert motion.duration == pytest.approx(max(each.duration for each in alone), rel=1e-12)
    if motion.duration > 0:
        early, late = motion.sample(1e-2 * motion.duration), motion.sample(0.99 * motion.duration)
        moves = np.abs(travel) > 1e-6
        assert (early.q != start)[moves].all()
        assert (late.q != end)[moves].all()


@pytest.mark.parametrize("profile", PROFILES)
def test_a_little_less_than_the_shortest_duration_is_refused(profile: ProfileName) -> None:
    start, end = ROBOT.pose("rest"), ROBOT.pose("home")
    shortest = PointToPoint.plan(ROBOT, start, end, profile=profile).duration
    assert PointToPoint.plan(ROBOT, start, end, shortest, profile).duration == shortest
    text = rf"(Base|Shoulder|Elbow|Wrist).*limit.*{re.escape(shortest_words(shortest))}"
    with pytest.raises(MotionRefusedError, match=text):
        PointToPoint.plan(ROBOT, start, end, shortest * 0.999, profile)


@given(st.floats(0.0, 170.0))
def test_the_shortest_duration_that_is_told_is_taken(degrees: float) -> None:
    end = np.radians([degrees / 2, 0.0, 0.0, 0.0, 0.0])
    shortest = PointToPoint.plan(ROBOT, np.zeros(5), end).duration
    told = re.search(r"is (\d+\.\d{3}) s$", shortest_words(shortest))
    assert told is not None
    assert shortest <= float(told[1]) < shortest + 0.001 + 1e-9 or shortest == pytest.approx(float(told[1]))
    PointToPoint.plan(ROBOT, np.zeros(5), end, float(told[1]))


@pytest.mark.parametrize(
    ("degrees", "duration", "profile", "text"),
    [
        (90.0, 1.6, "cubic", r"Base: 90.00° in 1.600 s needs 84.4 °/s, its limit is 60.0 °/s"),
        (1.0, 0.1, "cubic", r"Base: 1.00° in 0.100 s needs 600.0 °/s², its limit is 360.0 °/s²"),
        (0.01, 1e-3, "quintic", r"needs .* °/s³, its limit is 7200.0 °/s³"),
        (
            90.0,
            1.0,
            "s-curve",
            r"Base: 90.00° in 1.000 s is too fast for its limits of 60.0 °/s and",
        ),
        (90.0, 0.0, "cubic", "Base: cannot move in 0 s"),
    ],
)
def test_what_is_refused_says_which_limit_it_is(
    degrees: float, duration: float, profile: ProfileName, text: str
) -> None:
    with pytest.raises(MotionRefusedError, match=text):
        PointToPoint.plan(ROBOT, np.zeros(5), np.radians([degrees, 0, 0, 0, 0]), duration, profile)


def test_the_middle_and_the_ends_of_a_quarter_turn_in_two_seconds() -> None:
    cubic = PointToPoint.lasting([0.0], [np.pi / 2], 2.0)
    state = cubic.sample(np.array([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(state.q[:, 0], [0, np.pi / 4, np.pi / 2], atol=1e-15)
    np.testing.assert_allclose(state.velocity[:, 0], [0, 1.5 * np.pi / 4, 0], atol=1e-15)
    np.testing.assert_allclose(state.acceleration[:, 0], [6 * np.pi / 8, 0, -6 * np.pi / 8], atol=1e-15)


@given(travel=st.floats(-6, 6).map(lambda e: 10.0**e), duration=st.floats(-3, 6).map(lambda e: 10.0**e))
def test_huge_and_tiny_moves_of_any_duration(travel: float, duration: float) -> None:
    for profile in ("cubic", "quintic"):
        motion = PointToPoint.lasting([0.0], [travel], duration, profile)
        state = motion.sample(np.linspace(-duration, 2 * duration, 301))
        assert np.isfinite(state.jerk).all()
        assert (state.q >= 0).all()
        assert (state.q <= travel).all()


def test_outside_its_duration_it_holds_the_nearer_end_exactly() -> None:
    start, end = ROBOT.pose("rest"), ROBOT.pose("home")
    for motion in (PointToPoint.plan(ROBOT, start, end), PointToPoint.each_for_itself(ROBOT, start, end)):
        state = motion.sample(np.array([-1.0, motion.duration + 1.0]))
        np.testing.assert_array_equal(state.q, [start, end])
        for still in (state.velocity, state.acceleration, state.jerk):
            np.testing.assert_array_equal(still, np.zeros((2, 5)))


def test_a_motion_that_goes_nowhere_takes_no_time() -> None:
    home = ROBOT.pose("home")
    for profile in PROFILES:
        motion = PointToPoint.plan(ROBOT, home, home, profile=profile)
        assert motion.duration == 0
        np.testing.assert_array_equal(motion.sample(0.0).q, home)
        np.testing.assert_array_equal(motion.sample(np.array([0.0, 1.0])).velocity, np.zeros((2, 5)))
        np.testing.assert_array_equal(motion.peaks.speed, np.zeros(5))
    assert PointToPoint.lasting(home, home, 3.0).duration == 3


def test_normal_movement_each_joint_at_its_own_speed() -> None:
    start, end = np.zeros(5), np.array([1.0, 0.5, 0.3, 0.05, 0.0])
    motion = PointToPoint.each_for_itself(ROBOT, start, end)
    np.testing.assert_allclose(motion.peaks.speed[:2], ROBOT.speed_limits[:2])
    np.testing.assert_allclose(motion.peaks.acceleration[:4], ROBOT.acceleration_limits[:4])
    time = np.linspace(0, motion.duration, 50)
    for j in range(4):
        alone = PointToPoint.plan(ROBOT, start, only(j, end), profile="trapezoid")
        np.testing.assert_allclose(motion.sample(time).q[:, j], alone.sample(time).q[:, j], atol=1e-12)


@pytest.mark.parametrize(
    ("start", "end", "duration", "text"),
    [
        ([0.0], [1.0, 2.0], 1.0, "same number"),
        ([], [], 1.0, "same number"),
        ([np.nan], [1.0], 1.0, "finite"),
        (["a"], [1.0], 1.0, "must be numbers"),
        ([0.0], [1.0], 0.0, "cannot take 0.0 s"),
        ([0.0], [1.0], -1.0, "cannot take"),
        ([0.0], [1.0], 1e-300, "cannot take 1e-300 s"),
        ([0.0], [1.0], np.inf, "finite number, got inf"),
        ([0.0], [1.0], "1", "must be numbers, got '1'"),
    ],
)
def test_what_is_no_motion_is_refused(
    start: list[float], end: list[float], duration: float, text: str
) -> None:
    with pytest.raises(InputError, match=text):
        PointToPoint.lasting(start, end, duration)


def test_a_shape_that_depends_on_limits_has_no_duration_of_its_own() -> None:
    with pytest.raises(InputError, match="plan it"):
        PointToPoint.lasting([0.0], [1.0], 1.0, "s-curve")


@pytest.mark.parametrize(
    ("duration", "text"),
    [(np.nan, "finite number, got nan"), (-1.0, "leave it open"), ("x", "must be numbers, got 'x'")],
)
def test_a_duration_that_is_none_is_refused(duration: float, text: str) -> None:
    with pytest.raises(InputError, match=text):
        PointToPoint.plan(ROBOT, np.zeros(5), np.ones(5) * 0.1, duration)


def test_a_duration_too_short_to_divide_by_is_no_time_at_all() -> None:
    with pytest.raises(MotionRefusedError, match="cannot move in 0 s; the shortest possible duration is"):
        PointToPoint.plan(ROBOT, np.zeros(5), np.ones(5) * 0.1, 1e-300)
    assert PointToPoint.plan(ROBOT, np.zeros(5), np.zeros(5), 1e-300).duration == 0.0


def test_too_few_joints_are_refused() -> None:
    for plan in (PointToPoint.plan, PointToPoint.each_for_itself):
        with pytest.raises(InputError, match="5 joint angles are needed, got 2"):
            plan(ROBOT, [0.0, 0.0], [1.0, 1.0])
