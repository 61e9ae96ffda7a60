from __future__ import annotations

import pytest

from armctl.errors import ProgramError
from armctl.program import (
    EndStep,
    Program,
    RepeatStep,
    WaitStep,
    delete,
    duplicate,
    insert,
    move,
    repeat,
    replace,
)

A, B, C, D = (WaitStep(seconds=k) for k in range(4))
PROGRAM = Program(robot="uzuner", steps=(A, B, C))
TWICE, END = RepeatStep(times=2), EndStep()
BLOCK = Program(robot="uzuner", steps=(A, TWICE, B, END, C))


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


def test_duplicate() -> None:
    assert duplicate(PROGRAM, 1).steps == (A, B, B, C)
    for marker in (1, 3):
        assert duplicate(BLOCK, marker).steps == (A, TWICE, B, END, TWICE, B, END, C)


def test_a_marker_takes_the_other_with_it() -> None:
    for marker in (1, 3):
        assert delete(BLOCK, marker).steps == (A, B, C)
    assert delete(BLOCK, 2).steps == (A, TWICE, END, C)
    assert delete(Program(robot="uzuner", steps=(A, END)), 1).steps == (A,)


def test_repeat_wraps_a_range() -> None:
    assert repeat(PROGRAM, 1, 1, 2).steps == BLOCK.steps
    assert repeat(PROGRAM, 0, 2, 2).steps == (TWICE, A, B, C, END)
    assert repeat(BLOCK, 0, 3, 2).steps == (TWICE, A, TWICE, B, END, END, C)
    assert repeat(BLOCK, 2, 2, 2).steps == (A, TWICE, TWICE, B, END, END, C)


def test_what_cannot_be_repeated() -> None:
    for first, last in ((0, 1), (1, 2), (3, 4)):
        with pytest.raises(ProgramError, match=r"cut the block of steps 2 … 4; take all of it, or none"):
            repeat(BLOCK, first, last, 2)
    with pytest.raises(ProgramError, match="a block cannot go from step 3 back to step 2"):
        repeat(PROGRAM, 2, 1, 2)
    with pytest.raises(ProgramError, match="there is no step 4; the program has 3 steps"):
        repeat(PROGRAM, 2, 3, 2)
    for times in (0, 1_000_001):
        with pytest.raises(ProgramError, match=f"a block repeats 1 … 1000000 times, not {times}"):
            repeat(PROGRAM, 0, 1, times)
