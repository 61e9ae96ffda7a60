from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import BoardError
from armctl.hardware import ChannelSettings
from armctl.hardware.firmata.pins import PinTable

SERVO_PINS = tuple(range(2, 50))


def table(*settings: ChannelSettings, servo_pins=SERVO_PINS) -> PinTable:
    return PinTable(settings, servo_pins)


def test_pins_come_lowest_first():
    assert table(ChannelSettings(22, 1000, 2000), ChannelSettings(9, 1000, 2000)).pins == (9, 22)


def test_a_pin_that_drives_no_servo_is_named_with_those_that_do():
    with pytest.raises(
        BoardError, match="pin 50 cannot drive a servo on this board; the pins that can: 2 … 49; change"
    ):
        table(ChannelSettings(50, 1000, 2000))
    with pytest.raises(BoardError, match="the pins that can: 3, 5 … 6, 9;"):
        table(ChannelSettings(2, 1000, 2000), servo_pins=(9, 5, 6, 3))
    with pytest.raises(BoardError, match="the pins that can: none at all;"):
        table(ChannelSettings(2, 1000, 2000), servo_pins=())


def test_a_pin_twice_is_refused():
    with pytest.raises(BoardError, match="pin 9 is configured twice; give each joint a pin of its own"):
        table(ChannelSettings(9, 1000, 2000), ChannelSettings(9, 1000, 2000))


def test_more_servos_than_the_line_carries_are_refused():
    table(*(ChannelSettings(pin, 1000, 2000) for pin in range(2, 18)))
    with pytest.raises(BoardError, match="17 servos: at 57600 baud a Firmata board can be sent 16 setpoints"):
        table(*(ChannelSettings(pin, 1000, 2000) for pin in range(2, 19)))


@pytest.mark.parametrize(
    ("low", "high"),
    [
        (500, 2400),
        (543.9, 2000),
        (2000, 1000),
        (1000, 2913),
        (math.nan, 2000),
        (1000, math.inf),
        (-1, 5),
        (600.2, 600.8),
    ],
)
def test_a_range_that_cannot_be(low: float, high: float):
    with pytest.raises(BoardError, match=r"is no range for a servo .* within 544 … 2912 µs.*degrees"):
        table(ChannelSettings(9, low, high))


def test_a_setpoint_outside_is_refused_and_the_message_says_what_is_allowed():
    pins = table(ChannelSettings(9, 1000, 2000))
    for bad in (999.9, 2000.1, math.nan, math.inf, -math.inf):
        with pytest.raises(BoardError, match=r"pin 9: .* is outside 1000 … 2000 µs; nothing was sent"):
            pins.admit(9, bad)
    with pytest.raises(BoardError, match=r"pin 8 is not configured \(configured: 9\); nothing was sent"):
        pins.admit(8, 1500)
    with pytest.raises(BoardError, match=r"\(configured: none\)"):
        table().admit(8, 1500)


@given(st.floats(544, 2912), st.floats(544, 2912), st.floats(0, 1))
def test_rounding_never_leads_out_of_the_range(a: float, b: float, share: float):
    low, high = sorted((a, b))
    if math.ceil(low) > math.floor(high):
        return
    pulse_us = min(high, max(low, low + share * (high - low)))
    admitted = table(ChannelSettings(9, low, high)).admit(9, pulse_us)
    assert low <= admitted <= high
    assert abs(admitted - pulse_us) < 1.0
