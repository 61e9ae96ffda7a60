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
        kept = msgspec.json.decode(data, type=dict[str, KeptServo])
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except msgspec.DecodeError as error:  # ValidationError is one
        raise InputError(f"{path}: not a calibration of LeRobot: {error}") from error
    ids = [one.id for one in kept.values()]
    twice = sorted({one for one in ids if ids.count(one) > 1})
    if twice:
        raise InputError(f"{path}: two motors have the id {twice[0]}; each needs its own")
    for name, one in kept.items():
        if one.range_min >= one.range_max:
            raise InputError(
                f"{path}: {name}: range_min {one.range_min} is not below range_max {one.range_max}: it "
                "crosses the end of the turn. Turn the horn, or calibrate it with the joint in its middle"
            )
    return kept


def write_kept(path: Path, servos: Mapping[str, FoundServo]) -> None:
    """Write what stands in the servos, by the names of their motors. ``InputError``: not writable."""
    kept = {
        name: KeptServo(one.id, 0, one.settings.offset, one.settings.lowest, one.settings.highest)
        for name, one in servos.items()
    }
    try:
        write_atomically(path, msgspec.json.format(msgspec.json.encode(kept), indent=4))
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
