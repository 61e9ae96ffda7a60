from __future__ import annotations

import csv
import io
import math
import os
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.arms import FIVE
from tests.long import examples
from tests.program.kit import programs

from armctl.errors import ProgramError
from armctl.program import (
    CommentStep,
    EndStep,
    GripperStep,
    LineStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    Step,
    WaitStep,
    read_csv,
    write_csv,
)
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
JOINTS = "base_deg,shoulder_deg,elbow_deg,wrist_pitch_deg,wrist_roll_deg"
HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))


def read(text: str | bytes) -> tuple[Step, ...]:
    return read_csv(text, ROBOT, "test").steps


@given(programs(joints=st.just(5)))
@settings(max_examples=200 if os.environ.get("ARMCTL_LONG") else 20)
def test_writing_and_reading_is_the_identity(program: Program) -> None:
    text = write_csv(program, ROBOT)
    if not program.steps:
        with pytest.raises(ProgramError, match="no rows"):
            read_csv(text, ROBOT)
        return
    assert read_csv(text, ROBOT, program.name) == program
    assert read_csv(text.encode(), ROBOT, program.name) == program


@given(programs(joints=st.just(5)))
@settings(max_examples=examples(100))
def test_no_text_can_be_taken_for_a_formula(program: Program) -> None:
    rows = list(csv.reader(io.StringIO(write_csv(program, ROBOT), newline="")))
    texts = [cell for row in rows for cell in row if not _is_number(cell)]
    assert not [cell for cell in texts if cell.startswith(("=", "+", "-", "@", "\t", "\r", "\n"))]


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False


def test_angles_by_their_heads_alone() -> None:
    assert read(f"{JOINTS}\n0,90,-80,-40,0\n1,2,3,4,5\n") == (HOME, MoveStep(joints_deg=(1, 2, 3, 4, 5)))
    radians = JOINTS.replace("_deg", "_rad")
    (step,) = read(f"{radians}\n0,{math.pi / 2},-1,0.5,0\n")
    assert isinstance(step, MoveStep)
    assert step.joints_deg == pytest.approx((0, 90, -math.degrees(1), math.degrees(0.5), 0))
    shuffled = "wrist_roll_deg,elbow_deg,base_deg,wrist_pitch_deg,shoulder_deg"
    assert read(f"{shuffled}\n0,-80,0,-40,90\n") == (HOME,)


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0)])
def test_points_by_their_heads_alone(unit: str, factor: float) -> None:
    text = f"x_{unit},y_{unit},z_{unit},pitch_deg,roll_rad,duration_ms,blend_cm\n2,-1,0.5,-30,,1500,1\n"
    assert read(text) == (
        PointStep(
            x_mm=2 * factor, y_mm=-factor, z_mm=0.5 * factor, pitch_deg=-30, duration_s=1.5, blend_mm=10
        ),
    )


def test_a_row_may_also_set_the_gripper_and_wait() -> None:
    head = "x_mm,y_mm,z_mm,gripper_percent,wait_s,note"
    text = f"{head}\n200,0,85,30,0.5,pick\n,,,,2,\n,,,70,,let go\n,,,,,only a word\n"
    assert read(text) == (
        PointStep(x_mm=200, y_mm=0, z_mm=85, note="pick"),
        GripperStep(open_percent=30),
        WaitStep(seconds=0.5),
        WaitStep(seconds=2),
        GripperStep(open_percent=70, note="let go"),
        CommentStep(note="only a word"),
    )


def test_the_size_of_a_part_goes_with_the_gripper() -> None:
    head = "x_mm,y_mm,z_mm,gripper_percent,part_x_mm,part_y_mm,part_z_cm"
    assert read(f"{head}\n200,0,85,30,20,30,4\n,,,70,,,\n") == (
        PointStep(x_mm=200, y_mm=0, z_mm=85),
        GripperStep(open_percent=30, part_x_mm=20, part_y_mm=30, part_z_mm=40),
        GripperStep(open_percent=70),
    )


