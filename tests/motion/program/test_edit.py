from __future__ import annotations

import pytest

from armctl.errors import ProgramError
from armctl.motion import Program, WaitStep, delete, insert, move, replace

A, B, C, D = (WaitStep(seconds=k) for k in range(4))
PROGRAM = Program(robot="uzuner", steps=(A, B, C))


def test_insert() -> None:
    assert insert(PROGRAM, 0, D).steps == (D, A, B, C)
    assert insert(PROGRAM, 3, D).steps == (A, B, C, D)
    assert PROGRAM.steps == (A, B, C)


def test_replace() -> None:
    assert replace(PROGRAM, 1, D).steps == (A, D, C)


def test_delete() -> None:
    assert delete(PROGRAM, 1).steps == (A, C)


def test_move_ends_up_where_it_was_told() -> None:
    assert move(PROGRAM, 0, 2).steps == (B, C, A)
    assert move(PROGRAM, 2, 0).steps == (C, A, B)
    assert move(PROGRAM, 1, 1).steps == (A, B, C)


def test_places_that_are_not_there_are_refused() -> None:
    with pytest.raises(ProgramError, match="cannot be inserted at 5; the program has 3 steps"):
        insert(PROGRAM, 4, D)
    for attempt in (lambda: delete(PROGRAM, 3), lambda: move(PROGRAM, 0, 3), lambda: replace(PROGRAM, -1, D)):
        with pytest.raises(ProgramError, match=r"there is no step \d; the program has 3 steps"):
            attempt()
    with pytest.raises(ProgramError, match=r"the program has 1 step$"):
        delete(Program(robot="uzuner", steps=(A,)), 1)
