"""Editing a program: each function gives a new program."""

from __future__ import annotations

import re

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import InputError, ProgramError
from armctl.program.base_steps import BlockStep, Step, keys_of
from armctl.program.frames import BASE, MOST_FRAMES, NAME_OF_FRAME, FrameStep, Placing, UserFrame
from armctl.program.logic_steps import EndStep
from armctl.program.program import Blocks, Program

# Rows: and the index of the row to select.

PLACES: tuple[str, ...] = (
    "at the end",
    "before the selected row",
    "after the selected row",
    "in place of the selected row",
)
Change = tuple[Program, int]
_DIGITS = 3
"""of a place: micrometres"""
_RANGE = re.compile(r"\s*(\d{1,6})\s*(?:(?:-|–|…|to)\s*(\d{1,6})\s*)?")


def add(program: Program, step: Step, where: str, selected: int) -> Change:
    """A step goes to one of the ``PLACES``; several put before or after the selected row keep their order.

    One that begins a block brings its end. Its points are in the base frame; in the list they are given in
    the user frame that counts there.
    """
    count = len(program.steps)
    spans = ((count, 0), (selected, 0), (selected + 1, 0), (selected, 1))
    at, removed = dict(zip(PLACES, spans, strict=True))[where] if count else (0, 0)
    ends = (EndStep(),) if isinstance(step, BlockStep) else ()
    row = at + 1 + len(ends) if where == PLACES[1] and count else at
    changed = _spliced(program, at, removed, (step, *ends))
    if program.frames:
        step = Placing(changed.steps, program.frames).given(at, step)
    return _spliced(program, at, removed, (step, *ends)), row


def point_in(program: Program, row: int, point_mm: ArrayLike) -> tuple[float, float, float]:
    """X, Y, Z in the base frame as the step in a row has to give them, to a micrometre [mm].

    In the user frame that counts there; of a step in a cell from the first cell of the grid around it.
    """
    T = Placing(program.steps, program.frames).matrix(row)
    point = np.asarray(point_mm, dtype=np.float64)
    if T is not None:
        point = np.linalg.solve(T, np.append(point, 1.0))[:3]
    grid = grid_around(program, row) if program.steps[row].in_cell else None
    if grid is not None:
        point = point - np.asarray(grid.cell(0))
    x, y, z = (np.round(point, _DIGITS) + 0.0).tolist()
    return x, y, z


def _point_out(program: Program, row: int, point_mm: ArrayLike) -> FloatArray:
    """(3,) The reverse of ``point_in``."""
    T = Placing(program.steps, program.frames).matrix(row)
    grid = grid_around(program, row) if program.steps[row].in_cell else None
    point = np.asarray(point_mm) + (0.0 if grid is None else np.asarray(grid.cell(0)))
    return point if T is None else T[:3, :3] @ point + T[:3, 3]


def grid_around(program: Program, row: int) -> BlockStep | None:
    """The innermost block around a row that has cells; None: there is none."""
    found: BlockStep | None = None
    for begin, end in Blocks.of(program.steps).partners.items():
        block = program.steps[begin]
        if begin < row <= end and isinstance(block, BlockStep) and block.cell(0) is not None:
            found = block  # an outer one begins, and is found, before an inner one
    return found


def places_of(step: Step) -> dict[str, tuple[str, ...]]:
    """The labels of the fields of a step that are a place, and the keys of its X, Y and Z."""
    found: dict[str, tuple[str, ...]] = {}
    for key in keys_of(type(step)):
        if key.field.touched:
            found[key.field.label] = (*found.get(key.field.label, ()), key.name)
    return found


def replace(program: Program, row: int, step: Step) -> Change:
    """``step`` instead of the one in a row.

    If that puts its points into a cell, or out of it, they stay where they are in the first cell.
    """
    before, changed = program.steps[row], _spliced(program, row, 1, (step,))
    grid = grid_around(program, row)
    if grid is None or step.in_cell == before.in_cell:
        return changed, row
    same = {
        key: value
        for keys in places_of(step).values()
        if [getattr(step, key) for key in keys] == [getattr(before, key, None) for key in keys]
        for key, value in zip(
            keys,
            point_in(changed, row, _point_out(program, row, [getattr(step, key) for key in keys])),
            strict=True,
        )
    }
    return _spliced(program, row, 1, (msgspec.structs.replace(step, **same),)), row


def delete(program: Program, row: int) -> Change:
    """Without a row; a marker of a block takes the others with it, and leaves what is in the block.

    What is behind ``else`` goes with any of them: two branches never become one after the other. The next row
    is selected, or the last.
    """
    _require_row(program, row)
    blocks = Blocks.of(program.steps)
    first, last = blocks.whole(row)
    gone = {first, last, *range(blocks.elses.get(first, last), last)}
    if program.steps[row].divides:
        gone = set(range(row, last)) or {row}
    steps = tuple(step for i, step in enumerate(program.steps) if i not in gone)
    selected = sum(i not in gone for i in range(row))
    return _with(program, steps), max(min(selected, len(steps) - 1), 0)