@pytest.mark.parametrize(
    "text",
    [
        "x_mm;y_mm;z_mm\r\n200,5;0;85\r\n",
        "x_mm\ty_mm\tz_mm\r\n200,5\t0\t85\r\n",
        "x_mm;y_mm;z_mm\n200.5;0;85\n",
        "x_mm,y_mm,z_mm\r200.5,0,85\r",
        '"x_mm", "y_mm", "z_mm"\n"200.5","0","85"\n'.replace(", ", ","),
        "\n\nX_mm , Y_MM,z_mm\n 200.5 ,0,85\n,,\n\n",
        "sep=;\r\nx_mm;y_mm;z_mm\r\n200,5;0;85\r\n",
        "x_mm,y_mm,z_mm,\n200.5,0,85,\n",
        "step,x_mm,y_mm,z_mm\n7,200.5,0,85\n",
        "x_mm,y_mm,z_mm,note\n200.5,0,85\n",
        "x_mm;y_mm;z_mm\n2.005e2;−0;85\n",
    ],
)
def test_what_spreadsheets_make_of_it(text: str) -> None:
    expected = (PointStep(x_mm=200.5, y_mm=0, z_mm=85),)
    assert read(text) == expected
    assert read(b"\xef\xbb\xbf" + text.encode()) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("\n , \n", "the file is empty"),
        ("x_mm,y_mm,z_mm\n", "the file has no rows below its head"),
        ("x,y,z\n1,2,3\n", "line 1, column 'x' has no unit; write x_mm or x_cm or x_m"),
        ("base,shoulder\n1,2\n", "line 1, column 'base' has no unit; write base_deg or base_rad"),
        ("x_inch,y_mm,z_mm\n", "line 1, column 'x_inch': the unit 'inch' is not known here; write x_mm or"),
        ("X (inch),y_mm\n", r"line 1, column 'X \(inch\)': the unit 'inch' is not known here; write x_mm"),
        ("x_mm,y_mm,z_mm,wait\n", "column 'wait' has no unit; write wait_s or wait_ms"),
        ("x_mm,y_mm,z_mm,colour\n", "line 1, column 'colour' is not known; known are base_deg, "),
        ("x_mm,y_mm\n1,2\n", "line 1: the column z_mm is missing"),
        (f"{JOINTS.replace('elbow_deg,', '')}\n", "line 1: the column elbow_deg is missing"),
        ("x_mm,y_mm,z_mm,x_m\n", "line 1, column 'x_m' says the same as 'x_mm'; keep one"),
        ("note,wait_s\nhello,1\n", r"line 1: neither the joints' angles \(base_deg …\) nor a point"),
        ("\nx_mm,y_mm,z_mm\n1,2,3\n1,,3\n", "line 4, column y_mm: the cell is empty"),
        (f"{JOINTS}\n0,90,-80\n", "line 2, column wrist_pitch_deg: the cell is empty"),
        ("x_mm,y_mm,z_mm\n1,2,3,4\n", "line 2: '4' stands in a column without a head"),
        ("x_mm,y_mm,z_mm\n1,two,3\n", "line 2, column y_mm: 'two' is not a number"),
        ("x_mm,y_mm,z_mm\n1,nan,3\n", "line 2, column y_mm: 'nan' is not a number"),
        ("x_mm,y_mm,z_mm\n1,1e999,3\n", "line 2, column y_mm: '1e999' is too large"),
        ("x_mm,y_mm,z_mm\n1,1_0,3\n", "line 2, column y_mm: '1_0' is not a number"),
        ("x_mm,y_mm,z_mm\n1,٣,3\n", "line 2, column y_mm: '٣' is not a number"),
        ('x_mm,y_mm,z_mm\n1,"2,5",3\n', "'2,5' is not a number; with decimal commas, separate the columns"),
        ("x_mm;y_mm;z_mm\n1.234,5;2;3\n", "'1.234,5' is not a number; write it without thousands"),
        ("x_mm,y_mm,z_mm\n=1+1,2,3\n", r"line 2, column x_mm: '=1\+1' is not a number"),
        ("x_mm,y_mm,z_mm,duration_s\n1,2,3,-1\n", "line 2, column duration_s: must be 0 … 86400, not -1"),
        ("x_mm,y_mm,z_mm,profile\n1,2,3,fast\n", "line 2, column profile: must be one of .*, not 'fast'"),
        ("x_mm,y_mm,z_mm,times\n1,2,3,4\n", "line 2, column times: a 'point' step has no such thing"),
        ("do,note\nwait,x\n", "line 2, column wait_s: the cell is empty"),
        ("x_mm,y_mm,z_mm,do,wait_s\n1,2,3,wait,1\n", "line 2, column x_mm: a 'wait' step has no such thing"),
        ("x_mm,y_mm,z_mm,do\n1,2,3,fly\n", "line 2, column do: must be one of 'move', .*, not 'fly'"),
        ("x_mm,y_mm,z_mm,do\n1,2,,line\n", "line 2, column z_mm: the cell is empty"),
        ("do,times\nrepeat,2.5\n", "line 2, column times: '2.5' is not a whole number"),
        ("do,times\nrepeat,2\n", "line 2: this 'repeat' has no 'end'"),
        ("do,wait_s\nwait,1\nend,\n", "line 3: 'end' without a 'repeat'"),
        (f"{JOINTS},x_mm,y_mm,z_mm\n1,2,3,4,5,6,7,8\n", "line 2: both angles and a point"),
        (f"{JOINTS},choose\n,,,,,published\n", "line 2: nothing says what to do"),
        ('x_mm,y_mm,z_mm\n1,"2,3\n', "line 2: cannot be split into cells"),
        (b"\xff\xfex\x00", "UTF-16; save it as UTF-8"),
        (b"x_mm,y_mm,z_mm,note\n1,2,3,\xe9\n", "not a text file in UTF-8: byte 27 cannot be read"),
        ("PK\x03\x04", "is not known"),
        ("PK\0", r"line 1, column 'PK\\x00' is not known"),
        ("x_mm" * 40_000, "line 1: cannot be split into cells: field larger than"),
        ("do\n" + "end\n" * 200_000, "line 20002: a program has 20000 steps at most"),
    ],
)
def test_what_is_refused_names_line_and_column(text: str | bytes, message: str) -> None:
    with pytest.raises(ProgramError, match=message):
        read(text)


