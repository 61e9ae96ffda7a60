"""Programs for spreadsheets: one row a step, every number with its unit in the head."""

from __future__ import annotations

import csv
import io
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ProgramError
from armctl.motion.program.csv_columns import JOINTS, NUMBER, heads_in_order
from armctl.motion.program.csv_text import guarded
from armctl.motion.program.program import MoveStep, PointStep, Program, Step, defaults_of, kind_of
from armctl.robot import Robot

CsvForm = Literal["angles", "points"]
"""angles: every step as it is; points: moves to angles become points of the tool"""
FloatArray = NDArray[np.float64]
_DIGITS = 6


def write_csv(program: Program, robot: Robot, form: CsvForm = "angles") -> str:
    """The program as CSV; ``read_csv`` gives the same steps again.

    With ``points``, a move is written as the point (with tool pitch and roll, where the arm has them) to
    which its angles lead. Which of the solutions the arm takes there is then chosen when it is run.

    Args:
        program: what to write; its name is not in the file.
        robot: names the columns.
        form: how moves are written.

    Raises:
        ProgramError: a move has another number of angles than the arm has joints; names the step.
    """
    for index, step in enumerate(program.steps):
        if isinstance(step, MoveStep) and len(step.joints_deg) != robot.n:
            raise ProgramError(
                f"step {index + 1}: {robot.name} has {robot.n} joints, "
                f"the step has {len(step.joints_deg)} angles"
            )
    steps = _as_points(program.steps, robot) if form == "points" else program.steps
    records = [_cells(step) for step in steps]
    used = {place for record in records for place in record} | {("do", None)}
    if not steps:
        used |= {(JOINTS, i) for i in range(robot.n)}
    columns = [
        (head, (key, joint)) for head, key, joint in heads_in_order(robot.joint_names) if (key, joint) in used
    ]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\r\n")
    writer.writerow([NUMBER, *(guarded(head) for head, _ in columns)])
    for number, record in enumerate(records, 1):
        writer.writerow([number, *(record.get(place, "") for _, place in columns)])
    return out.getvalue()


def _cells(step: Step) -> dict[tuple[str, int | None], object]:
    """(key, joint) to what its cell holds; what is as by default is left out."""
    cells: dict[tuple[str, int | None], object] = {("do", None): kind_of(step)}
    for key, default in defaults_of(step).items():
        value = getattr(step, key)
        if key == JOINTS:
            cells |= {(JOINTS, i): angle for i, angle in enumerate(value)}
        elif value is not None and value != default:
            cells[key, None] = guarded(value) if isinstance(value, str) else value
    return cells


def _as_points(steps: tuple[Step, ...], robot: Robot) -> list[Step]:
    """The steps with moves led through forward kinematics."""
    moves = [step for step in steps if isinstance(step, MoveStep)]
    if not moves:
        return list(steps)
    q = np.radians([step.joints_deg for step in moves])
    points = np.round(1000 * robot.forward(q)[:, :3, 3], _DIGITS)
    found = (_as_point(step, robot, q[i], points[i]) for i, step in enumerate(moves))
    return [next(found) if isinstance(step, MoveStep) else step for step in steps]


def _as_point(step: MoveStep, robot: Robot, q: FloatArray, point_mm: FloatArray) -> PointStep:
    pitch, roll = (
        None if angle is None else round(float(np.degrees(angle)), _DIGITS)
        for angle in robot.inverse_kinematics.pitch_and_roll(q)
    )
    x, y, z = point_mm.tolist()
    return PointStep(
        x_mm=x,
        y_mm=y,
        z_mm=z,
        pitch_deg=pitch,
        roll_deg=roll,
        profile=step.profile,
        duration_s=step.duration_s,
        blend_mm=step.blend_mm,
        note=step.note,
    )
