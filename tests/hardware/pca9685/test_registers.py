"""Registers and pulses, held against the data sheet."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import BoardError, BoardProtocolError
from armctl.hardware import ChannelSettings
from armctl.hardware.pca9685 import Pca9685Options, channel_table
from armctl.hardware.pca9685.registers import (
    FULL_OFF,
    IDENTIFYING,
    RegisterBlock,
    blocks,
    check_chip,
    decode,
    is_high,
    period_us,
    prescale,
    pulse,
    register_of,
    step_us,
    transfers,
)

FRESH = dict(zip(IDENTIFYING, bytes.fromhex("11 04 e2 e4 e8 e0 1e"), strict=True))
"""after power-up (table 4)"""


def test_the_prescale_of_the_data_sheet_and_of_servos():
    assert prescale(Pca9685Options(frequency_hz=200)) == 0x1E  # section 7.3.5, example; the value at power-up
    assert prescale(Pca9685Options()) == 0x79
    assert prescale(Pca9685Options(frequency_hz=60)) == 0x65
    assert prescale(Pca9685Options(oscillator_mhz=26.3)) == 0x7F
    assert step_us(0x79, 25.0) == pytest.approx(4.88)
    assert period_us(Pca9685Options()) == pytest.approx(19988.48)


@pytest.mark.parametrize(
    ("registers", "steps"),
    [
        ("00 00 33 01", 307),  # 1498 µs at 50 Hz
        ("99 01 cc 04", 0x4CC - 0x199),  # data sheet, example 1: on 409, off 1228
        ("ff 0e 32 02", 4096 - 0xEFF + 0x232),  # on after off: the pulse goes on into the next period
        ("00 00 00 10", None),  # full off, as after power-up
        ("00 10 00 10", None),  # full off counts more than full on
        ("00 10 00 00", None),  # full on: no pulse either
        ("00 00 00 00", None),
    ],
)
def test_what_a_channel_sends(registers: str, steps: int | None):
    assert decode(bytes.fromhex(registers)) == steps


def test_an_output_that_is_high_all_the_time_is_told_from_one_that_is_off():
    assert is_high(bytes.fromhex("00 10 00 00"))
    assert not is_high(bytes.fromhex("00 10 00 10"))


@given(st.integers(1, 4095))
def test_a_pulse_comes_back_as_it_was(steps: int):
    assert decode(pulse(steps)) == steps


def test_both_ends_of_a_pulse_go_in_one_transfer_and_neighbours_together():
    assert register_of(15) == 66
    assert transfers({3: pulse(307), 0: FULL_OFF, 1: pulse(0x199)}, 64) == [
        (0x06, bytes.fromhex("00 00 00 10 00 00 99 01")),
        (0x12, bytes.fromhex("00 00 33 01")),
    ]
    every = transfers(dict.fromkeys(range(16), FULL_OFF), 28)
    assert [(register, len(data)) for register, data in every] == [(6, 28), (34, 28), (62, 8)]


def test_what_is_read_for_channels():
    assert blocks((0, 1, 5), 64) == [RegisterBlock(6, 24)]
    assert blocks(tuple(range(16)), 28) == [RegisterBlock(6, 28), RegisterBlock(34, 28), RegisterBlock(62, 8)]
    assert list(RegisterBlock(34, 28).channels) == [7, 8, 9, 10, 11, 12, 13]
    assert blocks((), 28) == []


def test_another_chip_at_the_address_is_not_taken_for_one():
    check_chip("bus", FRESH)
    for change in ({0x01: 0x9F}, {0x02: 0xE3}, {0xFE: 0x00}):
        with pytest.raises(BoardProtocolError, match=r"bus: what answers is no PCA9685 \(registers 00=11 "):
            check_chip("bus", FRESH | change)


@pytest.mark.parametrize(
    ("one", "says"),
    [
        (ChannelSettings(16, 1000, 2000), "channel 16: a PCA9685 has channels 0 … 15"),
        (ChannelSettings(0, 1000, 2000.0e1), "no range for pulses that come 50 times a second"),
        (ChannelSettings(0, 2000, 1000), "no range"),
        (ChannelSettings(0, 1500, 1502), r"holds a step of 4\.9 µs"),
        (ChannelSettings(0, float("nan"), 2000), "no range"),
    ],
)
def test_channels_that_the_chip_cannot_have(one: ChannelSettings, says: str):
    with pytest.raises(BoardError, match=says):
        channel_table([one], period_us(Pca9685Options()))
