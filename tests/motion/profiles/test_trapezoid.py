from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armctl.errors import InputError
from armctl.motion import TrapezoidTrajectory
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
LOW, HIGH = ROBOT.limits[:, 0], ROBOT.limits[:, 1]
SHARES = st.lists(st.floats(0, 1), min_size=ROBOT.n, max_size=ROBOT.n)


def inside(shares: list[float]) -> np.ndarray:
    return LOW + np.array(shares) * (HIGH - LOW)


def test_ten_rad_at_two_rad_per_second() -> None:
    # Ramps of 1 s and 1 rad each, 8 rad at 2 rad/s between them: 6 s.
    trapezoid = TrapezoidTrajectory([0.0], [10.0], [2.0], [2.0])
    assert trapezoid.duration == pytest.approx(6.0)
    sample = trapezoid.sample(np.array([0.5, 1.0, 3.0, 5.5]))
    np.testing.assert_allclose(sample.q[:, 0], [0.25, 1.0, 5.0, 9.75])
    np.testing.assert_allclose(sample.velocity[:, 0], [1.0, 2.0, 2.0, 1.0])
    np.testing.assert_allclose(sample.acceleration[:, 0], [2.0, 0.0, 0.0, -2.0])


def test_a_short_way_is_a_triangle() -> None:
    trapezoid = TrapezoidTrajectory([1.0], [0.0], [10.0], [4.0])
    assert trapezoid.duration == pytest.approx(1.0)
    assert trapezoid.peak_speed == pytest.approx([2.0])
    assert trapezoid.sample(0.5).q == pytest.approx([0.5])
    assert trapezoid.sample(0.5).velocity == pytest.approx([-2.0])


def test_each_joint_arrives_in_its_own_time() -> None:
    trapezoid = TrapezoidTrajectory([0.0, 0.0], [10.0, 2.0], [2.0, 2.0], [2.0, 2.0])
    at_two = trapezoid.sample(2.0 + 1e-9)
    assert at_two.q[1] == 2.0
    assert at_two.velocity[1] == 0.0
    assert at_two.acceleration[1] == 0.0
    assert at_two.velocity[0] == 2.0


@given(SHARES, SHARES)
@settings(max_examples=60)
def test_it_is_smooth_keeps_the_limits_and_meets_the_ends(first: list[float], last: list[float]) -> None:
    start, end = inside(first), inside(last)
    trapezoid = TrapezoidTrajectory.plan(ROBOT, start, end)
    assert np.array_equal(trapezoid.sample(0.0).q, start)
    assert np.array_equal(trapezoid.sample(trapezoid.duration).q, end)
    t = np.linspace(0, trapezoid.duration, 501)
    sample = trapezoid.sample(t)
    assert (np.abs(sample.velocity) <= ROBOT.speed_limits * (1 + 1e-9)).all()
    assert (np.abs(sample.acceleration) <= ROBOT.acceleration_limits * (1 + 1e-9)).all()
    step = trapezoid.duration / 500
    assert (np.abs(np.diff(sample.q, axis=0)) <= ROBOT.speed_limits * step + 1e-9).all()
    assert (np.abs(np.diff(sample.velocity, axis=0)) <= ROBOT.acceleration_limits * step + 1e-9).all()
    # the area under the speed is the way
    np.testing.assert_allclose(
        np.trapezoid(sample.velocity, dx=step, axis=0),
        end - start,
        atol=ROBOT.acceleration_limits.max() * step**2 + 1e-9,
    )


def test_limits_that_are_no_limits_are_refused() -> None:
    for speed, acceleration, text in (
        ([0.0], [1.0], "speed"),
        ([1.0], [-1.0], "acceleration"),
        ([1.0, 1.0], [1.0], "speed"),
    ):
        with pytest.raises(InputError, match=f"positive {text} limit"):
            TrapezoidTrajectory([0.0], [1.0], speed, acceleration)
