"""Laws from rest to rest, and motions of all joints by them."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples

from armctl.errors import InputError, MotionRefusedError
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.profiles import PROFILES, PointToPoint, ProfileName, law_over, shortest_words
from armctl.robot import load_robot

LENGTHS = st.floats(-9, 6).map(lambda e: 10.0**e)
LIMITS = st.floats(-6, 4).map(lambda e: 10.0**e)
KEEPS_JERK = ("quintic", "s-curve")


def tick(law: PiecewisePolynomial) -> float:
    """What the time at a seam is worth: a few roundings of the whole duration."""
    return 1e-15 * law.high


def peak(curve: PiecewisePolynomial) -> float:
    low, high = curve.extremes()
    return float(max(-low[0], high[0]))


@pytest.mark.parametrize("profile", PROFILES)
@given(length=LENGTHS, speed=LIMITS, acceleration=LIMITS, jerk=LIMITS)
def test_ends_limits_and_no_way_back_and_it_could_not_be_shorter(
    profile: ProfileName, length: float, speed: float, acceleration: float, jerk: float
) -> None:
    law = law_over(length, speed, acceleration, jerk, profile)
    rate = law.derivative()
    push = rate.derivative()
    assert law(0.0)[0] == 0.0
    assert law(law.high)[0] == pytest.approx(length, rel=1e-9)
    slip, kick = acceleration * tick(law), jerk * tick(law)
    assert rate(law.high)[0] == pytest.approx(0.0, abs=1e-9 * speed + slip)
    assert peak(rate) <= speed * (1 + 1e-9) + slip
    assert peak(push) <= acceleration * (1 + 1e-9) + (kick if profile == "s-curve" else 0.0)
    assert rate.extremes()[0][0] >= -1e-9 * speed - slip
    used = [peak(rate) / speed, peak(push) / acceleration]
    if profile in KEEPS_JERK:
        used.append(peak(push.derivative()) / jerk)
        assert used[-1] <= 1 + 1e-9
    # a limit is touched; the peak of a phase is known as well as its duration
    blur = max(acceleration / speed, jerk / acceleration) * tick(law)
    assert max(used) == pytest.approx(1.0, rel=1e-6 + blur)


@pytest.mark.parametrize("profile", PROFILES)
@given(length=LENGTHS, speed=LIMITS, acceleration=LIMITS, jerk=LIMITS)
def test_no_seam_jumps_in_way_or_speed(
    profile: ProfileName, length: float, speed: float, acceleration: float, jerk: float
) -> None:
    law = law_over(length, speed, acceleration, jerk, profile)
    widths = np.diff(law.breaks)
    curve = law
    slips = (speed * tick(law), acceleration * tick(law), jerk * tick(law))
    sizes = (length, speed, acceleration)
    for size, slip in list(zip(sizes, slips, strict=True))[: 3 if profile == "s-curve" else 2]:
        powers = widths[:, None] ** np.arange(curve.coefficients.shape[1])
        ends = (curve.coefficients[:, :, 0] * powers).sum(axis=1)
        np.testing.assert_allclose(ends[:-1], curve.coefficients[1:, 0, 0], rtol=0, atol=1e-9 * size + slip)
        curve = curve.derivative()


@given(
    length=st.floats(0.01, 10),
    speed=st.floats(0.1, 5),
    acceleration=st.floats(0.1, 20),
    jerk=st.floats(1, 200),
)
def test_no_motion_inside_those_limits_is_faster_than_the_s_curve(
    length: float, speed: float, acceleration: float, jerk: float
) -> None:
    """Steered by brute force: full jerk up, and back in time, for each peak speed that could be meant."""
    law = law_over(length, speed, acceleration, jerk, "s-curve")
    best = math.inf
    for peak_speed in np.linspace(1e-3 * speed, speed, 400):
        # up to the peak speed: by the jerk alone, or with the acceleration held in between
        bend = min(acceleration / jerk, math.sqrt(peak_speed / jerk))
        ramp = bend + peak_speed / (jerk * bend)
        cruise = (length - peak_speed * ramp) / peak_speed
        if cruise >= 0:
            best = min(best, 2 * ramp + cruise)
    assert law.high <= best * (1 + 1e-9)


def test_the_textbook_s_curve() -> None:
    # Biagiotti and Melchiorri, example 3.9: h = 10, v = 5, a = 10, j = 30
    law = law_over(10.0, 5.0, 10.0, 30.0, "s-curve")
    assert law.high == pytest.approx(2.8333, abs=1e-4)
    np.testing.assert_allclose(np.diff(law.breaks)[[0, 1, 3]], [0.3333, 0.1667, 1.1667], atol=1e-4)


def test_a_profile_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="choose among cubic, quintic, trapezoid, s-curve"):
        law_over(1.0, 1.0, 1.0, 1.0, "septic")  # pyright: ignore[reportArgumentType]


# --- all joints

ROBOT = load_robot("uzuner")
# now and then a joint does not move, or hardly
TRAVELS = st.lists(
    st.one_of(st.just(0.0), st.floats(-7, 1).map(lambda e: 10.0**e), st.floats(-3, 3), st.just(1e-300)),
    min_size=ROBOT.n,
    max_size=ROBOT.n,
)


def only(j: int, travel: np.ndarray) -> np.ndarray:
    return np.where(np.arange(len(travel)) == j, travel, 0.0)


@pytest.mark.parametrize("profile", PROFILES)
@given(start=TRAVELS, end=TRAVELS, slower=st.one_of(st.none(), st.floats(1, 20)))
@settings(max_examples=examples(60))
def test_ends_and_limits(
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


@pytest.mark.parametrize("profile", PROFILES)
@given(start=TRAVELS, end=TRAVELS)
@settings(max_examples=examples(40))
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
@settings(max_examples=examples(60))
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
            r"Base: 90.00° in 1.000 s is too fast for its limits of 60.0 °/s, 360.0 °/s² and 7200.0 °/s³;",
        ),
        (0.01, 0.01, "s-curve", r"is too fast for its limit of 7200.0 °/s³; with the profile s-curve"),
        (1.0, 0.1, "trapezoid", r"is too fast for its limit of 360.0 °/s²; the shortest"),
        (90.0, 1.6666, "trapezoid", r"in 1.6666 s .* duration is 1.667 s"),
        (90.0, 2.2499999, "cubic", r"in 2.2499999 s needs 60.000003 °/s, its limit is 60.000000 °/s"),
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
    assert PointToPoint.lasting([0.0], [1e-6], 1e6, "quintic").sample(5e5).q == pytest.approx([5e-7])


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
    with pytest.raises(InputError, match="plan it"):
        PointToPoint.lasting([0.0], [1.0], 1.0, "s-curve")
    for plan in (PointToPoint.plan, PointToPoint.each_for_itself):
        with pytest.raises(InputError, match="5 joint angles are needed, got 2"):
            plan(ROBOT, [0.0, 0.0], [1.0, 1.0])
    with pytest.raises(InputError, match="leave it open"):
        PointToPoint.plan(ROBOT, np.zeros(5), np.ones(5) * 0.1, -1.0)
