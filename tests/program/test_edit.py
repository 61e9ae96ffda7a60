from __future__ import annotations

import msgspec
import pytest
from tests.program.kit import program

from armctl.errors import InputError, ProgramError
from armctl.program import (
    ElseStep,
    EndStep,
    FrameStep,
    GridStep,
    IfStep,
    PlaceStep,
    PointStep,
    RepeatStep,
    Step,
    UserFrame,
    WaitStep,
)
from armctl.program.edit import (
    PLACES,
    Change,
    add,
    delete,
    duplicate,
    move,
    move_before,
    point_in,
    replace,
    surround,
)

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
    assert delete(program(A, ELSE, B), 1) == change(1, A, B)


def test_two_branches_never_become_one_after_the_other() -> None:
    assert delete(BRANCH, 1) == change(1, A, B, D)
    assert delete(BRANCH, 3) == change(3, A, IF, B, END, D)
    assert delete(BRANCH, 5) == change(2, A, B, D)


def test_a_block_is_copied_whole_and_the_copy_is_selected() -> None:
    assert duplicate(PROGRAM, 1) == change(2, A, B, B, C)
    doubled = (A, TWICE, B, END, TWICE, B, END, C)
    assert [duplicate(BLOCK, marker) for marker in (1, 3)] == [change(4, *doubled), change(6, *doubled)]


def test_a_range_is_wrapped_into_a_block() -> None:
    assert surround(PROGRAM, TWICE, "2", 0) == surround(PROGRAM, TWICE, "", 1) == (BLOCK, 1)
    for text in ("1-3", " 1 – 3 ", "1 to 3", "1…3"):
        assert surround(PROGRAM, TWICE, text, 1) == change(0, TWICE, A, B, C, END)
    assert surround(BLOCK, TWICE, "1-4", 0) == change(0, TWICE, A, TWICE, B, END, END, C)
    assert surround(BLOCK, TWICE, "3", 0) == change(2, A, TWICE, TWICE, B, END, END, C)


@pytest.mark.parametrize("text", ["x", "1,3", "-1", "1-2-3", "1.5"])
def test_what_is_no_range_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"is no range of rows; write e.g. 2-5"):
        surround(PROGRAM, TWICE, text, 0)


def test_what_cannot_be_repeated() -> None:
    for rows in ("1-2", "2-3", "4-5"):
        with pytest.raises(ProgramError, match=r"cut the block of steps 2 … 4; take all of it, or none"):
            surround(BLOCK, TWICE, rows, 0)
    with pytest.raises(ProgramError, match="a block cannot go from step 3 back to step 2"):
        surround(PROGRAM, TWICE, "3-2", 0)
    with pytest.raises(ProgramError, match="there is no row 4; the program has 3"):
        surround(PROGRAM, TWICE, "2-4", 0)


IF, ELSE = IfStep(watch="button"), ElseStep()
BRANCH = program(A, IF, B, ELSE, C, END, D)


def test_a_block_comes_with_its_end_and_what_follows_goes_into_it() -> None:
    end, before, after, instead = PLACES
    block, row = add(PROGRAM, TWICE, after, 0)
    assert (block, row) == change(1, A, TWICE, END, B, C)
    assert add(block, D, after, row) == change(2, A, TWICE, D, END, B, C)
    assert add(PROGRAM, TWICE, end, 0) == change(3, A, B, C, TWICE, END)
    assert add(PROGRAM, TWICE, before, 1) == change(3, A, TWICE, END, B, C)
    assert add(PROGRAM, TWICE, instead, 1) == change(1, A, TWICE, END, C)


def test_a_block_is_moved_whole_and_its_end_alone() -> None:
    assert move(BRANCH, 1, -1) == change(0, IF, B, ELSE, C, END, A, D)
    assert move(BRANCH, 1, 1) == change(2, A, D, IF, B, ELSE, C, END)
    assert move(BRANCH, 5, 1) == change(6, A, IF, B, ELSE, C, D, END)
    assert move(BRANCH, 3, 1) == change(4, A, IF, B, C, ELSE, END, D)
    assert move_before(BRANCH, 1, 0) == move(BRANCH, 1, -1)
    assert move_before(BRANCH, 1, 7) == move(BRANCH, 1, 1)
    assert move_before(BRANCH, 6, 3) == change(3, A, IF, B, D, ELSE, C, END)
    assert move(program(TWICE, A, END, IF, B, END), 3, -1)[0] == program(TWICE, A, IF, B, END, END)
    for to in (2, 4, 5):
        with pytest.raises(ProgramError, match="a block cannot go into itself"):
            move_before(BRANCH, 1, to)
    with pytest.raises(ProgramError, match="row 1 is the first one already"):
        move(program(TWICE, A, END), 0, -1)
    with pytest.raises(ProgramError, match="row 2 is the last one already"):
        move(program(A, TWICE, B, END), 1, 1)


GRID = GridStep(
    x_mm=180, y_mm=-30, z_mm=80, row_x_mm=180, row_y_mm=30, row_z_mm=80,
    column_x_mm=220, column_y_mm=-30, column_z_mm=80, rows=2, columns=2,
)  # fmt: skip
TABLE = UserFrame(x_mm=100, y_mm=50, z_mm=20, rz_deg=90)


def test_a_point_that_is_put_into_a_cell_stays_where_it_is_in_the_first_one() -> None:
    place = PlaceStep(x_mm=190, y_mm=-30, z_mm=95)
    in_cell = PlaceStep(x_mm=10, y_mm=0, z_mm=15, frame="cell")
    assert replace(program(GRID, place, END), 1, msgspec.structs.replace(place, frame="cell")) == change(
        1, GRID, in_cell, END
    )
    assert replace(program(GRID, in_cell, END), 1, msgspec.structs.replace(in_cell, frame=None)) == change(
        1, GRID, place, END
    )
    far = PointStep(x_mm=1, y_mm=2, z_mm=3)
    alone = msgspec.structs.replace(far, frame="cell")  # of no grid: the check says so
    assert replace(program(far), 0, alone) == change(0, alone)


def test_the_place_of_the_tool_is_given_in_the_frame_and_the_cell_of_the_step() -> None:
    in_cell = PlaceStep(x_mm=0, y_mm=0, z_mm=0, frame="cell")
    framed = msgspec.structs.replace(
        program(FrameStep(frame="table"), A, GRID, in_cell, END, FrameStep(frame="base"), A),
        frames={"table": TABLE},
    )
    there = TABLE.matrix @ [180, -30, 80, 1]
    assert point_in(framed, 1, there[:3]) == (180, -30, 80)
    assert point_in(framed, 2, there[:3]) == (180, -30, 80)
    assert point_in(framed, 3, there[:3]) == (0, 0, 0)
    assert point_in(framed, 6, (1, 2, 3)) == (1, 2, 3)
    within = add(framed, msgspec.structs.replace(GRID.moved(TABLE.matrix)), PLACES[2], 1)[0].steps[2]
    assert isinstance(within, GridStep)
    assert within.cell(3) == pytest.approx(GRID.cell(3), abs=2e-3)


def test_what_cannot_be_done_is_refused_in_words() -> None:
    with pytest.raises(ProgramError, match="row 1 is the first one already"):
        move(PROGRAM, 0, -1)
    with pytest.raises(ProgramError, match="row 3 is the last one already"):
        move(PROGRAM, 2, 1)
    for attempt in (lambda: move(EMPTY, 0, 1), lambda: duplicate(EMPTY, 0), lambda: delete(EMPTY, 0)):
        with pytest.raises(ProgramError, match="the list is empty; record a pose first"):
            attempt()
