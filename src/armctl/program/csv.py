"""Programs for spreadsheets: one row a step; a head with units decides what a column means."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Literal, TypeVar, cast

import msgspec
import numpy as np

from armctl.decoding import MOST_REFUSALS, Decoder, Refusal
from armctl.errors import Errors, ProgramError
from armctl.program.base_steps import Step, keys_of
from armctl.program.csv_columns import (
    DO,
    JOINTS,
    NUMBER,
    POINT,
    TIME,
    UNITS,
    Cell,
    Column,
    Columns,
    guarded,
    unguarded,
)
from armctl.program.frames import FrameStep, Placing, UserFrame
from armctl.program.motion_steps import MoveStep, PointStep, tool_turn
from armctl.program.program import MOST_STEPS, PROGRAM_FILES, Blocks, Program
from armctl.program.standing_steps import EDGES
from armctl.program.steps import CommentStep, any_step
from armctl.robot import Robot

T = TypeVar("T")
CsvForm = Literal["angles", "points"]
"""angles: every step as it is; points: moves to angles become points of the tool"""
_EXTRA = {"gripper": ("open_percent", *EDGES), "wait": ("seconds",)}
"""kinds of steps that a row without ``do`` may ask for behind its motion, and their keys: the first asks"""
_COMMENTS = ("#", "%", "//")
_NEAR, _FAR = 0.05, 1.05
"""shares of the arm's length between which the farthest point of a program lies"""
_LOOKED_AT = 8
"""points of a program of which the arm reaches one"""
_DIGITS = 6
_DELIMITERS = (",", ";", "\t")
_SEPARATOR_LINE = re.compile(r"sep=(.)\r?\n", re.IGNORECASE)


def write_csv(program: Program, robot: Robot, form: CsvForm = "angles") -> str:
    """The program as CSV; ``points``: moves become points, whose solution is chosen when they are run.

    The first row that chooses a user frame says where it is, too.
    """
    steps = list(program.steps)
    placing = Placing(steps, program.frames)
    for index, step in enumerate(steps):
        if isinstance(step, MoveStep):
            if len(step.joints_deg) != robot.n:
                raise ProgramError(
                    f"step {index + 1}: {robot.name} has {robot.n} joints, "
                    f"the step has {len(step.joints_deg)} angles"
                )
            if form == "points":
                steps[index] = placing.given(index, _as_point(step, robot))
    frames = dict(program.frames)
    records = [_cells(step, frames) for step in steps]
    used = {place for record in records for place in record} | {(DO, None)}
    if not steps:
        used |= {(JOINTS, i) for i in range(robot.n)}
    columns = [column for column in Columns(robot.joint_names).written if column.place in used]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\r\n")
    writer.writerow([NUMBER, *(guarded(column.head) for column in columns)])
    for number, record in enumerate(records, 1):
        writer.writerow([number, *(record.get(column.place, "") for column in columns)])
    return out.getvalue()


def _cells(step: Step, frames: dict[str, UserFrame]) -> dict[Cell | None, object]:
    """``frames``: those that no row has told of yet; what is told is taken out."""
    cells: dict[Cell | None, object] = {(DO, None): step.kind}
    if isinstance(step, FrameStep) and (frame := frames.pop(step.frame, None)) is not None:
        cells |= {(key, None): value for key, value in msgspec.structs.asdict(frame).items()}
    for key in keys_of(type(step)):
        value = getattr(step, key.name)
        if key.name == JOINTS:
            cells |= {(JOINTS, i): angle for i, angle in enumerate(value)}
        elif value is not None and value != key.default:
            text = " ".join(map(repr, value)) if key.form == "numbers" else value
            cells[key.name, None] = guarded(text) if isinstance(text, str) else text
    return cells


def _as_point(step: MoveStep, robot: Robot) -> PointStep:
    q = robot.read(step.joints_deg)
    x, y, z = np.round(1000 * robot.forward(q)[:3, 3], _DIGITS).tolist()
    shared = {key: getattr(step, key) for key in ("profile", "duration_s", "blend_mm", "note")}
    return PointStep(x_mm=x, y_mm=y, z_mm=z, **tool_turn(robot, q), **shared)


