from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armctl.errors import InputError, MotionRefusedError
from armctl.motion import CubicTrajectory, shortest_duration
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
LOW, HIGH = ROBOT.limits[:, 0], ROBOT.limits[:, 1]
SHARES = st.lists(st.floats(0, 1), min_size=ROBOT.n, max_size=ROBOT.n)


def inside(shares: list[float]) -> np.ndarray:
    return LOW + np.array(shares) * (HIGH - LOW)


def test_the_middle_and_the_ends_of_a_quarter_turn_in_two_seconds() -> None:
    cubic = CubicTrajectory([0.0], [np.pi / 2], 2.0)
    sample = cubic.sample(np.array([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(sample.q[:, 0], [0, np.pi / 4, np.pi / 2], atol=1e-15)
    np.testing.assert_allclose(sample.velocity[:, 0], [0, 1.5 * np.pi / 4, 0], atol=1e-15)
    np.testing.assert_allclose(sample.acceleration[:, 0], [6 * np.pi / 8, 0, -6 * np.pi / 8], atol=1e-15)


@given(SHARES, SHARES)
@settings(max_examples=60)
def test_the_shortest_meets_one_limit_exactly_and_breaks_none(first: list[float], last: list[float]) -> None:
    cubic = CubicTrajectory.plan(ROBOT, inside(first), inside(last))
    used = np.concatenate(
        [cubic.peak_speed / ROBOT.speed_limits, cubic.peak_acceleration / ROBOT.acceleration_limits]
    )
    assert used.max() <= 1 + 1e-9
    if cubic.duration > 0:
        assert used.max() == pytest.approx(1, abs=1e-9)


@given(SHARES, SHARES, st.floats(1, 20))
@settings(max_examples=60)
def test_derivatives_equal_finite_differences_and_peaks_bound_them(
    first: list[float], last: list[float], slower: float
) -> None:
    start, end = inside(first), inside(last)
    shortest = shortest_duration(end - start, ROBOT.speed_limits, ROBOT.acceleration_limits)
    cubic = CubicTrajectory.plan(ROBOT, start, end, max(shortest * slower, 0.01))
    h = cubic.duration * 1e-4
    t = np.linspace(2 * h, cubic.duration - 2 * h, 37)
    before, here, after = cubic.sample(t - h), cubic.sample(t), cubic.sample(t + h)
    scale = 1e-6 * (1 + 1 / cubic.duration**2)
    np.testing.assert_allclose(here.velocity, (after.q - before.q) / (2 * h), atol=scale)
    np.testing.assert_allclose(here.acceleration, (after.velocity - before.velocity) / (2 * h), atol=scale)
    assert (np.abs(here.velocity) <= cubic.peak_speed + 1e-12).all()
    assert (np.abs(here.acceleration) <= cubic.peak_acceleration + 1e-12).all()


def test_outside_its_duration_it_holds_the_nearer_end_exactly() -> None:
    start, end = inside([0.1, 0.2, 0.3, 0.4, 0.5]), inside([0.9, 0.7, 0.35, 0.2, 0.1])
    cubic = CubicTrajectory.plan(ROBOT, start, end)
    for t, q in ((-1.0, start), (0.0, start), (cubic.duration, end), (cubic.duration + 1, end)):
        sample = cubic.sample(t)
        assert np.array_equal(sample.q, q)
        assert not sample.velocity.any()
    assert not cubic.sample(-1.0).acceleration.any()
    assert not cubic.sample(cubic.duration + 1e-9).acceleration.any()


def test_a_duration_that_is_too_short_is_refused_with_joint_need_and_shortest() -> None:
    start = ROBOT.pose("zero")
    end = start.copy()
    end[1] = np.radians(90)
    # 90° at 60 °/s: 1.5 · 90 / 60 = 2.25 s
    with pytest.raises(
        MotionRefusedError,
        match=r"Shoulder: 90\.00° in 1\.000 s needs 135\.0 °/s, its limit is 60\.0 °/s; the shortest "
        r"possible duration is 2\.250 s",
    ):
        CubicTrajectory.plan(ROBOT, start, end, 1.0)
    assert CubicTrajectory.plan(ROBOT, start, end, 2.25).duration == pytest.approx(2.25)


def test_a_short_way_is_bound_by_the_acceleration() -> None:
    start = ROBOT.pose("zero")
    end = start.copy()
    end[0] = np.radians(6)
    # sqrt(6 · 6 / 360) = 0.316 s, by speed it would be 0.15 s
    with pytest.raises(MotionRefusedError, match=r"Base: .* °/s², its limit is 360\.0 °/s².* 0\.316 s"):
        CubicTrajectory.plan(ROBOT, start, end, 0.2)


@pytest.mark.parametrize("duration", [-1.0, np.nan, np.inf])
def test_an_impossible_duration_is_refused(duration: float) -> None:
    with pytest.raises(InputError, match="cannot take"):
        CubicTrajectory.plan(ROBOT, ROBOT.pose("zero"), ROBOT.pose("home"), duration)


def test_zero_seconds_are_right_for_going_nowhere_only() -> None:
    home = ROBOT.pose("home")
    nowhere = CubicTrajectory.plan(ROBOT, home, home)
    assert nowhere.duration == 0
    assert np.array_equal(nowhere.sample(0.0).q, home)
    assert nowhere.sample(np.zeros(3)).q.shape == (3, ROBOT.n)
    with pytest.raises(MotionRefusedError, match="cannot move in 0 s"):
        CubicTrajectory.plan(ROBOT, home, ROBOT.pose("zero"), 0.0)


@pytest.mark.parametrize("bad", [[0.0, 1.0], [[0.0] * 5], [np.nan, 0, 0, 0, 0], ["a", 0, 0, 0, 0]])
def test_wrong_joint_angles_are_refused(bad: list[object]) -> None:
    with pytest.raises(InputError):
        CubicTrajectory.plan(ROBOT, ROBOT.pose("home"), bad)  # pyright: ignore[reportArgumentType]


def test_nobody_can_change_it_afterwards() -> None:
    end = ROBOT.pose("zero")
    cubic = CubicTrajectory.plan(ROBOT, ROBOT.pose("home"), end)
    end[0] = 1.0
    cubic.end[1] = 2.0
    assert np.array_equal(cubic.end, ROBOT.pose("zero"))
