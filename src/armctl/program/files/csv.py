"""Programs from spreadsheets: a head with units decides what the columns mean."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import msgspec
import numpy as np

from armctl.arrays import FloatArray
from armctl.documents import refusal_of
from armctl.errors import ProgramError
from armctl.program.keys import defaults_of
from armctl.program.program import MOST_STEPS, PROGRAM_FILES, Blocks, Program
from armctl.program.steps import MoveStep, PointStep, Step, all_keys, any_step
from armctl.robot import Robot

# The columns of a program's CSV file: what their heads mean, and in which unit.

_UNITS: tuple[dict[str, float], ...] = (
    {"mm_s": 1.0, "cm_s": 10.0, "m_s": 1000.0},
    {"mm": 1.0, "cm": 10.0, "m": 1000.0},
    {"deg": 1.0, "rad": 180 / math.pi},
    {"s": 1.0, "ms": 0.001},
    {"percent": 1.0},
)
"""units of one measure, the one of the steps first, and their factors to it"""
NUMBER = "step"
"""head of the running number: for people, not read"""
_DO = "do"
JOINTS = "joints_deg"
_POINTS_PLACE = 2
"""of the last key of a point among the keys of steps"""
_NUMBER_TEXT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WHOLE_TEXT = re.compile(r"[0-9]{1,9}")


@dataclass(frozen=True, slots=True)
class Column:
    """What one head means."""

    head: str
    key: str
    """of the step; ``joints_deg`` for a joint; empty where the column is not read"""
    factor: float | None = None
    """to the step's unit; None: not a number with a unit"""
    joint: int | None = None
    integer: bool = False


class Columns:
    """All heads that are written or can be read for an arm."""

    def __init__(self, joint_names: Sequence[str]) -> None:
        keys = [key for key in all_keys() if key.name != JOINTS]
        self._known: dict[str, Column] = {NUMBER: Column(NUMBER, ""), _DO: Column(_DO, _DO)}
        self._units: dict[str, list[str]] = {}
        """units of each noun"""
        for key in keys:
            if key.form == "number":
                self._add_number(key.head, key.name)
            else:
                self._known[key.head] = Column(key.head, key.name, integer=key.form == "integer")
        taken = {*self._units, *self._known}
        self._joints = [f"joint_{name}_deg" if name in taken else f"{name}_deg" for name in joint_names]
        for joint, head in enumerate(self._joints):
            self._add_number(head, JOINTS, joint)
        self._folded = {head.casefold(): column for head, column in self._known.items()}
        others = [self._known[key.head] for key in keys]
        self.written: tuple[Column, ...] = (
            self._known[_DO],
            *(self._known[head] for head in self._joints),
            *others,
        )
        """in their order, without the running number"""
        self._others = [key.head for key in keys if key.field.place > _POINTS_PLACE]

    def find(self, head: str) -> Column | None:
        """The column of a head, whatever its capitals; None: not known."""
        return self._known.get(head) or self._folded.get(head.strip().casefold())

    def known(self, head: str) -> Column:
        """The column of a head.

        Raises:
            ProgramError: unknown, without a unit, or with one that does not fit; says what is known.
        """
        column = self.find(head)
        if column is None:
            raise ProgramError(self._why_not(head.strip()))
        return column

    def head(self, key: str, joint: int | None = None) -> str:
        """The head under which a step's key is written."""
        return next(one.head for one in self.written if one.key == key and one.joint == joint)

    def _add_number(self, head: str, key: str, joint: int | None = None) -> None:
        """A column for each unit that a number may have."""
        for units in _UNITS:
            own = next(iter(units))
            if head.endswith(f"_{own}"):
                noun = head.removesuffix(f"_{own}")
                for unit, factor in units.items():
                    self._known[f"{noun}_{unit}"] = Column(f"{noun}_{unit}", key, factor, joint)
                self._units.setdefault(noun, []).extend(units)
                return
        self._known[head] = Column(head, key, 1.0, joint)

    def _why_not(self, head: str) -> str:
        plain = re.sub(r"[\s(\[]+", "_", head.casefold()).rstrip(")]_°")
        # The longest noun first: "via_x" before "x".
        for noun in sorted(self._units, key=len, reverse=True):
            allowed = " or ".join(f"{noun}_{unit}" for unit in self._units[noun])
            if plain == noun.casefold():
                return f"column {head!r} has no unit; write {allowed}"
            if plain.startswith(f"{noun.casefold()}_"):
                unit = plain[len(noun) + 1 :]
                return f"column {head!r}: the unit {unit!r} is not known here; write {allowed}"
        joints, others = ", ".join(self._joints), ", ".join(self._others)
        return f"column {head!r} is not known; known are {joints}, or x_mm, y_mm, z_mm, also {others}"


