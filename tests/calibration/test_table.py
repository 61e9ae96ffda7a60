"""Marks and points from spreadsheets."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from armctl.calibration import Mark, Touches, read_marks, read_touches, touches_csv
from armctl.errors import CalibrationError
from armctl.robot import load_robot


def written(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    "text",
    [
        "output,angle_deg\n1000,-30\n1500.5,12.5\n",
        "angle_deg,Output\r\n-30,1000\r\n\r\n12.5,1500.5\r\n",
        "\ufeffoutput;angle_deg\n1000;−30\n1500,5;12,5\n",
        "output\tangle_deg\n1000\t-30\n1500,5\t12,5\n",
    ],
)
def test_marks_are_read_as_spreadsheets_write_them(tmp_path: Path, text: str) -> None:
    assert read_marks(written(tmp_path, text)) == (
        Mark(1000.0, math.radians(-30)),
        Mark(1500.5, math.radians(12.5)),
    )


def test_points_are_read_in_any_order_of_columns(tmp_path: Path) -> None:
    robot = load_robot("mico")
    names = ("tool", "elbow", "shoulder", "base")
    head = ",".join(
        ["x_mm,y_mm,z_mm", *(f"{name}_deg" for name in names), *(f"{name}_sense" for name in names)]
    )
    rows = "".join(f"{10 * i},2,3,4,5,6,7,1,0,-1,1\n" for i in range(6))
    touches = read_touches(written(tmp_path, f"{head}\n{rows}"), robot, "sheet")
    np.testing.assert_allclose(np.degrees(touches.q[0]), [7, 6, 5, 4])
    np.testing.assert_allclose(touches.points_m[1], [0.01, 0.002, 0.003])
    assert touches.senses[0].tolist() == [1, -1, 0, 1]
    assert touches.commanded is None and touches.frame == "sheet"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "must name the columns output, angle_deg; it names nothing"),
        ("output,angle\n1,2\n", "it names output, angle"),
        ("output,angle_deg\n1,2\n3\n", "line 3: has 1 cells, the first line 2"),
        ("output,angle_deg\n1,two\n", "line 2, column angle_deg: 'two' is not a number"),
        ("output,angle_deg\n1,nan\n", "line 2, column angle_deg: nan is not a finite number"),
        (b"\xff\xfe", "is not a text file in UTF-8"),
        ('output,angle_deg\n1,"2\n' + "x" * 200_000, "line"),
    ],
)
def test_a_table_that_is_wrong_says_where(tmp_path: Path, text: str | bytes, says: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(CalibrationError, match=f"{path}: .*{says}"):
        read_marks(path)


def test_a_table_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"none\.csv: cannot be read: No such file"):
        read_marks(tmp_path / "none.csv")


@pytest.mark.parametrize("more", [False, True])
def test_points_are_written_as_they_are_read(tmp_path: Path, more: bool) -> None:
    robot, rng = load_robot("mico"), np.random.default_rng(1)
    q, points = rng.uniform(-1.0, 1.0, (8, robot.n)), rng.uniform(-0.3, 0.3, (8, 3))
    sense = np.sign(q) if more else None
    touches = Touches.checked(robot, q, points, "sheet", sense, q + 0.01 if more else None)
    read = read_touches(written(tmp_path, touches_csv(touches, robot)), robot, "sheet")
    np.testing.assert_allclose(read.q, q, atol=1e-5)
    np.testing.assert_allclose(read.points_m, points, atol=6e-6)
    assert (read.sense is not None) is (read.commanded is not None) is more
    np.testing.assert_array_equal(read.senses, touches.senses)
