"""Figures worked out from Servo.cpp: limits in steps of 4 µs in a signed byte, degrees below 544."""

from __future__ import annotations

import pytest

from armctl.hardware.firmata.simulated import SimulatedServo


def test_a_servo_begins_in_the_middle():
    servo = SimulatedServo()
    servo.attach()
    assert servo.width_us == 1500


@pytest.mark.parametrize(
    ("value", "width_us"),
    [
        (-5, 544),
        (0, 544),
        (90, 1472),
        (180, 2400),
        (200, 2400),
        (543, 2400),
        (544, 544),
        (1234, 1234),
        (9999, 2400),
    ],
)
def test_degrees_below_544_and_microseconds_from_there(value: int, width_us: int):
    servo = SimulatedServo()
    servo.attach()
    servo.write(value)
    assert servo.width_us == width_us


@pytest.mark.parametrize(
    ("limits", "shortest", "longest"),
    [
        ((1000, 2000), 1000, 2000),
        ((1002, 2001), 1000, 2004),  # cut towards 544 and 2400
        ((1000, 1800), 1000, 2824),  # 600 µs below 2400 do not fit: wrapped round
        ((1100, 2000), 76, 2000),
    ],
)
def test_limits(limits: tuple[int, int], shortest: int, longest: int):
    servo = SimulatedServo()
    servo.attach(*limits)
    servo.write(544)
    assert servo.width_us == max(shortest, 544)
    servo.write(3000)
    assert servo.width_us == longest
    servo.write(0)
    assert servo.width_us == shortest


def test_attaching_again_keeps_the_width():
    servo = SimulatedServo()
    servo.attach()
    servo.write(1700)
    servo.attach(1000, 2000)
    assert servo.width_us == 1700
