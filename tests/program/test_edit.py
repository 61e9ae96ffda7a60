from __future__ import annotations

import pytest
from tests.program.kit import program

from armctl.errors import InputError, ProgramError
from armctl.program import EndStep, RepeatStep, Step, WaitStep
from armctl.program.program import PLACES, Change, add, delete, duplicate, move, repeat, replace

A, B, C, D = (WaitStep(seconds=k) for k in range(4))
TWICE, END = RepeatStep(times=2), EndStep()


EMPTY, PROGRAM, BLOCK = program(), program(A, B, C), program(A, TWICE, B, END, C)


def change(selected: int, *steps: Step) -> Change:
    return program(*steps), selected


def test_a_step_goes_to_its_place_and_the_next_one_behind_it() -> None:
    end, before, after, instead = PLACES
    assert add(PROGRAM, D, end, 0) == change(3, A, B, C, D)
    assert add(PROGRAM, D, before, 1) == change(2, A, D, B, C)
    assert add(program(A, D, B, C), A, before, 2) == change(3, A, D, A, B, C)
    assert add(PROGRAM, D, after, 1) == change(2, A, B, D, C)
    assert add(PROGRAM, D, instead, 1) == replace(PROGRAM, 1, D) == change(1, A, D, C)
    assert [add(EMPTY, A, where, 0) for where in PLACES] == [change(0, A)] * 4


def test_up_and_down_take_the_selection_along() -> None:
    assert move(PROGRAM, 2, -1) == change(1, A, C, B)
    assert move(PROGRAM, 0, 1) == change(1, B, A, C)


def test_a_marker_takes_the_other_with_it() -> None:
    assert delete(PROGRAM, 0) == change(0, B, C)
    assert delete(PROGRAM, 2) == change(1, A, B)
    assert delete(program(A), 0) == change(0)
    assert [delete(BLOCK, marker) for marker in (1, 3)] == [change(1, A, B, C), change(2, A, B, C)]
    assert delete(BLOCK, 2) == change(2, A, TWICE, END, C)
    assert delete(program(A, END), 1) == change(0, A)


def test_a_block_is_copied_whole_and_the_copy_is_selected() -> None:
    assert duplicate(PROGRAM, 1) == change(2, A, B, B, C)
    doubled = (A, TWICE, B, END, TWICE, B, END, C)
    assert [duplicate(BLOCK, marker) for marker in (1, 3)] == [change(4, *doubled), change(6, *doubled)]


def test_a_range_is_wrapped_into_a_block() -> None:
    assert repeat(PROGRAM, "2", 0, 2) == repeat(PROGRAM, "", 1, 2) == (BLOCK, 1)
    for text in ("1-3", " 1 – 3 ", "1 to 3", "1…3"):
        assert repeat(PROGRAM, text, 1, 2) == change(0, TWICE, A, B, C, END)
    assert repeat(BLOCK, "1-4", 0, 2) == change(0, TWICE, A, TWICE, B, END, END, C)
    assert repeat(BLOCK, "3", 0, 2) == change(2, A, TWICE, TWICE, B, END, END, C)


@pytest.mark.parametrize("text", ["x", "1,3", "-1", "1-2-3", "1.5"])
def test_what_is_no_range_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"is no range of rows; write e.g. 2-5"):
        repeat(PROGRAM, text, 0, 2)


def test_what_cannot_be_repeated() -> None:
    for rows in ("1-2", "2-3", "4-5"):
        with pytest.raises(ProgramError, match=r"cut the block of steps 2 … 4; take all of it, or none"):
            repeat(BLOCK, rows, 0, 2)
    with pytest.raises(ProgramError, match="a block cannot go from step 3 back to step 2"):
        repeat(PROGRAM, "3-2", 0, 2)
    with pytest.raises(ProgramError, match="there is no row 4; the program has 3"):
        repeat(PROGRAM, "2-4", 0, 2)
    for times in (0, 1_000_001):
        with pytest.raises(ProgramError, match=f"a block repeats 1 … 1000000 times, not {times}"):
            repeat(PROGRAM, "1-2", 0, times)


def test_what_cannot_be_done_is_refused_in_words() -> None:
    with pytest.raises(ProgramError, match="row 1 is the first one already"):
        move(PROGRAM, 0, -1)
    with pytest.raises(ProgramError, match="row 3 is the last one already"):
        move(PROGRAM, 2, 1)
    for attempt in (lambda: move(EMPTY, 0, 1), lambda: duplicate(EMPTY, 0), lambda: delete(EMPTY, 0)):
        with pytest.raises(ProgramError, match="the list is empty; record a pose first"):
            attempt()
