"""What is said of servos that are not as an arm needs them, in English."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from armctl.facts import servos
from armctl.facts.angles import in_degrees
from armctl.facts.reasons import Reason

_REGISTERS = {
    "offset": "homing offset",
    "lowest": "lowest position",
    "highest": "highest position",
    "mode": "operating mode",
}

_UNCONFIRMED = {
    "told": "does not confirm what it is told",
    "on": "did not switch its torque on",
    "locked": "did not lock its EEPROM; try once more",
    "open": "did not open its EEPROM; try once more",
}


def _plug(one: servos.ServoSilent) -> str:
    if one.behind is not None:
        return f"look at the plug before servo {one.behind}: all behind it are silent"
    if one.stranger is not None:
        return f"if it is the one that answers as {one.stranger}: give that one the id {one.servo}"
    return "look at its plug; a new servo has the id 1: plug it in alone and give it its id"


def _range(one: servos.ServoRange) -> str:
    return (
        f"servo {one.servo}: its own limits {one.lowest} … {one.highest} cut off a part of the "
        f"{one.minimum:g} … {one.maximum:g} steps of the robot file"
    )


def _changed(one: servos.ServoChanged) -> str:
    return (
        f"servo {one.servo}: its {_REGISTERS[one.register]} is {one.now}, and was {one.kept} when armctl "
        "kept it: another program has changed it since"
    )


def _not_taken(one: servos.ServoNotTaken) -> str:
    if one.register == "goal":
        return f"servo {one.servo} did not take {one.number} steps as its goal, but {one.has}"
    return f"servo {one.servo} did not take {one.number} as its {one.register}"


WHAT: Mapping[type[Reason], Callable[[Any], str]] = {
    servos.ServoSilent: lambda one: (
        f"servo {one.servo}{f' ({one.joint})' if one.joint else ''} does not answer"
    ),
    servos.ServoStranger: lambda one: f"servo {one.servo} is not one of this arm",
    servos.ServoAtBaud: lambda one: f"servo {one.servo} answers at {one.baud} baud",
    servos.ServoUnfit: lambda one: f"servo {one.servo}: {one.why}",
    servos.ServoRange: _range,
    servos.ServoOffset: lambda one: f"servo {one.servo}: its homing offset is {one.offset} steps",
    servos.ServoSeam: lambda one: (
        f"the joint crosses the end of its servo's turn, where {one.turn - 1:.0f} is followed by 0: it stood "
        f"at {one.high:.0f} and at {one.low:.0f} steps"
    ),
    servos.ServoTold: lambda one: f"servo {one.servo}: {one.words}",
    servos.ServoChanged: _changed,
    servos.ServoUnconfirmed: lambda one: f"servo {one.servo} {_UNCONFIRMED[one.what]}",
    servos.ServoNotTaken: _not_taken,
    servos.ServoTorqueOn: lambda one: (
        f"the torque of servo {one.servo} is on: release the arm before its EEPROM is written"
    ),
    servos.ServoTurned: lambda one: (
        f"servo {one.servo} has turned by {in_degrees(one.turn, '.1f')} since it was looked at; "
        "let the arm stand still, and enable again"
    ),
    servos.ServoTurning: lambda one: (
        f"servo {one.servo} turns while its torque is switched on; hold the arm still"
        if one.enabling
        else f"servo {one.servo}: its readings differ, it turns: let it stand and try again"
    ),
    servos.ServoOutside: lambda one: (
        f"servo {one.servo} stands at {one.place} steps, outside the limits {one.lowest} … {one.highest} of "
        f"its own EEPROM: with torque on it would jump by {in_degrees(one.jump, '.1f')}. "
        "Turn it back by hand, or set those limits anew"
    ),
}
ADVICE: Mapping[type[Reason], Callable[[Any], str]] = {
    servos.ServoSilent: _plug,
    servos.ServoStranger: lambda _: "unplug it, or give it the id that is missing",
    servos.ServoAtBaud: lambda one: f"armctl speaks {one.wanted}: set it",
    servos.ServoUnfit: lambda _: "write the register that is named",
    servos.ServoRange: lambda _: "widen them, or narrow the limits of the joint",
    servos.ServoOffset: lambda _: "keep it where the arm was calibrated with it",
    servos.ServoSeam: lambda one: (
        f"put the horn on anew, with the joint in its middle and the servo near {one.turn / 2:.0f} steps; or "
        "set its offset so"
    ),
    servos.ServoChanged: lambda one: f"write {one.kept} again, or keep it as it is now",
}