def move(program: Program, row: int, by: int) -> Change:
    """A row up (-1) or down (+1); a ProgramError where it is the first or the last already.

    What begins a block goes with all of it; its ``end`` goes alone, so that the block grows or shrinks.
    """
    first, last = _moved_rows(program, row)
    to = first + by if by < 0 else last + 1 + by
    if not 0 <= to <= len(program.steps):
        raise ProgramError(f"row {row + 1} is the {'first' if by < 0 else 'last'} one already")
    return move_before(program, row, to)


def move_before(program: Program, row: int, to: int) -> Change:
    """A row, or what ``move`` takes with it, goes before the row ``to``; at the end: their number."""
    first, last = _moved_rows(program, row)
    if first < to <= last:
        raise ProgramError("a block cannot go into itself")
    steps = program.steps
    taken, rest = steps[first : last + 1], (*steps[:first], *steps[last + 1 :])
    at = to if to <= first else to - len(taken)
    return _with(program, (*rest[:at], *taken, *rest[at:])), at


def _moved_rows(program: Program, row: int) -> tuple[int, int]:
    _require_row(program, row)
    if isinstance(program.steps[row], BlockStep):
        return Blocks.of(program.steps).whole(row)
    return row, row


def duplicate(program: Program, row: int) -> Change:
    """A copy of a row behind it, or of the whole block that it begins or ends; the copy is selected.

    Its steps are objects of their own, so that they can be told from those that were copied.
    """
    _require_row(program, row)
    first, last = Blocks.of(program.steps).whole(row)
    copied = tuple(msgspec.structs.replace(step) for step in program.steps[first : last + 1])
    return _spliced(program, last + 1, 0, copied), row + len(copied)


def surround(program: Program, block: BlockStep, rows: str, selected: int) -> Change:
    """The rows of a range, e.g. ``2-5``, in a block; empty: the selected row."""
    first = last = selected
    if rows.strip():
        match = _RANGE.fullmatch(rows)
        if match is None:
            raise InputError(f"rows inside: {rows.strip()[:40]!r} is no range of rows; write e.g. 2-5")
        first, last = int(match[1]) - 1, int(match[2] or match[1]) - 1
    for row in (selected, first, last):
        _require_row(program, row)
    if last < first:
        raise ProgramError(f"a block cannot go from step {first + 1} back to step {last + 1}")
    blocks = Blocks.matched(program.steps)
    for row in range(first, last + 1):
        begin, end = blocks.whole(row)
        if begin < first or last < end:
            raise ProgramError(
                f"steps {first + 1} … {last + 1} cut the block of steps {begin + 1} … {end + 1}; "
                "take all of it, or none"
            )
    inside = program.steps[first : last + 1]
    return _spliced(program, first, len(inside), (block, *inside, EndStep())), first


def _require_row(program: Program, row: int) -> None:
    if not program.steps:
        raise ProgramError("the list is empty; record a pose first")
    if not 0 <= row < len(program.steps):
        raise ProgramError(f"there is no row {row + 1}; the program has {len(program.steps)}")


def _spliced(program: Program, at: int, removed: int, steps: tuple[Step, ...]) -> Program:
    return _with(program, (*program.steps[:at], *steps, *program.steps[at + removed :]))


def _with(program: Program, steps: tuple[Step, ...]) -> Program:
    return msgspec.structs.replace(program, steps=steps)


# User frames.


def put_frame(program: Program, name: str, frame: UserFrame) -> Program:
    """With a frame, new or in place of that with its name: what is given in it moves with it."""
    if name not in program.frames:
        _require_free(program, name)
    return msgspec.structs.replace(program, frames={**program.frames, name: frame})


def rename_frame(program: Program, name: str, to: str) -> Program:
    """With another name for a frame, also in the steps that choose it."""
    _require_free(program, to)
    frames = {to if one == name else one: frame for one, frame in program.frames.items()}
    steps = tuple(
        msgspec.structs.replace(step, frame=to)
        if isinstance(step, FrameStep) and step.frame == name
        else step
        for step in program.steps
    )
    return msgspec.structs.replace(program, frames=frames, steps=steps)


def delete_frame(program: Program, name: str) -> Program:
    """Without a frame; a ProgramError where a step chooses it."""
    for index, step in enumerate(program.steps):
        if isinstance(step, FrameStep) and step.frame == name:
            raise ProgramError(f"step {index + 1} chooses the frame {name!r}; delete that step first")
    frames = {one: frame for one, frame in program.frames.items() if one != name}
    return msgspec.structs.replace(program, frames=frames)


def _require_free(program: Program, name: str) -> None:
    if NAME_OF_FRAME.fullmatch(name) is None:
        raise InputError(
            f"{name[:60]!r} is no name of a frame: 1 … 40 letters, digits, spaces, '_', '.', '+' and '-', "
            "beginning with none of the last four"
        )
    if name == BASE:
        raise InputError("'base' is the frame of the arm; take another name")
    if name in program.frames:
        raise InputError(f"there is a frame {name!r} already; take another name")
    if len(program.frames) >= MOST_FRAMES:
        raise InputError(f"a program has {MOST_FRAMES} frames at most")
