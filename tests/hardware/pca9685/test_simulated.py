"""The simulated chip, held against the data sheet."""

from __future__ import annotations

import pytest

from armctl.errors import InputError
from armctl.hardware.pca9685.registers import Mode1
from armctl.hardware.pca9685.simulated import SimulatedI2cBus, SimulatedPca9685


def registers(chip: SimulatedPca9685, start: int, count: int) -> str:
    return chip.transfer(bytes((start,)), count).hex(" ")


def say(chip: SimulatedPca9685, *texts: str) -> None:
    for text in texts:
        chip.transfer(bytes.fromhex(text), 0)


def test_after_power_up_it_sleeps_with_everything_off():
    chip = SimulatedPca9685()
    assert [registers(chip, one, 1) for one in (0, 1, 2, 3, 4, 5, 0xFE)] == "11 04 e2 e4 e8 e0 1e".split()
    assert [registers(chip, one, 1) for one in (6, 7, 8, 9, 69)] == "00 00 00 10 10".split()
    assert chip.frequency_hz == pytest.approx(196.9, abs=0.1)
    assert chip.pulse_us(0) is None


def test_registers_count_up_only_where_that_is_switched_on():
    chip = SimulatedPca9685()
    assert registers(chip, 0, 3) == "11 11 11"
    say(chip, "00 31")
    assert registers(chip, 0, 6) == "31 04 e2 e4 e8 e0"
    assert registers(chip, 68, 4) == "00 10 31 04"  # from the last channel on to MODE1
    assert registers(chip, 0xFA, 6) == "00 00 00 00 1e 31"  # what is written only reads 0


def test_the_prescale_is_taken_asleep_only():
    chip = SimulatedPca9685()
    say(chip, "fe 79")
    assert chip.frequency_hz == pytest.approx(50.0, abs=0.1)
    say(chip, "00 21", "fe 65")
    assert chip.frequency_hz == pytest.approx(50.0, abs=0.1)


def test_pulses_at_the_chips_own_clock():
    chip = SimulatedPca9685(oscillator_mhz=26.5)
    say(chip, "fe 79", "00 20", "0e 00 00 33 01")  # channel 2
    assert chip.pulse_us(2) == pytest.approx(307 * 122 / 26.5)
    say(chip, "fd 10")  # all off at once
    assert chip.pulse_us(2) is None
    say(chip, "0e 00 00 33 01", "01 14")  # inverted
    assert chip.pulse_us(2) is None
    with pytest.raises(InputError, match="channels 0 … 15"):
        chip.pulse_us(16)


def test_asleep_it_keeps_its_pulses_and_a_restart_brings_them_back():
    chip = SimulatedPca9685()
    say(chip, "00 20", "06 00 00 33 01", "00 30")
    assert chip.pulse_us(0) is None
    assert chip.mode & Mode1.RESTART
    say(chip, "00 20", "00 a0")
    assert not chip.mode & Mode1.RESTART
    assert chip.pulse_us(0) is not None


def test_the_external_clock_stays_until_a_power_cut():
    chip = SimulatedPca9685()
    say(chip, "00 70", "00 20")
    assert chip.mode & Mode1.EXTCLK
    chip.power_up()
    assert not chip.mode & Mode1.EXTCLK


def test_the_address_of_all_chips():
    chips = [SimulatedPca9685(0x40), SimulatedPca9685(0x41)]
    bus = SimulatedI2cBus(chips)
    bus.transfer(0x40, bytes.fromhex("00 20"), 0)  # deaf to it from now on
    assert bus.transfer(0x70, bytes.fromhex("fe 79"), 0) == b""
    assert [round(one.frequency_hz) for one in chips] == [197, 50]
    assert bus.transfer(0x42, b"\x00", 1) is None
    chips[1].powered = False
    assert bus.transfer(0x41, b"\x00", 1) is None
    bus.works = False
    assert bus.transfer(0x40, b"\x00", 1) is None
