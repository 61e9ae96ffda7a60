"""A grid of cells: where they are, the order, and that the check walks each of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.program.kit import program

from armctl.errors import ProgramError
from armctl.facts import CellOutsideGrid, OnPath, PathTurn
from armctl.program import (
    Cursor,
    EndStep,
    GridStep,
    LineStep,
    MoveStep,
    PointStep,
    RepeatStep,
    check_program,
    load_program,
    read_csv,
    save_program,
    write_csv,
    write_script,
)
from armctl.program.rehearsal import pose_after, rehearse
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
END = EndStep()
HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))
CORNERS = dict(
    x_mm=180, y_mm=-30, z_mm=80, row_x_mm=180, row_y_mm=30, row_z_mm=80,
    column_x_mm=220, column_y_mm=-30, column_z_mm=80,
)  # fmt: skip
ABOVE, AT = PointStep(x_mm=0, y_mm=0, z_mm=30, frame="cell"), LineStep(x_mm=0, y_mm=0, z_mm=0, frame="cell")


def grid(rows: int = 2, columns: int = 3, layers: int = 1, **more: object) -> GridStep:
    size = {"rows": rows, "columns": columns, "layers": layers, "layer_mm": 10}
    keys: dict[str, Any] = {**CORNERS, **size, **more}
    return GridStep(**keys)


def test_cells_come_in_their_order() -> None:
    places = {
        order: [grid(layers=2, order=order).place(k) for k in range(7)]
        for order in ("rows", "columns", "snake")
    }
    assert places["rows"] == [(0, 0, 0), (0, 1, 0), (0, 2, 0), (1, 0, 0), (1, 1, 0), (1, 2, 0), (0, 0, 1)]
    assert places["columns"] == [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (0, 2, 0), (1, 2, 0), (0, 0, 1)]
    assert places["snake"] == [(0, 0, 0), (0, 1, 0), (0, 2, 0), (1, 2, 0), (1, 1, 0), (1, 0, 0), (0, 0, 1)]
    cells = [grid(layers=2).cell(k) for k in (0, 1, 2, 3, 5, 6, 11)]
    np.testing.assert_allclose(
        cells,
        [
            (180, -30, 80), (180, 0, 80), (180, 30, 80), (220, -30, 80), (220, 30, 80), (180, -30, 90),
            (220, 30, 90),
        ],
    )  # fmt: skip
    assert grid(1, 1).cell(0) == (180, -30, 80)


def test_points_in_the_frame_of_a_cell_follow_it_and_others_stay() -> None:
    fixed = PointStep(x_mm=200, y_mm=0, z_mm=130)
    what = program(grid(1, 2), fixed, ABOVE, RepeatStep(times=2), AT, END, END)
    cursor = Cursor(what)
    seen: list[tuple[int, float, float]] = []
    while (found := cursor.next()) is not None:
        assert isinstance(found[1], PointStep | LineStep) and found[1].frame is None
        seen.append((found[0], found[1].y_mm, found[1].z_mm))
    assert seen == [
        (1, 0, 130), (2, -30, 110), (4, -30, 80), (4, -30, 80),
        (1, 0, 130), (2, 30, 110), (4, 30, 80), (4, 30, 80),
    ]  # fmt: skip


def test_the_check_walks_each_cell_and_names_it() -> None:
    home = ROBOT.pose("home")
    what = program(HOME, grid(3, 4, 2), ABOVE, AT, ABOVE, END, HOME)
    assert check_program(what, ROBOT, start=home) == []
    steps = rehearse(ROBOT, what, home).steps
    assert [step.index for step in steps] == [0, *24 * [2, 3, 4], 6]
    tips = {
        tuple(np.round(1000 * ROBOT.forward(s.trajectory.end)[:3, 3]).tolist()) for s in steps if s.index == 3
    }
    assert len(tips) == 24
    far = program(HOME, grid(3, 4, 2, column_x_mm=340), ABOVE, END)
    (found, *_) = check_program(far, ROBOT, start=home)
    assert found.step == 2 and isinstance(found.reason, OnPath)
    (turn,) = found.reason.turns
    reached = [check_program(program(HOME, PointStep(x_mm=x, y_mm=y, z_mm=z + 30)), ROBOT, start=home) == []
               for x, y, z in map(grid(3, 4, 2, column_x_mm=340).cell, range(24))]  # fmt: skip
    assert turn == PathTurn(1, "cell", reached.index(False) + 1)
    assert f"(path: step 2: cell {turn.number})" in str(found)


def test_it_goes_through_files_and_tables(tmp_path: Path) -> None:
    what = program(grid(order="snake"), ABOVE, AT, END)
    save_program(what, tmp_path / "pick.toml")
    assert load_program(tmp_path / "pick.toml") == what
    assert read_csv(write_csv(what, ROBOT), ROBOT, "pick") == what
    assert what.steps[0].describe() == "2 rows × 3 columns, snake"
    assert ABOVE.describe().startswith("0, 0, 30 mm from the cell")
    with pytest.raises(ProgramError, match="step 1: no call of Arm does what a 'grid' step does"):
        write_script(what)


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (grid(layers=2, layer_mm=0), "2 layers need a layer_mm"),
        (grid(100, 101), "at most 10000 cells, not 10100"),
        (grid(row_y_mm=-30), "the corners must be apart"),
        (grid(column_x_mm=180, column_y_mm=30), "lie on a line"),
    ],
)
def test_what_gives_no_grid_is_refused(step: GridStep, message: str) -> None:
    (finding,) = check_program(program(step, END), ROBOT)
    assert finding.step == 0 and message in finding.what


def test_a_cell_needs_its_grid() -> None:
    what = program(HOME, grid(1, 1), ABOVE, END, RepeatStep(times=2), ABOVE, END)
    (finding,) = check_program(what, ROBOT)
    assert (finding.step, finding.reason) == (5, CellOutsideGrid())


def test_the_pose_of_a_row_is_that_in_the_first_cell() -> None:
    found = pose_after(ROBOT, program(HOME, grid(), ABOVE, AT, END), 3, ROBOT.pose("home"))
    assert found is not None
    np.testing.assert_allclose(1000 * ROBOT.forward(found)[:3, 3], (180, -30, 80), atol=1e-6)
