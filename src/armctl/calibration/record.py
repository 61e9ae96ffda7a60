"""What a calibration says: of one robot on one board."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
import tomli_w
from msgspec import Meta

from armctl.arrays import FloatArray
from armctl.calibration.fit import Mark
from armctl.documents import Document, DocumentKind
from armctl.errors import CalibrationError
from armctl.robot import FLATTEST_PER_DEG, Robot

_CALIBRATIONS = DocumentKind(CalibrationError, most_bytes=256 * 1024, largest=1e9)


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

    def require_sense(self) -> None:
        """Refuse numbers that contradict each other."""
        for name, joint in self.joints.items():
            if abs(joint.per_deg) < FLATTEST_PER_DEG:
                raise CalibrationError(
                    f"joints.{name}.per_deg = {joint.per_deg:g}: the joint would not move; "
                    f"{FLATTEST_PER_DEG} {self.unit} a degree or more"
                )
            if joint.low >= joint.high:
                raise CalibrationError(
                    f"joints.{name}: low = {joint.low:g} and high = {joint.high:g} {self.unit}: the smallest "
                    "safe output comes first"
                )
        if self.gripper and self.gripper.closed == self.gripper.open:
            raise CalibrationError(f"gripper: closed and open are both {self.gripper.open:g} {self.unit}")


def checked_record(calibration: Calibration, again: int | None = None) -> dict[str, object]:
    """The tables of a calibration's file; refuses numbers that make no sense by themselves."""
    file = _CalibrationFile(
        format=1,
        robot=calibration.robot,
        board=calibration.board,
        unit=calibration.unit,
        made=calibration.made,
        note=calibration.note,
        again=again,
        gripper=calibration.gripper and _GripperEntry(*map(float, calibration.gripper)),
        joints={
            name: _JointEntry(float(one.zero), float(one.per_rad) / _PER_RAD, float(one.low), float(one.high))
            for name, one in calibration.joints.items()
        },
    )
    record = {key: value for key, value in msgspec.to_builtins(file).items() if value is not None}
    Document(_CALIBRATIONS, record).convert(_CalibrationFile)
    file.require_sense()
    return record


def encode_calibration(calibration: Calibration, again: int | None = None) -> str:
    """The text of a calibration's file; ``again``: the version of the store that it brings back."""
    return tomli_w.dumps(checked_record(calibration, again))


def decode_calibration(text: str | bytes) -> Calibration:
    """A calibration from the text of its file; a refusal names the key."""
    return _decode_version(text)[0]


def _decode_version(text: str | bytes) -> tuple[Calibration, int | None]:
    file = _CALIBRATIONS.decode(text, _CalibrationFile)
    file.require_sense()
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
    return calibration, file.again


def read_calibration(path: Path) -> Calibration:
    """A calibration from a file; a refusal names the file, and as ``decode_calibration``."""
    return read_version(path)[0]


def read_version(path: Path) -> tuple[Calibration, int | None]:
    """As ``read_calibration``, with the version that it brought back, if it did."""
    return _CALIBRATIONS.load(path, _decode_version)


# Numbers from a spreadsheet: marks of a joint, and touched points.


_TABLES = DocumentKind(CalibrationError, most_bytes=256 * 1024)
_DELIMITERS = (";", "\t", ",")
_MARK_COLUMNS = ("output", "angle_deg")
_POINT_COLUMNS = ("x_mm", "y_mm", "z_mm")


def read_marks(path: Path) -> tuple[Mark, ...]:
    """Marks from a CSV file with the columns ``output`` (board's unit) and ``angle_deg``."""
    return tuple(Mark(output, math.radians(angle)) for output, angle in _read(path, _MARK_COLUMNS).tolist())


def read_points(path: Path, robot: Robot) -> tuple[FloatArray, FloatArray]:
    """Joint angles (k, n) [rad] and the points (k, 3) [m] that the tool touched at them, from a CSV file.

    Its columns are ``NAME_deg`` for each joint, and ``x_mm``, ``y_mm``, ``z_mm``.
    """
    table = _read(path, [*(f"{name}_deg" for name in robot.joint_names), *_POINT_COLUMNS])
    return np.radians(table[:, : robot.n]), table[:, robot.n :] / 1000


def _read(path: Path, columns: Sequence[str]) -> FloatArray:
    """(rows, columns) the numbers of a file, its columns in any order."""
    text = _TABLES.load(path, _TABLES.text)
    head = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = next((one for one in _DELIMITERS if one in head), ",")
    reader = csv.reader(io.StringIO(text), delimiter=delimiter)
    try:
        rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as cause:
        raise CalibrationError(f"{path}: line {reader.line_num}: {cause}") from cause
    heads = [] if not rows else [cell.strip().casefold() for cell in rows[0][1]]
    if sorted(heads) != sorted(columns):
        raise CalibrationError(
            f"{path}: its first line must name the columns {', '.join(columns)}; it names "
            f"{', '.join(heads) or 'nothing'}"
        )
    places = [heads.index(column) for column in columns]
    table = [_numbers(f"{path}: line {line}", row, heads, delimiter) for line, row in rows[1:]]
    return np.array(table, dtype=np.float64).reshape(-1, len(columns))[:, places]


def _numbers(where: str, row: list[str], heads: list[str], delimiter: str) -> list[float]:
    if len(row) != len(heads):
        raise CalibrationError(f"{where}: has {len(row)} cells, the first line {len(heads)}")
    numbers: list[float] = []
    for head, cell in zip(heads, row, strict=True):
        plain = cell.strip().replace("−", "-")
        if delimiter != ",":
            plain = plain.replace(",", ".")
        try:
            numbers.append(float(plain))
        except ValueError as cause:
            what = f"{cell.strip()[:40]!r} is not a number"
            raise CalibrationError(f"{where}, column {head}: {what}") from cause
        if not math.isfinite(numbers[-1]):
            raise CalibrationError(f"{where}, column {head}: {plain} is not a finite number")
    return numbers
