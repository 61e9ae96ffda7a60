"""What the serial motion's buttons do to the list, and which row is selected afterwards."""

from __future__ import annotations

from typing import Literal

from armctl.errors import ProgramError
from armctl.motion import Program, Step, delete, insert, move, replace

Where = Literal["at the end", "before the selected row", "in place of the selected row"]
PLACES: tuple[Where, ...] = ("at the end", "before the selected row", "in place of the selected row")
Change = tuple[Program, int]
"""the new program, and the index of the row that is selected in it"""


def add(program: Program, step: Step, where: str, selected: int) -> Change:
    """A recorded step goes to its place.

    A step put before the selected row leaves that row selected, so that several come out in the order in
    which they were recorded.
    """
    if where == PLACES[0] or not program.steps:
        return insert(program, len(program.steps), step), len(program.steps)
    if where == PLACES[1]:
        return insert(program, selected, step), selected + 1
    return replace(program, selected, step), selected


def remove(program: Program, selected: int) -> Change:
    """Without the selected row; the next one is selected, or the last."""
    shorter = delete(program, selected)
    return shorter, min(selected, max(len(shorter.steps) - 1, 0))


def shift(program: Program, selected: int, by: int) -> Change:
    """The selected row up (-1) or down (+1).

    Raises:
        ProgramError: it is the first or the last already.
    """
    _there(program, selected)
    if not 0 <= selected + by < len(program.steps):
        raise ProgramError(f"row {selected + 1} is the {'first' if by < 0 else 'last'} one already")
    return move(program, selected, selected + by), selected + by


def duplicate(program: Program, selected: int) -> Change:
    """A copy of the selected row behind it, which is selected then."""
    _there(program, selected)
    return insert(program, selected + 1, program.steps[selected]), selected + 1


def _there(program: Program, selected: int) -> None:
    if not 0 <= selected < len(program.steps):
        raise ProgramError(f"there is no row {selected + 1}; record a pose first")
