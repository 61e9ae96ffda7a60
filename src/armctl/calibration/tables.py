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
from armctl.calibration.touch_model import Frame, Touches
from armctl.documents import DocumentKind
from armctl.errors import CalibrationError
from armctl.robot import Robot

_TABLES = DocumentKind(CalibrationError, most_bytes=256 * 1024)
_DELIMITERS = (";", "\t", ",")
_MARK_COLUMNS = ("output", "angle_deg")
_POINT_COLUMNS = ("x_mm", "y_mm", "z_mm")


def read_marks(path: Path) -> tuple[Mark, ...]:
    """Marks from a CSV file with the columns ``output`` (board's unit) and ``angle_deg``."""
    return tuple(
        Mark(output, math.radians(angle)) for output, angle in _read(path, _MARK_COLUMNS)["output"].tolist()
    )


def read_touches(path: Path, robot: Robot, frame: Frame = "base") -> Touches:
    """Touched points from a CSV file, whose points are in ``frame``.

    Its columns are ``NAME_deg`` for each joint, what was read there, and ``x_mm``, ``y_mm``, ``z_mm``.
    Besides there may be, for all joints, ``NAME_sense``: in which sense it turned last, 1, -1, or 0 for
    unknown; and ``NAME_commanded_deg``, where what was read is measured.
    """
    kinds = ("_deg", "_sense", "_commanded_deg")
    read, sense, commanded = ([f"{name}{kind}" for name in robot.joint_names] for kind in kinds)
    points = list(_POINT_COLUMNS)
    given = _read(path, [*read, *points], sense, commanded)
    return Touches.checked(
        robot,
        np.radians(given[read[0]][:, : robot.n]),
        given[read[0]][:, robot.n :] / 1000,
        frame,
        given.get(sense[0]),
        None if (told := given.get(commanded[0])) is None else np.radians(told),
    )


def touches_csv(touches: Touches, robot: Robot) -> str:
    """Touched points as ``read_touches`` reads them: 0.001°, 0.01 mm."""
    parts = [("_deg", np.degrees(touches.q), 3)]
    if touches.sense is not None:
        parts.append(("_sense", touches.sense, 0))
    if touches.commanded is not None:
        parts.append(("_commanded_deg", np.degrees(touches.commanded), 3))
    heads = [f"{name}{kind}" for kind, _, _ in parts for name in robot.joint_names]
    lines = [",".join([*heads, *_POINT_COLUMNS])]
    for i, point in enumerate(touches.points_m):
        cells = [f"{value:z.{digits}f}" for _, values, digits in parts for value in values[i].tolist()]
        lines.append(",".join([*cells, *(f"{1000 * value:z.2f}" for value in point.tolist())]))
    return "\n".join(lines) + "\n"


def _read(path: Path, columns: Sequence[str], *more: Sequence[str]) -> dict[str, FloatArray]:
    """The numbers of a file, its columns in any order: (rows, columns) by the first of ``columns``.

    Each of ``more`` may be there besides, all of its columns or none.
    """
    text = _TABLES.load(path, _TABLES.text)
    head = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = next((one for one in _DELIMITERS if one in head), ",")
    reader = csv.reader(io.StringIO(text), delimiter=delimiter)
    try:
        rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as cause:
        raise CalibrationError(f"{path}: line {reader.line_num}: {cause}") from cause
    heads = [] if not rows else [cell.strip().casefold() for cell in rows[0][1]]
    named = [columns, *(one for one in more if set(one) & set(heads))]
    wanted = [column for one in named for column in one]
    if sorted(heads) != sorted(wanted):
        raise CalibrationError(
            f"{path}: its first line must name the columns {', '.join(wanted)}; it names "
            f"{', '.join(heads) or 'nothing'}"
        )
    table = [_numbers(f"{path}: line {line}", row, heads, delimiter) for line, row in rows[1:]]
    numbers = np.array(table, dtype=np.float64).reshape(-1, len(heads))
    return {one[0]: numbers[:, [heads.index(column) for column in one]] for one in named}


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
