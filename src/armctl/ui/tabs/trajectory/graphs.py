"""Graphs of a motion, with its limits, another motion beside it, and the table of its peaks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from armctl.motion.analysis import Derivative, Limit, MotionAnalysis, near_limits
from armctl.robot import Robot
from armctl.ui.tabs.trajectory.motions import PlannedMotion, ShownMotion
from armctl.ui.widgets.html import fixed, heading, muted, numbers, strong, table
from armctl.ui.widgets.plots import COLORS, Line, Picture, span, thinned, upright

FloatArray = NDArray[np.float64]
Of = Literal["Tool", "Joints"]
Quantity = Literal["Position", "Velocity", "Acceleration", "Jerk"]
LimitsShown = Literal["near", "all", "none"]
OF: tuple[Of, ...] = get_args(Of)
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
LIMITS: tuple[LimitsShown, ...] = get_args(LimitsShown)
_DERIVATIVE: dict[str, Derivative] = {
    "Position": "position",
    "Velocity": "velocity",
    "Acceleration": "acceleration",
    "Jerk": "jerk",
}
_PER = {"Position": "", "Velocity": "/s", "Acceleration": "/s²", "Jerk": "/s³"}
_PLOT_SAMPLES = 600
_MANY, _CURSOR, _FLOOR = "#868e96", "#c2255c", "#846358"
_LIMIT_DASH, _OTHER_DASH = (8.0, 5.0), (3.0, 3.0)
_FLOOR_NEAR_M = 0.05
"""the floor is drawn where the tool comes this near"""


@dataclass(frozen=True, slots=True)
class GraphChoice:
    """What is drawn."""

    of: str = "Tool"
    quantity: str = "Position"
    limits: str = "near"


def graph(
    robot: Robot,
    shown: ShownMotion,
    choice: GraphChoice,
    cursor: float | None = None,
    beside: ShownMotion | None = None,
) -> Picture:
    """One quantity of the tool (mm) or of the joints (degrees) over time.

    Args:
        robot: the arm.
        shown: the motion.
        choice: of what.
        cursor: where an upright line is drawn [s].
        beside: another motion, drawn thin and dashed.
    """
    time = _times(shown, beside)
    names, unit = _names(robot, choice.of)
    mark = "" if beside is None else "B "
    lines = _lines(shown, choice, time, tuple(f"{mark}{name}" for name in names))
    if beside is not None:
        others = _lines(beside, choice, time, tuple(f"A {name}" for name in names))
        lines += [Line(line.name, line.y, line.color, dash=_OTHER_DASH, width=1.2) for line in others]
    lines += _limit_lines(robot, shown, choice, time)
    if cursor is not None:
        lines.append(Line("cursor", upright(time, cursor, *span(lines)), _CURSOR, width=1.2))
    title = f"{'Joint' if choice.of == 'Joints' else 'Tool'} {choice.quantity.lower()}"
    return Picture(f"{title} ({unit}{_PER[choice.quantity]})", "time (s)", time, tuple(lines))


def peaks_html(robot: Robot, shown: ShownMotion) -> str:
    """Duration, largest joint speeds and accelerations against their limits, largest tool speed."""
    planned, motion, peaks = shown.planned, shown.motion, shown.peaks
    rows = [
        [joint.title, fixed(v, 1), fixed(v_limit, 0), fixed(a, 1), fixed(a_limit, 0)]
        for joint, v, v_limit, a, a_limit in zip(
            robot.joints,
            *(
                np.degrees(value).tolist()
                for value in (
                    peaks.speed, robot.speed_limits, peaks.acceleration, robot.acceleration_limits,
                )
            ),
            strict=True,
        )
    ]  # fmt: skip
    tool_speed = 1000 * float(motion.tool_speed.max())
    tool_push = 1000 * float(np.linalg.norm(motion.tool_acceleration, axis=1).max())
    asked = "" if planned.speed is None else f" (asked for: {fixed(1000 * planned.speed, 0)} mm/s)"
    head = ["largest", "speed °/s", "limit", "acc. °/s²", "limit"]
    return (
        strong(f"{planned.title}: {fixed(planned.trajectory.duration, 3)} s")
        + (muted(planned.note) if planned.note else "")
        + heading("Peaks against the limits")
        + table(head, rows)
        + muted(f"tool: at most {fixed(tool_speed, 1)} mm/s{asked} and {fixed(tool_push, 0)} mm/s²")
    )


def _times(shown: ShownMotion, beside: ShownMotion | None) -> FloatArray:
    """When the plot has points: samples of the motion, and beyond its end what a longer one needs."""
    own = shown.motion.time[thinned(len(shown.motion.time), _PLOT_SAMPLES)]
    if beside is None or beside.motion.time[-1] <= own[-1]:
        return own
    begin, end = float(own[-1]), float(beside.motion.time[-1])
    return np.concatenate([own, np.linspace(begin, end, _PLOT_SAMPLES // 2)[1:]])


def _names(robot: Robot, of: str) -> tuple[tuple[str, ...], str]:
    if of == "Tool":
        return ("x", "y", "z"), "mm"
    return tuple(joint.title for joint in robot.joints), "°"


def _lines(shown: ShownMotion, choice: GraphChoice, time: FloatArray, names: tuple[str, ...]) -> list[Line]:
    values = _values(shown.motion, choice)
    at = shown.motion.time
    return [
        Line(name, np.interp(time, at, values[:, i], right=np.nan), COLORS[i % len(COLORS)])
        for i, name in enumerate(names)
    ]


def _values(motion: MotionAnalysis, choice: GraphChoice) -> FloatArray:
    """(k, m) in mm or degrees."""
    if choice.of == "Tool":
        tool = {
            "Position": motion.position,
            "Velocity": motion.tool_velocity,
            "Acceleration": motion.tool_acceleration,
            "Jerk": motion.tool_jerk,
        }
        return 1000 * tool[choice.quantity]
    joints = {
        "Position": motion.q,
        "Velocity": motion.velocity,
        "Acceleration": motion.acceleration,
        "Jerk": motion.jerk,
    }
    return np.degrees(joints[choice.quantity])


def _limit_lines(robot: Robot, shown: ShownMotion, choice: GraphChoice, time: FloatArray) -> list[Line]:
    if choice.limits == "none":
        return []
    if choice.of == "Tool":
        near = float(shown.motion.position[:, 2].min()) < robot.floor_z + _FLOOR_NEAR_M
        if choice.quantity != "Position" or not (near or choice.limits == "all"):
            return []
        return [_level("floor", 1000 * robot.floor_z, _FLOOR, time)]
    found = near_limits(robot, shown.motion, _DERIVATIVE[choice.quantity], every=choice.limits == "all")
    together: dict[float, list[Limit]] = {}
    for limit in found:
        together.setdefault(round(limit.value, 3), []).append(limit)
    return [
        _level(_limit_name(robot, limits), value, _limit_color(limits), time)
        for value, limits in sorted(together.items(), reverse=True)
    ]


def _limit_name(robot: Robot, limits: list[Limit]) -> str:
    who = robot.joints[limits[0].joint].title if len(limits) == 1 else f"{len(limits)} joints"
    return f"{who} {'≤' if limits[0].is_upper else '≥'} {fixed(limits[0].value, 1).removesuffix('.0')}"


def _limit_color(limits: list[Limit]) -> str:
    return COLORS[limits[0].joint % len(COLORS)] if len(limits) == 1 else _MANY


def _level(name: str, value: float, color: str, time: FloatArray) -> Line:
    return Line(name, np.full(len(time), value), color, dash=_LIMIT_DASH, width=1.2)


def cursor_html(robot: Robot, planned: PlannedMotion, time: float) -> str:
    """Where the tool and the joints are at one time [s], and how fast."""
    state = planned.trajectory.sample(time)
    point = 1000 * robot.forward(state.q)[:3, 3]
    speed = 1000 * float(np.linalg.norm(robot.jacobian(state.q)[:3] @ state.velocity))
    head = ["", *(joint.title for joint in robot.joints)]
    rows = [
        ["θ °", *(fixed(value, 2) for value in np.degrees(state.q).tolist())],
        ["°/s", *(fixed(value, 1) for value in np.degrees(state.velocity).tolist())],
        ["°/s²", *(fixed(value, 0) for value in np.degrees(state.acceleration).tolist())],
    ]
    return (
        f"<div>at {fixed(time, 2)} s: tool (<b>{numbers(point.tolist(), 1)}</b>) mm, {fixed(speed, 1)} mm/s"
        f"{_step_text(planned, time)}</div>"
        f"<div style='font-size:11.5px'>{table(head, rows)}</div>"
    )


def _step_text(planned: PlannedMotion, time: float) -> str:
    step = planned.step_at(time)
    return "" if step is None else f", step {step + 1}"
