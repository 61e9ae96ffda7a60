"""Golden bytes, written out by hand from the Firmata protocol 2.5."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import InputError
from armctl.hardware.firmata import codec
from armctl.hardware.firmata.codec import PinMode
from armctl.hardware.firmata.simulated import SimulatedServo


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (codec.version_query(), "f9"),
        (codec.firmware_query(), "f0 79 f7"),
        (codec.capability_query(), "f0 6b f7"),
        (codec.pin_state_query(9), "f0 6d 09 f7"),
        (codec.pin_state_query(49), "f0 6d 31 f7"),
        (codec.pin_mode(9, PinMode.SERVO), "f4 09 04"),
        (codec.pin_mode(22, PinMode.OUTPUT), "f4 16 01"),
        (codec.pin_mode(22, PinMode.INPUT), "f4 16 00"),
        (codec.servo_config(9, 544, 2400), "f0 70 09 20 04 60 12 f7"),  # 544 = 4·128 + 32, 2400 = 18·128 + 96
        (codec.servo_config(22, 1000, 2000), "f0 70 16 68 07 50 0f f7"),
        (codec.servo_write(9, 1500), "f0 6f 09 5c 0b f7"),  # 1500 = 11·128 + 92
        (codec.servo_write(22, 544), "f0 6f 16 20 04 f7"),
        (codec.servo_write(127, 2912), "f0 6f 7f 60 16 f7"),
    ],
)
def test_bytes(message: bytes, expected: str):
    assert message.hex(" ") == expected


@pytest.mark.parametrize("pulse_us", [0, 90, 180, 543, 2913, -1])
def test_what_the_sketch_would_take_as_degrees_or_cut_is_never_sent(pulse_us: int):
    with pytest.raises(InputError, match=rf"pulse width {pulse_us} is outside 544 … 2912"):
        codec.servo_write(9, pulse_us)


@pytest.mark.parametrize("pin", [-1, 128])
def test_a_pin_that_is_no_data_byte_is_refused(pin: int):
    for message in (
        lambda: codec.servo_write(pin, 1500),
        lambda: codec.servo_config(pin, 544, 2400),
        lambda: codec.pin_state_query(pin),
        lambda: codec.pin_mode(pin, PinMode.OUTPUT),
    ):
        with pytest.raises(InputError, match=f"pin {pin} is outside 0 … 127"):
            message()


@given(st.integers(0, 127), st.integers(544, 2912))
def test_between_the_frame_of_a_write_there_are_only_data_bytes(pin: int, pulse_us: int):
    message = codec.servo_write(pin, pulse_us)
    assert message[0] == 0xF0
    assert message[-1] == 0xF7
    assert all(byte < 0x80 for byte in message[1:-1])
    assert message[3] + 128 * message[4] == pulse_us


@given(st.integers(544, 2912), st.integers(544, 2912), st.integers(544, 2912))
def test_the_boards_own_limits_never_cut_a_pulse_inside_the_range(low: int, middle: int, high: int):
    low, middle, high = sorted((low, middle, high))
    servo = SimulatedServo()
    servo.attach(*codec.servo_limits(low, high))
    servo.write(middle)
    assert servo.width_us == middle


@given(st.integers(544, 1052), st.integers(1892, 2900))
def test_the_boards_own_limits_are_within_3_us_of_a_range_that_it_can_hold(low: int, high: int):
    servo = SimulatedServo()
    servo.attach(*codec.servo_limits(low, high))
    servo.write(544)
    assert low - 3 <= servo.width_us <= low
    servo.write(3000)
    assert high <= servo.width_us <= high + 3
