"""The check-up of an Arduino with StandardFirmata that answers."""

from __future__ import annotations

from collections.abc import Sequence

from armctl.errors import BoardError
from armctl.hardware.board_type import (
    ChannelsToCheck,
    CheckUp,
    Finding,
    failed,
    not_checked,
    ok,
    round_trips,
    warning,
)
from armctl.hardware.firmata import pin_table
from armctl.hardware.firmata.codec import PinMode
from armctl.hardware.firmata.line import FirmataLine

_SKETCH = "StandardFirmata"
_ANSWER_S = 0.25
_PIN = 2
"""the first pin that is not part of the serial port"""


def examine_firmata(check_up: CheckUp) -> list[Finding]:
    """The findings of ``BoardType.examine``."""
    needs = check_up.needs
    line = FirmataLine(check_up.line, check_up.now)
    identity = line.identify(0.0)
    name = identity.firmware.name
    version = f"{identity.firmware.major}.{identity.firmware.minor}"
    channels = _pins(needs, identity.capabilities.pins_with(PinMode.SERVO))
    pins = sorted(one.channel for one in needs.channels)
    states = [line.pin_state(pin, _ANSWER_S) for pin in pins]
    on = ", ".join(f"{state.pin} at {state.value}" for state in states if state.mode == PinMode.SERVO)
    asked = pins[0] if pins else _PIN
    return [
        ok("firmware", f"{name} {version}")
        if name.startswith(_SKETCH)
        else warning(
            "firmware",
            f"{name or 'a sketch without a name'} {version} speaks Firmata",
            f"armctl is tried with {_SKETCH}; load that one if anything is odd",
        ),
        *channels,
        ok("outputs", f"servo pulses on pin {on}" if on else "all pulses are off"),
        warning(
            "watchdog",
            "StandardFirmata has none: if this computer or the cable fails, the servos keep their position",
            "have a switch for the servos' supply within reach",
        ),
        round_trips(lambda: line.pin_state(asked, _ANSWER_S), check_up.now),
        not_checked(
            "supply",
            "an Arduino does not tell its servos' voltage",
            "feed the servos from a supply of their own, never from the Arduino's 5 V pin, and join the "
            "grounds; when the board restarts as the arm moves, that supply is the first suspect",
        ),
    ]


def _pins(needs: ChannelsToCheck, servo_pins: Sequence[int]) -> list[Finding]:
    """Whether the board can drive a servo on each pin, in the range that the robot file wants."""
    problems: list[str] = []
    for one in needs.channels:
        try:
            pin_table([one], servo_pins)
        except BoardError as error:
            problems.append(str(error))
    if problems:
        return [failed("channels", "; ".join(problems), "change the pins or ranges in the robot file")]
    pins = ", ".join(str(one.channel) for one in needs.channels)
    if not pins:
        return [needs.not_known("channels")]
    return [
        ok("channels", f"the board can drive servos on pins {pins}"),
        ok("ranges", "the robot file's ranges can be sent"),
    ]
