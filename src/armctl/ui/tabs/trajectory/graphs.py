"""A motion in pictures and figures: graphs with limits, peaks, one instant, and two motions compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from armctl.arrays import FloatArray
from armctl.motion.analysis import Derivative, Limit, near_limits
from armctl.robot import Robot
from armctl.ui.tabs.trajectory.plan import PlannedMotion, ShownMotion
from armctl.ui.widgets.html import fixed, heading, muted, numbers, strong, table
from armctl.ui.widgets.plots import COLORS, Line, Picture, span, thinned, upright

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
    """The choices above the plot."""

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
        choice: what to plot.
        cursor: where an upright line is drawn [s].
        beside: another motion, drawn thin and dashed.
    """
    time = shown.motion.time[thinned(len(shown.motion.time), _PLOT_SAMPLES)]
    if beside is not None and beside.motion.time[-1] > time[-1]:  # the other one takes longer
        rest = np.linspace(float(time[-1]), float(beside.motion.time[-1]), _PLOT_SAMPLES // 2)
        time = np.concatenate([time, rest[1:]])
    lines = _lines(robot, shown, choice, time, "" if beside is None else "B ")
    if beside is not None:
        others = _lines(robot, beside, choice, time, "A ")
        lines += [Line(line.name, line.y, line.color, dash=_OTHER_DASH, width=1.2) for line in others]
    lines += _limit_lines(robot, shown, choice, time)
    if cursor is not None:
        lines.append(Line("cursor", upright(time, cursor, *span(lines)), _CURSOR, width=1.2))
    who, unit = ("Joint", "°") if choice.of == "Joints" else ("Tool", "mm")
    title = f"{who} {choice.quantity.lower()} ({unit}{_PER[choice.quantity]})"
    return Picture(title, "time (s)", time, tuple(lines))


def _lines(robot: Robot, shown: ShownMotion, choice: GraphChoice, time: FloatArray, mark: str) -> list[Line]:
    motion = shown.motion
    if choice.of == "Tool":
        names = ["x", "y", "z"]
        values = (
            1000
            * {
                "Position": motion.position,
                "Velocity": motion.tool_velocity,
                "Acceleration": motion.tool_acceleration,
                "Jerk": motion.tool_jerk,
            }[choice.quantity]
        )
    else:
        names = [joint.title for joint in robot.joints]
        joints = {
            "Position": motion.q,
            "Velocity": motion.velocity,
            "Acceleration": motion.acceleration,
            "Jerk": motion.jerk,
        }
        values = np.degrees(joints[choice.quantity])
    return [
        Line(
            f"{mark}{name}",
            np.interp(time, motion.time, values[:, i], right=np.nan),
            COLORS[i % len(COLORS)],
        )
        for i, name in enumerate(names)
    ]


def _limit_lines(robot: Robot, shown: ShownMotion, choice: GraphChoice, time: FloatArray) -> list[Line]:
    def level(name: str, value: float, color: str) -> Line:
        return Line(name, np.full(len(time), value), color, dash=_LIMIT_DASH, width=1.2)

    every = choice.limits == "all"
    if choice.limits == "none":
        return []
    if choice.of == "Tool":
        near = float(shown.motion.position[:, 2].min()) < robot.floor_z + _FLOOR_NEAR_M
        floor = choice.quantity == "Position" and (near or every)
        return [level("floor", 1000 * robot.floor_z, _FLOOR)] if floor else []
    together: dict[float, list[Limit]] = {}  # equal limits of several joints are one line
    for limit in near_limits(robot, shown.motion, _DERIVATIVE[choice.quantity], every=every):
        together.setdefault(round(limit.value, 3), []).append(limit)
    lines: list[Line] = []
    for value, limits in sorted(together.items(), reverse=True):
        first, alone = limits[0], len(limits) == 1
        who = robot.joints[first.joint].title if alone else f"{len(limits)} joints"
        name = f"{who} {'≤' if first.is_upper else '≥'} {fixed(first.value, 1).removesuffix('.0')}"
        lines.append(level(name, value, COLORS[first.joint % len(COLORS)] if alone else _MANY))
    return lines


def peaks_html(robot: Robot, shown: ShownMotion) -> str:
    """Duration, largest joint speeds and accelerations against their limits, largest tool speed."""
    planned, motion, peaks = shown.planned, shown.motion, shown.peaks
    columns = (peaks.speed, robot.speed_limits, peaks.acceleration, robot.acceleration_limits)
    rows = [
        [joint.title, *(fixed(value, digits) for value, digits in zip(row, (1, 0, 1, 0), strict=True))]
        for joint, row in zip(robot.joints, np.degrees(np.column_stack(columns)).tolist(), strict=True)
    ]
    tool_speed = 1000 * float(motion.tool_speed.max())
    tool_acceleration = 1000 * float(np.linalg.norm(motion.tool_acceleration, axis=1).max())
    asked = "" if planned.speed is None else f" (asked for: {fixed(1000 * planned.speed, 0)} mm/s)"
    return (
        strong(f"{planned.title}: {fixed(planned.trajectory.duration, 3)} s")
        + (muted(planned.note) if planned.note else "")
        + heading("Peaks against the limits")
        + table(["largest", "speed °/s", "limit", "acc. °/s²", "limit"], rows)
        + muted(f"tool: at most {fixed(tool_speed, 1)} mm/s{asked} and {fixed(tool_acceleration, 0)} mm/s²")
    )


def cursor_html(robot: Robot, planned: PlannedMotion, time: float) -> str:
    """Where the tool and the joints are at one time [s], and how fast."""
    state = planned.trajectory.sample(time)
    point = 1000 * robot.forward(state.q)[:3, 3]
    speed = 1000 * float(np.linalg.norm(robot.jacobian(state.q)[:3] @ state.velocity))
    step = planned.step_at(time)
    rows = [
        ["θ °", *(fixed(value, 2) for value in np.degrees(state.q).tolist())],
        ["°/s", *(fixed(value, 1) for value in np.degrees(state.velocity).tolist())],
        ["°/s²", *(fixed(value, 0) for value in np.degrees(state.acceleration).tolist())],
    ]
    return (
        f"<div>at {fixed(time, 2)} s: tool (<b>{numbers(point.tolist(), 1)}</b>) mm, {fixed(speed, 1)} mm/s"
        f"{'' if step is None else f', step {step + 1}'}</div><div style='font-size:11.5px'>"
        f"{table(['', *(joint.title for joint in robot.joints)], rows)}</div>"
    )


def compare_html(robot: Robot, a: ShownMotion, b: ShownMotion) -> str:
    """Durations, peaks of the joints as a share of their limits, and the largest tool speeds of both."""
    rows = [
        ["duration s", *(fixed(shown.planned.trajectory.duration, 3) for shown in (a, b))],
        ["tool, largest mm/s", *(fixed(1000 * float(shown.motion.tool_speed.max()), 1) for shown in (a, b))],
    ]
    shares = np.column_stack(
        [
            *(shown.peaks.speed / robot.speed_limits for shown in (a, b)),
            *(shown.peaks.acceleration / robot.acceleration_limits for shown in (a, b)),
            *(np.abs(shown.motion.jerk).max(axis=0) / robot.jerk_limits for shown in (a, b)),
        ]
    )
    percent = [
        [joint.title, *(fixed(100 * share, 0) for share in row)]
        for joint, row in zip(robot.joints, shares.tolist(), strict=True)
    ]
    return (
        muted(f"A (dashed): {a.planned.title}")
        + muted(f"B: {b.planned.title}")
        + table(["", "A", "B"], rows)
        + table(["% of limit", "speed A", "B", "acc. A", "B", "jerk A", "B"], percent)
        + muted("Only quintic and s-curve keep the jerk limits; trapezoid and cubic jump in acceleration.")
    )
