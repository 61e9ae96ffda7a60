"""A calibration as TOML, decoded strictly: an unknown key or a wrong type is refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import tomli_w
from msgspec import Meta

from armctl.calibration.record import Calibration, JointCalibration, checked_calibration
from armctl.errors import CalibrationError
from armctl.robot import OutputUnit

_PER_RAD = 180 / math.pi


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What all parts of a calibration file share."""


class _JointEntry(_Strict, frozen=True):
    zero: float
    per_deg: float
    low: float
    high: float


class _GripperEntry(_Strict, frozen=True):
    closed: float
    open: float


class _CalibrationFile(_Strict, frozen=True):
    format: Literal[1]
    robot: Annotated[str, Meta(min_length=1)]
    board: Annotated[str, Meta(min_length=1)]
    unit: OutputUnit
    made: str
    note: str = ""
    again: Annotated[int, Meta(ge=1)] | None = None
    """the earlier version that this one brought back"""
    joints: dict[str, _JointEntry] = {}
    gripper: _GripperEntry | None = None


def encode_calibration(calibration: Calibration, again: int | None = None) -> str:
    """The text of a calibration's file; ``again``: the version of the store that it brings back.

    Raises:
        CalibrationError: a value that could not be read again.
    """
    checked_calibration(calibration)
    record: dict[str, object] = {
        "format": 1,
        "robot": calibration.robot,
        "board": calibration.board,
        "unit": calibration.unit,
        "made": calibration.made,
        "note": calibration.note,
    }
    if again is not None:
        record["again"] = again
    if calibration.gripper is not None:
        closed, opened = calibration.gripper
        record["gripper"] = {"closed": float(closed), "open": float(opened)}
    record["joints"] = {
        name: {
            "zero": float(joint.zero),
            "per_deg": float(joint.per_rad) / _PER_RAD,
            "low": float(joint.low),
            "high": float(joint.high),
        }
        for name, joint in calibration.joints.items()
    }
    return tomli_w.dumps(record)


def decode_calibration(text: str | bytes) -> Calibration:
    """A calibration from the text of its file.

    Raises:
        CalibrationError: not TOML, an unknown key, a wrong type or an impossible value; names the key.
    """
    return decode_version(text)[0]


def decode_version(text: str | bytes) -> tuple[Calibration, int | None]:
    """As ``decode_calibration``, with the version that it brought back, if it did."""
    try:
        file = msgspec.toml.decode(text, type=_CalibrationFile)
    except (ValueError, OverflowError, RecursionError) as cause:  # all that TOML and UTF-8 can do wrong
        raise CalibrationError(f"is no calibration file: {cause}") from cause
    calibration = Calibration(
        robot=file.robot,
        board=file.board,
        unit=file.unit,
        joints={
            name: JointCalibration(entry.zero, entry.per_deg * _PER_RAD, entry.low, entry.high)
            for name, entry in file.joints.items()
        },
        gripper=None if file.gripper is None else (file.gripper.closed, file.gripper.open),
        made=file.made,
        note=file.note,
    )
    return checked_calibration(calibration), file.again


def read_calibration(path: Path) -> Calibration:
    """A calibration from a file.

    Raises:
        CalibrationError: unreadable, or as ``decode_calibration``; names the file.
    """
    return read_version(path)[0]


def read_version(path: Path) -> tuple[Calibration, int | None]:
    """As ``read_calibration``, with the version that it brought back, if it did."""
    try:
        return decode_version(path.read_bytes())
    except OSError as cause:
        raise CalibrationError(f"{path}: cannot be read: {cause.strerror}") from cause
    except CalibrationError as cause:
        raise CalibrationError(f"{path}: {cause}") from cause
