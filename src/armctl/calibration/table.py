"""Numbers from a spreadsheet: marks of a joint, and touched points."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from armctl.arrays import FloatArray
from armctl.calibration.fit import Mark
from armctl.documents import DocumentKind
from armctl.errors import CalibrationError
from armctl.robot import Robot

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
