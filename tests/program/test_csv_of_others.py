"""CSV files that are nearly right: times, comments, heads without units, workbooks."""

from __future__ import annotations

import random
import zipfile
from itertools import accumulate
from pathlib import Path

import numpy as np
import pytest

from armctl import load_robot
from armctl.cli.main import run
from armctl.errors import ProgramError
from armctl.program import CommentStep, MoveStep, PointStep, Program, open_program, read_csv

ROBOT = load_robot("uzuner")


def read(*lines: str) -> Program:
    return read_csv("\n".join(lines) + "\n", ROBOT)


# Times.


@pytest.mark.parametrize(
    ("head", "unit"),
    [
        ("t", 1),
        ("time", 1),
        ("T_s", 1),
        ("time_ms", 1000),
        ("time_from_start", 1),
        ("Time [ms]", 1000),
        ("secs", 1),
    ],
)
def test_a_column_of_times_is_when_rows_are_reached(head: str, unit: int) -> None:
    program = read(
        f"{head},x_mm,y_mm,z_mm", "0,220,-60,100", f"{1.5 * unit},220,60,100", f"{4 * unit},220,0,100"
    )
    assert [getattr(step, "duration_s", None) for step in program.steps] == [None, 1.5, 2.5]


@pytest.mark.parametrize("seed", range(10))
def test_durations_add_up_to_the_times(seed: int) -> None:
    chance = np.random.default_rng(seed)
    times = np.cumsum(chance.uniform(0.1, 3, 12)).round(3)
    waits = np.where(chance.random(12) < 0.3, 0.05, 0.0)
    rows = [
        f"{t},220,{y:.1f},100,{w or ''}"
        for t, y, w in zip(times, chance.uniform(-60, 60, 12), waits, strict=True)
    ]
    program = read("time,x_mm,y_mm,z_mm,wait_s", *rows)
    lasting = [step.duration_s or 0.0 for step in program.steps if isinstance(step, PointStep)]
    assert sum(lasting) + waits[:-1].sum() == pytest.approx(times[-1] - times[0], abs=1e-4)


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (("t,x_mm,y_mm,z_mm", "0,220,-60,100", "0,220,60,100"), "line 3, column t: 0 s is not after the 0 s"),
        (("t,x_mm,y_mm,z_mm", "2,220,-60,100", "1,220,60,100"), "line 3, column t: 1 s is not after the 2 s"),
        (("t,x_mm,y_mm,z_mm,duration_s", "0,220,-60,100,1"), "'t' says when .*'duration_s' how long"),
        (("t,x_mm,y_mm,z_mm", "soon,220,-60,100"), "line 2, column t: 'soon' is not a number"),
    ],
)
def test_times_that_cannot_be_kept_are_named(lines: tuple[str, ...], says: str) -> None:
    with pytest.raises(ProgramError, match=says):
        read(*lines)


# Comments.


@pytest.mark.parametrize("head", ["comment", "Comments", "remark", "notes", "description"])
def test_a_column_of_comments_is_a_note(head: str) -> None:
    (step,) = read(f"x_mm,y_mm,z_mm,{head}", "220,-60,100,pick").steps
    assert step.note == "pick"


def test_lines_of_comments_are_comments() -> None:
    head = ("# my points", '% "made by', "// me", "")
    program = read(*head, "x_mm;y_mm;z_mm", "220;-60;100", "# above; the box", "220;60;100,5")
    assert [type(step) for step in program.steps] == [PointStep, CommentStep, PointStep]
    assert program.steps[1].note == "above; the box"
    program = read(",x_mm,y_mm,z_mm", "# above the box", ",220,-60,100")  # a column without a head
    assert [type(step) for step in program.steps] == [CommentStep, PointStep]
    with pytest.raises(ProgramError, match="line 7"):
        read(*head, "x_mm,y_mm,z_mm", "220,-60,100", "220,far,100")