def parse_cell(text: str, column: Column, *, comma: bool) -> float | int | str:
    """The value of a cell that is not empty.

    Args:
        text: what it holds.
        column: which says the unit.
        comma: the decimal point may be written as a comma.

    Raises:
        ProgramError: not a number, or not finite.
    """
    if column.factor is None and not column.integer:
        return text if column.key == "note" else text.strip()
    plain = text.strip().replace("−", "-")
    if column.integer:
        if _WHOLE_TEXT.fullmatch(plain) is None:
            raise ProgramError(f"{plain[:40]!r} is not a whole number")
        return int(plain)
    if comma and plain.count(",") == 1 and "." not in plain:
        plain = plain.replace(",", ".")
    if _NUMBER_TEXT.fullmatch(plain) is None:
        raise ProgramError(f"{plain[:40]!r} is not a number{_hint(plain, comma)}")
    value = float(plain) * (1.0 if column.factor is None else column.factor)
    if not math.isfinite(value):
        raise ProgramError(f"{plain[:40]!r} is too large")
    return value


def _hint(plain: str, comma: bool) -> str:
    if "," in plain and not comma:
        return "; with decimal commas, separate the columns by semicolons"
    return "; write it without thousands separators and units" if plain[:1].isdigit() else ""


# Text in a CSV cell that no spreadsheet may take for a formula.

_BEGINS_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")
_MARK = "'"


def guarded(text: str) -> str:
    """``text`` with an apostrophe before what would begin a formula; ``unguarded`` takes it off again."""
    return _MARK + text if text.startswith((*_BEGINS_FORMULA, _MARK)) else text


def unguarded(text: str) -> str:
    """The text of a cell; an apostrophe that guards nothing stays."""
    rest = text.removeprefix(_MARK)
    return rest if text != rest and rest.startswith((*_BEGINS_FORMULA, _MARK)) else text


_DELIMITERS = (",", ";", "\t")
_SEPARATOR_LINE = re.compile(r"sep=(.)\r?\n", re.IGNORECASE)
_POINT = ("x_mm", "y_mm", "z_mm")
_EXTRA = {"open_percent": "gripper", "seconds": "wait"}
"""what a row without ``do`` may ask for behind its motion, and the kind of step that does it"""


def read_csv(text: bytes | str, robot: Robot, name: str = "untitled") -> Program:
    """A program from a CSV file.

    A row with a ``do`` is one step of that kind. A row without goes to its angles, or to its point; then
    it sets the gripper and waits, where those columns say so. Columns may be separated by commas,
    semicolons or tabs; with the latter two, numbers may have decimal commas.

    Args:
        text: the file.
        robot: whose joints the heads name.
        name: of the program; the file does not hold it.

    Raises:
        ProgramError: an unknown column, a missing or unknown unit, a cell that is missing or no number, a
            value that is not allowed; names the line and the column.
    """
    plain, delimiter = _opened(text)
    table = _Table.of(plain, delimiter, Columns(robot.joint_names), robot.n)
    steps: list[Step] = []
    lines: list[int] = []
    for line, cells in table.rows():
        for step in _steps_of(line, cells, table):
            steps.append(step)
            lines.append(line)
    if not steps:
        raise ProgramError("the file has no rows below its head")
    if len(steps) > MOST_STEPS:
        raise ProgramError(f"it has {len(steps)} steps; a program has {MOST_STEPS} at most")
    for index, what in Blocks.of(steps).findings:
        raise ProgramError(f"line {lines[index]}: {what}")
    return Program(robot=robot.name, name=name, steps=tuple(steps))


Cell = float | int | str


