"""Inputs and outputs of a Mega with the StandardFirmata that others built: levels on its pins."""

from __future__ import annotations

import pytest
from tests.avr.avr import Avr
from tests.avr.conftest import MakeAvr
from tests.avr.mega import PINS, duty
from tests.avr.serve import stepped_line

from armctl.errors import BoardError
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.transport import Connection
from armctl.robot.signals import Input, Output, Signals

TICK_S = 0.020
BUTTON, DOOR = Input("button", "Button", 23, "pull-up"), Input("door", "Door", 40)
LAMP, FAN, BELL = Output("lamp", "Lamp", 25), Output("fan", "Fan", 9, "pwm"), Output("bell", "Bell", 22)
SERVOS = (2, 3, 4, 5, 6)


class Rig:
    """The driver with a few servos on, ticked as the runtime does; all in simulated time."""

    def __init__(self, avr: Avr) -> None:
        self.avr = avr
        self.driver = FirmataDriver(Connection(stepped_line(avr), lambda: avr.now))
        self.driver.open()
        self.driver.configure([ChannelSettings(pin, 544, 2400) for pin in SERVOS])
        self.driver.use_signals(Signals((BUTTON, DOOR), (LAMP, FAN, BELL)))

    def tick(self, setpoints: dict[int, int] | None = None):
        self.avr.run_for(TICK_S)
        if setpoints is not None:
            self.driver.write(setpoints)
        back = self.driver.read()
        assert back.errors == ()
        return back


@pytest.fixture
def rig(make_avr: MakeAvr) -> Rig:
    rig = Rig(make_avr("firmata"))
    rig.avr.set_pin(PINS[23], 1)
    rig.avr.set_pin(PINS[40], 0)
    for _ in range(60):
        rig.tick(dict.fromkeys(SERVOS, 1500))
    return rig


def test_a_level_is_seen_within_a_tick_also_while_servos_are_streamed(rig: Rig) -> None:
    assert rig.tick().inputs == {"button": 1.0, "door": 0.0}
    for k in range(6):
        level = 1 - k % 2
        rig.avr.set_pin(PINS[40], level)
        rig.avr.set_pin(PINS[23], 1 - level)
        seen = rig.tick({pin: 1500 + 7 * k for pin in SERVOS}).inputs
        assert seen == {"button": float(1 - level), "door": float(level)}


def test_outputs_have_their_level_and_duty_within_a_tick(rig: Rig) -> None:
    rig.driver.set_output("lamp", 1.0)
    rig.driver.set_output("fan", 0.25)
    rig.tick(dict.fromkeys(SERVOS, 1520))
    assert (rig.avr.pin(PINS[25]), rig.avr.pin(PINS[22])) == (1, 0)
    assert duty(rig.avr, 9) == pytest.approx(0.25, abs=0.01)
    rig.driver.set_output("lamp", 0.0)
    rig.driver.set_output("bell", 1.0)
    for _ in range(5):
        back = rig.tick()
    assert (rig.avr.pin(PINS[25]), rig.avr.pin(PINS[22])) == (0, 1)
    assert back.outputs == {"lamp": 0.0, "fan": 0.25, "bell": 1.0}
    assert rig.driver._signals._unsure == {}  # the sketch has confirmed them


def test_release_leaves_them_as_they_are(rig: Rig) -> None:
    rig.driver.set_output("lamp", 1.0)
    rig.tick()
    rig.driver.release()
    assert rig.avr.pin(PINS[25]) == 1


def test_servos_take_the_timer_of_some_pwm_pins(make_avr: MakeAvr) -> None:
    avr = make_avr("firmata")
    driver = FirmataDriver(Connection(stepped_line(avr), lambda: avr.now))
    driver.open()
    driver.configure([ChannelSettings(pin, 544, 2400) for pin in SERVOS])
    driver.use_signals(Signals((), (Output("fan", "Fan", 9, "pwm"),)))
    for _ in range(60):
        driver.write(dict.fromkeys(SERVOS, 1500))
        driver.read()
        avr.run_for(TICK_S)
    with pytest.raises(ValueError, match="timer 5 counts in mode 0: that is no PWM"):
        avr.write(bytes.fromhex("f4 2c 03 f0 6f 2c 40 00 f7"))
        avr.run_for(TICK_S)
        duty(avr, 44)
    with pytest.raises(BoardError, match="Fan: pin 44 has no PWM while servos are on: they take its timer"):
        driver.use_signals(Signals((), (Output("fan", "Fan", 44, "pwm"),)))
