from __future__ import annotations

import csv

import pytest

from armctl.errors import ProgramError
from armctl.motion import GripperStep, MoveStep, PointStep, Program, WaitStep
from armctl.robot import load_robot
from armctl.ui.widgets import step_edit
from armctl.ui.widgets.step_list import PAGE_ROWS, describe, page_count, page_of, program_csv, step_table

ROBOT = load_robot("uzuner")
POSE = MoveStep(joints_deg=(0.0, 90.0, -80.256, -40.0, 0.0))
POINT = PointStep(x_mm=200.0, y_mm=-10.5, z_mm=100.0, pitch_deg=-30.0)
WAIT, GRIP = WaitStep(seconds=1.5), GripperStep(open_percent=40)
PROGRAM = Program(robot="uzuner", steps=(POSE, WAIT, GRIP))


def test_steps_in_words() -> None:
    assert describe(POSE) == ("pose", "0, 90, −80.26, −40, 0 °")
    assert describe(MoveStep(joints_deg=(1.0,), duration_s=2)) == ("pose", "1 ° in 2 s")
    assert describe(POINT) == ("point", "(200, −10.5, 100) mm, pitch −30°")
    assert describe(WAIT) == ("wait", "1.5 s")
    assert describe(GRIP) == ("gripper", "40 % open")


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


def test_csv_has_units_in_its_heads_and_a_row_a_step() -> None:
    program = Program(robot="uzuner", steps=(POSE, POINT, WAIT, GRIP))
    rows = list(csv.DictReader(program_csv(program, ROBOT).splitlines()))
    assert list(rows[0])[:7] == ["step", "kind", *(f"{name}_deg" for name in ROBOT.joint_names)]
    assert [row["kind"] for row in rows] == ["pose", "point", "wait", "gripper"]
    assert (rows[0]["elbow_deg"], rows[0]["wait_s"]) == ("-80.256", "")
    assert (rows[1]["x_mm"], rows[1]["pitch_deg"], rows[1]["base_deg"]) == ("200.0", "-30.0", "")
    assert (rows[2]["wait_s"], rows[3]["gripper_percent"]) == ("1.5", "40")


def test_recording_at_the_end_before_and_in_place() -> None:
    end, before, instead = step_edit.PLACES
    assert step_edit.add(PROGRAM, POINT, end, 0)[0].steps == (POSE, WAIT, GRIP, POINT)
    assert step_edit.add(PROGRAM, POINT, end, 0)[1] == 3
    changed, selected = step_edit.add(PROGRAM, POINT, before, 1)
    changed, selected = step_edit.add(changed, GRIP, before, selected)
    assert changed.steps == (POSE, POINT, GRIP, WAIT, GRIP)
    assert selected == 3
    assert step_edit.add(PROGRAM, POINT, instead, 1)[0].steps == (POSE, POINT, GRIP)
    empty = Program(robot="uzuner")
    assert [step_edit.add(empty, POSE, where, 0)[0].steps for where in step_edit.PLACES] == [(POSE,)] * 3


def test_up_down_duplicate_delete_take_the_selection_along() -> None:
    assert step_edit.shift(PROGRAM, 2, -1) == (Program(robot="uzuner", steps=(POSE, GRIP, WAIT)), 1)
    assert step_edit.shift(PROGRAM, 0, 1) == (Program(robot="uzuner", steps=(WAIT, POSE, GRIP)), 1)
    assert step_edit.duplicate(PROGRAM, 0) == (Program(robot="uzuner", steps=(POSE, POSE, WAIT, GRIP)), 1)
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
        lambda: step_edit.duplicate(empty, 0),
        lambda: step_edit.remove(empty, 0),
    ):
        with pytest.raises(ProgramError, match="there is no"):
            attempt()
