"""The study "joint by joint" of the Trajectory tab: how fast each joint alone moves the tip."""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics.workspace import longest_levers
from armctl.motion.joint_study import JointStudy, Turning, study_csv, study_joints
from armctl.robot import Robot
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, fixed, heading, muted, strong, table
from armctl.ui.widgets.number_field import NumberField
from armctl.ui.widgets.plots import COLORS, Line, LinePlot, Picture

_TURNING: dict[str, Turning] = {"each joint alone": "in turn", "all joints at once": "all at once"}
_PRESENT = "present pose"
_SLOWEST_DEG_S, _FASTEST_DEG_S = 1.0, 360.0
_PAPER_DEG_S = 20.0
_ALONE_HINT = (
    "Alone: each joint turns from the start pose while the others stand still. "
    "At once: they turn together, and the figures are what each contributes."
)
_SPEED_HINT = f"Of every joint, {_SLOWEST_DEG_S:g} … {_FASTEST_DEG_S:g} °/s. The paper takes 20."
_DURATION_HINT = "Seconds. 0 or empty: until every joint has come to its limit."
_NOTHING = "Nothing is shown yet: press Show. A study moves nothing."
_TOTAL_COLOR = "#212529"
_PAPER_SPEED = math.radians(_PAPER_DEG_S)
_PRINTED_M_S = {"abaas": 8.32}
"""tip speeds that a paper prints at 20 °/s and that cannot be [m/s]"""


@dataclass(frozen=True, slots=True, eq=False)
class StudyRequest:
    """The study that the fields ask for."""

    turning: Turning
    start: FloatArray
    """(n,) [rad]"""
    start_name: str
    speed: float
    """[rad/s]"""
    duration_s: float | None
    """None: until every joint has come to its limit"""


@dataclass(frozen=True, slots=True, eq=False)
class ShownStudy:
    """A study, and how far the tip can come from each joint's axis (n,) [m]."""

    request: StudyRequest
    study: JointStudy
    levers: FloatArray


class StudyForm:
    """The fields of a study; hidden while a motion is chosen."""

    def __init__(self, session: Session) -> None:
        """Add the fields to the present container."""
        self._session = session
        gui, poses = session.gui, session.console.robot.poses
        self._turning = gui.add_dropdown("Turn", tuple(_TURNING), hint=_ALONE_HINT, visible=False)
        starts = (*poses, _PRESENT)
        self._from = gui.add_dropdown("Start at", starts, initial_value=starts[0], visible=False)
        self._speed = NumberField(gui, "Joint speed °/s", _PAPER_DEG_S, hint=_SPEED_HINT, visible=False)
        self.duration = NumberField(gui, "For s", 0.0, hint=_DURATION_HINT, visible=False)
        self.fields = (self._speed, self.duration)

    @property
    def settings(self) -> tuple[object, ...]:
        """All settings of the study, but for where the arm stands."""
        return self._turning.value, self._from.value, self._speed.text, self.duration.text

    def show(self, visible: bool) -> None:
        """Show or hide the fields."""
        for field in (self._turning, self._from, *self.fields):
            field.visible = visible

    def request(self) -> StudyRequest:
        """The study that the fields ask for.

        Raises:
            InputError: a number that cannot be used.
        """
        speed = self._speed.value
        if not _SLOWEST_DEG_S <= speed <= _FASTEST_DEG_S:
            raise InputError(
                f"Joint speed: {speed:g} °/s is outside {_SLOWEST_DEG_S:g} … {_FASTEST_DEG_S:g} °/s"
            )
        seconds = 0.0 if self.duration.is_empty else self.duration.value
        if seconds < 0:
            raise InputError(f"For: {seconds:g} s is negative; 0 is until every joint is at its limit")
        name = self._from.value
        robot, here = self._session.console.robot, self._session.snapshot.q_command
        start = here if name == _PRESENT else robot.pose(name)
        return StudyRequest(_TURNING[self._turning.value], start, name, math.radians(speed), seconds or None)


