"""A program's steps as people read them: table rows, pages, and a CSV file."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from html import escape

from armctl.motion import GripperStep, MoveStep, PointStep, Program, Step, WaitStep
from armctl.robot import Robot

PAGE_ROWS = 15
_CELL = "padding:0 6px;white-space:nowrap;overflow:hidden;text-overflow:ellipsis;max-width:290px"
_SELECTED = "background:rgba(34,139,230,.20);box-shadow:inset 3px 0 #228be6"
_RUNNING = "background:rgba(64,192,87,.28);font-weight:600"


def describe(step: Step) -> tuple[str, str]:
    """Kind and content of a step, in words."""
    match step:
        case MoveStep():
            angles = ", ".join(_short(value) for value in step.joints_deg)
            return "pose", f"{angles} °{_in(step.duration_s)}"
        case PointStep():
            where = f"({_short(step.x_mm)}, {_short(step.y_mm)}, {_short(step.z_mm)}) mm"
            pitch = "" if step.pitch_deg is None else f", pitch {_short(step.pitch_deg)}°"
            roll = "" if step.roll_deg is None else f", roll {_short(step.roll_deg)}°"
            return "point", f"{where}{pitch}{roll}{_in(step.duration_s)}"
        case WaitStep():
            return "wait", f"{step.seconds:g} s"
        case GripperStep():
            return "gripper", f"{step.open_percent:g} % open"


def page_of(row: int) -> int:
    """The page (from 0) that shows a row (from 0)."""
    return max(row, 0) // PAGE_ROWS


def page_count(rows: int) -> int:
    """How many pages there are; an empty list has one."""
    return max(1, -(-rows // PAGE_ROWS))


def step_table(steps: Sequence[Step], page: int, selected: int | None, running: int | None) -> str:
    """One page of the list as HTML.

    Args:
        steps: all of them.
        page: which page, from 0.
        selected: index of the selected row.
        running: index of the step that the arm does now.
    """
    if not steps:
        return (
            "<div style='opacity:.75'>No steps yet. Bring the arm somewhere (Joints, Jog), then press "
            "<b>Record pose</b>; repeat; press <b>Run once</b>.</div>"
        )
    parts = ["<table style='border-collapse:collapse;width:100%;line-height:1.35'>"]
    first = page * PAGE_ROWS
    for index, step in enumerate(steps[first : first + PAGE_ROWS], first):
        kind, content = describe(step)
        marks = [text for here, text in ((selected, _SELECTED), (running, _RUNNING)) if here == index]
        content += f" · {step.note}" if step.note else ""
        parts.append(
            f"<tr style='border-top:1px solid rgba(128,128,128,.2);{';'.join(marks)}'>"
            f"<td style='{_CELL};text-align:right'>{'▶ ' if index == running else ''}{index + 1}</td>"
            f"<td style='{_CELL}'>{kind}</td><td style='{_CELL};width:100%'>{escape(content)}</td></tr>"
        )
    return "".join([*parts, "</table>"])


def program_csv(program: Program, robot: Robot) -> str:
    """The program for a spreadsheet: one row a step, units in the heads, empty where there is nothing."""
    joints = [f"{name}_deg" for name in robot.joint_names]
    point = ["x_mm", "y_mm", "z_mm", "pitch_deg", "roll_deg"]
    out = io.StringIO()
    writer = csv.DictWriter(
        out,
        ["step", "kind", *joints, *point, "gripper_percent", "wait_s", "duration_s"],
        restval="",
        lineterminator="\r\n",
    )
    writer.writeheader()
    for number, step in enumerate(program.steps, 1):
        row: dict[str, object] = {"step": number, "kind": describe(step)[0]}
        match step:
            case MoveStep():
                row |= dict(zip(joints, step.joints_deg, strict=False)) | {"duration_s": step.duration_s}
            case PointStep():
                row |= {key: getattr(step, key) for key in point} | {"duration_s": step.duration_s}
            case WaitStep():
                row["wait_s"] = step.seconds
            case GripperStep():
                row["gripper_percent"] = step.open_percent
        writer.writerow(row)
    return out.getvalue()


def _short(value: float) -> str:
    return f"{round(value, 2) + 0.0:g}".replace("-", "−")


def _in(duration_s: float | None) -> str:
    return "" if duration_s is None else f" in {duration_s:g} s"
