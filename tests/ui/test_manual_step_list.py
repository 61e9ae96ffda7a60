from __future__ import annotations

import pytest

from armctl.errors import InputError, ProgramError
from armctl.program import (
    EndStep,
    GripperStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    Step,
    WaitStep,
)
from armctl.ui.tabs.program import editing as step_edit
from armctl.ui.tabs.program.step_list import PAGE_ROWS, page_count, page_of, step_table

POSE = MoveStep(joints_deg=(0.0, 90.0, -80.256, -40.0, 0.0))
POINT = PointStep(x_mm=200.0, y_mm=-10.5, z_mm=100.0, pitch_deg=-30.0)
WAIT, GRIP = WaitStep(seconds=1.5), GripperStep(open_percent=40)
PROGRAM = Program(robot="uzuner", steps=(POSE, WAIT, GRIP))
TWICE, END = RepeatStep(times=2), EndStep()
BLOCK = Program(robot="uzuner", steps=(POSE, TWICE, WAIT, END, GRIP))


def test_pages() -> None:
    assert [page_count(n) for n in (0, 1, PAGE_ROWS, PAGE_ROWS + 1)] == [1, 1, 1, 2]
    assert [page_of(n) for n in (0, PAGE_ROWS - 1, PAGE_ROWS)] == [0, 0, 1]


def test_a_page_shows_its_rows_only_and_marks_the_selected_and_the_running_one() -> None:
    steps = [WaitStep(seconds=k) for k in range(2 * PAGE_ROWS)]
    html = step_table(steps, 1, PAGE_ROWS, PAGE_ROWS + 2)
    assert html.count("<tr") == PAGE_ROWS
    assert f"▶ {PAGE_ROWS + 3}<" in html
    assert html.count("▶") == 1
    assert html.count("box-shadow") == 1
    assert "▶" not in step_table(steps, 0, 0, PAGE_ROWS + 2)


def test_notes_are_escaped_and_an_empty_list_says_what_to_do() -> None:
    assert "<img" not in step_table([WaitStep(seconds=1, note="<img src=x onerror=alert(1)>")], 0, 0, None)
    assert "Record pose" in step_table([], 0, None, None)


def replaced(*steps: Step) -> Program:
    return Program(robot="uzuner", steps=steps)


def test_what_is_repeated_is_set_in() -> None:
    rows = step_table(BLOCK.steps, 0, None, None).split("<tr")[1:]
    assert ["padding-left:18px" in row for row in rows] == [False, False, True, False, False]


def test_a_blocks_markers_go_and_come_together() -> None:
    for marker, selected in ((1, 1), (3, 2)):
        assert step_edit.remove(BLOCK, marker) == (replaced(POSE, WAIT, GRIP), selected)
    doubled = replaced(POSE, TWICE, WAIT, END, TWICE, WAIT, END, GRIP)
    assert step_edit.double(BLOCK, 1) == (doubled, 4)
    assert step_edit.double(BLOCK, 3) == (doubled, 6)


def test_a_range_is_wrapped_into_a_block() -> None:
    assert step_edit.wrap(PROGRAM, "2", 0, 2) == (replaced(POSE, TWICE, WAIT, END, GRIP), 1)
    assert step_edit.wrap(PROGRAM, "", 1, 2) == (replaced(POSE, TWICE, WAIT, END, GRIP), 1)
    for text in ("1-3", " 1 – 3 ", "1 to 3", "1…3"):
        assert step_edit.wrap(PROGRAM, text, 1, 2) == (replaced(TWICE, POSE, WAIT, GRIP, END), 0)
    for text in ("x", "1,3", "-1", "1-2-3", "1.5"):
        with pytest.raises(InputError, match=r"is no range of rows; write e.g. 2-5"):
            step_edit.wrap(PROGRAM, text, 0, 2)
    with pytest.raises(ProgramError, match="there is no row 4; the program has 3"):
        step_edit.wrap(PROGRAM, "2-4", 0, 2)


def test_recording_at_the_end_before_and_in_place() -> None:
    end, before, after, instead = step_edit.PLACES
    assert step_edit.add(PROGRAM, POINT, end, 0)[0].steps == (POSE, WAIT, GRIP, POINT)
    assert step_edit.add(PROGRAM, POINT, end, 0)[1] == 3
    changed, selected = step_edit.add(PROGRAM, POINT, before, 1)
    changed, selected = step_edit.add(changed, GRIP, before, selected)
    assert changed.steps == (POSE, POINT, GRIP, WAIT, GRIP)
    assert selected == 3
    assert step_edit.add(PROGRAM, POINT, instead, 1)[0].steps == (POSE, POINT, GRIP)
    assert step_edit.add(PROGRAM, POINT, after, 1) == (replaced(POSE, WAIT, POINT, GRIP), 2)
    empty = Program(robot="uzuner")
    assert [step_edit.add(empty, POSE, where, 0)[0].steps for where in step_edit.PLACES] == [(POSE,)] * 4


def test_up_down_duplicate_delete_take_the_selection_along() -> None:
    assert step_edit.shift(PROGRAM, 2, -1) == (Program(robot="uzuner", steps=(POSE, GRIP, WAIT)), 1)
    assert step_edit.shift(PROGRAM, 0, 1) == (Program(robot="uzuner", steps=(WAIT, POSE, GRIP)), 1)
    assert step_edit.double(PROGRAM, 0) == (Program(robot="uzuner", steps=(POSE, POSE, WAIT, GRIP)), 1)
    assert step_edit.remove(PROGRAM, 2) == (Program(robot="uzuner", steps=(POSE, WAIT)), 1)
    assert step_edit.remove(PROGRAM, 0)[1] == 0


def test_what_cannot_be_done_is_refused_in_words() -> None:
    with pytest.raises(ProgramError, match="row 1 is the first one already"):
        step_edit.shift(PROGRAM, 0, -1)
    with pytest.raises(ProgramError, match="row 3 is the last one already"):
        step_edit.shift(PROGRAM, 2, 1)
    empty = Program(robot="uzuner")
    for attempt in (
        lambda: step_edit.shift(empty, 0, 1),
        lambda: step_edit.double(empty, 0),
        lambda: step_edit.remove(empty, 0),
    ):
        with pytest.raises(ProgramError, match="the list is empty; record a pose first"):
            attempt()