class StudyView:
    """Plot, figures and export of one page's study."""

    def __init__(self, session: Session) -> None:
        """Add the widgets to the present container."""
        self._session = session
        self._shown: ShownStudy | None = None
        gui = session.gui
        self._box = gui.add_folder(None, visible=False)
        with self._box:
            self._note = LiveHtml(gui, muted(_NOTHING))
            self._plot = LinePlot(gui)
            self._figures = LiveHtml(gui)
            export = gui.add_button("Export study (CSV)", icon=viser.Icon.DOWNLOAD, color="gray")
        session.on(export.on_click, self._on_export)

    @property
    def shown(self) -> bool:
        """Whether there is a study to look at."""
        return self._shown is not None

    def show(self, visible: bool) -> None:
        """Show or hide all of it."""
        self._box.visible = visible

    def take(self, shown: ShownStudy) -> None:
        """Show another study."""
        robot, study = self._session.console.robot, shown.study
        self._shown = shown
        alone = study.total is None
        turn = "Each joint alone turns" if alone else "All joints turn at once"
        how = f"{turn} at {_deg_s(study.speed)} from {shown.request.start_name}, towards its farther limit."
        how += (
            " A joint that turns alone carries the tip along a circle about its axis, so its line is level; "
            "it ends at the joint's limit."
            if alone
            else " A joint that has come to its limit stays there."
        )
        self._note.show(strong(fastest_words(robot, study)) + muted(how))
        self._plot.show(study_picture(robot, study))
        self._figures.show(study_html(robot, shown))

    async def _on_export(self) -> None:
        if self._shown is None:
            raise InputError("there is no study to export: press Show first")
        robot = self._session.console.robot
        text = await asyncio.to_thread(study_csv, robot, self._shown.study)
        name = f"{robot.name}-joint-by-joint.csv"
        self._session.client.send_file_download(name, text.encode(), save_immediately=True)


def make_study(robot: Robot, request: StudyRequest) -> ShownStudy:
    """Compute what is asked for; belongs into a worker thread.

    Raises:
        ArmctlError: as ``study_joints``.
    """
    study = study_joints(robot, request.start, request.turning, request.speed, request.duration_s)
    return ShownStudy(request, study, longest_levers(robot.chain, robot.limits))


def study_picture(robot: Robot, study: JointStudy) -> Picture:
    """Tip speed over time, one line a joint, in mm/s."""
    speeds = 1000 * study.tip_speed
    lines = [
        Line(robot.joints[joint].title, np.ascontiguousarray(speeds[:, i]), COLORS[joint % len(COLORS)])
        for i, joint in enumerate(study.moving)
    ]
    if study.total is not None:
        lines.append(Line("all together", 1000 * study.total, _TOTAL_COLOR))
    return Picture("Tip speed by joint (mm/s)", "time (s)", study.time, tuple(lines))


def study_html(robot: Robot, shown: ShownStudy) -> str:
    """The joints' figures, what is possible at most, and how the curves were checked."""
    study, levers = shown.study, shown.levers
    rows = [
        [
            robot.joints[joint].title,
            *(fixed(1000 * value, 1) for value in (peak, study.speed * levers[joint], levers[joint])),
        ]
        for joint, peak in zip(study.moving, study.peaks.tolist(), strict=True)
    ]
    html = table(["tip speed mm/s", "largest here", "any pose: ω·R", "R mm"], rows)
    if study.total is not None:
        html += muted(f"All joints together: at most {fixed(1000 * float(study.total.max()), 1)} mm/s.")
    if study.held:
        names = ", ".join(robot.joints[i].title for i in study.held)
        html += muted(f"Left out, because its limits hold it still: {names}.")
    slower = [robot.joints[i] for i in study.moving if study.speed > robot.joints[i].speed * (1 + 1e-9)]
    if slower:
        names = ", ".join(f"{joint.title} ({_deg_s(joint.speed)})" for joint in slower)
        html += muted(f"Faster than the real arm may turn: {names}.")
    mismatch = f"{study.mismatch:.0e}".replace("e-0", "e-").replace("-", "−")
    html += heading("At most") + muted(_at_most(robot, study, levers))
    return html + muted(
        f"J·q̇ and central differences of the forward kinematics agree within {mismatch} of the largest speed."
    )


def fastest_words(robot: Robot, study: JointStudy) -> str:
    """Which joint moves the tip fastest, and which comes next."""
    order: list[int] = np.argsort(-study.peaks).tolist()
    ranked = [(robot.joints[study.moving[i]].title, 1000 * float(study.peaks[i])) for i in order]
    (first, best), *others = ranked
    if best == 0.0:
        return "No joint moves the tip from this pose."
    text = f"{first} moves the tip fastest: {fixed(best, 1)} mm/s"
    if others:
        text += f"; next is {others[0][0]} with {fixed(others[0][1], 1)} mm/s"
    return f"{text}."


def _at_most(robot: Robot, study: JointStudy, levers: FloatArray) -> str:
    reach = float(levers.max())
    text = (
        "A joint gives the tip its speed times the tip's distance from its axis, which is "
        f"{fixed(1000 * reach, 1)} mm at most: {_deg_s(study.speed)} give "
        f"{fixed(1000 * study.speed * reach, 1)} mm/s at most."
    )
    printed = _PRINTED_M_S.get(robot.name)
    if printed is not None:
        text += (
            f" The {fixed(printed, 2)}·10³ mm/s that the paper prints at 20 °/s cannot be: that would take "
            f"an arm of {fixed(printed / _PAPER_SPEED, 1)} m; right is "
            f"{fixed(1000 * _PAPER_SPEED * reach, 0)} mm/s at most."
        )
    return text


def _deg_s(speed: float) -> str:
    return f"{round(math.degrees(speed), 3):g} °/s"