@pytest.mark.parametrize("seed", range(30))
def test_random_comments_and_times_change_no_motion(seed: int) -> None:
    """Comments anywhere, a column of notes, times in any unit and place, any delimiter, an empty column."""
    chance = random.Random(seed)
    rows = [[round(chance.uniform(-20, 20), 2) for _ in range(ROBOT.n)] for _ in range(chance.randint(1, 6))]
    times = list(accumulate(round(chance.uniform(0.5, 2), 3) for _ in rows))
    mark = chance.choice((",", ";", "\t"))
    remark = f"a remark {chance.choice(('', f'with{mark}a sign', 'of 3 words'))}"
    heads = [f"{name}_deg" for name in ROBOT.joint_names]
    unit = chance.choice((None, "t", "time_ms", "Time_s"))
    notes, blank = chance.choice((None, "comment", "Notes")), chance.random() < 0.3
    table = [[str(value) for value in row] for row in rows]
    for head, cells in (
        (notes, [f"row {k}" for k in range(len(rows))]),
        (unit, [f"{1000 * t:g}" if unit == "time_ms" else f"{t:g}" for t in times]),
        ("" if blank else None, ["" for _ in rows]),
    ):
        if head is not None:
            place = chance.randint(0, len(heads))
            heads.insert(place, head)
            for row, cell in zip(table, cells, strict=True):
                row.insert(place, cell)
    lines, said = [mark.join(heads)], 0
    for row in table:
        if chance.random() < 0.4 and heads[0] != notes:
            lines.append(f"{chance.choice(('#', '%', '//'))} {remark}")
            said += 1
        lines.append(mark.join(row))
    ahead = [f"{chance.choice(('#', '%', '//'))} {remark}" for _ in range(chance.randint(0, 2))]
    program = read(*ahead, *lines)
    moves = [step for step in program.steps if isinstance(step, MoveStep)]
    assert np.array([step.joints_deg for step in moves]) == pytest.approx(np.array(rows))
    comments = [step.note for step in program.steps if isinstance(step, CommentStep)]
    assert comments == [remark.strip()] * said
    if notes is not None:
        assert [step.note for step in moves] == [f"row {k}" for k in range(len(rows))]
    if unit is not None:
        assert [step.duration_s for step in moves[1:]] == pytest.approx(np.diff(times).tolist())


def test_a_head_behind_a_sign_is_the_head() -> None:
    assert len(read("# x_mm, y_mm, z_mm", "220,-60,100").steps) == 1
    program = read("#,x_mm,y_mm,z_mm", "1,220,-60,100", "2,220,60,100")
    assert [type(step) for step in program.steps] == [PointStep, PointStep]


# Units.


@pytest.mark.parametrize(
    ("heads", "row"),
    [
        ("X (mm),Y [mm],z / mm", "220,-60,100"),
        ("x [m],y (m),Z_M", "0.22,-0.06,0.1"),
        ("Base [°],shoulder (deg),elbow_deg,Wrist Pitch (°),wrist_roll °", "10,60,-60,20,5"),
        ("j1_deg,J2 [deg],joint3_deg,joint_4 (deg),q5_deg", "10,60,-60,20,5"),
        ("j1,j2,j3,j4,j5", "10,60,-60,20,5"),
    ],
)
def test_units_in_brackets_and_numbered_joints_are_read(heads: str, row: str) -> None:
    step = read(heads, row).steps[-1]
    if isinstance(step, PointStep):
        assert (step.x_mm, step.y_mm, step.z_mm) == pytest.approx((220, -60, 100))
    else:
        assert isinstance(step, MoveStep) and step.joints_deg == pytest.approx((10, 60, -60, 20, 5))


@pytest.mark.parametrize(
    ("head", "says"),
    [
        ("X (inch)", r"'X \(inch\)': the unit 'inch' is not known here; write x_mm or x_cm or x_m"),
        ("joint_0", "'joint_0' is not known"),  # whether such a file counts from 0 is not asked of the arm
        ("joint_6", "'joint_6' is not known"),
    ],
)
def test_heads_that_could_mean_anything_are_named(head: str, says: str) -> None:
    with pytest.raises(ProgramError, match=says):
        read(f"{head},y_mm,z_mm", "1,2,3")


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "mm"), (0.1, "cm"), (0.001, "m")])
def test_points_without_a_unit_are_read_in_the_one_that_fits(scale: float, unit: str) -> None:
    rows = [",".join(f"{scale * value:g}" for value in point) for point in ((220, -60, 100), (220, 60, 100))]
    told, first, _ = read("x,y,z", *rows).steps
    assert f"x, y, z: read in {unit}" in told.note
    assert isinstance(first, PointStep) and (first.x_mm, first.y_mm) == pytest.approx((220, -60))


def test_angles_without_a_unit_are_read_where_only_degrees_fit() -> None:
    names = ",".join(ROBOT.joint_names)
    told, step = read(names, ",".join(f"{angle:.2f}" for angle in np.degrees(ROBOT.pose("home")))).steps
    assert "read in deg" in told.note and isinstance(step, MoveStep)
    with pytest.raises(ProgramError, match="has no unit"):
        read(names, ",".join("0" for _ in ROBOT.joint_names))


@pytest.mark.parametrize("row", ["0,0,0", "9e9,0,0", "1,2,3", "far,0,0"])
def test_points_that_fit_no_unit_are_refused(row: str) -> None:
    with pytest.raises(ProgramError, match="column 'x' has no unit; write x_mm"):
        read("x,y,z", row)


# Workbooks.


@pytest.mark.parametrize("name", ["points.csv", "points.xlsx", "points.ods"])
def test_a_workbook_is_named(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with zipfile.ZipFile(tmp_path / name, "w") as packed:
        packed.writestr("xl/workbook.xml", "<workbook/>")
    with pytest.raises(ProgramError, match=r"workbook.*save it.* as CSV"):
        open_program(tmp_path / name, ROBOT)
    assert run(["check", str(tmp_path / name), "--robot", "uzuner"]) == 1
    assert "as CSV" in capsys.readouterr().err