def test_a_cell_over_several_lines_counts_them_all() -> None:
    with pytest.raises(ProgramError, match="line 5, column x_mm: the cell is empty"):
        read('x_mm,y_mm,z_mm,note\n1,2,3,"two\nlines\nmore"\n,2,3,\n')


def test_other_joints_than_this_arms_are_not_known() -> None:
    text = write_csv(Program(robot="mico", steps=(MoveStep(joints_deg=(0, 0, 0, 0)),)), load_robot("mico"))
    with pytest.raises(
        ProgramError, match="line 1, column 'tool_deg' is not known; known are base_deg, shoulder_deg"
    ):
        read(text)


def test_a_move_with_another_number_of_angles_is_not_written() -> None:
    steps = (HOME, MoveStep(joints_deg=(1, 2)))
    with pytest.raises(ProgramError, match="step 2: uzuner has 5 joints, the step has 2 angles"):
        write_csv(Program(robot="uzuner", steps=steps), ROBOT)


@pytest.mark.parametrize("name", FIVE)
def test_as_points_moves_are_led_through_forward_kinematics(name: str) -> None:
    robot = load_robot(name)
    q = robot.pose(next(iter(robot.poses)))
    line = LineStep(x_mm=1, y_mm=2, z_mm=3, pitch="free")
    move = MoveStep(
        joints_deg=tuple(np.degrees(q).tolist()), duration_s=3, blend_mm=4, profile="quintic", note="n"
    )
    steps = (RepeatStep(times=2), move, EndStep(), line)
    text = write_csv(Program(robot=name, steps=steps), robot, "points")
    assert f"{robot.joint_names[0]}_deg" not in text.splitlines()[0]
    begin, point, end, after = read_csv(text, robot).steps
    assert (begin, end, after) == (steps[0], steps[2], steps[3])
    assert isinstance(point, PointStep)
    assert [point.x_mm, point.y_mm, point.z_mm] == pytest.approx(
        (1000 * robot.forward(q)[:3, 3]).tolist(), abs=1e-6
    )
    pitch, roll = robot.inverse_kinematics.pitch_and_roll(q)
    assert (point.pitch_deg is None, point.roll_deg is None) == (pitch is None, roll is None)
    assert (point.duration_s, point.blend_mm, point.profile, point.note) == (3, 4, "quintic", "n")


def test_as_points_moves_of_six_joints_keep_their_orientation() -> None:
    robot = load_robot("ur5")
    q = robot.pose("home")
    move = MoveStep(joints_deg=tuple(np.degrees(q).tolist()))
    (point,) = read_csv(write_csv(Program(robot="ur5", steps=(move,)), robot, "points"), robot).steps
    assert isinstance(point, PointStep) and point.pitch_deg is None
    there = robot.forward(point.end(robot, q))
    np.testing.assert_allclose(there, robot.forward(q), atol=1e-7)


def test_an_empty_program_has_the_heads_of_the_joints() -> None:
    assert write_csv(Program(robot="uzuner"), ROBOT) == f"step,do,{JOINTS}\r\n"


def test_all_that_is_wrong_is_told_at_once() -> None:
    text = "do,x_mm,y_mm,z_mm,duration_s\npoint,220,0,100,\npoint,far,0,high,\nhop,,,,\npoint,220,,100,-1\n"
    with pytest.raises(ProgramError) as refused:
        read_csv(text, load_robot("uzuner"))
    told = [re.findall(r"^line (\d), column (\w+)", str(one)) for one in refused.value.each]
    wrong = [("3", "x_mm"), ("3", "z_mm"), ("4", "do"), ("5", "duration_s"), ("5", "y_mm")]
    assert told == [[one] for one in wrong]