def read_csv(text: bytes | str, robot: Robot, name: str = "untitled") -> Program:
    """A program called ``name`` from the text of a CSV file, whose heads name the joints of ``robot``.

    A row with a ``do`` is one step of that kind. A row without goes to its angles, or to its point; then
    it sets the gripper and waits, where those columns say so. Columns may be separated by commas,
    semicolons or tabs; with the latter two, numbers may have decimal commas. Lines that begin with # are
    comments; those ahead of the head are left out. A column of times says when each row is reached. Points
    and angles without a unit are read where the arm leaves one unit that is possible; the first step says so.
    A ProgramError names the line and the column.
    """
    table = _Table(PROGRAM_FILES.text(text), robot)
    found: list[tuple[int, Step]] = []
    errors = Errors()
    for line, cells in table.rows(errors):
        with errors:
            found += [(line, step) for step in table.steps(line, cells)]
        if len(errors.found) >= MOST_REFUSALS:
            break
        if len(found) > MOST_STEPS:
            raise ProgramError(f"line {line}: a program has {MOST_STEPS} steps at most")
    errors.raise_all()
    steps = tuple(step for _, step in found)
    if table.told:
        steps = (CommentStep(note="; ".join(table.told)), *steps)
    if not found:
        raise ProgramError("the file has no rows below its head")
    for index, why in Blocks.of(steps).findings:
        raise ProgramError(why).about(f"line {found[index][0]}")
    return Program(robot=robot.name, name=name, frames=table.frames, steps=steps)


