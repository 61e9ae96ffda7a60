"""armctl's PCA9685 driver through the StandardFirmata that others built, to a chip on the Mega's I²C pins."""

from __future__ import annotations

import pytest
from tests.avr.conftest import MakeAvr
from tests.avr.i2c import I2cPins
from tests.avr.serve import stepped_line

from armctl.errors import BoardTimeoutError
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.pca9685.driver import Pca9685Driver
from armctl.hardware.pca9685.simulated import SimulatedI2cBus, SimulatedPca9685
from armctl.hardware.transport import Connection

TICK_S, STEP_US = 0.020, 122 / 25
CHANNELS = [ChannelSettings(channel, 1000.0, 2000.0) for channel in range(6)]


def test_an_arm_is_driven_and_let_go(make_avr: MakeAvr):
    avr, chip = make_avr("firmata"), SimulatedPca9685()
    pins = I2cPins(avr, SimulatedI2cBus([chip]).transfer)
    driver = Pca9685Driver(Connection(stepped_line(avr), lambda: avr.now))
    assert driver.open().kind.startswith("PCA9685 at 0x40 behind an Arduino with StandardFirmata")
    driver.configure(CHANNELS)
    assert chip.frequency_hz == pytest.approx(50.03, abs=0.01)
    lost = 0
    for k in range(60):
        avr.run_for(TICK_S)
        driver.write({channel: 1200.0 + 5 * k + 20 * channel for channel in range(6)})
        lost += driver.read().lost
    assert lost == 0
    for _ in range(8):
        avr.run_for(TICK_S)
        back = driver.read()
    wanted = {channel: 1495.0 + 20 * channel for channel in range(6)}
    assert back.positions == wanted
    for channel, pulse_us in wanted.items():
        assert chip.pulse_us(channel) == pytest.approx(pulse_us, abs=STEP_US)
    assert all(len(data) % 4 == 0 for register, data in chip.transfers if 6 <= register < 70)
    driver.release_channels([2])
    assert chip.pulse_us(2) is None
    assert chip.pulse_us(3) is not None
    driver.release()
    assert [chip.pulse_us(channel) for channel in range(6)] == [None] * 6
    assert pins is not None


def test_nobody_at_the_address(make_avr: MakeAvr):
    avr, chip = make_avr("firmata"), SimulatedPca9685(0x41)
    pins = I2cPins(avr, SimulatedI2cBus([chip]).transfer)
    driver = Pca9685Driver(Connection(stepped_line(avr), lambda: avr.now))
    with pytest.raises(BoardTimeoutError, match="nothing answers at 0x40; on this bus 0x41 does"):
        driver.open()
    assert chip.transfers == []
    assert pins is not None
