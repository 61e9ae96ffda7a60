"""The motions that the Trajectory screen can show: what is asked for, and what comes of it."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.kinematics import Target
from armctl.motion import Finding, PitchMode, Profile, Trajectory, arc, line
from armctl.motion.analysis import MotionAnalysis
from armctl.motion.error_report import IdealPath
from armctl.motion.plan import Passing
from armctl.motion.trajectory import Peaks
from armctl.program import Program, ProgramFinding
from armctl.robot import Robot
from armctl.ui.widgets.html import LiveHtml, fixed, muted, table

if TYPE_CHECKING:
    from collections.abc import Callable

    from armctl.ui.session import Session


FloatArray = NDArray[np.float64]
JOINTS = "Joint motion"
TOOL_LINE = "Tool line"
TOOL_ARC = "Tool arc"
ARC = "Arc (58 points)"
LINE = "Line (29 points)"
PROGRAM = "Program on the desk"
JOINT_BY_JOINT = "Joint by joint (study)"
MOTIONS = (JOINTS, TOOL_LINE, TOOL_ARC, ARC, LINE, PROGRAM, JOINT_BY_JOINT)
"""in the order in which they are offered"""
TOOL_PATHS = (TOOL_LINE, TOOL_ARC)
TEST_PATHS = {ARC: arc, LINE: line}
"""the paper's test paths, by their labels"""
_COARSE_STEP = 0.02
"""[rad] of a swept joint, where it only matters whether there is a solution"""


@dataclass(frozen=True, slots=True, eq=False)
class ToolWish:
    """How the tool shall be led along a line or an arc."""

    end: FloatArray
    """(3,) [m]"""
    via: FloatArray | None = None
    """(3,) a point of the arc [m]; None: a line"""
    pitch: PitchMode = "kept"
    end_pitch: float | None = None
    """[rad]"""
    speed: float | None = None
    """largest speed of the tool [m/s]; None: as fast as the joints can"""


@dataclass(frozen=True, slots=True, eq=False)
class PointWish:
    """How the points of a test path shall be passed."""

    passing: Passing | None = "stop"
    """None: the tool is led along the curve itself, from the first point"""
    blend_m: float = 0.002


@dataclass(frozen=True, slots=True, eq=False)
class MotionRequest:
    """What the screen asks for."""

    motion: str
    title: str
    start: FloatArray | Target
    """(n,) where it begins [rad], or where the tool is then"""
    profile: Profile = "cubic"
    duration_s: float | None = None
    choose: str = "least-rotation"
    end: FloatArray | Target | None = None
    """of a joint motion: as ``start``"""
    tool: ToolWish | None = None
    points: PointWish = PointWish()
    program: Program | None = None
    present: FloatArray | None = None
    """(n,) where the arm stands [rad], for the choice of a start by least travel"""
    opening: float | None = None
    """of the gripper when a program begins, 0..1; None: not known"""


@dataclass(frozen=True, slots=True, eq=False)
class PlannedMotion:
    """A motion that can be drawn, and what its pre-flight says."""

    title: str
    trajectory: Trajectory
    findings: tuple[Finding | ProgramFinding, ...] = ()
    ideal: IdealPath | None = None
    """what the tool shall follow; None: nothing is prescribed between its ends"""
    points: FloatArray | None = None
    """(k, 3) points that it goes through [m]; None: none are prescribed"""
    solved: FloatArray | None = None
    """(k, n) joint angles in those points [rad]"""
    program: Program | None = None
    """run this instead of the trajectory: it has waits and gripper steps"""
    steps: tuple[tuple[float, int], ...] = ()
    """of a program: when the motion of which step begins [s]"""
    speed: float | None = None
    """largest speed of the tool that was asked for [m/s]"""
    note: str = ""

    @property
    def refusal(self) -> Finding | ProgramFinding | None:
        """The first error of its pre-flight; None: it may be run."""
        return next((finding for finding in self.findings if finding.severity == "error"), None)

    def step_at(self, time: float) -> int | None:
        """Index of the program step that moves at a time [s]; None: it is no program."""
        at = bisect_right(self.steps, time, key=lambda step: step[0]) - 1
        return self.steps[at][1] if at >= 0 else None


