"""A program's steps as people read them: table rows and pages."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from armctl.program import (
    ArcStep,
    CommentStep,
    EndStep,
    GripperStep,
    LineStep,
    MotionStep,
    MoveStep,
    PointStep,
    RepeatStep,
    SpeedStep,
    Step,
    WaitStep,
    depths_of,
)

PAGE_ROWS = 15
_CELL = "padding:0 6px;white-space:nowrap;overflow:hidden;text-overflow:ellipsis;max-width:290px"
_SELECTED = "background:rgba(34,139,230,.20);box-shadow:inset 3px 0 #228be6"
_RUNNING = "background:rgba(64,192,87,.28);font-weight:600"
_DEEPEST_SHOWN = 8
_INDENT_PX = 12
_PLAIN_PROFILE = "cubic"


def describe(step: Step) -> tuple[str, str]:
    """Kind and content of a step, in words."""
    match step:
        case MoveStep():
            return "pose", f"{_listed(step.joints_deg)} °{_way(step)}"
        case PointStep():
            pitch = "" if step.pitch_deg is None else f", pitch {_short(step.pitch_deg)}°"
            roll = "" if step.roll_deg is None else f", roll {_short(step.roll_deg)}°"
            return "point", f"{_point(step.x_mm, step.y_mm, step.z_mm)}{pitch}{roll}{_way(step)}"
        case LineStep():
            return "line", f"{_point(step.x_mm, step.y_mm, step.z_mm)}{_led(step)}{_way(step)}"
        case ArcStep():
            via = f"via {_point(step.via_x_mm, step.via_y_mm, step.via_z_mm)}"
            return "arc", f"{_point(step.x_mm, step.y_mm, step.z_mm)} {via}{_led(step)}{_way(step)}"
        case WaitStep():
            return "wait", f"{step.seconds:g} s"
        case GripperStep():
            return "gripper", f"{step.open_percent:g} % open"
        case SpeedStep():
            return "speed", f"{step.percent:g} % from here on"
        case RepeatStep():
            return "repeat", f"{step.times} times"
        case EndStep():
            return "end", "of the repeat"
        case CommentStep():
            return "#", ""


def page_of(row: int) -> int:
    """The page (from 0) that shows a row (from 0)."""
    return max(row, 0) // PAGE_ROWS


def page_count(rows: int) -> int:
    """How many pages there are; an empty list has one."""
    return max(1, -(-rows // PAGE_ROWS))


def step_table(steps: Sequence[Step], page: int, selected: int | None, running: int | None) -> str:
    """One page of the list as HTML; what is inside a repeat is set in.

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
    depths = depths_of(steps)
    parts = ["<table style='border-collapse:collapse;width:100%;line-height:1.35'>"]
    first = page * PAGE_ROWS
    for index, step in enumerate(steps[first : first + PAGE_ROWS], first):
        kind, content = describe(step)
        marks = [text for here, text in ((selected, _SELECTED), (running, _RUNNING)) if here == index]
        content = " · ".join(text for text in (content, step.note) if text)
        inset = 6 + _INDENT_PX * min(depths[index], _DEEPEST_SHOWN)
        parts.append(
            f"<tr style='border-top:1px solid rgba(128,128,128,.2);{';'.join(marks)}'>"
            f"<td style='{_CELL};text-align:right'>{'▶ ' if index == running else ''}{index + 1}</td>"
            f"<td style='{_CELL};padding-left:{inset}px'>{kind}</td>"
            f"<td style='{_CELL};width:100%' title='{escape(content)}'>{escape(content)}</td></tr>"
        )
    return "".join([*parts, "</table>"])


def _short(value: float) -> str:
    return f"{round(value, 2) + 0.0:g}".replace("-", "−")


def _listed(values: Sequence[float]) -> str:
    return ", ".join(map(_short, values))


def _point(x_mm: float, y_mm: float, z_mm: float) -> str:
    return f"({_listed((x_mm, y_mm, z_mm))}) mm"


def _led(step: LineStep | ArcStep) -> str:
    pitch = "" if step.pitch_deg is None else f" to {_short(step.pitch_deg)}°"
    mode = "" if step.pitch == "kept" else f", pitch {step.pitch}{pitch}"
    return mode if step.speed_mm_s is None else f"{mode}, {_short(step.speed_mm_s)} mm/s"


def _way(step: MotionStep) -> str:
    seconds = "" if step.duration_s is None else f" in {step.duration_s:g} s"
    profile = step.profile if isinstance(step, MoveStep | PointStep) else _PLAIN_PROFILE
    law = "" if profile == _PLAIN_PROFILE else f", {profile}"
    return f"{seconds}{law}{f', blend {step.blend_mm:g} mm' if step.blend_mm else ''}"