@dataclass
class _Table:
    delimiter: str
    columns: list[Column | None]
    """None: a column without a head"""
    joints: int
    known: Columns
    _reader: Iterator[tuple[int, list[str]]]
    by_key: dict[tuple[str, int | None], Column] = field(default_factory=dict[tuple[str, int | None], Column])

    @classmethod
    def of(cls, text: str, delimiter: str | None, known: Columns, joints: int) -> _Table:
        delimiter = delimiter or _delimiter(text, known)
        reader = _records(text, delimiter)
        try:
            line, heads = next((line, cells) for line, cells in reader if any(map(str.strip, cells)))
        except StopIteration as cause:
            raise ProgramError("the file is empty") from cause
        try:
            columns = [known.known(unguarded(head)) if head.strip() else None for head in heads]
        except ProgramError as refusal:
            raise ProgramError(f"line {line}, {refusal}") from refusal
        table = cls(delimiter, columns, joints, known, reader)
        for column in columns:
            if column is None or not column.key:
                continue
            place = (column.key, column.joint)
            if place in table.by_key:
                raise ProgramError(
                    f"line {line}, column {column.head!r} says the same as "
                    f"{table.by_key[place].head!r}; keep one of them"
                )
            table.by_key[place] = column
        table._require_whole(line)
        return table

    def rows(self) -> Iterator[tuple[int, dict[Column, Cell]]]:
        """(line, what its cells hold) of each row that is not empty."""
        comma = self.delimiter != ","
        for line, cells in self._reader:
            values: dict[Column, Cell] = {}
            for i, text in enumerate(cells):
                column = self.columns[i] if i < len(self.columns) else None
                if column is None:
                    if text.strip():
                        raise ProgramError(
                            f"line {line}: {text.strip()[:40]!r} stands in a column without a head"
                        )
                    continue
                text = unguarded(text) if column.factor is None else text
                if not column.key or not (text if column.key == "note" else text.strip()):
                    continue
                try:
                    values[column] = parse_cell(text, column, comma=comma)
                except ProgramError as refusal:
                    raise ProgramError(f"line {line}, column {column.head}: {refusal}") from refusal
            if values:
                yield line, values

    def head(self, key: str, joint: int | None = None) -> str:
        """The head under which a step's key stands, or would stand."""
        column = self.by_key.get((key, joint))
        return self.known.head(key, joint) if column is None else column.head

    def _require_whole(self, line: int) -> None:
        """Columns that mean something together only must be there together."""
        joints = [(JOINTS, i) for i in range(self.joints)]
        for group in (joints, [(key, None) for key in _POINT]):
            missing = [place for place in group if place not in self.by_key]
            if missing and len(missing) < len(group):
                raise ProgramError(f"line {line}: the column {self.head(*missing[0])} is missing")
        if not any(place in self.by_key for place in (*joints, (_POINT[0], None), ("do", None))):
            angles = f"the joints' angles ({self.head(JOINTS, 0)} …)"
            raise ProgramError(f"line {line}: neither {angles} nor a point (x_mm, y_mm, z_mm), nor 'do'")


def _steps_of(line: int, cells: dict[Column, Cell], table: _Table) -> Iterator[Step]:
    record: dict[str, object] = {column.key: value for column, value in cells.items() if column.joint is None}
    angles = {column.joint: value for column, value in cells.items() if column.joint is not None}
    if angles:
        for joint in range(table.joints):
            if joint not in angles:
                raise ProgramError(f"line {line}, column {table.head(JOINTS, joint)}: the cell is empty")
        record[JOINTS] = tuple(angles[joint] for joint in range(table.joints))
    if "do" in record:
        yield _step(line, record, table)
        return
    has_point = any(key in record for key in _POINT)
    if angles and has_point:
        what = "both angles and a point; leave one of them empty, or say by 'do' which"
        raise ProgramError(f"line {line}: {what}")
    extras = {kind: {key: record.pop(key)} for key, kind in _EXTRA.items() if key in record}
    if angles or has_point:
        yield _step(line, {"do": "move" if angles else "point", **record}, table)
        record = {}
    elif not extras:
        if set(record) == {"note"}:
            yield _step(line, {"do": "comment", **record}, table)
            return
        raise ProgramError(f"line {line}: nothing says what to do; fill in the angles, the point, or 'do'")
    for kind, extra in extras.items():
        yield _step(line, {"do": kind, **extra, **record}, table)
        record = {}


def _step(line: int, record: dict[str, object], table: _Table) -> Step:
    try:
        return msgspec.convert(record, any_step())
    except msgspec.ValidationError as cause:
        refusal = refusal_of(cause, record, any_step())
        place, what = f"line {line}", refusal.what
        if refusal.key is not None:
            joint = 0 if refusal.key == JOINTS else None
            place += f", column {table.head(refusal.key, joint)}"
            missing = refusal.key not in record
            what = "the cell is empty" if missing else f"a {str(record['do'])!r} step has no such thing"
        elif refusal.place:
            place += f", column {table.head(str(refusal.place[0]))}"
        raise ProgramError(f"{place}: {what}") from cause


