from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import InputError
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.profiles import PROFILES, ProfileName, law_over

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
def test_ends_limits_and_no_way_back(
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
    if profile in KEEPS_JERK:
        assert peak(push.derivative()) <= jerk * (1 + 1e-9)
    assert rate.extremes()[0][0] >= -1e-9 * speed - slip


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


@pytest.mark.parametrize("profile", PROFILES)
@given(length=LENGTHS, speed=LIMITS, acceleration=LIMITS, jerk=LIMITS)
def test_it_touches_a_limit_so_that_it_could_not_be_shorter(
    profile: ProfileName, length: float, speed: float, acceleration: float, jerk: float
) -> None:
    law = law_over(length, speed, acceleration, jerk, profile)
    rate = law.derivative()
    used = [peak(rate) / speed, peak(rate.derivative()) / acceleration]
    if profile in KEEPS_JERK:
        used.append(peak(rate.derivative().derivative()) / jerk)
    # the peak of a phase is known as well as its duration
    blur = max(acceleration / speed, jerk / acceleration) * tick(law)
    assert max(used) == pytest.approx(1.0, rel=1e-6 + blur)


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


@given(length=LENGTHS, speed=LIMITS, acceleration=LIMITS)
def test_with_endless_jerk_the_s_curve_is_the_trapezoid(
    length: float, speed: float, acceleration: float
) -> None:
    trapezoid = law_over(length, speed, acceleration, 1.0, "trapezoid")
    smooth = law_over(length, speed, acceleration, 1e9 * acceleration / trapezoid.high, "s-curve")
    assert smooth.high == pytest.approx(trapezoid.high, rel=1e-6)
    assert smooth.high >= trapezoid.high * (1 - 1e-9)


@given(length=LENGTHS, speed=LIMITS, acceleration=LIMITS, jerk=LIMITS)
def test_the_trapezoid_is_the_shortest_without_a_jerk_limit(
    length: float, speed: float, acceleration: float, jerk: float
) -> None:
    shortest = law_over(length, speed, acceleration, jerk, "trapezoid").high
    for profile in PROFILES:
        assert law_over(length, speed, acceleration, jerk, profile).high >= shortest * (1 - 1e-9)


def test_the_textbook_s_curve() -> None:
    # Biagiotti and Melchiorri, example 3.9: h = 10, v = 5, a = 10, j = 30
    law = law_over(10.0, 5.0, 10.0, 30.0, "s-curve")
    assert law.high == pytest.approx(2.8333, abs=1e-4)
    np.testing.assert_allclose(np.diff(law.breaks)[[0, 1, 3]], [0.3333, 0.1667, 1.1667], atol=1e-4)


@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_what_is_not_positive_is_refused(place: int, value: float) -> None:
    numbers = [1.0, 1.0, 1.0, 1.0]
    numbers[place] = value
    with pytest.raises(InputError, match=("length", "speed", "acceleration", "jerk")[place]):
        law_over(*numbers, profile="cubic")


def test_a_profile_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="choose among cubic, quintic, trapezoid, s-curve"):
        law_over(1.0, 1.0, 1.0, 1.0, "septic")  # pyright: ignore[reportArgumentType]
