"""What a calibration says: of one robot on one board."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import tomli_w
from msgspec import Meta

from armctl.documents import DocumentKind
from armctl.errors import CalibrationError
from armctl.robot import FLATTEST_PER_DEG

LARGEST_OUTPUT = 1e9
"""no output of any board is larger"""
_CALIBRATIONS = DocumentKind(CalibrationError, most_bytes=256 * 1024, largest=LARGEST_OUTPUT)


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
    for key in ("robot", "board"):
        if not getattr(calibration, key):
            raise CalibrationError(f"{key} is empty; a calibration is of one robot on one board")
    for name, joint in calibration.joints.items():
        per_deg = math.radians(joint.per_rad)  # as the file has it
        values = {"zero": joint.zero, "per_deg": per_deg, "low": joint.low, "high": joint.high}
        for key, value in values.items():
            _require_usable(f"joints.{name}.{key}", value)
        if abs(per_deg) < FLATTEST_PER_DEG:
            raise CalibrationError(
                f"joints.{name}.per_deg = {per_deg:g}: the joint would not move; {FLATTEST_PER_DEG} "
                f"{calibration.unit} a degree or more"
            )
        if joint.low >= joint.high:
            raise CalibrationError(
                f"joints.{name}: low = {joint.low:g} and high = {joint.high:g} {calibration.unit}: "
                "the smallest safe output comes first"
            )
    if calibration.gripper is not None:
        closed, opened = calibration.gripper
        _require_usable("gripper.closed", closed)
        _require_usable("gripper.open", opened)
        if closed == opened:
            raise CalibrationError(f"gripper: closed and open are both {closed:g} {calibration.unit}")
    return calibration


def _require_usable(key: str, value: float) -> None:
    if not (math.isfinite(value) and abs(value) <= LARGEST_OUTPUT):
        raise CalibrationError(f"{key} = {value}: must be a finite number within ±{LARGEST_OUTPUT:.0e}")


# A calibration as TOML, decoded strictly: an unknown key or a wrong type is refused.

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
    unit: str
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
    file = _CALIBRATIONS.decode(text, _CalibrationFile)
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
    return _CALIBRATIONS.load(path, decode_version)
