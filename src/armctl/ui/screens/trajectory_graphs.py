"""Graphs and the table of peaks of a motion."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armctl.motion.analysis import MotionAnalysis, peak_rates
from armctl.robot import Robot
from armctl.ui.screens.trajectory_motion import PlannedMotion
from armctl.ui.widgets.html_bits import fixed, heading, muted, numbers, strong
from armctl.ui.widgets.plots import COLORS, Line, Picture
from armctl.ui.widgets.text import table

FloatArray = NDArray[np.float64]
Of = Literal["Tool", "Joints"]
Quantity = Literal["Position", "Velocity", "Acceleration"]
OF: tuple[Of, ...] = ("Tool", "Joints")
QUANTITIES: tuple[Quantity, ...] = ("Position", "Velocity", "Acceleration")
_PER = {"Position": "", "Velocity": "/s", "Acceleration": "/s²"}


def graph(robot: Robot, motion: MotionAnalysis, of: str, quantity: str) -> Picture:
    """One quantity of the tool (mm) or of the joints (degrees) over time."""
    per = _PER[quantity]
    if of == "Tool":
        values = {
            "Position": motion.position,
            "Velocity": motion.tool_velocity,
            "Acceleration": motion.tool_acceleration,
        }[quantity]
        names, shown, unit = ("x", "y", "z"), 1000 * values, "mm"
    else:
        values = {
            "Position": motion.q,
            "Velocity": motion.velocity,
            "Acceleration": motion.acceleration,
        }[quantity]
        names, shown, unit = tuple(joint.title for joint in robot.joints), np.degrees(values), "°"
    lines = tuple(
        Line(name, np.ascontiguousarray(shown[:, i]), COLORS[i % len(COLORS)]) for i, name in enumerate(names)
    )
    title = f"{of[:-1] if of == 'Joints' else of} {quantity.lower()} ({unit}{per})"
    return Picture(title, "time (s)", motion.time, lines)


def peaks_html(robot: Robot, planned: PlannedMotion, motion: MotionAnalysis) -> str:
    """Duration, largest joint speeds and accelerations against their limits, largest tool speed."""
    speed, push = peak_rates(planned.trajectory)
    shown = zip(
        robot.joints,
        *(np.degrees(v).tolist() for v in (speed, robot.speed_limits, push, robot.acceleration_limits)),
        strict=True,
    )
    rows = [
        [joint.title, fixed(v, 1), fixed(v_limit, 0), fixed(a, 1), fixed(a_limit, 0)]
        for joint, v, v_limit, a, a_limit in shown
    ]
    tool_speed = 1000 * float(np.linalg.norm(motion.tool_velocity, axis=1).max())
    tool_push = 1000 * float(np.linalg.norm(motion.tool_acceleration, axis=1).max())
    head = ["largest", "speed °/s", "limit", "acc. °/s²", "limit"]
    return (
        strong(f"{planned.title}: {fixed(planned.trajectory.duration, 3)} s")
        + (muted(planned.note) if planned.note else "")
        + heading("Peaks against the limits")
        + table(head, rows)
        + muted(f"tool: at most {fixed(tool_speed, 1)} mm/s and {fixed(tool_push, 0)} mm/s²")
    )


def cursor_html(robot: Robot, planned: PlannedMotion, time: float) -> str:
    """Where the tool and the joints are at one time [s]."""
    q = planned.trajectory.sample(time).q
    point = 1000 * robot.forward(q)[:3, 3]
    return (
        f"<div>at {fixed(time, 2)} s: tool (<b>{numbers(point.tolist(), 1)}</b>) mm</div>"
        f"<div>θ = ({numbers(np.degrees(q).tolist(), 2)})°</div>"
    )
