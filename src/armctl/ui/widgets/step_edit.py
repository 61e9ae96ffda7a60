"""What the serial motion's buttons do to the list, and which row is selected afterwards."""

from __future__ import annotations

import re

from armctl.errors import InputError, ProgramError
from armctl.motion.program import EndStep, Program, Step, delete, duplicate, insert, move, repeat, replace

PLACES = (
    "at the end",
    "before the selected row",
    "after the selected row",
    "in place of the selected row",
)
Change = tuple[Program, int]
"""the new program, and the index of the row that is selected in it"""
_RANGE = re.compile(r"\s*(\d{1,6})\s*(?:(?:-|–|…|to)\s*(\d{1,6})\s*)?")


def add(program: Program, step: Step, where: str, selected: int) -> Change:
    """A recorded step goes to its place.

    A step put before the selected row leaves that row selected, one put after it is selected itself, so
    that several come out in the order in which they were recorded.
    """
    if where == PLACES[0] or not program.steps:
        return insert(program, len(program.steps), step), len(program.steps)
    if where == PLACES[1]:
        return insert(program, selected, step), selected + 1
    if where == PLACES[2]:
        return insert(program, selected + 1, step), selected + 1
    return replace(program, selected, step), selected


def remove(program: Program, selected: int) -> Change:
    """Without the selected row (a block's marker goes with the other); the next is selected, or the last."""
    _there(program, selected)
    shorter = delete(program, selected)
    removed = len(program.steps) - len(shorter.steps)
    ended_block = removed == 2 and isinstance(program.steps[selected], EndStep)
    row = selected - 1 if ended_block else selected
    return shorter, max(min(row, len(shorter.steps) - 1), 0)


def shift(program: Program, selected: int, by: int) -> Change:
    """The selected row up (-1) or down (+1).

    Raises:
        ProgramError: it is the first or the last already.
    """
    _there(program, selected)
    if not 0 <= selected + by < len(program.steps):
        raise ProgramError(f"row {selected + 1} is the {'first' if by < 0 else 'last'} one already")
    return move(program, selected, selected + by), selected + by


def double(program: Program, selected: int) -> Change:
    """A copy of the selected row, or of the block that it begins or ends, which is selected then."""
    _there(program, selected)
    longer = duplicate(program, selected)
    return longer, selected + len(longer.steps) - len(program.steps)


def wrap(program: Program, rows: str, selected: int, times: int) -> Change:
    """The rows of a range, e.g. ``2-5``, in a block; empty: the selected row.

    Raises:
        InputError: the range cannot be read.
        ProgramError: as ``repeat``.
    """
    _there(program, selected)
    first = last = selected
    if rows.strip():
        match = _RANGE.fullmatch(rows)
        if match is None:
            raise InputError(f"rows to repeat: {rows.strip()[:40]!r} is no range of rows; write e.g. 2-5")
        first = int(match.group(1)) - 1
        last = first if match.group(2) is None else int(match.group(2)) - 1
        for row in (first, last):
            _there(program, row)
    return repeat(program, first, last, times), first


def _there(program: Program, selected: int) -> None:
    count = len(program.steps)
    if not count:
        raise ProgramError("the list is empty; record a pose first")
    if not 0 <= selected < count:
        raise ProgramError(f"there is no row {selected + 1}; the program has {count}")