@dataclass(frozen=True, slots=True, eq=False)
class ShownMotion:
    """A motion as it is drawn."""

    planned: PlannedMotion
    motion: MotionAnalysis
    peaks: Peaks


def why_not(robot: Robot, points: FloatArray) -> str | None:
    """Why a path cannot be followed: its first point (of (k, 3) [m]) that is out of reach; None: it can."""
    for number, point in enumerate(points, 1):
        solutions = robot.inverse(point, step=_COARSE_STEP)
        if not solutions.success:
            return f"point {number} of {len(points)}: {solutions.reason}"
    return None


# Two motions side by side: A is kept, B is what is shown now.

_HOW = "Keep the shown motion as A, then show another: A is drawn thin and dashed beside it."


class CompareView:
    """Keeps a motion, and sets its figures against those of the one that is shown."""

    def __init__(self, session: Session, changed: Callable[[], None]) -> None:
        """Add the widgets to the present container; ``changed()`` is told when A is another."""
        self._robot, self._changed = session.console.robot, changed
        self._a: ShownMotion | None = None
        self._shown: ShownMotion | None = None
        gui = session.gui
        self._text = LiveHtml(gui, muted(_HOW))
        self._keep = gui.add_button("Keep as A", icon=viser.Icon.PIN, color="gray")
        self._drop = gui.add_button("Drop A", icon=viser.Icon.PINNED_OFF, color="gray", visible=False)
        session.on(self._keep.on_click, self._on_keep)
        session.on(self._drop.on_click, self._on_drop)

    @property
    def beside(self) -> ShownMotion | None:
        """A, where it is another motion than the one that is shown."""
        return None if self._a is self._shown else self._a

    def take(self, shown: ShownMotion) -> None:
        """Another motion is shown: it is B from now on."""
        self._shown = shown
        self._draw()

    async def _on_keep(self) -> None:
        if self._shown is None:
            raise InputError("there is no motion to keep: press Show first")
        self._a = self._shown
        self._draw()
        self._changed()

    async def _on_drop(self) -> None:
        self._a = None
        self._draw()
        self._changed()

    def _draw(self) -> None:
        if self._drop.visible != (self._a is not None):
            self._drop.visible = self._a is not None
        if self._a is None or self._shown is None:
            self._text.show(muted(_HOW))
        elif self.beside is None:
            self._text.show(muted(f"A is {self._a.planned.title}. Choose another motion and press Show."))
        else:
            self._text.show(compare_html(self._robot, self._a, self._shown))


def compare_html(robot: Robot, a: ShownMotion, b: ShownMotion) -> str:
    """Durations, peaks of the joints as a share of their limits, and the largest tool speeds of both."""
    rows = [
        ["duration s", *(fixed(shown.planned.trajectory.duration, 3) for shown in (a, b))],
        ["tool, largest mm/s", *(fixed(1000 * float(shown.motion.tool_speed.max()), 1) for shown in (a, b))],
    ]
    speeds = [100 * shown.peaks.speed / robot.speed_limits for shown in (a, b)]
    pushes = [100 * shown.peaks.acceleration / robot.acceleration_limits for shown in (a, b)]
    jerks = [100 * np.abs(shown.motion.jerk).max(axis=0) / robot.jerk_limits for shown in (a, b)]
    shares = [
        [
            joint.title,
            *(fixed(float(of[i]), 0) for both in (speeds, pushes, jerks) for of in both),
        ]
        for i, joint in enumerate(robot.joints)
    ]
    head = ["% of limit", "speed A", "B", "acc. A", "B", "jerk A", "B"]
    return (
        muted(f"A (dashed): {a.planned.title}")
        + muted(f"B: {b.planned.title}")
        + table(["", "A", "B"], rows)
        + table(head, shares)
        + muted("Only quintic and s-curve keep the jerk limits; trapezoid and cubic jump in acceleration.")
    )