class _Table:
    def __init__(self, text: str, robot: Robot) -> None:
        self._known = Columns(robot.joint_names)
        self._joints: list[Cell] = [(JOINTS, i) for i in range(robot.n)]
        delimiter: str | None = None
        if match := _SEPARATOR_LINE.match(text):  # Excel's; an empty line in its place keeps the numbers
            text, delimiter = "\n" + text[match.end() :], match[1]
        text = self._without_comments(text)
        self._delimiter = delimiter or self._best_delimiter(text)
        self._records = _records(text, self._delimiter)
        filled = (found for found in self._records if any(map(str.strip, found[1])))
        line, heads = next(filled, (0, list[str]()))
        if not heads:
            raise ProgramError("the file is empty")
        self._columns = [self._known.find(head) if head.strip() else None for head in map(unguarded, heads)]
        """None: a column without a head"""
        self._before: float | None = None
        """when the row before is reached [s]"""
        self.told: list[str] = []
        """what was read from heads that do not say it"""
        self.frames: dict[str, UserFrame] = {}
        """that rows tell of"""
        self._read_without_units(list(map(unguarded, heads)), robot)
        for head, column in zip(map(unguarded, heads), self._columns, strict=True):
            if column is None and head.strip():
                raise ProgramError(f"line {line}, {self._known.why_not(head.strip())}")
        self._by_place: dict[Cell | None, Column] = {}
        for column in filter(None, self._columns):
            if (same := self._by_place.get(column.place)) is not None:
                what = f"column {column.head!r} says the same as {same.head!r}; keep one of them"
                raise ProgramError(f"line {line}, {what}")
            if column.place is not None:
                self._by_place[column.place] = column
        timed, lasting = self._by_place.get(TIME), self._by_place.get(("duration_s", None))
        if timed is not None and lasting is not None:
            what = f"column {timed.head!r} says when a row is reached, {lasting.head!r} how long it takes"
            raise ProgramError(f"line {line}, {what}; keep one of them")
        self._require_whole(line)

    def _without_comments(self, text: str) -> str:
        """The text with comments ahead of the head emptied; a head behind such a sign is laid open."""
        lines = text.splitlines(keepends=True)
        for k, line in enumerate(lines):
            plain = line.strip().lstrip("\ufeff")
            sign = next((sign for sign in _COMMENTS if plain.startswith(sign)), None)
            if plain and (sign is None or plain[len(sign) :].startswith(_DELIMITERS)):
                break  # the head, perhaps with # for the running number
            if sign is not None:
                behind = plain[len(sign) :].strip()
                cells = re.split(r"[,;\t]", behind)
                if all(self._known.find(cell) is not None for cell in cells):
                    lines[k] = behind + "\n"
                    break
                lines[k] = "\n"
        return "".join(lines)

    def _read_without_units(self, heads: Sequence[str], robot: Robot) -> None:
        """Points and angles whose heads have no unit, where the arm leaves one that is possible."""
        lacking = [k for k, head in enumerate(heads) if head.strip() and self._columns[k] is None]
        if not lacking:
            return
        records = list(self._records)
        self._records = iter(records)
        size = 1000 * robot.chain.length
        for units in UNITS[1:3]:
            possible: list[tuple[str, dict[int, Column]]] = []
            for unit in units:
                columns = {
                    k: found for k in lacking if (found := self._known.find(f"{heads[k].strip()}_{unit}"))
                }
                rows = [self._numbers(cells, columns) for _, cells in records]
                if columns and self._is_possible([row for row in rows if row], robot, size):
                    possible.append((unit, columns))
            if len(possible) == 1:
                unit, columns = possible[0]
                for k, column in columns.items():
                    self._columns[k] = column
                names = ", ".join(heads[k].strip() for k in columns)
                self.told.append(f"{names}: read in {unit}, the only unit that fits the arm")

    def _numbers(self, cells: Sequence[str], columns: Mapping[int, Column]) -> dict[Cell, float]:
        """The numbers of a row in the units of steps; what is none is left out."""
        found: dict[Cell, float] = {}
        for k, column in columns.items():
            if k < len(cells) and cells[k].strip() and column.place is not None:
                with suppress(ProgramError):
                    value = column.value(cells[k], comma=self._delimiter != ",")
                    if not isinstance(value, list):
                        found[column.place] = float(value)
        return found

    def _is_possible(self, rows: Sequence[Mapping[Cell, float]], robot: Robot, size: float) -> bool:
        """Whether an arm of this size [mm] could be meant by points [mm] or angles [degrees]."""
        if not rows:
            return False
        angles = [(joint, value) for row in rows for (key, joint), value in row.items() if key == JOINTS]
        if angles:
            limits = robot.shown(robot.limits.T).T
            return all(limits[j, 0] - 1e-6 <= value <= limits[j, 1] + 1e-6 for j, value in angles)
        if not all((key, None) in rows[0] for key in POINT):
            return False
        points = np.array([[row.get((key, None), 0.0) for key in POINT] for row in rows])
        if not _NEAR * size <= np.linalg.norm(points, axis=1).max() <= _FAR * size:
            return False
        some = points[:: len(points) // _LOOKED_AT + 1] / 1000
        return any(robot.inverse(point).success for point in some)

    def rows(self, errors: Errors) -> Iterator[tuple[int, dict[Cell, float | int | str | list[float]]]]:
        """(line, what its cells hold) of each row that is not empty; ``errors`` takes what is wrong."""
        for line, cells in self._records:
            values: dict[Cell, float | int | str | list[float]] = {}
            before = len(errors.found)
            sign = next((sign for sign in _COMMENTS if cells and cells[0].lstrip().startswith(sign)), None)
            if sign is not None and not (self._columns[0] and self._columns[0].place == ("note", None)):
                note = self._delimiter.join(cells).strip().removeprefix(sign).strip().rstrip(self._delimiter)
                yield line, {(DO, None): "comment", ("note", None): note}
                continue
            for i, text in enumerate(cells):
                with errors:
                    values |= self._cell(line, self._columns[i] if i < len(self._columns) else None, text)
            if values and len(errors.found) == before:
                yield line, values

    def _cell(
        self, line: int, column: Column | None, text: str
    ) -> dict[Cell, float | int | str | list[float]]:
        if column is None:
            if text.strip():
                what = f"{text.strip()[:40]!r} stands in a column without a head"
                raise ProgramError(f"line {line}: {what}")
            return {}
        text = unguarded(text) if column.factor is None else text
        if column.place is None or not (text if column.place == ("note", None) else text.strip()):
            return {}
        try:
            return {column.place: column.value(text, comma=self._delimiter != ",")}
        except ProgramError as refusal:
            raise ProgramError(f"line {line}, column {column.head}: {refusal}") from refusal

    def steps(self, line: int, cells: dict[Cell, float | int | str | list[float]]) -> Iterator[Step]:
        """The steps that a row asks for."""
        record: dict[str, object] = {key: value for (key, joint), value in cells.items() if joint is None}
        has_angles = any(place in cells for place in self._joints)
        if TIME[0] in record:
            self._take_time(line, record)
        if has_angles:
            for place in self._joints:
                if place not in cells:
                    raise ProgramError(f"line {line}, column {self._head(place)}: the cell is empty")
            record[JOINTS] = tuple(cells[place] for place in self._joints)
        if DO in record:
            if record[DO] == "frame" and POINT[0] in record:
                frame = {key: record.pop(key) for key in UserFrame.__struct_fields__ if key in record}
                self.frames[str(record.get("frame", ""))] = self._converted(line, frame, UserFrame)
            yield self._step(line, record)
            return
        has_point = any(key in record for key in POINT)
        if has_angles and has_point:
            what = "both angles and a point; leave one of them empty, or say by 'do' which"
            raise ProgramError(f"line {line}: {what}")
        extras = [
            {DO: kind, **{key: record.pop(key) for key in keys if key in record}}
            for kind, keys in _EXTRA.items()
            if keys[0] in record
        ]
        if has_angles or has_point:
            extras.insert(0, {DO: "move" if has_angles else "point"})
        elif not extras and set(record) == {"note"}:
            extras.append({DO: "comment"})
        if not extras:
            what = "nothing says what to do; fill in the angles, the point, or 'do'"
            raise ProgramError(f"line {line}: {what}")
        for extra in extras:  # the first step takes what else the row says
            yield self._step(line, {**extra, **record})
            record = {}

    def _take_time(self, line: int, record: dict[str, object]) -> None:
        """Make the time at which a row is reached the duration of its motion."""
        time, before = float(cast("float", record.pop(TIME[0]))), self._before
        self._before = time + float(cast("float", record.get("seconds", 0.0)))
        if before is None:
            return  # from wherever the arm stands
        if time <= before:
            column = self._by_place[TIME].head
            raise ProgramError(
                f"line {line}, column {column}: {time:g} s is not after the {before:g} s before"
            )
        record["duration_s"] = round(time - before, _DIGITS)

    def _step(self, line: int, record: dict[str, object]) -> Step:
        return self._converted(line, record, cast("type[Step]", any_step()))

    def _converted(self, line: int, record: dict[str, object], model: type[T]) -> T:
        try:
            return msgspec.convert(record, model)
        except msgspec.ValidationError:
            decoder, errors = Decoder(), Errors()
            step = decoder.decoded(record, model)
            for refusal in decoder.refusals:
                errors.found.append(self._refused(line, record, refusal))
            errors.raise_all()
            return step

    def _refused(self, line: int, record: dict[str, object], refusal: Refusal) -> ProgramError:
        key, what = refusal.key, refusal.what
        if key is not None:
            what = (
                f"a {str(record.get(DO, 'frame'))!r} step has no such thing"
                if key in record
                else "the cell is empty"
            )
        elif refusal.place:
            key = str(refusal.place[0])
        column = "" if key is None else f", column {self._head((key, 0 if key == JOINTS else None))}"
        return ProgramError(f"line {line}{column}: {what}")

    def _head(self, place: Cell) -> str:
        columns = (*self._by_place.values(), *self._known.written)
        return next(column.head for column in columns if column.place == place)

    def _require_whole(self, line: int) -> None:
        """Columns that mean something together only must be there together."""
        for group in (self._joints, [(key, None) for key in POINT]):
            missing = [place for place in group if place not in self._by_place]
            if missing and len(missing) < len(group):
                raise ProgramError(f"line {line}: the column {self._head(missing[0])} is missing")
        if not any(place in self._by_place for place in (*self._joints, (POINT[0], None), (DO, None))):
            angles = f"the joints' angles ({self._head((JOINTS, 0))} …)"
            raise ProgramError(f"line {line}: neither {angles} nor a point (x_mm, y_mm, z_mm), nor 'do'")

    def _best_delimiter(self, text: str) -> str:
        """What splits the head into the most columns that are known."""
        head = next((line for line in text.splitlines() if line.strip()), "")

        def score(delimiter: str) -> tuple[int, int]:
            try:
                cells = [cell for row in csv.reader([head], delimiter=delimiter) for cell in row]
            except csv.Error:  # a cell that is too large, which reading the rows refuses
                return 0, 0
            return sum(self._known.find(unguarded(cell)) is not None for cell in cells), len(cells)

        return max(_DELIMITERS, key=score)


def _records(text: str, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """(line on which it begins, cells) of each record."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    line = 1
    try:
        for cells in reader:
            yield line, cells
            line = reader.line_num + 1
    except csv.Error as cause:
        raise ProgramError(f"line {line}: cannot be split into cells: {cause}") from cause
