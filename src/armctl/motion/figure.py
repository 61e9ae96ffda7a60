"""A motion as a figure for a report: SVG or PNG, with axes, units, legend and limits.

matplotlib is imported when a figure is drawn, and without pyplot, which keeps state that threads would share.
"""

from __future__ import annotations

import io
import subprocess
import sys
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.motion.analysis import Derivative, MotionAnalysis, near_limits
from armctl.robot import Robot
from armctl.robot.record import plain, robot_of, robot_record

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# pyright: reportUnknownMemberType=false
# matplotlib's own types leave the keywords of nearly every call open.

FigureForm = Literal["svg", "png"]
_COLORS = ("#1971c2", "#e8590c", "#2f9e44", "#9c36b5", "#f08c00", "#0c8599", "#5c940d", "#495057")
_AXES = {"x": "#e03131", "y": "#2f9e44", "z": "#1971c2"}
"""as the axes of a frame are drawn"""
_QUANTITIES: tuple[tuple[Derivative, str], ...] = (
    ("position", ""), ("velocity", "/s"), ("acceleration", "/s²"), ("jerk", "/s³"),
)  # fmt: skip
_SIZE_IN = (11.7, 12.0)
_DPI = 150
_CAPTION = (
    "dashed: joint limits that the motion comes near to; "
    "where an acceleration jumps, the jerk has no bound and is not drawn"
)


class TitledMotion(NamedTuple):
    """A motion and what it is."""

    title: str
    motion: MotionAnalysis


def motion_figure(robot: Robot, shown: TitledMotion, beside: TitledMotion | None = None) -> Figure:
    """Position, velocity, acceleration and jerk of tool and joints over time; ``beside`` is dotted."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    heading = f"{robot.title}: {shown.title}, {shown.motion.time[-1]:.3f} s"
    if beside is not None:
        heading += f"\nA (dotted): {beside.title}, {beside.motion.time[-1]:.3f} s"
    figure.suptitle(_plain(heading), fontsize=13)
    axes: NDArray[np.object_] = figure.subplots(len(_QUANTITIES), 2, sharex=True)
    joint_names = [_plain(joint.title) for joint in robot.joints]
    for row, (quantity, per) in zip(axes, _QUANTITIES, strict=True):
        joints, tool = shown.motion.of(quantity)
        sides = (
            (row[0], 1000 * tool, list(_AXES), f"tool {quantity} (mm{per})"),
            (row[1], robot.shown(joints), joint_names, f"joint {quantity} (°{per})"),
        )
        for axis, values, names, label in sides:
            for i, name in enumerate(names):
                color = color_of(i, name)
                axis.plot(shown.motion.time, values[:, i], color=color, linewidth=1.3, label=name)
            axis.set_ylabel(label)
            axis.grid(visible=True, color="#dee2e6", linewidth=0.6)
            axis.margins(x=0.0)
        for limit in near_limits(robot, shown.motion, quantity):
            row[1].axhline(limit.value, color=color_of(limit.joint), linestyle="--", linewidth=0.9)
        if beside is not None:
            joints, tool = beside.motion.of(quantity)
            values_of = (1000 * tool, list(_AXES)), (robot.shown(joints), joint_names)
            for axis, (values, names) in zip(row, values_of, strict=True):
                for i, (line, name) in enumerate(zip(values.T, names, strict=True)):
                    color = color_of(i, name)
                    axis.plot(beside.motion.time, line, color=color, linewidth=1.0, linestyle=":")
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
    """The figure as a file (the texts of an SVG stay texts); takes about a second: see ``figure_file``."""
    import matplotlib

    matplotlib.rcParams["svg.fonttype"] = "none"  # always the same, so that threads cannot disagree
    with io.BytesIO() as file:
        motion_figure(robot, shown, beside).savefig(file, format=form, dpi=_DPI)
        return file.getvalue()


class _FigureRequest(msgspec.Struct, array_like=True):
    """What ``figure_file`` has drawn."""

    robot: dict[str, Any]
    form: FigureForm
    motions: list[tuple[str, dict[str, Any]]]


_DRAW = "from armctl.motion.figure import main; main()"


def figure_file(
    robot: Robot, form: FigureForm, shown: TitledMotion, beside: TitledMotion | None = None
) -> bytes:
    """As ``figure_bytes``, by a process of its own: matplotlib lets no other thread run for up to 0.3 s."""
    motions = [shown] if beside is None else [shown, beside]
    work = msgspec.msgpack.encode((robot_record(robot), form, motions), enc_hook=plain)
    prepare = f"import sys; sys.path[:] = {sys.path!r}; {_DRAW}"
    # a group of its own: Ctrl-C is for the process that asks, whose end ends this one, too
    drawn = subprocess.run(
        [sys.executable, "-c", prepare], input=work, capture_output=True, process_group=0, check=False
    )
    if drawn.returncode:
        raise RuntimeError(f"the figure was not drawn: {drawn.stderr.decode(errors='replace')}")
    return drawn.stdout


def color_of(i: int, name: str = "") -> str:
    """The colour of the i-th joint or branch, here and on screens; of a coordinate by its ``name``."""
    return _AXES.get(name.lower(), _COLORS[i % len(_COLORS)])


def main() -> None:
    """Draw what standard input says, for ``figure_file``."""
    asked = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=_FigureRequest)
    motions = [
        TitledMotion(title, MotionAnalysis(**{name: _array(rows) for name, rows in motion.items()}))
        for title, motion in asked.motions
    ]
    sys.stdout.buffer.write(figure_bytes(robot_of(asked.robot), asked.form, *motions))


def _array(rows: object) -> FloatArray:
    return np.array(rows, dtype=np.float64)


def _plain(text: str) -> str:
    """A text without mathematics: matplotlib would set what stands between two dollar signs as a formula."""
    return text.replace("$", r"\$")
