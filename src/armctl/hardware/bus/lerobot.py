"""LeRobot's calibration files: what stands in the EEPROM of each servo of an arm, as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from armctl.documents import write_atomically
from armctl.errors import InputError
from armctl.hardware.servos import FoundServo
from armctl.robot import Robot

Step = Annotated[int, Meta(ge=0, le=4095)]
Offset = Annotated[int, Meta(ge=-2047, le=2047)]


class KeptServo(msgspec.Struct, frozen=True, forbid_unknown_fields=False):
    """One servo of a file; homing offset and range in steps."""

    id: Annotated[int, Meta(ge=0, le=252)]
    drive_mode: Annotated[int, Meta(ge=0, le=1)]
    homing_offset: Offset
    range_min: Step
    range_max: Step


def read_kept(path: Path) -> dict[str, KeptServo]:
    """The servos of a file by the names of their motors. ``InputError`` says what is wrong with it."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    return decode_kept(data, str(path))


def decode_kept(data: bytes, where: str) -> dict[str, KeptServo]:
    """The servos of a file's bytes; ``where`` it is from. ``InputError`` says what is wrong with it."""
    try:
        kept = msgspec.json.decode(data, type=dict[str, KeptServo])
    except (msgspec.DecodeError, UnicodeDecodeError) as error:  # ValidationError is one
        raise InputError(f"{where}: not a calibration of LeRobot: {error}") from error
    ids = [one.id for one in kept.values()]
    twice = sorted({one for one in ids if ids.count(one) > 1})
    if twice:
        raise InputError(f"{where}: two motors have the id {twice[0]}; each needs its own")
    for name, one in kept.items():
        if one.range_min >= one.range_max:
            raise InputError(
                f"{where}: {name}: range_min {one.range_min} is not below range_max {one.range_max}: it "
                "crosses the end of the turn. Turn the horn, or calibrate it with the joint in its middle"
            )
    return kept


def motor_names(robot: Robot) -> dict[int, str]:
    """By servo, as LeRobot calls its motors: joints by their names, and ``gripper``."""
    outputs = robot.outputs
    names = dict(zip(outputs.channels, robot.joint_names, strict=True))
    names |= {one.channel: f"{robot.joint_names[one.joint]}_{one.channel}" for one in outputs.mirrors}
    return names if outputs.gripper_channel is None else names | {outputs.gripper_channel: "gripper"}


def require_fits(kept: Mapping[str, KeptServo], robot: Robot, where: str) -> None:
    """Refuse (``InputError``) a file that is of another arm, or that a servo could not be set to."""
    names = {name: servo for servo, name in motor_names(robot).items()}
    strangers = [name for name in kept if name not in names]
    if strangers:
        raise InputError(f"{where}: {robot.title} has no motor {strangers[0]!r}; it has {', '.join(names)}")
    for name, one in kept.items():
        if one.id != names[name]:
            raise InputError(f"{where}: {name} has the id {one.id}, in {robot.title} it is {names[name]}")
        if one.drive_mode:
            raise InputError(
                f"{where}: {name} has drive_mode 1; turn its direction round in the robot file "
                "(steps_per_deg)"
            )


def encode_kept(servos: Mapping[str, FoundServo]) -> bytes:
    """A file of what stands in the servos, by the names of their motors."""
    kept = {
        name: KeptServo(one.id, 0, one.settings.offset, one.settings.lowest, one.settings.highest)
        for name, one in servos.items()
    }
    return msgspec.json.format(msgspec.json.encode(kept), indent=4)


def write_kept(path: Path, servos: Mapping[str, FoundServo]) -> None:
    """Write it; ``InputError``: not writable."""
    try:
        write_atomically(path, encode_kept(servos))
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def changed(kept: KeptServo, found: FoundServo) -> list[tuple[str, int, int]]:
    """Registers that differ from a file: name, what the file says, what the servo has."""
    pairs = (
        ("offset", kept.homing_offset, found.settings.offset),
        ("lowest", kept.range_min, found.settings.lowest),
        ("highest", kept.range_max, found.settings.highest),
    )
    return [(name, wanted, has) for name, wanted, has in pairs if wanted != has]
