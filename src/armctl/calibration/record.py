"""What a calibration says: of one robot on one board."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import tomli_w
from msgspec import Meta

from armctl.documents import DocumentKind
from armctl.errors import CalibrationError
from armctl.robot import FLATTEST_PER_DEG

_LARGEST = 1e9
"""no output of any board is larger"""
_CALIBRATIONS = DocumentKind(CalibrationError, most_bytes=256 * 1024, largest=_LARGEST)


class JointCalibration(msgspec.Struct, frozen=True):
    """output = zero + per_rad · angle, and the outputs that are safe; in the board's unit."""

    zero: float
    """output at 0 rad"""
    per_rad: float
    """signed"""
    low: float
    """smallest output that is safe"""
    high: float
    """largest one"""

    def angles(self) -> tuple[float, float]:
        """The angles at the safe outputs, the smaller one first [rad]."""
        first, last = sorted(((self.low - self.zero) / self.per_rad, (self.high - self.zero) / self.per_rad))
        return first, last


class Calibration(msgspec.Struct, frozen=True):
    """What was measured of one robot on one board. What it does not name is as in the robot file."""

    robot: str
    """name of the robot"""
    board: str
    """serial number of the board, or "simulated" """
    unit: str
    joints: Mapping[str, JointCalibration]
    """by name"""
    gripper: tuple[float, float] | None = None
    """outputs at which it is closed and open"""
    made: str = ""
    """when it was measured (ISO 8601)"""
    note: str = ""

    @property
    def empty(self) -> bool:
        """It changes nothing: the robot file holds as it is."""
        return not self.joints and self.gripper is None


def checked_calibration(calibration: Calibration) -> Calibration:
    """The calibration, if its numbers make sense by themselves.

    Raises:
        CalibrationError: names the part, its value and what is allowed.
    """
    unit = calibration.unit
    for key in ("robot", "board"):
        if not getattr(calibration, key):
            raise CalibrationError(f"{key} is empty; a calibration is of one robot on one board")
    entries = {f"joints.{name}": _JointEntry.of(one) for name, one in calibration.joints.items()}
    gripper = calibration.gripper and _GripperEntry(*calibration.gripper)
    for place, entry in (*entries.items(), *([("gripper", gripper)] if gripper else [])):
        for key, value in msgspec.structs.asdict(entry).items():
            if not (math.isfinite(value) and abs(value) <= _LARGEST):
                raise CalibrationError(
                    f"{place}.{key} = {value}: must be a finite number within ±{_LARGEST:.0e}"
                )
    for place, joint in entries.items():
        if abs(joint.per_deg) < FLATTEST_PER_DEG:
            raise CalibrationError(
                f"{place}.per_deg = {joint.per_deg:g}: the joint would not move; {FLATTEST_PER_DEG} {unit} "
                "a degree or more"
            )
        if joint.low >= joint.high:
            raise CalibrationError(
                f"{place}: low = {joint.low:g} and high = {joint.high:g} {unit}: the smallest safe output "
                "comes first"
            )
    if gripper and gripper.closed == gripper.open:
        raise CalibrationError(f"gripper: closed and open are both {gripper.open:g} {unit}")
    return calibration


def iso_time(stamp: float) -> str:
    """Local day and time to the second, with its offset, of seconds since the epoch (ISO 8601)."""
    return datetime.fromtimestamp(stamp).astimezone().isoformat(timespec="seconds")


# A calibration as TOML, decoded strictly: an unknown key or a wrong type is refused.

_PER_RAD = 180 / math.pi


class _JointEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    zero: float
    per_deg: float
    low: float
    high: float

    @classmethod
    def of(cls, joint: JointCalibration) -> _JointEntry:
        return cls(float(joint.zero), float(joint.per_rad) / _PER_RAD, float(joint.low), float(joint.high))


class _GripperEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    closed: float
    open: float


class _CalibrationFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    format: Literal[1]
    robot: Annotated[str, Meta(min_length=1)]
    board: Annotated[str, Meta(min_length=1)]
    unit: str
    made: str
    note: str = ""
    again: Annotated[int, Meta(ge=1)] | None = None
    """the earlier version that this one brought back"""
    gripper: _GripperEntry | None = None
    joints: dict[str, _JointEntry] = {}


def encode_calibration(calibration: Calibration, again: int | None = None) -> str:
    """The text of a calibration's file; ``again``: the version of the store that it brings back.

    Raises:
        CalibrationError: a value that could not be read again.
    """
    checked_calibration(calibration)
    file = _CalibrationFile(
        format=1,
        robot=calibration.robot,
        board=calibration.board,
        unit=calibration.unit,
        made=calibration.made,
        note=calibration.note,
        again=again,
        gripper=calibration.gripper and _GripperEntry(*map(float, calibration.gripper)),
        joints={name: _JointEntry.of(joint) for name, joint in calibration.joints.items()},
    )
    record: dict[str, object] = msgspec.to_builtins(file)
    return tomli_w.dumps({key: value for key, value in record.items() if value is not None})


def decode_calibration(text: str | bytes) -> Calibration:
    """A calibration from the text of its file.

    Raises:
        CalibrationError: not TOML, an unknown key, a wrong type or an impossible value; names the key.
    """
    return _decode_version(text)[0]


def _decode_version(text: str | bytes) -> tuple[Calibration, int | None]:
    file = _CALIBRATIONS.decode(text, _CalibrationFile)
    calibration = Calibration(
        robot=file.robot,
        board=file.board,
        unit=file.unit,
        joints={
            name: JointCalibration(entry.zero, entry.per_deg * _PER_RAD, entry.low, entry.high)
            for name, entry in file.joints.items()
        },
        gripper=file.gripper and (file.gripper.closed, file.gripper.open),
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
    return _CALIBRATIONS.load(path, _decode_version)
