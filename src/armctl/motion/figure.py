"""A motion as a figure for a report: SVG or PNG, with axes, units, legend and limits.

matplotlib is imported when a figure is drawn, not before, and only its object-oriented interface is used:
pyplot keeps state that threads would share.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.motion.analysis import Derivative, Limit, MotionAnalysis, near_limits
from armctl.robot import Robot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# pyright: reportUnknownMemberType=false
# matplotlib's own types leave the keywords of nearly every call open.


FigureForm = Literal["svg", "png"]
COLORS = ("#1971c2", "#e8590c", "#2f9e44", "#9c36b5", "#f08c00", "#0c8599", "#5c940d", "#495057")
"""of joints and coordinates, in their order, here and on screens"""
_SIZE_IN = (11.7, 12.0)
_DPI = 150
_CAPTION = (
    "dashed: joint limits that the motion comes near to; "
    "where an acceleration jumps, the jerk has no bound and is not drawn"
)


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """One quantity of joints and tool."""

    name: str
    per: str
    joints: FloatArray
    tool: FloatArray
    limits: Sequence[Limit]


@dataclass(frozen=True, slots=True, eq=False)
class TitledMotion:
    """A motion and what it is."""

    title: str
    motion: MotionAnalysis

    @property
    def heading(self) -> str:
        """With its duration."""
        return _plain(f"{self.title}, {self.motion.time[-1]:.3f} s")


def motion_figure(robot: Robot, shown: TitledMotion, beside: TitledMotion | None = None) -> Figure:
    """Position, velocity, acceleration and jerk of tool and joints over time; ``beside`` is dotted."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    heading = f"{_plain(robot.title)}: {shown.heading}"
    if beside is not None:
        heading += f"\nA (dotted): {beside.heading}"
    figure.suptitle(heading, fontsize=13)
    motion, rows = shown.motion, _rows(robot, shown.motion)
    axes: NDArray[np.object_] = figure.subplots(len(rows), 2, sharex=True)
    joint_names = [_plain(joint.title) for joint in robot.joints]
    for k, row in enumerate(rows):
        _draw(axes[k, 0], motion.time, row.tool, ("x", "y", "z"), f"tool {row.name} (mm{row.per})", ())
        _draw(axes[k, 1], motion.time, row.joints, joint_names, f"joint {row.name} (°{row.per})", row.limits)
    if beside is not None:
        for k, row in enumerate(_rows(robot, beside.motion)):
            _draw_beside(axes[k, 0], beside.motion.time, row.tool)
            _draw_beside(axes[k, 1], beside.motion.time, row.joints)
    for axis in axes[-1]:
        axis.set_xlabel("time (s)")
    for axis, many in zip(axes[0], (3, min(robot.n, 3)), strict=True):
        axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=many, frameon=False, fontsize=9)
    figure.align_ylabels()
    figure.supxlabel(_CAPTION, fontsize=9, color="#495057")
    return figure


def figure_bytes(
    robot: Robot, form: FigureForm, shown: TitledMotion, beside: TitledMotion | None = None
) -> bytes:
    """The figure as a file (the texts of an SVG stay texts); takes about a second, so use a worker thread."""
    import matplotlib

    matplotlib.rcParams["svg.fonttype"] = "none"  # always the same, so that threads cannot disagree
    with io.BytesIO() as file:
        motion_figure(robot, shown, beside).savefig(file, format=form, dpi=_DPI)
        return file.getvalue()


def _plain(text: str) -> str:
    """A text without mathematics: matplotlib would set what stands between two dollar signs as a formula."""
    return text.replace("$", r"\$")


def _rows(robot: Robot, motion: MotionAnalysis) -> list[_Row]:
    quantities: tuple[tuple[Derivative, str, FloatArray, FloatArray], ...] = (
        ("position", "", motion.q, motion.position),
        ("velocity", "/s", motion.velocity, motion.tool_velocity),
        ("acceleration", "/s²", motion.acceleration, motion.tool_acceleration),
        ("jerk", "/s³", motion.jerk, motion.tool_jerk),
    )
    return [
        _Row(name, per, np.degrees(joints), 1000 * tool, near_limits(robot, motion, name))
        for name, per, joints, tool in quantities
    ]


def _draw(
    axis: Axes,
    time: FloatArray,
    values: FloatArray,
    names: Sequence[str],
    label: str,
    limits: Sequence[Limit],
) -> None:
    for i, name in enumerate(names):
        axis.plot(time, values[:, i], color=COLORS[i % len(COLORS)], linewidth=1.3, label=name)
    for limit in limits:
        axis.axhline(limit.value, color=COLORS[limit.joint % len(COLORS)], linestyle="--", linewidth=0.9)
    axis.set_ylabel(label)
    axis.grid(visible=True, color="#dee2e6", linewidth=0.6)
    axis.margins(x=0.0)


def _draw_beside(axis: Axes, time: FloatArray, values: FloatArray) -> None:
    for i in range(values.shape[1]):
        axis.plot(time, values[:, i], color=COLORS[i % len(COLORS)], linewidth=1.0, linestyle=":")
