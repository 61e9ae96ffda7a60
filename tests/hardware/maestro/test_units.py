from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import InputError
from armctl.hardware.maestro import codec as units


@pytest.mark.parametrize(
    ("pulse_us", "quarters"),
    [(1500.0, 6000), (641.75, 2567), (1500.12, 6000), (1500.13, 6001), (0.01, 1), (4095.75, 16383)],
)
def test_pulse_widths_are_quarters_of_a_microsecond(pulse_us, quarters):
    assert units.us_to_quarters(pulse_us) == quarters


@pytest.mark.parametrize("pulse_us", [0.0, -1.0, 4095.76, math.nan, math.inf, -math.inf])
def test_a_pulse_that_cannot_be_sent_is_refused(pulse_us):
    with pytest.raises(InputError, match="pulse width"):
        units.us_to_quarters(pulse_us)


@given(st.integers(1, units.MAX_TARGET))
def test_quarters_round_trip(quarters):
    assert units.us_to_quarters(units.quarters_to_us(quarters)) == quarters


@pytest.mark.parametrize(
    ("speed", "expected"),
    [
        (None, 0),  # unlimited only when asked for
        (3500.0, 140),  # the guide's example: 3.5 µs/ms
        (3499.9999999, 140),
        (3499.0, 139),  # down: never faster than the limit
        (25.0, 1),
        (24.0, 1),  # 0 would mean unlimited
        (1e-9, 1),
        (409_575.0, 16383),
        (1e9, 16383),
    ],
)
def test_speed_units(speed, expected):
    assert units.speed_to_units(speed) == expected


@pytest.mark.parametrize(
    ("acceleration", "expected"),
    [
        (None, 0),
        (1250.0, 4),  # the guide's example for 4
        (1249.0, 3),
        (1.0, 1),
        (79_687.5, 255),
        (1e12, 255),
    ],
)
def test_acceleration_units(acceleration, expected):
    assert units.acceleration_to_units(acceleration) == expected


@pytest.mark.parametrize("convert", [units.speed_to_units, units.acceleration_to_units])
@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan, math.inf])
def test_a_limit_that_makes_no_sense_is_refused(convert, limit):
    with pytest.raises(InputError, match="makes no sense"):
        convert(limit)


@given(st.floats(25.0, 1e7))
def test_a_limit_of_at_least_one_unit_is_never_exceeded(speed):
    assert units.speed_to_units(speed) * units.SPEED_UNIT_US_PER_S <= speed * (1 + 1e-6)


@given(st.integers(1, units.MAX_SPEED), st.integers(1, units.MAX_ACCELERATION))
def test_whole_units_stay_what_they_are(speed, acceleration):
    assert units.speed_to_units(speed * units.SPEED_UNIT_US_PER_S) == speed
    assert units.acceleration_to_units(acceleration * units.ACCELERATION_UNIT_US_PER_S2) == acceleration