def _opened(text: bytes | str) -> tuple[str, str | None]:
    """The text, and the delimiter if a first line names it, as Excel's may."""
    plain = PROGRAM_FILES.text(text)
    match = _SEPARATOR_LINE.match(plain)
    if match is None:
        return plain, None
    # An empty line in its place: the others keep their numbers.
    return "\n" + plain[match.end() :], match.group(1)


def _delimiter(text: str, known: Columns) -> str:
    """What splits the head into the most columns that are known."""
    head = next((line for line in text.splitlines() if line.strip()), "")

    def score(delimiter: str) -> tuple[int, int]:
        cells = [cell for row in csv.reader([head], delimiter=delimiter) for cell in row]
        return sum(known.find(unguarded(cell)) is not None for cell in cells), len(cells)

    return max(_DELIMITERS, key=score)


def _records(text: str, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """(line on which it begins, cells) of each record."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    while True:
        line = reader.line_num + 1
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as cause:
            raise ProgramError(f"line {line}: cannot be split into cells: {cause}") from cause
        yield line, cells


# Programs for spreadsheets: one row a step, every number with its unit in the head.

CsvForm = Literal["angles", "points"]
"""angles: every step as it is; points: moves to angles become points of the tool"""
_DIGITS = 6


def write_csv(program: Program, robot: Robot, form: CsvForm = "angles") -> str:
    """The program as CSV; ``read_csv`` gives the same steps again.

    With ``points``, a move is written as the point (with tool pitch and roll, where the arm has them) to
    which its angles lead. Which of the solutions the arm takes there is then chosen when it is run.

    Args:
        program: what to write; its name is not in the file.
        robot: names the columns.
        form: how moves are written.

    Raises:
        ProgramError: a move has another number of angles than the arm has joints; names the step.
    """
    for index, step in enumerate(program.steps):
        if isinstance(step, MoveStep) and len(step.joints_deg) != robot.n:
            raise ProgramError(
                f"step {index + 1}: {robot.name} has {robot.n} joints, "
                f"the step has {len(step.joints_deg)} angles"
            )
    steps = _as_points(program.steps, robot) if form == "points" else program.steps
    records = [_cells(step) for step in steps]
    used = {place for record in records for place in record} | {("do", None)}
    if not steps:
        used |= {(JOINTS, i) for i in range(robot.n)}
    columns = [column for column in Columns(robot.joint_names).written if (column.key, column.joint) in used]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\r\n")
    writer.writerow([NUMBER, *(guarded(column.head) for column in columns)])
    for number, record in enumerate(records, 1):
        writer.writerow([number, *(record.get((column.key, column.joint), "") for column in columns)])
    return out.getvalue()


def _cells(step: Step) -> dict[tuple[str, int | None], object]:
    """(key, joint) to what its cell holds; what is as by default is left out."""
    cells: dict[tuple[str, int | None], object] = {("do", None): step.kind}
    for key, default in defaults_of(type(step)).items():
        value = getattr(step, key)
        if key == JOINTS:
            cells |= {(JOINTS, i): angle for i, angle in enumerate(value)}
        elif value is not None and value != default:
            cells[key, None] = guarded(value) if isinstance(value, str) else value
    return cells


def _as_points(steps: tuple[Step, ...], robot: Robot) -> list[Step]:
    """The steps with moves led through forward kinematics."""
    moves = [step for step in steps if isinstance(step, MoveStep)]
    if not moves:
        return list(steps)
    q = np.radians([step.joints_deg for step in moves])
    points = np.round(1000 * robot.forward(q)[:, :3, 3], _DIGITS)
    found = (_as_point(step, robot, q[i], points[i]) for i, step in enumerate(moves))
    return [next(found) if isinstance(step, MoveStep) else step for step in steps]


def _as_point(step: MoveStep, robot: Robot, q: FloatArray, point_mm: FloatArray) -> PointStep:
    pitch, roll = (
        None if angle is None else round(float(np.degrees(angle)), _DIGITS)
        for angle in robot.inverse_kinematics.pitch_and_roll(q)
    )
    x, y, z = point_mm.tolist()
    return PointStep(
        x_mm=x,
        y_mm=y,
        z_mm=z,
        pitch_deg=pitch,
        roll_deg=roll,
        profile=step.profile,
        duration_s=step.duration_s,
        blend_mm=step.blend_mm,
        note=step.note,
    )
