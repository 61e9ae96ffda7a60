"""Paths made motions: as fast as the limits allow, and by a named profile."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples

from armctl import load_robot
from armctl.errors import InputError, MotionRefusedError
from armctl.motion import ProfileName
from armctl.motion.polynomial import PiecewisePolynomial, spline_through
from armctl.motion.preflight import preflight
from armctl.motion.profiles import law_over, shortest_words
from armctl.motion.time_optimal import PathLimits, fastest_rates, time_optimal_law
from armctl.motion.timing import PathTrajectory, timed

ROBOT = load_robot("uzuner")


def random_path(seed: int, count: int) -> PiecewisePolynomial:
    rng = np.random.default_rng(seed)
    low, high = ROBOT.limits.T
    points = rng.uniform(low, high, (count, ROBOT.n))
    return spline_through(points, 1 / ROBOT.speed_limits)


def rate(motion: PathTrajectory, t: float | np.ndarray) -> np.ndarray:
    """ds/dt."""
    return motion.law.derivatives(t, 1)[1, ..., 0]


def straight(end: np.ndarray) -> PiecewisePolynomial:
    return PiecewisePolynomial([0.0, 1.0], np.stack([np.zeros(5), end])[None])


@given(st.integers(0, 10_000), st.integers(2, 12), st.floats(1e-3, 2.0))
@settings(max_examples=examples(60))
def test_no_limit_is_ever_passed(seed: int, count: int, cap: float) -> None:
    motion = PathTrajectory.fastest(ROBOT, random_path(seed, count), cap)
    state = motion.sample(np.linspace(0.0, motion.duration, 3000))
    assert (np.abs(state.velocity) <= ROBOT.speed_limits * (1 + 1e-9)).all()
    assert (np.abs(state.acceleration) <= ROBOT.acceleration_limits * (1 + 1e-9)).all()
    peaks = motion.peaks
    assert (np.abs(state.velocity).max(axis=0) <= peaks.speed * (1 + 1e-9) + 1e-12).all()
    assert (np.abs(state.acceleration).max(axis=0) <= peaks.acceleration * (1 + 1e-9) + 1e-12).all()
    assert (state.q >= peaks.low - 1e-9).all()
    assert (state.q <= peaks.high + 1e-9).all()
    assert rate(motion, np.linspace(0.0, motion.duration, 1000)).max() <= cap
    np.testing.assert_allclose(state.velocity[[0, -1]], 0.0, atol=1e-9)


@given(st.integers(0, 10_000))
@settings(max_examples=examples(30))
def test_each_derivative_is_that_of_the_one_before(seed: int) -> None:
    motion = PathTrajectory.fastest(ROBOT, random_path(seed, 5))
    # between the breaks, where the law has all its derivatives
    middle = 0.5 * (motion.law.breaks[:-1] + motion.law.breaks[1:])
    step = 1e-2 * np.diff(motion.law.breaks)
    early, late = motion.sample(middle - step), motion.sample(middle + step)
    here = motion.sample(middle)
    for slope, before, after in (
        (here.velocity, early.q, late.q),
        (here.acceleration, early.velocity, late.velocity),
        (here.jerk, early.acceleration, late.acceleration),
    ):
        size = 1 + np.abs(slope).max()
        np.testing.assert_allclose((after - before) / (2 * step[:, None]), slope, rtol=2e-2, atol=2e-2 * size)


def test_along_a_straight_way_it_is_the_trapezoid_of_the_slowest_joint() -> None:
    end = np.array([1.2, 0.1, 0.0, -0.2, 0.0])
    motion = PathTrajectory.fastest(ROBOT, straight(end))
    base = ROBOT.joints[0]
    alone = law_over(1.2, base.speed, base.acceleration, base.jerk, "trapezoid")
    assert motion.duration == pytest.approx(alone.high, rel=1e-7)
    np.testing.assert_array_equal(motion.sample(motion.duration).q, end)
    np.testing.assert_array_equal(motion.sample(motion.duration + 1).velocity, np.zeros(5))
    state = motion.sample(np.linspace(1e-6, motion.duration - 1e-6, 999))
    load = np.maximum(
        (np.abs(state.velocity) / ROBOT.speed_limits).max(axis=1),
        (np.abs(state.acceleration) / ROBOT.acceleration_limits).max(axis=1),
    )
    assert load.min() > 0.999  # touches a limit nearly everywhere


def test_what_cannot_be_timed_is_refused() -> None:
    with pytest.raises(InputError, match="cannot be begun at the rate"):
        fastest_rates(PathLimits.of(ROBOT, straight(np.full(5, 1e-3))), first=1e3)
    with pytest.raises(InputError, match="must be positive"):
        PathTrajectory.fastest(ROBOT, straight(np.ones(5)), 0.0)


def test_a_first_rate_is_kept_and_braked() -> None:
    path = random_path(4, 6)
    limits = PathLimits.of(ROBOT, path)
    first = 0.2 * float(limits.most[0]) ** 0.5
    rates = fastest_rates(limits, first)
    motion = PathTrajectory(path, time_optimal_law(limits.breaks, rates, limits.cap, limits.push))
    assert rate(motion, 0.0) == pytest.approx(first)
    assert rate(motion, motion.duration) == pytest.approx(0.0, abs=1e-9)


def test_slower_is_the_same_way() -> None:
    motion = PathTrajectory.fastest(ROBOT, random_path(8, 4))
    slow = motion.scaled(2.5)
    t = np.linspace(0.0, motion.duration, 500)
    np.testing.assert_allclose(slow.sample(2.5 * t).q, motion.sample(t).q, atol=1e-12)
    np.testing.assert_allclose(slow.peaks.speed, motion.peaks.speed / 2.5, rtol=1e-3)


@pytest.mark.parametrize(
    ("turns", "factors", "profile", "cap", "what"),
    [
        ((1.0, 0.1, 0, 0, 0), (1.0, 9.0, 9.0), "trapezoid", np.inf, "Base is near its largest speed, 60 °/s"),
        ((0.1, 1.0, 0, 0, 0), (9.0, 1.0, 9.0), "trapezoid", np.inf, "Shoulder is near its largest acceler"),
        ((0.1, 1.0, 0, 0, 0), (9.0, 9.0, 1.0), "s-curve", np.inf, "Shoulder is near its largest jerk"),
        ((1.0, 0.1, 0, 0, 0), (1.0, 9.0, 9.0), "trapezoid", 0.1, "it goes at the speed that was asked for"),
    ],
)
def test_too_short_a_duration_is_refused_with_the_joint_and_its_limit(
    turns: tuple[float, ...], factors: tuple[float, ...], profile: ProfileName, cap: float, what: str
) -> None:
    speed, push, jerk = factors
    joints = tuple(
        replace(
            joint, speed=speed * joint.speed, acceleration=push * joint.acceleration, jerk=jerk * joint.jerk
        )
        for joint in ROBOT.joints
    )
    robot = replace(ROBOT, joints=joints)
    with pytest.raises(MotionRefusedError, match=re.escape(f"most of the time {what}")) as refused:
        timed(robot, straight(np.array(turns)), profile=profile, rate_cap=cap, duration_s=0.05)
    shortest = timed(robot, straight(np.array(turns)), profile=profile, rate_cap=cap).duration
    words = shortest_words(shortest, profile)
    assert str(refused.value).endswith(f"; {words}")


def cornered() -> PiecewisePolynomial:
    """There and back, without a rounding."""
    q, d = np.zeros(5), 0.3 * np.eye(5)[0]
    return PiecewisePolynomial([0.0, 1.0, 2.0], np.array([[q, d], [q + d, -d]]))


def test_where_the_slope_of_a_path_jumps_the_arm_stops() -> None:
    motion = PathTrajectory.fastest(ROBOT, cornered())
    assert (motion.peaks.acceleration <= ROBOT.acceleration_limits * (1 + 1e-9)).all()
    time = np.linspace(0.0, motion.duration, 20_001)
    speed = motion.sample(time).velocity
    steps = np.abs(np.diff(speed, axis=0)) / time[1]
    assert (steps <= ROBOT.acceleration_limits * (1 + 1e-6)).all()
    assert not [finding for finding in preflight(ROBOT, motion) if finding.kind == "acceleration"]


def test_a_corner_taken_at_speed_is_refused() -> None:
    motion = PathTrajectory(cornered(), law_over(2.0, 0.1, 0.1, 0.1, "quintic"))
    assert np.isinf(motion.peaks.acceleration[0])
    assert "acceleration" in [finding.kind for finding in preflight(ROBOT, motion)]
    for profile in ("cubic", "s-curve", "quintic"):
        with pytest.raises(InputError, match="turns a corner"):
            timed(ROBOT, cornered(), profile=profile)


@pytest.mark.parametrize("profile", ["trapezoid", "cubic", "s-curve", "quintic"])
def test_a_path_need_not_begin_at_nought(profile: ProfileName) -> None:
    path = straight(np.full(5, 0.3))
    later = PiecewisePolynomial(path.breaks + 1.0, path.coefficients)
    motion, same = timed(ROBOT, later, profile=profile), timed(ROBOT, path, profile=profile)
    assert motion.duration == pytest.approx(same.duration)
    time = np.linspace(0.0, same.duration, 50)
    np.testing.assert_allclose(motion.sample(time).q, same.sample(time).q, atol=1e-9)
