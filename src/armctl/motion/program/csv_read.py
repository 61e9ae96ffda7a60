"""Programs from spreadsheets: a head with units decides what the columns mean."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import msgspec

from armctl.errors import ProgramError
from armctl.motion.program.blocks import block_findings
from armctl.motion.program.csv_columns import JOINTS, Column, Columns, head_of, joint_noun, parse_cell
from armctl.motion.program.csv_text import unguarded
from armctl.motion.program.program import Program, Step
from armctl.motion.program.text import plain_text
from armctl.motion.program.wording import refusal_of
from armctl.robot import Robot

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
    columns = Columns(robot.joint_names)
    table = _Table.of(plain, delimiter, columns, robot.joint_names)
    steps: list[Step] = []
    lines: list[int] = []
    for line, cells in table.rows():
        for step in _steps_of(line, cells, table):
            steps.append(step)
            lines.append(line)
    if not steps:
        raise ProgramError("the file has no rows below its head")
    program = Program(robot=robot.name, name=name, steps=tuple(steps))
    for index, what in block_findings(program):
        raise ProgramError(f"line {lines[index]}: {what}")
    return program


Cell = float | int | str


@dataclass
class _Table:
    delimiter: str
    columns: list[Column | None]
    """None: a column without a head"""
    joints: Sequence[str]
    _reader: Iterator[tuple[int, list[str]]]
    by_key: dict[tuple[str, int | None], Column] = field(default_factory=dict[tuple[str, int | None], Column])

    @classmethod
    def of(cls, text: str, delimiter: str | None, known: Columns, joints: Sequence[str]) -> _Table:
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
        table = cls(delimiter, columns, joints, reader)
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
        if column is not None:
            return column.head
        return head_of(key) if joint is None else f"{joint_noun(self.joints[joint])}_deg"

    def _require_whole(self, line: int) -> None:
        """Columns that mean something together only must be there together."""
        joints = [(JOINTS, i) for i in range(len(self.joints))]
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
        for joint in range(len(table.joints)):
            if joint not in angles:
                raise ProgramError(f"line {line}, column {table.head(JOINTS, joint)}: the cell is empty")
        record[JOINTS] = tuple(angles[joint] for joint in range(len(table.joints)))
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
        return msgspec.convert(record, Step)
    except msgspec.ValidationError as cause:
        refusal = refusal_of(cause, record)
        place, what = f"line {line}", refusal.what
        if refusal.key is not None:
            joint = 0 if refusal.key == JOINTS else None
            place += f", column {table.head(refusal.key, joint)}"
            missing = refusal.key not in record
            what = "the cell is empty" if missing else f"a {str(record['do'])!r} step has no such thing"
        elif refusal.where:
            place += f", column {table.head(refusal.where)}"
        raise ProgramError(f"{place}: {what}") from cause


def _opened(text: bytes | str) -> tuple[str, str | None]:
    """The text, and the delimiter if a first line names it, as Excel's may."""
    plain = plain_text(text)
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
