"""The pins of an Arduino Mega as StandardFirmata 2.3 sees them (Boards.h)."""

from __future__ import annotations

from armctl.hardware.firmata.codec import PinMode

PINS = 70

_SERIAL_PINS = (0, 1)
_FIRST_ANALOG_PIN = 54
_PWM_PINS = (*range(2, 14), 44, 45, 46)
_LAST_SERVO_PIN = 49  # the Servo library has room for 48, and the sketch keeps one for each pin from 2 on
_I2C_PINS = (20, 21)


def mode_after_reset(pin: int) -> PinMode:
    """What a reset sets a pin to: the analog ones listen, the others are low; the serial ones it leaves."""
    if pin in _SERIAL_PINS:
        return PinMode.INPUT
    return PinMode.ANALOG if pin >= _FIRST_ANALOG_PIN else PinMode.OUTPUT


def capabilities(pin: int) -> dict[int, int]:
    """The modes that a pin knows, with their resolution in bits, in the sketch's order."""
    if pin in _SERIAL_PINS or not 0 <= pin < PINS:
        return {}
    modes: dict[int, int] = {PinMode.INPUT: 1, PinMode.OUTPUT: 1}
    if pin >= _FIRST_ANALOG_PIN:
        modes[PinMode.ANALOG] = 10
    if pin in _PWM_PINS:
        modes[PinMode.PWM] = 8
    if pin <= _LAST_SERVO_PIN:
        modes[PinMode.SERVO] = 14
    if pin in _I2C_PINS:
        modes[PinMode.I2C] = 1
    return modes


SERVO_PINS = tuple(pin for pin in range(PINS) if PinMode.SERVO in capabilities(pin))
